"""Charts: curves and maps have the values of the results."""

from __future__ import annotations

import json

import numpy as np
import pytest

from pvdf_fem import Scene
from pvdf_fem.batch import batch
from pvdf_fem.batch.store import Record
from pvdf_fem.studies.design import design, find_best_design
from pvdf_fem.studies.sweep import sweep
from pvdf_fem.view.charts import sweep as sweep_charts
from pvdf_fem.view.charts.design import draw_designs
from pvdf_fem.view.charts.sweep import draw_sweep
from pvdf_fem.view.charts.vibration import draw_frequency_response
from tests.helpers.bump_response import make_bump_response
from tests.helpers.sweep_cases import BASE, made_up


def swept(monkeypatch: pytest.MonkeyPatch, *axes: dict) -> object:
    """A sweep with made-up charges; none where a force of 2 N presses at 0 mm."""

    def solved(scenes, frames):
        failed = [s.load.force_N == 2.0 and s.probe.x_mm == 0.0 for s in scenes]
        records = zip(made_up(scenes, frames), failed, strict=True)
        return [Record("unstable", "", tuple("ABCD")) if no else r for r, no in records]

    monkeypatch.setattr(batch, "make_records", solved)
    return sweep(BASE, axes, processes=1)


def test_a_sweep_of_one_axis_is_drawn_as_curves_with_failures_marked(monkeypatch):
    data = swept(monkeypatch, {"load.force_N": [2.0, 0.5, 8.0, 1.0, 4.0]}, {"probe.x_mm": [0.0]})
    [ax] = draw_sweep(data).axes
    sorted_data = data.squeeze("x_mm").sortby("force_N")
    for bars, name in zip(ax.containers, "ABCD", strict=True):
        np.testing.assert_array_equal(bars[0].get_xdata(), [0.5, 1.0, 2.0, 4.0, 8.0])
        charges = sorted_data.charge_pC.sel(electrode=name)
        np.testing.assert_array_equal(bars[0].get_ydata(), charges)
    [mark] = [line for line in ax.lines if "unstable" in str(line.get_label())]
    assert mark.get_xdata() == [2.0]
    assert [text.get_text() for text in ax.figure.legends[1].get_texts()] == [mark.get_label()]
    assert (ax.get_xlabel(), ax.get_xscale()) == ("load force (N)", "log")


def test_a_sweep_of_two_axes_is_drawn_as_a_map_for_each_electrode(monkeypatch):
    monkeypatch.setattr(sweep_charts, "MAX_CURVES", 2)
    data = swept(monkeypatch, {"load.force_N": [1.0, 2.0, 3.0]}, {"probe.x_mm": [0.0, 3.0, 5.0]})
    figure = draw_sweep(data)
    for ax, name in zip(figure.axes[:4], "ABCD", strict=True):
        drawn = np.ma.filled(ax.collections[0].get_array(), np.nan)
        np.testing.assert_array_equal(drawn, data.charge_pC.sel(electrode=name))
        corners = ax.collections[0].get_coordinates()
        assert corners[0, 0].tolist() == [0.0, 1.0]  # nothing is drawn beyond the first and last
        assert corners[-1, -1].tolist() == [5.0, 3.0]
        assert ax.lines[0].get_xydata().tolist() == [[0.0, 2.0]]
        assert (ax.get_xscale(), ax.get_yscale()) == ("linear", "linear")
    assert len({ax.collections[0].colorbar for ax in figure.axes[:4]}) == 4  # a scale for each


def test_a_short_axis_is_drawn_as_a_family_of_curves(monkeypatch):
    forces = {"load.force_N": [1.0, 3.0, 9.0]}
    probes = {"probe": [{"shape": "circle"}, {"shape": "rectangle", "x_mm": 3.0}], "name": "tip"}
    for axes in ([forces, probes], [probes, forces]):
        data = swept(monkeypatch, *axes)
        figure = draw_sweep(data)
        for ax, name in zip(figure.axes, "ABCD", strict=True):
            for i, bars in enumerate(ax.containers):
                charges = data.charge_pC.sel(electrode=name).isel(tip=i)
                np.testing.assert_array_equal(bars[0].get_ydata(), charges)
        assert [json.loads(label) for label in data.tip.values] == probes["probe"]  # in full


def test_phases_are_unwrapped_with_ticks_at_multiples_of_45_degrees():
    turns = np.linspace(0.0, -3.0 * np.pi, 60)
    scene = Scene().with_(**{"film.loss_tangent": 0.05, "air": {"baffle": True}})
    charges = {"A": np.exp(1j * turns), "B": 2.0 * np.exp(0.5j * turns)}
    frequencies_Hz = np.geomspace(1.0, 100.0, 60)
    _, phase = draw_frequency_response(frequencies_Hz, charges, np.array([50.0]), scene).axes
    np.testing.assert_allclose(phase.lines[0].get_ydata(), np.degrees(turns), atol=1e-9)
    np.testing.assert_array_equal(np.diff(phase.get_yticks()), 180.0)
    free = draw_frequency_response(np.array([1.0, 9.0]), {"A": np.ones(2)}, np.empty(0), Scene())
    assert len(free.axes) == 1  # without damping there are no phases


def test_designs_are_drawn_as_curves_and_a_map_of_the_best():
    vary = {"electrodes.ring_radius_mm": [6, 8, 9.5], "load.force_N": [0.5, 1]}
    model, ring = (
        make_bump_response("circle"),
        {"layout": "ring", "shape": "circle", "radius_mm": 1.0},
    )
    sensor, counts = model.scene.with_(electrodes=ring), {"electrodes.count": [4, 6]}
    data = design(sensor, {**counts, **vary}, step_mm=4.0, response=model.for_scene)
    chosen = find_best_design(data)
    curves, film, _ = draw_designs(data, chosen).axes
    medians = data.place_deviation_median_mm.sel(force_N=chosen.force_N.item())
    for line, count in zip(curves.lines, (4, 6), strict=True):
        np.testing.assert_array_equal(line.get_ydata(), medians.sel(count=count))
    drawn = np.ma.filled(film.collections[0].get_array(), np.nan)
    np.testing.assert_array_equal(drawn, chosen.place_deviation_mm)

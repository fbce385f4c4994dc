"""The report of extreme scenes: reproducible draws, rows for whatever happens, laws to rounding."""

from __future__ import annotations

import time

import numpy as np
import pytest

from pvdf_fem import Scene
from reports.robustness import runs as extremes_runs
from reports.robustness.laws import charge_power, cube_root, linear, rounding, similarity
from reports.robustness.runs import row_of
from reports.robustness.scenes import FORCE_N, MODULUS_GPA, RADIUS_MM, THICKNESS_UM, scenes


def test_scenes_are_drawn_again_and_fill_their_ranges():
    drawn = scenes(300)
    assert scenes(20) == drawn[:20]
    for values, (low, high) in (
        ([s.film.thickness_um for s in drawn], THICKNESS_UM),
        ([s.film.radius_mm for s in drawn], RADIUS_MM),
        ([s.load.force_N for s in drawn], FORCE_N),
        ([np.min(s.film.youngs_modulus_GPa) for s in drawn], MODULUS_GPA),
    ):
        assert low <= min(values) < low * (high / low) ** 0.05
        assert high * (low / high) ** 0.05 < max(values) <= high
    heated = [s.film.temperature_change_K > 0 for s in drawn]
    assert heated == [s.film.compression == "tension-field" for s in drawn]


def test_awkward_places_are_met():
    drawn = scenes(300)
    gaps, hairs = [], []
    for scene in drawn:
        assert scene.probe is not None
        probe, radius = scene.probe.outline, scene.film.radius
        gaps.append(1e3 * (radius - probe.reach))
        vertices = getattr(probe, "vertices", None)
        turned = scene.electrode_list[0].rotation_deg
        if vertices is not None and turned % 90.0 != 0.0:
            normal = np.array([-np.sin(np.radians(turned)), np.cos(np.radians(turned))])
            edges = scene.electrode_list[0].outline.vertices @ normal
            hairs.append(1e3 * np.abs(edges[:, None] - vertices @ normal).min())
    gaps = np.array(gaps)
    assert gaps.min() > -1e-6
    assert 0.1 < (np.abs(gaps) < 1e-6).mean() < 0.25  # probes as large as the film
    assert ((gaps > 5e-4) & (gaps < 0.02)).any()
    assert len(hairs) > 10
    assert max(hairs) < 2e-9


def test_an_exception_is_a_row(monkeypatch):
    def fail(_):
        raise ZeroDivisionError("of all things")

    monkeypatch.setattr(extremes_runs, "solve", fail)
    row = row_of(Scene())
    assert row.status == "crashed"
    assert "of all things" in row.reason


def test_a_solve_that_takes_too_long_is_ended():
    scene = Scene.parse('[probe]\nshape = "rectangle"\n[numerics]\ntolerance = 1e-7')
    start = time.perf_counter()
    [row] = extremes_runs.rows([scene], time_limit=0.05)
    assert row.status == "hung"
    assert time.perf_counter() - start < 60.0


def test_processes_give_rows_in_order_and_replace_one_that_is_ended():
    slow = Scene.parse(
        '[probe]\nshape = "rectangle"\n[film]\nbending = true\n[numerics]\ntolerance = 1e-7'
    )
    quick = [Scene(), Scene().with_(**{"load.force_N": 2.0})]
    told = []
    found = extremes_runs.rows(
        [slow, quick[0], slow, quick[1]], lambda number, _: told.append(number), 1.0, processes=2
    )
    assert [row.status for row in found] == ["hung", "converged"] * 2
    assert [row.charges_pC for row in found[1::2]] == [row_of(one).charges_pC for one in quick]
    assert told[0] == 1
    assert sorted(told) == [0, 1, 2, 3]


@pytest.mark.parametrize("law", [cube_root, charge_power, linear, similarity, rounding])
def test_laws_hold_to_rounding(law):
    _, found, wanted = law()
    assert found == pytest.approx(wanted, rel=3e-8)

"""The report on locating touches, with made-up charges in place of solves."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from pvdf_fem import Scene
from pvdf_fem.batch.store import Record
from pvdf_fem.problem.problem import Problem
from pvdf_fem.solver.adaptive import compute_unloaded_charges
from reports.__main__ import load_report
from reports.locating import signals, touches
from reports.locating.signals import Taps
from reports.locating.touches import LAYOUTS, NOISE
from tests.helpers.bump_response import PROBE_POINTS_MM, BumpResponse
from tests.helpers.streams import MembraneCharges

DISC = {"shape": "circle", "radius_mm": 4.0}


def make_response(scene, kind=BumpResponse):
    """Make a made-up response for a scene."""
    points = PROBE_POINTS_MM[scene.single_probe.shape]
    return kind(scene, points, np.empty(0), ()).for_scene(scene)


def compute_charges(scene, kind=BumpResponse):
    probe = scene.single_probe
    response = make_response(scene, kind)
    touch = [[probe.x_mm, probe.y_mm, probe.rotation_deg, scene.load.force_N]]
    return response.evaluate(np.array(touch, dtype=float))[0][0]


def make_record(scene):
    """Make a record with made-up charges; without any where the probe is far to the left."""
    names = tuple(e.name for e in scene.electrode_list)
    if scene.single_probe.x_mm < -9.0:
        return Record("not_converged", "made up", names)
    forces = [[charge / scene.film.d31_pC_N, 0.0] for charge in compute_charges(scene).tolist()]
    return Record("converged", "", names, {"material": forces})


@pytest.fixture
def made_up(monkeypatch):
    def built(scene, *args, **how):
        return make_response(scene)

    monkeypatch.setattr(touches, "build_response", built)
    monkeypatch.setattr(touches, "solve_scenes", lambda scenes, **how: [*map(make_record, scenes)])
    for name, value in {"BATCH": 50, "ONCE": 2, "DRAWS": 20}.items():
        monkeypatch.setattr(touches, name, value)


def test_touches_are_located_within_their_deviations(made_up):
    """Only touches with a known rotation are compared."""
    inputs, needed = load_report("locating").plan.collect_requirements(quick=True)
    need = next(need for need in needed if need.item.name == "triangle")
    rows = pd.DataFrame(replace(need.tasks[0], touches=20, reach_mm=12.0, pitch_mm=6.0).run())
    found, places = rows[rows.sort == "touch"], rows[rows.sort == "place"]
    assert set(rows.electrodes) == set(LAYOUTS)
    assert found.x_mm.min() > -9.0  # without charges there is no touch to find
    exact = found[(found.noise == 0.0) & (found.electrodes != "three")]
    assert np.hypot(exact.x_mm_error, exact.y_mm_error).max() < 1e-2
    assert exact.force_N_error.abs().max() < 2e-3
    turned = found.turned.astype(bool)
    assert set(found[turned].electrodes) == {"four", "eight"}
    noisy = found[(found.noise == NOISE) & (found.electrodes == "eight") & ~turned]
    assert 0.0 < (noisy.force_N_error / noisy.force_N_deviation).abs().max() < 4.0
    assert (places.error_mm > 0.0).all()
    medians = places.groupby("electrodes").error_mm.median()
    assert medians["eight"] < medians["four"] < medians["three"]
    numbers = need.item.kind.draw(inputs, [rows]).numbers
    assert numbers["fits"] > 75.0  # there is no chi-square where the rotation is sought
    assert numbers["exact"] > 90.0
    assert 45.0 < numbers["within"]["four"] < 90.0


def test_a_tap_is_tracked_through_its_circuit(monkeypatch):
    def solved(scene):
        changes = compute_charges(scene, MembraneCharges) - 1e12 * compute_unloaded_charges(
            Problem.from_scene(scene)
        )
        names = [electrode.name for electrode in scene.electrode_list]
        return SimpleNamespace(charge_changes_pC=dict(zip(names, changes.tolist(), strict=True)))

    monkeypatch.setattr(signals, "solve", solved)
    monkeypatch.setattr(
        signals, "build_response", lambda scene, *args, **how: make_response(scene, MembraneCharges)
    )
    tap, *samples = Taps(Scene().with_(probe=DISC), 1, 6.0, (0.5, 1.0), 1e-5).run()
    assert tap["touches"] == 1
    place = tap["true_x_mm"], tap["true_y_mm"]
    assert (tap["x_mm"], tap["y_mm"]) == pytest.approx(place, abs=0.5)
    assert tap["force_N"] == pytest.approx(tap["true_N"], rel=0.05)
    assert max(row["true_N"] for row in samples) == pytest.approx(tap["true_N"], rel=1e-3)

"""The report on accuracy: what is known of its cases, its tables, and solves of a few cases."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from pvdf_fem import Scene
from pvdf_fem.batch.batch import solve_scenes
from pvdf_fem.report.kind import Inputs
from pvdf_fem.report.registry import load_kinds
from pvdf_fem.report.results import ReportResults
from pvdf_fem.report.task import compute_key
from reports.__main__ import get_kinds_path
from reports.accuracy import results
from reports.accuracy.cases import RoundFilm, read_cases
from reports.accuracy.drawn import KINDS
from reports.accuracy.measure import SweepTimes, TimedSolve

CASES = {case.name: case for case in read_cases("cases.toml")}
INPUTS = Inputs(Scene(), {}, quick=True)
COARSE = {"numerics.tolerance": 1e-2}


def made(kind, **keys):
    """What a kind composes of tasks that were run, and of scenes that were solved."""
    item = load_kinds(get_kinds_path("accuracy"))[kind](kind=kind, **keys)
    rows = {compute_key(task): task.run() for task in item.list_tasks(INPUTS)}
    scenes = item.list_scenes(INPUTS)
    records = dict(zip(scenes, solve_scenes(scenes, processes=1), strict=True))
    return item.compose(INPUTS, ReportResults({**records, **rows}))


def test_a_charge_is_the_integral_of_the_tension_over_its_electrode():
    """Of 1 + (r/a)^2, over a disc and over a square off the centre: exact in a Gauss rule."""
    film = RoundFilm(CASES["disc of 5 mm"].scene)
    a, h, d = film.scene.film.radius, film.scene.film.thickness, film.scene.film.d31
    disc = np.pi * 6e-3**2 * (1.0 + 6e-3**2 / (2.0 * a**2))
    square = 3e-3**2 * (1.0 + (10e-3**2 + 3e-3**2 / 6.0) / a**2)
    charges = film.charges(lambda r: 1.0 + (r / a) ** 2)
    assert charges == pytest.approx({"A": 1e12 * d / h * disc, "B": 1e12 * d / h * square})


def test_errors_are_relative_and_resolved_only_above_the_doubt():
    rows = {"case": ["x", "x"], "known_pC": [-200.0, 100.0], "doubt_pC": [0.1, 0.6]}
    rows |= {"charge_pC": [-201.0, 101.0], "stated_pC": [0.5, 2.0]}
    frame = results.add_errors(pd.DataFrame(rows))
    assert frame.true.tolist() == pytest.approx([0.005, 0.01])
    assert frame.stated.tolist() == pytest.approx([0.0025, 0.02])
    assert frame.telling.tolist() == [True, False]
    assert results.select_worst(frame.assign(code="c")).charge_pC.tolist() == [101.0]


def test_true_errors_by_tolerance_and_a_failed_solve():
    content = made("error-vs-time", only=["disc of 5 mm", "rectangle"])
    assert content.frame.true.max() < 1e-3
    assert content.table["within it"].tolist() == ["2 of 2", "2 of 2"]
    assert content.claim
    (row,) = TimedSolve(
        Scene().with_(**{"probe.shape": "circle", "numerics.max_unknowns": 100})
    ).run()
    assert (row["status"], "charge_pC" in row) == ("tolerance_not_reached", False)


def test_stated_errors_are_counted_by_group():
    content = made("stated-errors", only=["disc of 5 mm"])
    told = content.frame[content.frame.telling]
    assert set(content.frame.group) == {"cases", *list(KINDS)[:2]}
    assert content.table.scenes.tolist() == [*told.group.unique(), "all"]
    ratio = told.stated / told.true
    good = 100.0 * ((ratio >= 0.3) & (ratio < 3.0)).mean()
    assert content.table["0.3 to 3"].tolist()[-1] == f"{good:.0f} %"
    assert int(content.table.charges.tolist()[-1]) == len(told) > 3


def test_a_sweep_has_fewer_solves_than_scenes():
    (row,) = SweepTimes(Scene().with_(**{"probe.shape": "triangle", **COARSE}), 2, alone=1).run()
    assert (row["scenes"], row["solves"], row["failed"]) == (50, 5, 0)

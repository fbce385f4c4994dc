"""The thesis's statements under a sphere: few solves, and functions with known answers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from reports.chapters import spheres
from reports.common.page import Table
from reports.common.results import Results
from reports.common.thesis_data import Thesis
from tests.helpers.sensing_cases import Peak

PEAKS = {"A": Peak(10.0, 0.0), "B": Peak(0.0, 10.0), "C": Peak(-10.0, 0.0)}


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Results:
    solved = Results(tmp_path_factory.mktemp("results"), 1)
    solved.solve(spheres._scenes(Thesis.read().quick()))
    return solved


def test_a_quick_report_says_what_a_sphere_does_to_orientation(
    results: Results, tmp_path: Path
) -> None:
    content = spheres._compose(Thesis.read().quick(), results, tmp_path)
    (table,) = content.blocks
    assert isinstance(table, Table)
    (row,) = table.rows
    assert row[-1] == "does not hold"
    assert "0.5" in str(row[3])


def test_a_centred_sphere_has_equal_charges_and_one_beside_it_favours_a(results: Results) -> None:
    evidence = spheres.Evidence(Thesis.read(), results)
    centred = evidence.charges(spheres.CENTRE_MM, 1.0, "4")
    beside = evidence.charges(spheres.BESIDE_MM, 1.0, "4")
    assert list(centred.values()) == pytest.approx([centred["A"]] * 4, rel=1e-3)
    assert beside["A"] > centred["A"] > beside["C"]
    assert beside["B"] == pytest.approx(beside["D"], rel=1e-3)


def test_places_at_one_distance_share_a_solve(results: Results) -> None:
    scenes = spheres.sphere_places(1.0).scenes
    assert len(scenes) == 37
    assert results.missing(scenes) == 7


def test_meeting_finds_the_place_whose_charges_are_given() -> None:
    place = (2.0, -3.0)
    charges = {name: peak.charge(place) for name, peak in PEAKS.items()}
    assert spheres.meeting(PEAKS, charges, place).error_mm < 1e-4
    off = spheres.meeting(PEAKS, charges, (2.0, -2.0)).error_mm
    assert off == pytest.approx(1.0, abs=1e-4)


def test_falls_and_deviations_are_those_of_gaussian_peaks() -> None:
    """The slope of ln Q is r/100 per mm, along the line from the peak."""
    peak = Peak(0.0, -10.0)
    fall = spheres.falls_percent_mm(peak, np.array([0.0, -10.0]), (90.0, 60.0))
    assert fall == pytest.approx(4.0)
    pair = {name: PEAKS[name] for name in "AB"}
    deviation = spheres.deviation_mm(pair, np.zeros((1, 2)))
    assert deviation == pytest.approx(spheres.NOISE * np.sqrt(2.0) / 0.1)

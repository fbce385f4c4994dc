"""Chapters of the thesis report on contours and positions: nothing of the thesis's is left out."""

from dataclasses import replace

import numpy as np
import pytest

from reports.chapters import calibration as thesis_calibration
from reports.chapters.calibration import (
    Setting,
    TurnedMap,
    calibration,
    calibration_scenes,
    charge_functions,
    lines_deg,
    mapping,
    turned_from,
)
from reports.chapters.contours import FIGURE_3_9_CHAPTER, radius
from reports.chapters.positions.groups import EXPERIMENTS, GROUPS
from reports.chapters.positions.location import (
    Crossing,
    LocatedCase,
    PositionCase,
    margins_percent,
    mm_per_percent,
    place_of,
)
from reports.chapters.positions.positions import EXPERIMENT_POSITIONS_CHAPTER, remark
from reports.chapters.positions.texts import LIMIT_MM
from reports.common.chapter import Content
from reports.common.thesis_data import Thesis
from reports.common.thesis_scene import thesis_scene
from reports.thesis_methods.triangulation import fit_place
from tests.helpers.sensing_cases import Peak

ALL = (*GROUPS, EXPERIMENTS)
ROUND = {"A": Peak(10.0, 0.0), "B": Peak(0.0, 10.0), "C": Peak(-10.0, 0.0), "D": Peak(0.0, -10.0)}


@pytest.fixture(scope="module")
def thesis():
    return Thesis.read()


# --------------------------------------------------------------------------------- completeness


def test_every_position_of_the_thesis_has_its_group(thesis):
    rows = [row.case for group in ALL for row in group.rows(thesis)]
    assert sorted(rows) == sorted(row.case for row in thesis.positions)


def test_every_point_of_a_triangulation_is_shown_once(thesis):
    points = [
        p for group in ALL for group_points in group.printed(thesis).values() for p in group_points
    ]
    ids = [(p.case, p.item) for p in points]
    assert sorted(ids) == sorted((p.case, p.item) for p in thesis.triangulation)


def test_panels_show_cases_of_their_group(thesis):
    for group in ALL:
        assert set(group.panels.values()) <= {row.case for row in group.rows(thesis)}


def test_the_simulated_figures_of_contours_and_positions_are_shown():
    shown = {figure for group in GROUPS for figure in group.shows}
    numbers = [8, 10, 11, 12, 13, 14, 15, 19, 21, 22]
    assert {f"Fig. 3.{number}" for number in numbers} <= shown


def test_a_chapter_without_rows_says_so(thesis, tmp_path):
    none = replace(thesis, positions=(), triangulation=(), contours=())
    assert EXPERIMENT_POSITIONS_CHAPTER.scenes(none) == []
    for chapter in (EXPERIMENT_POSITIONS_CHAPTER, FIGURE_3_9_CHAPTER):
        content = chapter.compose(none, None, tmp_path)
        assert isinstance(content, Content)
        assert content.blocks == []


# ----------------------------------------------------------------------------------- calibration


@pytest.mark.parametrize(
    ("probe", "rotation_deg", "solved_deg", "quarters"),
    [("tri7", -90.0, 0.0, 3), ("tri7", 180.0, 0.0, 2), ("rect14x7", -45.0, 45.0, 3)],
)
def test_a_setting_is_quarter_turns_of_a_solved_one(probe, rotation_deg, solved_deg, quarters):
    setting = Setting(probe, rotation_deg, 1.0)
    assert (setting.solved.rotation_deg, setting.quarters) == (solved_deg, quarters)
    assert solved_deg + 90.0 * quarters - rotation_deg in (0.0, 360.0)


@pytest.mark.parametrize("layout", ["3", "4"])
def test_the_ring_has_the_electrodes_of_both_layouts(layout, thesis, monkeypatch):
    """Each electrode's function is that of the ring's electrode at its place."""
    ring = {e.name: e for e in calibration(Setting("tri7", 0.0, 1.0), 4.0).scene.electrode_list}
    monkeypatch.setattr(thesis_calibration, "_maps", lambda *_: ring)
    chosen = charge_functions(thesis, None, Setting("tri7", 0.0, 1.0), layout)
    for electrode in thesis_scene(layout, "tri7").electrode_list:
        of_ring, expected = chosen[electrode.name].function.outline, electrode.outline
        assert of_ring.centroid == pytest.approx(expected.centroid, abs=1e-12)
        assert of_ring.area == pytest.approx(expected.area)


def test_a_turned_setting_takes_the_electrode_that_comes_to_lie_there(thesis, monkeypatch):
    """A quarter turn brings the ring's electrode at 0° to 90°, and y to where x was."""
    asked = []

    def maps(results, setting, pitch_mm, d31, d32):
        asked.append((setting, d31, d32))
        angles = np.radians(range(0, 360, 30))
        return {f"{30 * k}": Peak(10 * np.cos(a), 10 * np.sin(a)) for k, a in enumerate(angles)}

    monkeypatch.setattr(thesis_calibration, "_maps", maps)
    functions = charge_functions(thesis, None, Setting("tri7", 90.0, 1.0), "4", "uniaxial")
    assert asked == [(Setting("tri7", 0.0, 1.0), 2.0, 18.0)]
    places = np.array([[3.0, -1.0], [0.5, 6.0]])
    for name, peak in ROUND.items():
        value, slope = functions[name].value_and_gradient(places)
        expected, expected_slope = peak.value_and_gradient(places)
        assert value == pytest.approx(expected)
        assert slope == pytest.approx(expected_slope)


def test_one_electrode_turned_serves_all_if_they_look_alike():
    alike = turned_from({name: TurnedMap(peak, 0) for name, peak in ROUND.items()}, "D")
    places = np.array([[3.0, -1.0], [0.5, 6.0]])
    for name, peak in ROUND.items():
        expected = peak.value_and_gradient(places)
        turned = alike[name].value_and_gradient(places)
        assert turned[0] == pytest.approx(expected[0])
        assert turned[1] == pytest.approx(expected[1])


def test_settings_that_are_turns_of_each_other_are_solved_once(thesis):
    unturned = calibration_scenes(thesis, [Setting("tri7", 0.0, 1.0)])
    turned = calibration_scenes(
        thesis, [Setting("tri7", r, 1.0) for r in (0.0, 90.0, 180.0, -90.0)]
    )
    assert turned == unturned


def test_lines_of_three_electrodes_are_those_printed_and_more(thesis):
    lines = lines_deg(thesis, "3")
    for name in "AB":
        assert set(thesis.angles_deg[name]) <= set(lines[name])
    assert lines["C"] == tuple(180.0 - angle for angle in lines["B"])


@pytest.mark.parametrize("layout", ["3", "4"])
def test_lines_lie_on_both_sides_of_the_direction_to_the_centre(layout, thesis):
    for electrode in thesis_scene(layout, "tri7").electrode_list:
        inwards = -electrode.outline.centroid
        angles = np.array(lines_deg(thesis, layout)[electrode.name])
        offsets = np.degrees(np.arctan2(inwards[1], inwards[0])) - angles
        offsets = np.sort((offsets + 180.0) % 360.0 - 180.0)
        assert offsets == pytest.approx(-offsets[::-1])


def test_a_mapping_has_the_charges_at_its_places(thesis):
    b_mapping = mapping(thesis, "4", "B", ROUND["B"])
    for line in b_mapping.lines:
        assert line.charges_pC == pytest.approx(1000.0 * np.exp(-(line.distances_mm**2) / 200.0))


# ------------------------------------------------------------------------------------ locations


def crossing_of(radii_mm, target=(0.0, 0.0)):
    circles = [ROUND[name].circle(name, r) for name, r in radii_mm.items()]
    return Crossing(tuple(circles), np.array(target))


def test_margins_tell_by_how_much_contours_cross():
    """Circles about A and C, 20 mm apart, of 10.5 mm: they reach to 9.5 mm from the other."""
    contours = crossing_of({"A": 10.5, "C": 10.5}).contours
    expected = 100.0 * (ROUND["C"].at_radius(9.5) / ROUND["C"].at_radius(10.5) - 1.0)
    assert margins_percent(contours, ROUND)["A-C"] == pytest.approx(expected, rel=1e-2)


def test_margins_are_negative_where_contours_pass():
    contours = crossing_of({"A": 9.5, "C": 9.5}).contours
    expected = 100.0 * (ROUND["C"].at_radius(10.5) / ROUND["C"].at_radius(9.5) - 1.0)
    assert margins_percent(contours, ROUND)["A-C"] == pytest.approx(expected, rel=1e-2)


def test_a_place_is_that_of_its_triple():
    crossing = crossing_of({"A": 9.0, "B": 10.0, "C": 11.0, "D": 10.0}, (1.0, 0.0))
    triangles = crossing.triangulation.triangles
    assert np.isnan(place_of(crossing, "BCD")).any() == (triangles[3].candidates == ())
    triple = {"".join(triangle.electrodes): triangle for triangle in triangles}["ACD"]
    assert place_of(crossing, "ACD") == pytest.approx(triple.position_mm, nan_ok=True)
    mean_mm = crossing.triangulation.position_mm
    assert place_of(crossing, "average") == pytest.approx(mean_mm, nan_ok=True)


@pytest.fixture
def passing(thesis):
    """A row without a crossing in the thesis, with contours of A and C that pass each other."""
    row = next(r for r in thesis.positions if r.layout == "4" and np.isnan(r.error_mm))
    position = np.array([0.4, 0.5])
    charges = {name: peak.charge(position) for name, peak in ROUND.items()}
    radii = {n: float(np.hypot(*(position - [peak.x_mm, peak.y_mm]))) for n, peak in ROUND.items()}
    right = crossing_of(radii, position)
    wrong = crossing_of({"A": 9.5, "B": 9.5, "C": 9.5, "D": 11.0}, position)
    margins = margins_percent(wrong.contours, ROUND)
    case = replace(PositionCase.of(row), x_mm=0.4, y_mm=0.5)
    fit = fit_place(charges, ROUND)
    return row, LocatedCase(case, charges, wrong, {"D": wrong}, wrong, right, fit, 0.0, margins)


def test_a_remark_names_what_does_not_cross(passing):
    row, located = passing
    text = remark(row, located)
    assert "contours of A-C of the probe not turned do not meet" in text
    assert "2 of 4 triples, A-C pass at 1 mm" in text
    assert "true orientation" not in text
    assert located.true.error_mm < LIMIT_MM
    assert located.fit_error_mm < 1e-6


def test_what_one_percent_of_the_charges_moves(passing):
    """At the middle, slopes are 10 % per mm: sqrt(2) of four charges count along each axis."""
    _, located = passing
    assert mm_per_percent(located) == pytest.approx(0.1 / np.sqrt(2.0), rel=0.02)


def test_the_radius_of_a_charge_on_a_line():
    peak = ROUND["A"]
    start = np.array([10.0, 0.0])
    assert radius(peak, start, 150.0, peak.at_radius(7.0), 6.0) == pytest.approx(7.0)
    assert np.isnan(radius(peak, start, 150.0, 2000.0, 6.0))

"""Touches that are found from charges of made-up responses whose symmetries are known."""

import math
from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest

from pvdf_fem.inverse.touch.locate import locate, rank_probes
from pvdf_fem.inverse.touch.locate_many import locate_many
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, Domain
from tests.helpers.bump_response import (
    PROBE_POINTS_MM,
    BumpResponse,
    draw_uniform_touches,
    make_bump_response,
    read_charges,
)

PERIODS_DEG = {"triangle": 120.0, "rectangle": 180.0}
#: Rows of random touches at the ends of winding valleys.
WINDING_ROWS = {"rectangle": [47, 168, 451], "triangle": [62, 128, 162, 201]}
#: Largest distances of a listed touch from the true one: mm, mm, degrees, N.
COARSE = [0.05, 0.05, 5.0, 0.02]
FINE = [0.01, 0.01, 0.1, 0.01]
TOUCH = np.array([3.0, 4.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class RecordingResponse(BumpResponse):
    """A response that records the touches of each evaluation."""

    evaluated: list[np.ndarray] = field(default_factory=list)

    def evaluate(self, touches):
        self.evaluated.append(touches.copy())
        return super().evaluate(touches)


@pytest.mark.parametrize("shape", ["triangle", "rectangle", "circle"])
@pytest.mark.parametrize("electrodes", [3, 4, 6])
def test_exact_charges_locate_their_touch_with_few_evaluations(shape, electrodes):
    """Candidates are so close, and searches end so soon, that a call takes a millisecond."""
    response = RecordingResponse(**vars(make_bump_response(shape, electrodes)))
    calls = []
    evaluations = []
    for touch in draw_uniform_touches(20, seed=electrodes):
        charges = read_charges(response, touch)
        response.evaluated.clear()
        location = locate(response, charges, 1e-3, known={"rotation_deg": touch[2]})
        calls.append(len(response.evaluated))
        evaluations.append(sum(len(touches) for touches in response.evaluated))
        # Three charges fit a second touch here and there.
        nearest = min(location.touches, key=lambda one: np.hypot(*(one.values - touch)[:2]))
        assert nearest.values == pytest.approx(touch, rel=1e-5, abs=1e-5)
        assert nearest.chi_square < 1e-6
        assert electrodes == 3 or (nearest is location.best and not location.ambiguous)
    # The first call evaluates the coarse grid.
    assert np.median(calls) <= 3
    assert np.median(evaluations) <= 12


@pytest.mark.parametrize("shape", PERIODS_DEG)
def test_all_touches_with_an_unknown_rotation_are_listed(shape):
    """With as many charges as unknown quantities several touches may give the charges exactly.

    Some are at the end of winding valleys, which long steps of the rotation miss, as do searches
    that are merged too early. Two touches about to become one are listed as one.
    """
    response = make_bump_response(shape)
    period = PERIODS_DEG[shape]
    winding = draw_uniform_touches(600, seed=1)[WINDING_ROWS[shape]]
    cases = [(touch, COARSE) for touch in draw_uniform_touches(30, seed=5)]
    cases += [(touch, FINE) for touch in winding]
    ambiguous_count = 0
    for touch, tolerances in cases:
        charges = read_charges(response, touch)
        location = locate(response, charges, 1e-3, unknown=TOUCH_QUANTITIES)
        ambiguous_count += location.ambiguous
        inside = [one for one in location.touches if not one.at_edge]
        assert all(0.0 <= one.rotation_deg < period for one in inside)
        exact = [one for one in inside if one.chi_square < 1e-6]
        for one in exact:
            assert read_charges(response, one.values) == pytest.approx(charges, rel=1e-4)
        differences = np.array([one.values for one in location.touches]) - touch
        differences[:, 2] -= period * np.round(differences[:, 2] / period)
        assert (np.abs(differences) < tolerances).all(axis=1).any()
        # Chi-square is zero except for where searches stop; weights are proportional to widths.
        ranks = [(one.explained, one.weight) for one in location.touches]
        assert ranks == sorted(ranks, reverse=True)
        narrow = [one for one in exact if one.deviations["rotation_deg"] < 5.0]
        widths = [np.linalg.det(one.covariance) ** 0.5 / one.force_N for one in narrow]
        fractions = np.array([one.weight for one in narrow]) / widths
        assert fractions == pytest.approx(np.full(len(narrow), fractions[:1].sum()), rel=1e-2)
    assert ambiguous_count > 10


def test_mirror_images_are_both_listed():
    """Places mirror each other at the line of two electrodes if the force is known."""
    response = make_bump_response("circle", 2)
    location = locate(response, read_charges(response, TOUCH), unknown=("x_mm", "y_mm"))
    assert (location.status, location.alternatives) == ("ambiguous", 1)
    assert [one.weight for one in location.touches] == pytest.approx([0.5, 0.5], abs=1e-6)
    assert sorted(one.y_mm for one in location.touches) == pytest.approx([-4.0, 4.0], abs=1e-4)
    assert [one.x_mm for one in location.touches] == pytest.approx([3.0, 3.0], abs=1e-4)
    # Half of the probability is 8 mm away.
    best = location.best
    assert location.deviations["y_mm"] == pytest.approx(8.0, abs=best.deviations["y_mm"])
    assert location.deviations["x_mm"] == pytest.approx(best.deviations["x_mm"], rel=0.1)


def test_probes_are_ranked_by_their_evidence():
    log_evidences = {"a": 0.0, "b": math.log(3.0), "c": -math.inf}
    locations = {}
    for name, log_evidence in log_evidences.items():
        locations[name] = SimpleNamespace(log_evidence=log_evidence)
    matches = rank_probes(locations)
    assert [match.name for match in matches] == ["b", "a", "c"]
    assert [match.weight for match in matches] == pytest.approx([0.75, 0.25, 0.0])


EXACT = read_charges(make_bump_response("circle"), TOUCH)


@pytest.mark.parametrize(
    ("charges", "freedom", "status"),
    [
        ({"A": EXACT["A"], "B": EXACT["B"]}, -1, "undetermined"),
        ({name: EXACT[name] for name in "ABD"}, 0, "located"),
        ({"A": 5.0, "B": 9000.0, "C": 5.0}, 0, "unexplained"),
        (EXACT, 1, "located"),
        ({**EXACT, "A": 1.2 * EXACT["A"], "C": 1.2 * EXACT["C"]}, 1, "unexplained"),
    ],
)
def test_too_few_charges_and_impossible_charges_are_flagged(charges, freedom, status):
    """Without degrees of freedom there is no p-value; the domain's edge shows a misfit."""
    response = make_bump_response("circle")
    location = locate(response, charges)
    columns = {name: [charge] for name, charge in charges.items()}
    touches = locate_many(response, columns, rotations_deg=[0.0])
    assert (location.status, touches.status[0]) == (status, status)
    assert location.degrees_of_freedom == freedom
    assert location.explained == touches.explained[0] == (status == "located")
    assert bool(location.notes) == (status != "located")
    if status == "undetermined":
        assert location.touches == ()
        assert np.isnan(touches.values).all()
    else:
        assert np.isnan(location.best.p_value) == np.isnan(touches.p_value[0]) == (freedom == 0)
        chi_square = location.best.chi_square
        assert touches.chi_square[0] == pytest.approx(chi_square, rel=1e-3, abs=1e-3)


@pytest.mark.parametrize(
    ("touch", "limits", "status"),
    [
        ([11.0, 9.0, 0.0, 1.0], ("reach_mm",), "at edge"),
        ([3.0, 2.0, 0.0, 20.0], ("force_N",), "unexplained"),
        ([3.0, 2.0, 0.0, 0.02], ("force_N",), "unexplained"),
        ([14.0, 2.0, 0.0, 6.0], ("reach_mm", "force_N"), "at edge"),
        ([11.9, 0.0, 0.0, 4.9], (), "located"),
    ],
)
def test_a_touch_beyond_the_domain_is_at_its_edge_without_evaluations_beyond(touch, limits, status):
    response = RecordingResponse(**vars(make_bump_response("circle")))
    location = locate(response, read_charges(make_bump_response("circle"), touch))
    assert (location.best.at_edge, location.status) == (limits, status)
    triangle = replace(response, points_mm=PROBE_POINTS_MM["triangle"])
    charges = read_charges(make_bump_response("triangle"), touch)
    locate(triangle, charges, unknown=TOUCH_QUANTITIES)
    x, y, _, force = np.concatenate(response.evaluated).T
    assert np.hypot(x, y).max() <= 12.0 * (1.0 + 1e-9)
    assert force.min() >= 0.1 * (1.0 - 1e-9)
    assert force.max() <= 5.0 * (1.0 + 1e-9)


@pytest.mark.parametrize(("axis", "other"), [("x_mm", "y_mm"), ("y_mm", "x_mm")])
def test_a_position_on_a_line_is_searched_up_to_the_reach(axis, other):
    """The touch is beyond a reach of 10 mm; searches go 5 % beyond the reach."""
    wide = make_bump_response("circle", domain=Domain(14.0, (0.1, 5.0)))
    narrow = make_bump_response("circle", domain=Domain(10.0, (0.1, 5.0)))
    touch = [9.5, 6.0, 0.0, 1.0] if axis == "x_mm" else [6.0, 9.5, 0.0, 1.0]
    charges = read_charges(wide, touch)
    known = {other: 6.0, "rotation_deg": 0.0}
    at_edge = locate(narrow, charges, 0.01, unknown=(axis, "force_N"), known=known)
    assert getattr(at_edge.best, axis) == pytest.approx((10.5**2 - 6.0**2) ** 0.5, rel=1e-6)
    inside = locate(wide, charges, 0.01, unknown=(axis, "force_N"), known=known)
    assert getattr(inside.best, axis) == pytest.approx(9.5, abs=0.05)

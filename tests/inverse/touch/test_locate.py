"""Which touches are found from charges of made-up models whose symmetries are known."""

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
#: Rows of random touches, and how near to these one of the listed touches is.
WINDING = {"rectangle": [47, 168, 451], "triangle": [62, 128, 162, 201]}
ROUGH, FINE = [0.05, 0.05, 5.0, 0.02], [0.01, 0.01, 0.1, 0.01]
PLACE_MM = np.array([3.0, 4.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class Watched(BumpResponse):
    """A model that keeps the touches of each evaluation."""

    asked: list[np.ndarray] = field(default_factory=list)

    def evaluate(self, touches):
        self.asked.append(touches.copy())
        return super().evaluate(touches)


@pytest.mark.parametrize("shape", ["triangle", "rectangle", "circle"])
@pytest.mark.parametrize("electrodes", [3, 4, 6])
def test_the_touch_is_found_from_exact_charges_by_few_evaluations(shape, electrodes):
    """Starts are so close, and searches end so soon, that a call takes a millisecond."""
    model, calls = Watched(**vars(make_bump_response(shape, electrodes))), []
    for touch in draw_uniform_touches(20, seed=electrodes):
        charges = read_charges(model, touch)
        model.asked.clear()
        found = locate(model, charges, 1e-3, known={"rotation_deg": touch[2]})
        calls.append([len(touches) for touches in model.asked])
        # three charges fit a second touch here and there
        nearest = min(found.touches, key=lambda one: np.hypot(*(one.values - touch)[:2]))
        assert nearest.values == pytest.approx(touch, rel=1e-5, abs=1e-5)
        assert nearest.chi_square < 1e-6
        assert electrodes == 3 or (nearest is found.best and not found.ambiguous)
    # the first call makes the table of starts
    assert np.median([len(each) for each in calls]) <= 3
    assert np.median([sum(each) for each in calls]) <= 12


@pytest.mark.parametrize("shape", PERIODS_DEG)
def test_all_touches_with_an_unknown_rotation_are_listed(shape):
    """As many charges as unknown quantities: several touches may give them exactly. Some are at
    the end of winding valleys: long steps of the rotation, and searches that go on as one too
    early, miss these. Two touches about to become one are listed as one."""
    model, period, several = make_bump_response(shape), PERIODS_DEG[shape], 0
    plain, winding = (
        draw_uniform_touches(30, seed=5),
        draw_uniform_touches(600, seed=1)[WINDING[shape]],
    )
    for touch, near in ((t, n) for of, n in ((plain, ROUGH), (winding, FINE)) for t in of):
        charges = read_charges(model, touch)
        found = locate(model, charges, 1e-3, unknown=TOUCH_QUANTITIES)
        several += found.ambiguous
        inside = [one for one in found.touches if not one.at_edge]
        assert all(0.0 <= one.rotation_deg < period for one in inside)
        fits = [one for one in inside if one.chi_square < 1e-6]
        assert all(
            read_charges(model, one.values) == pytest.approx(charges, rel=1e-4) for one in fits
        )
        apart = np.array([one.values for one in found.touches]) - touch
        apart[:, 2] -= period * np.round(apart[:, 2] / period)
        assert (np.abs(apart) < near).all(axis=1).any()
        # chi-square is zero but for where the searches stop, and weights are those of widths
        ranks = [(one.explained, one.weight) for one in found.touches]
        assert ranks == sorted(ranks, reverse=True)
        sure = [one for one in fits if one.deviations["rotation_deg"] < 5.0]
        widths = [np.linalg.det(one.covariance) ** 0.5 / one.force_N for one in sure]
        shares = np.array([one.weight for one in sure]) / widths
        assert shares == pytest.approx(np.full(len(sure), shares[:1].sum()), rel=1e-2)
    assert several > 10


def test_mirror_images_are_both_listed():
    """Two electrodes on a line, the force known: places mirror each other at it."""
    model = make_bump_response("circle", 2)
    found = locate(model, read_charges(model, PLACE_MM), unknown=("x_mm", "y_mm"))
    assert (found.status, found.alternatives) == ("ambiguous", 1)
    assert [one.weight for one in found.touches] == pytest.approx([0.5, 0.5], abs=1e-6)
    assert sorted(one.y_mm for one in found.touches) == pytest.approx([-4.0, 4.0], abs=1e-4)
    assert [one.x_mm for one in found.touches] == pytest.approx([3.0, 3.0], abs=1e-4)
    # half of the probability is 8 mm away
    assert found.deviations["y_mm"] == pytest.approx(8.0, abs=found.best.deviations["y_mm"])
    assert found.deviations["x_mm"] == pytest.approx(found.best.deviations["x_mm"], rel=0.1)


def test_probes_weigh_as_the_evidence_for_them():
    logs = {"a": 0.0, "b": math.log(3.0), "c": -math.inf}
    found = rank_probes({name: SimpleNamespace(log_evidence=of) for name, of in logs.items()})
    assert [one.name for one in found] == ["b", "a", "c"]
    assert [one.weight for one in found] == pytest.approx([0.75, 0.25, 0.0])


EXACT = read_charges(make_bump_response("circle"), PLACE_MM)


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
def test_too_few_charges_and_charges_that_no_touch_gives_are_flagged(charges, freedom, status):
    """Without a degree of freedom there is no p-value; the edge of the domain tells no fit."""
    model = make_bump_response("circle")
    found = locate(model, charges)
    columns = {name: [charge] for name, charge in charges.items()}
    many = locate_many(model, columns, rotations_deg=[0.0])
    assert (found.status, many.status[0], found.degrees_of_freedom) == (status, status, freedom)
    assert found.explained == many.explained[0] == (status == "located")
    assert bool(found.remarks) == (status != "located")
    if status == "undetermined":
        assert found.touches == ()
        assert np.isnan(many.values).all()
    else:
        assert np.isnan(found.best.p_value) == np.isnan(many.p_value[0]) == (freedom == 0)
        assert many.chi_square[0] == pytest.approx(found.best.chi_square, rel=1e-3, abs=1e-3)


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
def test_a_touch_beyond_the_domain_is_at_its_edge_and_no_model_is_asked_there(
    touch, limits, status
):
    model = Watched(**vars(make_bump_response("circle")))
    found = locate(model, read_charges(make_bump_response("circle"), touch))
    assert (found.best.at_edge, found.status) == (limits, status)
    locate(
        replace(model, points_mm=PROBE_POINTS_MM["triangle"]),
        read_charges(make_bump_response(), touch),
        unknown=TOUCH_QUANTITIES,
    )
    x, y, _, force = np.concatenate(model.asked).T
    assert np.hypot(x, y).max() <= 12.0 * (1.0 + 1e-9)
    assert force.min() >= 0.1 * (1.0 - 1e-9)
    assert force.max() <= 5.0 * (1.0 + 1e-9)


@pytest.mark.parametrize(("axis", "other"), [("x_mm", "y_mm"), ("y_mm", "x_mm")])
def test_a_place_on_a_line_is_sought_as_far_as_the_reach(axis, other):
    """Of a touch beyond a reach of 10 mm, 6 mm off the centre; searches go 5 % beyond the reach."""
    wide, narrow = (
        make_bump_response("circle", domain=Domain(reach, (0.1, 5.0))) for reach in (14.0, 10.0)
    )
    charges = read_charges(wide, [9.5, 6.0, 0.0, 1.0] if axis == "x_mm" else [6.0, 9.5, 0.0, 1.0])
    asked = {"unknown": (axis, "force_N"), "known": {other: 6.0, "rotation_deg": 0.0}}
    found = locate(narrow, charges, 0.01, **asked)
    assert getattr(found.best, axis) == pytest.approx((10.5**2 - 6.0**2) ** 0.5, rel=1e-6)
    inside = locate(wide, charges, 0.01, **asked)
    assert getattr(inside.best, axis) == pytest.approx(9.5, abs=0.05)

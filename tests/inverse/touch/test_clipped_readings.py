"""Touches located from readings that are clipped at the range of their channel."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import norm

from pvdf_fem.inverse.touch import locate as locate_module
from pvdf_fem.inverse.touch import locate_many as locate_many_module
from pvdf_fem.inverse.touch.measurement import Measurement
from pvdf_fem.inverse.touch.search import search_rows
from pvdf_fem.inverse.touch.touch import TouchStatus
from pvdf_fem.inverse.touch.touches import Touches
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, TouchColumn
from tests.helpers.bump_response import draw_uniform_touches, make_bump_response, read_charges

locate = partial(locate_module.locate, unit="pC")
locate_many = partial(locate_many_module.locate_many, unit="pC")
TOUCH = np.array([5.0, 2.0, 0.0, 1.0])
POSITION_AND_FORCE = [0, 1, 3]


def make_response(electrodes=4, **readout):
    """Make a response of total charges, read by channels of 1000 pF."""
    response = make_bump_response("circle", electrodes)
    return replace(response, scene=response.scene.with_(readout={"reading": "total", **readout}))


def test_a_reading_far_beyond_its_limit_says_no_more_than_a_missing_one():
    """The likeliest touch and its deviations are those of the other three readings."""
    response = make_response(range_V={"A": 0.3})
    charges = read_charges(response, TOUCH)
    assert charges["A"] > 400.0
    location = locate(response, charges | {"A": 300.0})
    others = locate(response, {name: charges[name] for name in "BCD"})
    everything = locate(make_response(), charges)
    assert (location.clipped, others.clipped) == (("A",), ())
    assert location.status == others.status == "located"
    assert location.degrees_of_freedom == others.degrees_of_freedom == 0
    assert location.best.values == pytest.approx(others.best.values, abs=1e-3)
    assert location.best.values == pytest.approx(TOUCH, abs=1e-3)
    growth = []
    for name, deviation in location.deviations.items():
        assert deviation == pytest.approx(others.deviations[name], rel=0.05)
        growth.append(deviation / everything.deviations[name])
    assert max(growth) > 1.3
    assert location.to_json()["clipped"] == ["A"]
    (note,) = location.notes
    assert note.startswith("clipped: A:")
    assert "range_V" in note


def test_a_limit_moves_the_touch_as_the_censored_likelihood_says():
    """The other readings have errors, after which A would be below its limit."""
    response = make_response(5, range_V={"A": 1.0})
    charges = read_charges(response, TOUCH)
    limit = 1.01 * charges["A"]
    response = make_response(5, range_V={"A": limit / 1e3})
    readings = charges | {"A": limit, "B": 0.99 * charges["B"], "E": 0.98 * charges["E"]}
    location = locate(response, readings)
    assert location.clipped == ("A",)
    bound = 0.998 * limit
    measured = np.array([bound, *(readings[name] for name in "BCDE")])
    deviations = measured * np.hypot(0.01, 1e-4 / 3.0**0.5)

    def compute_deviance(coordinates):
        x, y, log_force = coordinates
        touch = np.array([[x, y, 0.0, np.exp(log_force)]])
        z = (response.evaluate(touch)[0][0] - measured) / deviations
        return np.square(z[1:]).sum() - 2.0 * norm.logcdf(z[0])

    start = [TOUCH[0], TOUCH[1], 0.0]
    expected = minimize(compute_deviance, start, method="Nelder-Mead", options={"xatol": 1e-6})
    assert location.best.chi_square == pytest.approx(expected.fun, abs=0.02)
    found = location.best.values[POSITION_AND_FORCE]
    sizes = np.array([*location.deviations.values()])
    assert np.abs(found - [*expected.x[:2], np.exp(expected.x[2])]) == pytest.approx(
        0.0, abs=0.1 * sizes.max()
    )
    without = locate(response, {name: readings[name] for name in "BCDE"})
    predicted = response.evaluate(without.best.values[None])[0][0, 0]
    moved = response.evaluate(location.best.values[None])[0][0, 0]
    assert predicted < moved  # towards the limit


def test_an_inverted_channel_is_clipped_at_its_lower_end():
    response = make_response(gain={"A": -1.0}, range_V=0.4)
    charges = read_charges(response, TOUCH)
    readings = charges | {"A": -400.0}
    location = locate(response, readings)
    assert (location.clipped, location.status) == (("A",), "located")
    assert location.best.values == pytest.approx(TOUCH, abs=1e-3)
    assert locate(response, readings | {"A": 400.0}).status == "unexplained"


def test_a_limit_that_no_touch_of_the_other_readings_reaches_is_unexplained():
    response = make_response(range_V={"A": 0.65})
    charges = read_charges(response, TOUCH)
    assert charges["A"] < 600.0
    location = locate(response, charges | {"A": 650.0})
    assert (location.status, location.clipped) == ("unexplained", ("A",))


def test_too_many_clipped_readings_have_a_status_and_say_what_to_do():
    response = make_response(range_V=0.3)
    charges = read_charges(response, TOUCH)
    readings = {name: min(charge, 300.0) for name, charge in charges.items()}
    location = locate(response, readings)
    assert (location.status, location.clipped, location.touches) == ("clipped", ("A", "B"), ())
    (note,) = location.notes
    assert note.startswith("clipped: A, B;")
    assert "range_V" in note
    known = locate(response, readings, unknown=("x_mm", "y_mm"), known={"force_N": 1.0})
    assert known.best.values == pytest.approx(TOUCH, abs=1e-3)
    few = locate(response, {"A": 300.0, "C": charges["C"]})
    assert few.status == "clipped"
    rows = np.array([[*charges.values()], [*readings.values()]])
    touches = locate_many(response, rows, rotations_deg=np.zeros(2))
    assert touches.status.tolist() == ["clipped"] * 2
    assert touches.clipped.tolist() == ["A B"] * 2
    assert touches.to_table()["clipped"].tolist() == ["A B"] * 2


@pytest.mark.parametrize("calibrated", [True, False])
@pytest.mark.parametrize(("electrodes", "clipped"), [(4, 1), (6, 1), (6, 2)])
def test_deviations_of_clipped_touches_are_those_of_drawn_errors(electrodes, clipped, calibrated):
    """Of 200 touches; ±0.1 of a root mean square of 600 pulls is three standard deviations."""
    response = make_response(electrodes)
    touches = draw_uniform_touches(200, seed=electrodes + clipped, reach_mm=8.0)
    touches[:, 2] = 0.0
    touches[:, 3] = touches[:, 3].clip(0.2, 3.0)
    noise = 0.01 * np.random.default_rng(4).standard_normal((200, electrodes))
    charges = response.evaluate(touches)[0] * (1.0 + noise)
    ordered = np.sort(charges, axis=1)
    # Each touch has a range between two of its readings.
    ends = 0.5 * (ordered[:, -clipped] + ordered[:, -clipped - 1])
    pulls = []
    explained = []
    for number in range(200):
        limits = dict.fromkeys(response.names, (-np.inf, ends[number]))
        found = locate_many(
            response,
            np.minimum(charges[number : number + 1], ends[number]),
            rotations_deg=[0.0],
            limits=limits,
            calibrated=calibrated,
        )
        assert len(found.clipped[0].split()) == clipped
        explained.append(bool(found.explained[0]))
        if found.status[0] == "located":
            error = (found.values[0] - touches[number])[POSITION_AND_FORCE]
            pulls.append(error / found.deviations[0])
    assert np.mean(explained) > 0.98
    assert len(pulls) > 150
    sizes = np.sqrt(np.square(pulls).mean(axis=0))
    assert sizes == pytest.approx(1.0, abs=0.2)


def test_a_table_without_a_range_shows_where_its_channels_clip():
    response = make_response()
    touches = draw_uniform_touches(30, seed=2, reach_mm=8.0)
    touches[:, 2] = 0.0
    touches[:, 3] = touches[:, 3].clip(0.2, 3.0)
    noise = 0.01 * np.random.default_rng(3).standard_normal((30, 4))
    charges = response.evaluate(touches)[0] * (1.0 + noise)
    end = np.sort(charges[:, 0])[-6]
    charges[:, 0] = np.minimum(charges[:, 0], end)
    found = locate_many(response, charges, rotations_deg=touches[:, 2])
    is_clipped = charges[:, 0] == end
    assert is_clipped.sum() == 6
    assert [text == "A" for text in found.clipped] == is_clipped.tolist()
    assert found.explained.all()
    errors = np.abs(found.values - touches)[:, POSITION_AND_FORCE] / found.deviations
    assert (errors < 4.0).all()
    as_values = locate_many(response, charges, rotations_deg=touches[:, 2], limits={})
    assert not as_values.explained[is_clipped].all()
    unlimited = np.flatnonzero(~is_clipped)
    assert found.values[unlimited] == pytest.approx(as_values.values[unlimited], abs=1e-9)


def test_mistakes_are_found_beside_clipped_readings():
    """The sides of clipped readings are exchanged and inverted with the readings."""
    response = make_response(6, range_V=0.5)
    touch = np.array([6.5, 2.0, 0.0, 1.0])
    charges = read_charges(response, touch)
    assert charges["A"] > 500.0
    clipped = {name: min(charge, 500.0) for name, charge in charges.items()}
    inverted = locate(response, {name: -charge for name, charge in clipped.items()})
    assert "readings have the wrong sign" in [each.text for each in inverted.explanations]
    swapped = locate(response, clipped | {"A": clipped["C"], "C": clipped["A"]})
    assert (swapped.status, swapped.clipped) == ("unexplained", ("C",))
    explanations = {text: found for text, found in swapped.explanations}
    found = explanations["channels A and C are swapped"]
    assert found.values == pytest.approx(touch, abs=1e-2)
    assert found.chi_square == min(each.chi_square for each in explanations.values())


def test_a_limit_does_not_weigh_probes_by_its_deviation():
    """The evidence is a density of values, but a probability of limits, whatever their size."""
    evidences = []
    for end in (0.1, 0.3):
        response = make_response(range_V={"A": end})
        readings = read_charges(response, TOUCH) | {"A": 1e3 * end}
        evidences.append(locate(response, readings).log_evidence)
    assert evidences[0] == pytest.approx(evidences[1], abs=1e-3)


def test_unknown_quantities_of_solves_are_located_beside_a_clipped_reading():
    """All quantities, with one reading more than unknowns."""
    response = make_bump_response("rectangle", 6)
    scene = response.scene.with_(readout={"reading": "total", "range_V": {"B": 0.3}})
    response = replace(response, scene=scene)
    touch = np.array([2.0, 5.0, 25.0, 0.7])
    charges = read_charges(response, touch)
    assert charges["B"] > 300.0
    location = locate(response, charges | {"B": 300.0}, 1e-3, unknown=TOUCH_QUANTITIES)
    assert location.clipped == ("B",)
    nearest = min(np.abs(each.values - touch).max() for each in location.touches)
    assert nearest < 0.05


def test_rows_without_a_touch_do_not_shift_the_degrees_of_freedom():
    """The second of three rows has a clipped reading, and thus none; the first is abandoned."""
    response = make_response()
    charges = np.tile(response.evaluate(TOUCH[None])[0], (3, 1))
    end = charges[0, 0] - 50.0
    charges[1, 0] = end
    response = make_response(range_V={"A": [-5.0, end / 1e3]})
    charges[[0, 2], 0] -= 60.0
    measurement = Measurement.from_response(response, "ABCD", 0.01, None, "total")
    problem = measurement.make_problem(charges, np.array(POSITION_AND_FORCE))
    assert problem.degrees_of_freedom.tolist() == [1, 0, 1]
    fixed = {TouchColumn.ROTATION: np.zeros(3)}
    ends = search_rows(problem, fixed, count=1)
    ends.converged[0] = False
    status = np.full(3, TouchStatus.LOCATED, dtype=object)
    touches = Touches.make_empty(status, ("x_mm", "y_mm", "force_N"), "total")
    touches.store(np.arange(3), problem, ends)
    assert touches.status[0] == "no_touch_found"
    assert np.isfinite(touches.p_value).tolist() == [False, False, True]

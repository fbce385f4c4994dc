"""Touches located from rows of readings, some of which cannot be used."""

import tracemalloc

import numpy as np
import pytest

from pvdf_fem.inverse.touch import locate_many as module
from pvdf_fem.inverse.touch.locate_many import locate_many
from pvdf_fem.inverse.touch.location_problem import LocationProblem
from pvdf_fem.inverse.touch.search import search_rows
from tests.helpers.bump_response import draw_uniform_touches, make_bump_response

#: Rows that cannot be used, by their status.
BAD_ROWS = {
    "not_finite": [[np.nan, 700.0, np.nan, 600.0], [None] * 4, [1.0, np.inf, np.inf, np.nan]],
    "clipped": [[1.0, np.inf, -np.inf, 1.0], [np.inf] * 4],
    "too_large": [[1e13, 1.0, 1.0, 1.0], [1e300, 1.0, 1.0, -1e300], [1.7e308] * 4],
    "zero_charge": [[0.0, 0.0, 0.0, 0.0], [700.0, 0.0, 600.0, 500.0], [1e-300, 1.0, 1.0, 1.0]],
}


def make_rows(count=12):
    """Make a response, touches, and their charges with errors of 1 %."""
    response = make_bump_response("rectangle")
    touches = draw_uniform_touches(count, seed=2, reach_mm=10.0)
    noise = 0.01 * np.random.default_rng(4).standard_normal((count, 4))
    return response, touches, response.evaluate(touches)[0] * (1.0 + noise)


def assert_same(found, expected, rows=slice(None)):
    for name in ("values", "covariances", "determined", "chi_square", "p_value", "at_edge"):
        np.testing.assert_array_equal(getattr(found, name)[rows], getattr(expected, name))


def test_a_bad_row_has_its_status_and_changes_no_other_row():
    response, touches, charges = make_rows()
    bad_rows = []
    statuses = []
    for status, rows in BAD_ROWS.items():
        bad_rows += rows
        statuses += [status] * len(rows)
    statuses += ["located"] * len(charges)
    order = np.random.default_rng(5).permutation(len(statuses))
    rotations = np.concatenate([np.zeros(len(bad_rows)), touches[:, 2]])[order]
    every_row = [*bad_rows, *charges.tolist()]
    mixed = [every_row[index] for index in order]
    found = locate_many(response, mixed, rotations_deg=rotations.tolist())
    assert found.status.tolist() == [statuses[index] for index in order]
    good = np.argsort(order)[len(bad_rows) :]
    assert_same(found, locate_many(response, charges, rotations_deg=touches[:, 2]), good)
    bad = np.argsort(order)[: len(bad_rows)]
    assert np.isnan(found.values[bad]).all()
    assert np.isnan(found.covariances[bad]).all()
    assert not (found.explained | found.determined | found.at_edge)[bad].any()


def test_known_rotations_and_forces_are_fixed_or_bad():
    response, touches, _ = make_rows()
    rotations = touches[:, 2].copy()
    forces = touches[:, 3].copy()
    forces[1:5] = 7.0, np.nan, forces[3], -1.0
    rotations[3] = np.inf
    charges = response.evaluate(touches)[0]
    found = locate_many(response, charges, 1e-3, rotations_deg=rotations, forces_N=forces)
    outside = "known_outside_domain"
    bad = "not_finite"
    assert found.status[:6].tolist() == ["located", outside, bad, bad, outside, "located"]
    assert found.unknown == ("x_mm", "y_mm")
    assert found.values[5:] == pytest.approx(touches[5:], abs=1e-4)


def test_a_charge_of_zero_has_a_deviation_by_noise():
    response, touches, charges = make_rows(3)
    charges[1, 2] = 0.0
    charges[2] = 0.0
    found = locate_many(response, charges, rotations_deg=touches[:, 2], noise_pC=5.0)
    assert found.status.tolist() == ["located", "unexplained", "zero_charge"]


def test_columns_in_any_order_give_the_same_touches_as_rows():
    response, touches, charges = make_rows()
    rotations = tuple(touches[:, 2])
    expected = locate_many(response, charges, rotations_deg=rotations)
    tuples = tuple(map(tuple, charges))
    assert_same(locate_many(response, tuples, rotations_deg=rotations), expected)
    columns = {name: charges[:, "ABCD".index(name)].tolist() for name in "CADB"}
    found = locate_many(response, columns, rotations_deg=rotations)
    assert found.values == pytest.approx(expected.values, abs=1e-3)
    columns["B"][3] = None
    found = locate_many(response, columns, rotations_deg=rotations)
    without = {name: [columns[name][3]] for name in "CAD"}
    alone = locate_many(response, without, rotations_deg=rotations[3:4])
    assert found.values[3] == pytest.approx(alone.values[0], abs=1e-3)
    assert found.deviations[3] == pytest.approx(alone.deviations[0], rel=1e-3)
    assert found.to_table()["remark"][3] == "no reading of B"
    others = np.delete(np.arange(len(charges)), 3)
    assert found.values[others] == pytest.approx(expected.values[others], abs=1e-3)


@pytest.mark.parametrize(
    ("readings", "options", "key"),
    [
        ({"A": [1.0], "E": [1.0]}, {}, r"readings\.E"),
        ({"A": [1.0], "B": [1.0, 2.0]}, {}, "readings"),
        ({}, {}, "readings"),
        ([[1.0] * 4, [1.0, 2.0, 3.0]], {}, "readings"),
        ({"A": [1.0, "broken"]}, {}, r"readings\.A"),
        (np.ones((2, 3)), {}, r"readings of shape \(2, 3\)"),
        (np.ones((2, 4)), {"forces_N": [1.0]}, r"forces_N of shape \(1,\)"),
        (np.ones((2, 4)), {"sigma": -1.0}, "sigma = -1"),
    ],
)
def test_a_table_that_cannot_be_used_is_rejected(readings, options, key):
    with pytest.raises(ValueError, match=f"^{key}"):
        locate_many(make_bump_response(), readings, **options)


def test_chunks_change_no_row_and_memory_does_not_grow_with_rows(monkeypatch):
    """Three times as many rows need no more memory than their results and inputs."""
    response, touches, charges = make_rows(4500)
    whole = locate_many(response, charges[:600], rotations_deg=touches[:600, 2])
    monkeypatch.setattr(module, "CHUNK_ROWS", 500)
    peaks = []
    for count in (1500, 4500):
        tracemalloc.start()
        found = locate_many(response, charges[:count], rotations_deg=touches[:count, 2])
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert (peaks[1] - peaks[0]) / 3000 < 400.0
    assert found.status[:600].tolist() == whole.status.tolist()
    np.testing.assert_allclose(found.values[:600], whole.values, atol=1e-2)


def test_more_candidates_of_a_row_find_a_touch_that_fits_no_worse():
    response = make_bump_response()
    charges, _ = response.evaluate(draw_uniform_touches(30, seed=3))
    problem = LocationProblem(response, np.arange(4), charges, 1e-3 * charges, np.arange(4))
    # the closest ends are duplicates: 3 % of the longest steps of 3 mm, 5 degrees and a factor e
    assert problem.merge_distances == pytest.approx([0.09, 0.09, 0.15, 0.03])
    first, best = (search_rows(problem, {}, count).chi_square for count in (1, 6))
    assert (best <= first + 1e-6).all()
    assert (first > 1.0).sum() > (best > 1.0).sum()

"""Touches from rows of charges, some of which cannot be used."""

import tracemalloc

import numpy as np
import pytest

from pvdf_fem.inverse.touch import locate_many as module
from pvdf_fem.inverse.touch.locate_many import locate_many
from tests.helpers.bump_response import draw_uniform_touches, make_bump_response

BAD = {
    "not_finite": [[np.nan, 1.0, 1.0, 1.0], [1.0, np.inf, 1.0, 1.0], [1.0, 1.0, None, 1.0]],
    "too_large": [[1e13, 1.0, 1.0, 1.0], [1e300, 1.0, 1.0, -1e300], [1.7e308] * 4],
    "zero_charge": [[0.0, 0.0, 0.0, 0.0], [700.0, 0.0, 600.0, 500.0], [1e-300, 1.0, 1.0, 1.0]],
}


def rows(count=12):
    """A model, touches, and their charges with errors of 1 %."""
    model, touches = (
        make_bump_response("rectangle"),
        draw_uniform_touches(count, seed=2, reach_mm=10.0),
    )
    factors = 1.0 + 0.01 * np.random.default_rng(4).standard_normal((count, 4))
    return model, touches, model.evaluate(touches)[0] * factors


def same(found, expected, chosen=slice(None)):
    for name in ("values", "covariances", "determined", "chi_square", "p_value", "at_edge"):
        np.testing.assert_array_equal(getattr(found, name)[chosen], getattr(expected, name))


def test_a_bad_row_has_its_status_and_changes_no_other():
    model, touches, charges = rows()
    bad = [row for each in BAD.values() for row in each]
    statuses = [name for name, each in BAD.items() for _ in each] + ["located"] * len(charges)
    order = np.random.default_rng(5).permutation(len(statuses))
    known = np.concatenate([np.zeros(len(bad)), touches[:, 2]])[order]
    mixed = [[*bad, *charges.tolist()][i] for i in order]
    found = locate_many(model, mixed, rotations_deg=known.tolist())
    assert found.status.tolist() == [statuses[i] for i in order]
    good = np.argsort(order)[len(bad) :]
    same(found, locate_many(model, charges, rotations_deg=touches[:, 2]), good)
    others = np.argsort(order)[: len(bad)]
    assert np.isnan(found.values[others]).all()
    assert np.isnan(found.covariances[others]).all()
    assert not (found.explained | found.determined | found.at_edge)[others].any()


def test_what_is_known_of_a_row_leaves_the_place_to_be_found_or_is_bad():
    model, touches, _ = rows()
    rotations, forces = touches[:, 2].copy(), touches[:, 3].copy()
    forces[1:5] = 7.0, np.nan, forces[3], -1.0
    rotations[3] = np.inf
    known = {"rotations_deg": rotations, "forces_N": forces}
    found = locate_many(model, model.evaluate(touches)[0], 1e-3, **known)
    outside, bad = "known_outside_domain", "not_finite"
    assert found.status[:6].tolist() == ["located", outside, bad, bad, outside, "located"]
    assert found.unknown == ("x_mm", "y_mm")
    assert found.values[5:] == pytest.approx(touches[5:], abs=1e-4)


def test_a_charge_of_zero_has_a_deviation_by_noise():
    model, touches, charges = rows(3)
    charges[1, 2], charges[2] = 0.0, 0.0
    found = locate_many(model, charges, rotations_deg=touches[:, 2], noise_pC=5.0)
    assert found.status.tolist() == ["located", "unexplained", "zero_charge"]


def test_columns_in_any_order_are_as_good_as_rows():
    model, touches, charges = rows()
    known = {"rotations_deg": tuple(touches[:, 2])}
    expected = locate_many(model, charges, **known)
    same(locate_many(model, tuple(map(tuple, charges)), **known), expected)
    columns = {name: charges[:, "ABCD".index(name)].tolist() for name in "CADB"}
    assert locate_many(model, columns, **known).values == pytest.approx(expected.values, abs=1e-3)
    columns["B"][3] = None
    found = locate_many(model, columns, **known)
    assert np.flatnonzero(found.status != "located").tolist() == [3]


@pytest.mark.parametrize(
    ("charges", "options", "key"),
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
def test_a_table_that_cannot_be_used_is_refused(charges, options, key):
    with pytest.raises(ValueError, match=f"^{key}"):
        locate_many(make_bump_response(), charges, **options)


def test_chunks_change_no_row_and_memory_does_not_grow_with_rows(monkeypatch):
    """Three times as many rows take no more than their results and inputs need."""
    model, touches, charges = rows(4500)
    whole = locate_many(model, charges[:600], rotations_deg=touches[:600, 2])
    monkeypatch.setattr(module, "CHUNK_ROWS", 500)
    peaks = []
    for count in (1500, 4500):
        tracemalloc.start()
        found = locate_many(model, charges[:count], rotations_deg=touches[:count, 2])
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert (peaks[1] - peaks[0]) / 3000 < 400.0
    assert found.status[:600].tolist() == whole.status.tolist()
    np.testing.assert_allclose(found.values[:600], whole.values, atol=1e-2)

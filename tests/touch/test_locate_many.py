"""Touches from rows of charges, some of which cannot be used."""

import tracemalloc

import numpy as np
import pytest

from pvdf_fem.touch import locate_many as module
from pvdf_fem.touch.locate import locate
from pvdf_fem.touch.locate_many import locate_many
from pvdf_fem.touch.touch import TouchStatus
from tests.helpers.touch_models import bumps, random_touches

BAD = {
    "not_finite": [[np.nan, 1.0, 1.0, 1.0], [1.0, np.inf, 1.0, 1.0], [1.0, 1.0, None, 1.0]],
    "too_large": [[1e13, 1.0, 1.0, 1.0], [1e300, 1.0, 1.0, -1e300], [1e308, 1e308, 1e308, 1e308]],
    "zero_charge": [[0.0, 0.0, 0.0, 0.0], [700.0, 0.0, 600.0, 500.0], [1e-300, 1.0, 1.0, 1.0]],
}


def rows(count=12):
    """A model, touches, and their charges with errors of 1 %."""
    model, touches = bumps("rectangle"), random_touches(count, seed=2, reach_mm=10.0)
    factors = 1.0 + 0.01 * np.random.default_rng(4).standard_normal((count, 4))
    return model, touches, model.evaluate(touches)[0] * factors


def same(found, expected, chosen=slice(None)):
    for name in ("values", "covariances", "determined", "chi_square", "p_value", "at_edge"):
        np.testing.assert_array_equal(getattr(found, name)[chosen], getattr(expected, name))


def test_a_bad_row_has_its_status_and_changes_no_other():
    model, touches, charges = rows()
    bad = [(row, name) for name, each in BAD.items() for row in each]
    mixed, good = [], []
    for k, row in enumerate(charges.tolist()):
        mixed += [one for one, _ in bad[k : k + 1]]
        good.append(len(mixed))
        mixed.append(row)
    mixed += [one for one, _ in bad[len(charges) :]]
    expected = np.full(len(mixed), "located", dtype=object)
    expected[np.setdiff1d(np.arange(len(mixed)), good)] = [name for _, name in bad]
    known = np.zeros(len(mixed))
    known[good] = touches[:, 2]
    found = locate_many(model, mixed, rotations_deg=known.tolist())
    assert found.status.tolist() == expected.tolist()
    same(found, locate_many(model, charges, rotations_deg=touches[:, 2]), good)
    others = found.status != TouchStatus.LOCATED
    assert np.isnan(found.values[others]).all()
    assert np.isnan(found.covariances[others]).all()
    assert not found.explained[others].any()
    assert not (found.determined | found.at_edge)[others].any()


def test_what_is_known_of_a_row_may_be_bad():
    model, touches, charges = rows(6)
    rotations, forces = touches[:, 2].copy(), touches[:, 3].copy()
    forces[1], forces[2], rotations[3] = 7.0, np.nan, np.inf
    forces[4] = -1.0
    found = locate_many(model, charges, rotations_deg=rotations, forces_N=forces)
    assert found.status.tolist() == [
        "located",
        "known_outside_domain",
        "not_finite",
        "not_finite",
        "known_outside_domain",
        "located",
    ]


def test_rotations_of_any_size_are_taken_by_their_period():
    model, touches, charges = rows(3)
    turns = touches[:, 2] + [0.0, 180.0 * 2**40, -180.0 * 2**40]
    found = locate_many(model, charges, rotations_deg=turns)
    near = locate_many(model, charges, rotations_deg=touches[:, 2])
    assert found.values[:, [0, 1, 3]] == pytest.approx(near.values[:, [0, 1, 3]], rel=1e-2)
    turns[1] = 1e300
    far = locate_many(model, charges, rotations_deg=turns)
    same(far, locate_many(model, charges[::2], rotations_deg=turns[::2]), [0, 2])
    one = dict(zip(model.names, charges[1].tolist(), strict=True))
    assert np.isfinite(locate(model, one, known={"rotation_deg": 1e300}).best.values).all()


def test_a_charge_of_zero_has_a_deviation_by_noise():
    model, touches, charges = rows(3)
    charges[1, 2], charges[2] = 0.0, 0.0
    found = locate_many(model, charges, rotations_deg=touches[:, 2], noise_pC=5.0)
    assert found.status.tolist() == ["located", "unexplained", "zero_charge"]
    assert not found.explained[1]


def test_lists_tuples_and_columns_are_as_good_as_arrays():
    model, touches, charges = rows()
    known, expected = touches[:, 2], locate_many(model, charges, rotations_deg=touches[:, 2])
    columns = {name: charges[:, k].tolist() for k, name in enumerate("ABCD")}
    shuffled = {name: tuple(columns[name]) for name in "CADB"}
    same(locate_many(model, charges.tolist(), rotations_deg=known.tolist()), expected)
    same(locate_many(model, tuple(map(tuple, charges)), rotations_deg=tuple(known)), expected)
    same(locate_many(model, columns, rotations_deg=known), expected)
    found = locate_many(model, shuffled, rotations_deg=known)
    assert found.values == pytest.approx(expected.values, abs=1e-3)
    columns["B"][3] = None
    found = locate_many(model, columns, rotations_deg=known)
    assert [k for k, status in enumerate(found.status) if status != "located"] == [3]


@pytest.mark.parametrize(
    ("charges", "options", "message"),
    [
        ({"A": [1.0], "E": [1.0]}, {}, "charges.E: no such electrode"),
        ({"A": [1.0], "B": [1.0, 2.0]}, {}, "columns differ in length"),
        ({}, {}, "none given"),
        ([[1.0] * 4, ["a lot", 1.0, 1.0, 1.0]], {}, "charges_pC: "),
        ([[1.0] * 4, [1.0, 2.0, 3.0]], {}, "charges_pC: "),
        ({"A": [1.0, "broken"]}, {}, "charges_pC.A: "),
        (np.ones((2, 3)), {}, r"give \(n, 4\)"),
        (np.ones((2, 4)), {"forces_N": [1.0]}, r"forces_N of shape \(1,\): give one per row"),
        (np.ones((2, 4)), {"sigma": -1.0}, "sigma = -1.0"),
    ],
)
def test_a_table_that_cannot_be_used_is_refused(charges, options, message):
    with pytest.raises(ValueError, match=message):
        locate_many(bumps(), charges, **options)


def test_no_rows_are_no_touches():
    found = locate_many(bumps(), np.empty((0, 4)))
    assert found.values.shape == (0, 4)
    assert found.covariances.shape == (0, 4, 4)


def test_memory_beyond_the_result_does_not_grow_with_the_rows(monkeypatch):
    """Three times as many rows take no more than their results and inputs need."""
    monkeypatch.setattr(module, "CHUNK", 500)
    peaks = []
    for count in (2000, 6000):
        model, touches, charges = rows(count)
        locate_many(model, charges[:10], rotations_deg=touches[:10, 2])
        tracemalloc.start()
        locate_many(model, charges, rotations_deg=touches[:, 2])
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    per_row = (peaks[1] - peaks[0]) / 4000
    assert per_row < 400.0

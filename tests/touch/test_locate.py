"""Touches from charges, with made-up models whose symmetries are known."""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from pvdf_fem.response.model import QUANTITIES
from pvdf_fem.touch.least_squares import SearchOptions
from pvdf_fem.touch.locate import locate, weigh
from pvdf_fem.touch.locate_many import locate_many
from pvdf_fem.touch.search import LocateOptions
from tests.helpers.touch_models import Bumps, bumps, random_touches

ALL = ("x_mm", "y_mm", "rotation_deg", "force_N")
PERIODS_DEG = {"triangle": 120.0, "rectangle": 180.0}


@dataclass(frozen=True, eq=False)
class Counted(Bumps):
    """A model that counts the touches of each evaluation."""

    calls: list[int] = field(default_factory=list)

    def evaluate(self, touches):
        self.calls.append(len(touches))
        return super().evaluate(touches)


def charges_of(model, touch, noise=None):
    charges = model.evaluate(np.atleast_2d(touch))[0][0]
    return dict(zip(model.names, (charges * (1 if noise is None else noise)).tolist(), strict=True))


def slopes_of(model, touch):
    """Central differences of the charges by x, y, rotation and force, (electrodes, 4)."""
    steps = np.diag([1e-4, 1e-4, 1e-3, 1e-5])
    ahead, back = (model.evaluate(touch + sign * steps)[0] for sign in (1, -1))
    return ((ahead - back) / (2.0 * np.diag(steps)[:, None])).T


@pytest.mark.parametrize("shape", ["triangle", "rectangle", "circle"])
@pytest.mark.parametrize("electrodes", [3, 4, 6])
def test_the_touch_is_found_from_exact_charges(shape, electrodes):
    model = bumps(shape, electrodes)
    for touch in random_touches(40, seed=electrodes):
        found = locate(model, charges_of(model, touch), 1e-3, known={"rotation_deg": touch[2]})
        # three charges fit a second touch here and there
        nearest = min(found.touches, key=lambda t: np.hypot(*(t.values - touch)[:2]))
        assert nearest.values == pytest.approx(touch, rel=1e-5, abs=1e-5)
        assert nearest.chi_square < 1e-6
        if electrodes > 3:
            assert nearest is found.best
            assert not found.ambiguous


@pytest.mark.parametrize("shape", ["triangle", "rectangle"])
def test_all_touches_with_an_unknown_rotation_are_listed(shape):
    """As many charges as unknown quantities: several touches may give them exactly."""
    model, period = bumps(shape), PERIODS_DEG[shape]
    several = 0
    for touch in random_touches(30, seed=5):
        found = locate(model, charges_of(model, touch), 1e-3, unknown=ALL)
        several += found.ambiguous
        inside = [one for one in found.touches if not one.at_edge]
        assert all(0.0 <= one.rotation_deg < period for one in inside)
        fits = [charges_of(model, one.values) for one in inside if one.chi_square < 1e-6]
        assert fits
        assert all(fit == pytest.approx(charges_of(model, touch), rel=1e-4) for fit in fits)
        apart = np.array([one.values for one in found.touches]) - touch
        apart[:, 2] -= period * np.round(apart[:, 2] / period)
        # two touches about to become one are listed as one
        assert (np.abs(apart) < [0.05, 0.05, 5.0, 0.02]).all(axis=1).any()
    assert several > 10


@pytest.mark.parametrize(
    ("shape", "rows"), [("rectangle", [47, 168, 451]), ("triangle", [62, 128, 162, 201])]
)
def test_touches_at_the_end_of_winding_valleys_are_listed(shape, rows):
    """Long steps of the rotation, and searches that go on as one too early, miss these."""
    model, period = bumps(shape), PERIODS_DEG[shape]
    for touch in random_touches(600, seed=1)[rows]:
        found = locate(model, charges_of(model, touch), 1e-3, unknown=ALL)
        apart = np.array([one.values for one in found.touches]) - touch
        apart[:, 2] -= period * np.round(apart[:, 2] / period)
        assert (np.abs(apart) < [0.01, 0.01, 0.1, 0.01]).all(axis=1).any()


@pytest.mark.parametrize(
    "unknown", [("force_N",), ("x_mm",), ("rotation_deg",), ("y_mm", "force_N")]
)
def test_any_quantities_may_be_known(unknown):
    model, touch = bumps("rectangle"), np.array([3.0, -4.0, 25.0, 0.7])
    known = {n: v for n, v in zip(QUANTITIES, touch, strict=True) if n not in unknown}
    found = locate(model, charges_of(model, touch), 1e-3, unknown=unknown, known=known)
    assert found.best.values == pytest.approx(touch, abs=1e-4)
    assert found.best.unknown == unknown
    assert not found.ambiguous


def test_a_missing_electrode_is_left_out():
    model, touch = bumps("circle"), np.array([3.0, -4.0, 0.0, 0.7])
    charges = charges_of(model, touch)
    del charges["B"]
    found = locate(model, charges, 1e-3)
    assert found.degrees_of_freedom == 0
    assert np.isnan(found.best.p_value)
    assert found.best.explained
    apart = min(np.hypot(*(one.values - touch)[:2]) for one in found.touches)
    assert apart < 1e-4


def test_exact_charges_take_few_evaluations():
    """Starts are so close, and searches end so soon, that a call takes a millisecond."""
    model, calls = Counted(**vars(bumps("triangle"))), []
    for touch in random_touches(60, seed=8):
        charges, known = charges_of(model, touch), {"rotation_deg": touch[2]}
        locate(model, charges, 1e-3, known=known)  # makes the table of starts
        model.calls.clear()
        locate(model, charges, 1e-3, known=known)
        calls.append(list(model.calls))
    assert np.median([len(each) for each in calls]) <= 3
    assert np.median([sum(each) for each in calls]) <= 12


@dataclass(frozen=True, eq=False)
class Folded(Bumps):
    """Charges that are nearly even in x."""

    def evaluate(self, touches):
        x, y, _, F = touches.T
        none, one = np.zeros_like(x), np.ones_like(x)
        by_place = [10.0 + y, 10.0 - y, 10.0 + 0.1 * x**2, 10.0 + 2e-4 * x]
        by_x, by_y = [none, none, 0.2 * x, 2e-4 * one], [one, -one, none, none]
        slopes = [[F * a, F * b, none, Q] for Q, a, b in zip(by_place, by_x, by_y, strict=True)]
        return (F * by_place).T, np.moveaxis(np.array(slopes), -1, 0)


@pytest.mark.parametrize("x", [-0.2, -0.05, 0.05, 0.2])
def test_both_sides_of_a_fold_are_searched(x):
    """From either side alone the search ends there, chi-square being a little larger or not."""
    model, touch = Folded(**vars(bumps("circle"))), np.array([x, 1.3, 0.0, 1.0])
    found = locate(model, charges_of(model, touch), 1e-5, known={"rotation_deg": 0.0})
    assert found.best.values == pytest.approx(touch, abs=1e-3)


def test_mirror_images_are_both_listed():
    """Two electrodes on a line, the force known: places mirror each other at it."""
    model, touch = bumps("circle", 2), np.array([3.0, 4.0, 0.0, 1.0])
    found = locate(model, charges_of(model, touch), unknown=("x_mm", "y_mm"))
    assert found.ambiguous
    assert [one.weight for one in found.touches] == pytest.approx([0.5, 0.5], abs=1e-6)
    assert sorted(one.y_mm for one in found.touches) == pytest.approx([-4.0, 4.0], abs=1e-5)
    assert [one.x_mm for one in found.touches] == pytest.approx([3.0, 3.0], abs=1e-5)
    assert "ambiguous: 2 touches are likely" in found.remarks


@dataclass(frozen=True, eq=False)
class Cubic(Bumps):
    """Charges that three places along x have, with slopes of 4.8, -1.2 and 1.6 pC/mm."""

    def evaluate(self, touches):
        x = touches[:, 0]
        charges, slopes = super().evaluate(touches)
        charges[:] = (100.0 + 0.1 * (x + 6.0) * x * (x - 2.0))[:, None]
        slopes[:] = 0.0
        slopes[:, :, 0] = (0.1 * (3.0 * x**2 + 8.0 * x - 12.0))[:, None]
        return charges, slopes


def test_rivals_weigh_as_much_as_the_places_that_fit():
    """The width of a place is inverse to its slope: 1 to 4 to 3."""
    model, known = Cubic(**vars(bumps("circle", 2))), dict.fromkeys(("y_mm", "rotation_deg"), 0.0)
    charges = dict.fromkeys(model.names, 100.0)
    found = locate(model, charges, 1e-3, unknown=["x_mm"], known={**known, "force_N": 1.0})
    by_place = {round(one.x_mm, 2): one.weight for one in found.touches}
    assert by_place == pytest.approx({-6.0: 1 / 8, 0.0: 1 / 2, 2.0: 3 / 8}, rel=1e-3)


def test_charges_that_undo_each_other_name_the_free_direction():
    """Four electrodes at one place tell a distance and nothing else."""
    model, touch = bumps("circle", 4), np.array([3.0, 4.0, 0.0, 1.0])
    model = replace(model, electrodes_mm=np.tile(model.electrodes_mm[:1], (4, 1)))
    best = locate(model, charges_of(model, touch), unknown=("x_mm", "y_mm")).best
    assert not best.determined
    [free] = best.null_directions
    slopes = slopes_of(model, best.values)[:, :2]
    assert np.sqrt(free @ np.linalg.solve(best.covariance, free)) == pytest.approx(1.0, rel=1e-3)
    assert slopes @ free == pytest.approx(np.zeros(4), abs=1e-4 * np.abs(slopes * free).max())


@pytest.mark.parametrize("electrodes", [1, 2])
def test_fewer_charges_than_unknowns_are_undetermined(electrodes):
    model, touch = bumps("circle", electrodes), np.array([3.0, 4.0, 0.0, 1.0])
    charges = charges_of(model, touch)
    found = locate(model, charges)
    assert (found.status, found.touches) == ("undetermined", ())
    assert found.to_json()["touches"] == []
    assert not found.explained
    assert len(found.remarks) == 1
    rows = locate_many(model, [[*charges.values()]], rotations_deg=[0.0])
    assert rows.status.tolist() == ["undetermined"]
    assert not rows.explained.any()
    assert np.isnan(rows.values).all()
    # one charge tells the force at a known place
    known = dict(zip(QUANTITIES[:3], touch, strict=False))
    assert locate(model, charges, unknown=["force_N"], known=known).best.force_N == pytest.approx(1)


def test_a_disc_has_no_rotation():
    model, touch = bumps("circle"), np.array([3.0, 4.0, 0.0, 1.0])
    found = locate(model, charges_of(model, touch), unknown=ALL)
    assert found.best.values[[0, 1, 3]] == pytest.approx(touch[[0, 1, 3]], abs=1e-5)
    assert not found.best.determined
    assert found.best.null_directions[0][[0, 1, 3]] == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    known = locate(model, charges_of(model, touch)).best
    for name, deviation in known.deviations.items():
        assert found.best.deviations[name] == pytest.approx(deviation, rel=1e-2)
    assert found.best.deviations["rotation_deg"] == pytest.approx(180.0)
    assert found.remarks == ("rotation is not determined; place and force are",)
    # any rotation is as likely
    assert found.deviations["rotation_deg"] == pytest.approx(0.6827 * 180.0, rel=0.08)


@pytest.mark.parametrize(
    ("shape", "size", "sigma"), [("triangle", 1.0, 0.01), ("triangle", 0.05, 1e-3)]
)
def test_touches_at_one_place_leave_the_rotation_open(shape, size, sigma):
    """Triangles at the centre of four electrodes, one of them nearly a point: several rotations."""
    model, touch = bumps(shape), np.array([0.0, 0.0, 20.0, 1.0])
    model = replace(model, points_mm=size * model.points_mm)
    found = locate(model, charges_of(model, touch), sigma, unknown=ALL)
    turns = [one.rotation_deg for one in found.touches if one.weight > 0.01]
    assert np.ptp(turns) > 30.0
    assert (found.status, found.alternatives) == ("located", 0)
    assert found.remarks == ("rotation is not determined; place and force are",)
    off = np.abs(found.best.values - touch)[[0, 1, 3]]
    sizes = [found.deviations[name] for name in ("x_mm", "y_mm", "force_N")]
    assert (off < 3.0 * np.array(sizes)).all()


def test_a_turned_touch_elsewhere_stays_ambiguous():
    """A rectangle beside the centre, and its image in the line of two electrodes."""
    model, touch = bumps("rectangle"), np.array([0.5, 0.2, 20.0, 1.0])
    found = locate(model, charges_of(model, touch), 1e-3, unknown=ALL)
    assert (found.status, found.alternatives) == ("ambiguous", 1)
    at_centre = locate(model, charges_of(model, touch * [0, 0, 1, 1]), 1e-3, unknown=ALL)
    assert (at_centre.status, len(at_centre.touches)) == ("located", 2)
    assert at_centre.deviations["rotation_deg"] > 30.0


def test_without_freedom_the_weight_ranks_touches():
    """Chi-square of exact charges is zero but for where the searches stop."""
    model = bumps("triangle")
    for touch in random_touches(30, seed=5):
        found = locate(model, charges_of(model, touch), 1e-3, unknown=ALL)
        ranks = [(one.explained, one.weight) for one in found.touches]
        assert ranks == sorted(ranks, reverse=True)


def test_the_covariance_is_the_inverse_information():
    """Against the Fisher information with slopes by central differences."""
    model, touch = bumps("rectangle", 6), np.array([3.0, -4.0, 25.0, 0.7])
    charges = charges_of(model, touch)
    # slopes are those before the last step
    options = LocateOptions(search=SearchOptions(arrived=1e-8))
    best = locate(model, charges, 0.02, unknown=ALL, noise_pC=3.0, options=options).best
    q = np.array(list(charges.values()))
    variance = (0.02**2 + 1e-8 / 3.0) * q**2 + 9.0
    slopes = slopes_of(model, touch)
    expected = np.linalg.inv(slopes.T @ (slopes / variance[:, None]))
    assert best.covariance == pytest.approx(expected, rel=1e-4)


@pytest.fixture(scope="module")
def noisy():
    model, touches = bumps("rectangle"), random_touches(4000, seed=3, reach_mm=11.0)
    touches[:, 3] = np.clip(touches[:, 3], 0.13, 4.0)
    factors = 1.0 + 0.01 * np.random.default_rng(4).standard_normal((len(touches), 4))
    charges = model.evaluate(touches)[0] * factors
    return model, touches, locate_many(model, charges, 0.01, rotations_deg=touches[:, 2]), charges


def test_stated_deviations_are_calibrated(noisy):
    """68.3 % within one standard deviation: of 4000, ±2.5 % are more than three of its own."""
    _, touches, found, _ = noisy
    errors = np.abs(found.values - touches)[:, [0, 1, 3]]
    within = errors < np.sqrt(np.einsum("nuu->nu", found.covariances))
    assert within.mean(axis=0) == pytest.approx(0.6827, abs=0.025)


def test_errors_are_calibrated_where_the_likelihood_has_two_maxima():
    """Two electrodes on a line tell y but for its sign: the likeliest is the wrong one or not."""
    model, touches = bumps("circle", 2), random_touches(200, seed=9, reach_mm=11.0)
    touches[:, 1] = np.abs(touches[:, 1])
    factors = 1.0 + 0.02 * np.random.default_rng(10).standard_normal((len(touches), 2))
    sign = np.random.default_rng(11).choice([-1.0, 1.0], len(touches))
    within, alone = [], []
    for touch, factor, side in zip(touches, factors, sign, strict=True):
        touch[1] *= side
        found = locate(
            model,
            charges_of(model, touch, factor),
            0.02,
            unknown=("x_mm", "y_mm"),
            known={"force_N": touch[3]},
        )
        error = np.abs([one.values - touch for one in found.touches])[:, :2]
        within.append(error[0] < list(found.deviations.values()))
        curved = [list(one.deviations.values()) for one in found.touches]
        alone.append(np.mean(error < curved, axis=0))
    # three standard deviations of a share of 200 are 0.1
    assert np.mean(within, axis=0) == pytest.approx(0.6827, abs=0.1)
    assert np.mean(alone, axis=0)[1] < 0.5


def ring_of_folds(count, seed):
    """Touches of a disc 9 to 12 mm from the centre, where charges' rise turns, and locations."""
    model, draw = bumps("circle", width_mm=4.0), np.random.default_rng(seed)
    r, a = np.sqrt(81.0 + 63.0 * draw.random(count)), 2.0 * np.pi * draw.random(count)
    force = 0.1 * 50.0 ** draw.random(count)
    touches = np.stack([r * np.cos(a), r * np.sin(a), np.zeros(count), force], axis=1)
    factors = 1.0 + 0.01 * draw.standard_normal((count, 4))
    pairs = zip(touches, factors, strict=True)
    return touches, [locate(model, charges_of(model, touch, factor)) for touch, factor in pairs]


def effective_draws(location):
    """Number of independent draws that would tell as much as the posterior's (Kong 1992)."""
    return 1.0 / np.square(location.posterior.weights).sum()


def test_errors_that_are_told_are_calibrated_along_folds():
    """By the curvature alone a third is within them near the edge; ±12 % are two of 56's own."""
    touches, locations = ring_of_folds(300, seed=1)
    best = np.array([found.best.values for found in locations])
    outer = np.flatnonzero(np.hypot(best[:, 0], best[:, 1]) > 11.5)
    told = [locations[k].to_json()["touches"][0]["standard_deviations"] for k in outer]
    errors = np.abs(best - touches)[outer][:, [0, 1, 3]]
    within = errors < [list(sizes.values()) for sizes in told]
    assert within.mean(axis=0) == pytest.approx(0.6827, abs=0.12)


def test_draws_follow_ridges_of_the_likelihood():
    """From the maxima alone a tenth of the posteriors had fewer than 30 effective draws."""
    _, locations = ring_of_folds(60, seed=2)
    effective = [effective_draws(found) for found in locations]
    assert np.percentile(effective, 10) > 60.0
    assert np.median(effective) > 250.0


def test_where_charges_are_linear_the_posterior_is_normal():
    model, touch = bumps("rectangle", 6), np.array([3.0, -4.0, 25.0, 0.7])
    found = locate(model, charges_of(model, touch), 1e-3, unknown=ALL)
    assert effective_draws(found) > 300.0
    for name, deviation in found.best.deviations.items():
        assert found.deviations[name] == pytest.approx(deviation, rel=0.1)
    sizes = np.array(list(found.best.deviations.values()))
    local, whole = (c / np.outer(sizes, sizes) for c in (found.best.covariance, found.covariance))
    assert whole == pytest.approx(local, abs=0.2)
    assert np.sqrt(np.diag(found.covariance)) == pytest.approx(list(found.deviations.values()))


def test_p_values_are_evenly_distributed(noisy):
    _, _, found, _ = noisy
    shares = np.histogram(found.p_value, 10, (0.0, 1.0))[0] / len(found.p_value)
    assert shares == pytest.approx(0.1, abs=0.02)
    assert (~found.explained).mean() < 0.004


def test_errors_are_those_of_the_cramer_rao_bound(noisy):
    model, touches, found, charges = noisy
    slopes = model.evaluate(touches)[1][:, :, [0, 1, 3]] / (0.01 * charges)[:, :, None]
    bound = np.linalg.inv(slopes.swapaxes(1, 2) @ slopes)
    errors = np.square((found.values - touches)[:, :2]).sum(axis=1)
    ratio = np.sqrt(errors.sum() / (bound[:, 0, 0] + bound[:, 1, 1]).sum())
    assert ratio == pytest.approx(1.0, abs=0.06)


def test_one_and_many_agree(noisy):
    model, touches, found, charges = noisy
    for k in range(0, 4000, 200):
        one = locate(
            model,
            dict(zip(model.names, charges[k].tolist(), strict=True)),
            known={"rotation_deg": touches[k, 2]},
        ).best
        assert one.values == pytest.approx(found.values[k], abs=2e-3)
        deviations = np.array(list(one.deviations.values()))
        sizes = np.outer(deviations, deviations)
        assert one.covariance / sizes == pytest.approx(found.covariances[k] / sizes, abs=1e-2)
        assert one.chi_square == pytest.approx(found.chi_square[k], abs=1e-2)


def test_many_with_known_forces_find_the_place(noisy):
    model, touches, *_ = noisy
    some = touches[:200]
    found = locate_many(
        model, model.evaluate(some)[0], 1e-3, rotations_deg=some[:, 2], forces_N=some[:, 3]
    )
    assert found.unknown == ("x_mm", "y_mm")
    assert found.values == pytest.approx(some, abs=1e-4)


def test_charges_that_no_touch_gives_are_flagged():
    """A and C, on opposite sides, 20 % too large; errors of 1 %."""
    model, touch = bumps("circle"), np.array([3.0, -4.0, 0.0, 1.0])
    noise = np.array([1.2, 1.0, 1.2, 1.0])
    found = locate(model, charges_of(model, touch, noise))
    assert not found.best.explained
    assert found.status == "unexplained"
    many = locate_many(
        model, np.array([list(charges_of(model, touch, noise).values())]), rotations_deg=np.zeros(1)
    )
    assert not many.explained[0]
    assert many.chi_square[0] == pytest.approx(found.best.chi_square, rel=1e-3)


def test_a_touch_beyond_the_domain_is_at_its_edge():
    model = bumps("circle")
    far = locate(model, charges_of(model, np.array([11.0, 9.0, 0.0, 1.0])))
    assert far.best.at_edge == ("reach_mm",)
    strong = locate(model, charges_of(model, np.array([3.0, 2.0, 0.0, 20.0])))
    assert "force_N" in strong.best.at_edge
    assert any("may lie beyond" in text for text in strong.remarks)
    inner = locate(model, charges_of(model, np.array([11.9, 0.0, 0.0, 4.9])))
    assert inner.best.at_edge == ()


def test_the_model_is_never_asked_beyond_its_domain():
    asked = []

    class Watched(type(bumps())):
        def evaluate(self, touches):
            asked.append(touches.copy())
            return super().evaluate(touches)

    model = Watched(**vars(bumps()))
    for touch in ([11.0, 9.0, 0.0, 20.0], [-15.0, 3.0, 50.0, 0.02], [0.0, 0.0, 0.0, 30.0]):
        locate(model, charges_of(bumps(), np.array(touch)), unknown=ALL)
    x, y, _, force = np.concatenate(asked).T
    assert np.hypot(x, y).max() <= 12.0 * (1.0 + 1e-9)
    assert force.min() >= 0.1 * (1.0 - 1e-9)
    assert force.max() <= 5.0 * (1.0 + 1e-9)


def test_the_right_probe_is_chosen():
    """Six charges, unknown rotation: the fit of the wrong probe costs two degrees of freedom."""
    models = {shape: bumps(shape, 6) for shape in ("triangle", "rectangle", "circle")}
    for touch in random_touches(4, seed=8, reach_mm=9.0):
        for name, model in models.items():
            choices = weigh(models, charges_of(model, touch), 1e-3)
            assert sum(one.weight for one in choices) == pytest.approx(1.0)
            right = next(one for one in choices if one.name == name)
            assert right.weight > 0.05
            assert right.location.best.chi_square < 1.0
    sure = weigh(models, charges_of(models["rectangle"], np.array([4.0, 1.0, 20.0, 1.0])), 1e-3)
    assert (sure[0].name, round(sure[0].weight, 3)) == ("rectangle", 1.0)


# -------------------------------------------------------------------------------------- mistakes


def test_all_mistakes_are_told():
    with pytest.raises(ValueError, match="no such electrode") as told:
        locate(
            bumps(),
            {"A": 700.0, "E": 1.0, "B": np.nan},
            -0.1,
            unknown=("x_mm", "mass"),
            known={"x_mm": 3.0, "y_mm": 20.0, "force_N": 9.0},
        )
    assert str(told.value).splitlines() == [
        "charges.E: no such electrode; choose from A, B, C, D",
        "charges.B = nan: give a charge in pC",
        "sigma = -0.1: give a share of the charge, 0 to 1",
        "x_mm: both sought and known; remove one",
        "mass: no quantity of a touch; choose from x_mm, y_mm, rotation_deg, force_N",
        "known y_mm = 20: beyond the 12 mm that the model reaches; build a larger one",
        "known force_N = 9: out of the model's 0.1 to 5 N; build one for it",
    ]

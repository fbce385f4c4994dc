"""Errors of positions found from charges, exact and with noise, by the thesis's way and by ours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pvdf_fem.touch.locate import PLACE_AND_FORCE, locate
from pvdf_fem.touch.location import Location
from pvdf_fem.touch.touch import QUANTITIES, Model, Touch, period_deg
from reports.locating.models import distance_mm, rows_of, triangulated_mm

Array = NDArray[np.float64]

#: Relative standard deviations of the charges; 0: exact.
NOISES = (0.0, 0.005, 0.01, 0.02, 0.05)
#: What a model is told of exact charges: those of a solve have errors too.
LEAST_SIGMA = 5e-5
TRIANGULATED, TURNED = "triangulation, unturned", "triangulation, turned"
TOLD, LOCATED, FREE = "locate, force known", "locate", "locate, rotation unknown"
#: The ways, and what each knows.
WAYS = {
    TRIANGULATED: "the thesis's way: contours of the unturned probe at the known force",
    TURNED: "the same with contours of the probe as it is turned",
    TOLD: "maximum likelihood of the place, force and rotation known: as much as that is told",
    LOCATED: "maximum likelihood of place and force, the rotation known",
    FREE: "maximum likelihood of place, force and rotation: the likeliest touch",
}
#: What maximum likelihood seeks.
SOUGHT = {TOLD: ("x_mm", "y_mm"), LOCATED: PLACE_AND_FORCE, FREE: QUANTITIES}
_NONE: NDArray[np.bool_] = np.zeros((0, 0), dtype=bool)


def random_touches(count: int, seed: int, reach_mm: float, forces_N: tuple[float, float]) -> Array:
    """Touches (count, 4): places evenly over a disc, any rotation, any magnitude of the force."""
    draw = np.random.default_rng(seed)
    places, (lowest, highest) = over_disc(draw, count, reach_mm), forces_N
    forces = lowest * (highest / lowest) ** draw.random(count)
    return np.column_stack([places, 360.0 * draw.random(count), forces])


def over_disc(random: np.random.Generator, count: int, radius_mm: float) -> Array:
    """Places (count, 2) drawn evenly over a disc about the origin."""
    r, a = radius_mm * np.sqrt(random.random(count)), 2.0 * np.pi * random.random(count)
    return np.stack([r * np.cos(a), r * np.sin(a)], axis=1)


@dataclass(frozen=True, eq=False)
class Trial:
    """Touches of one probe with their exact charges.

    Attributes
    ----------
    model : Model
    electrodes : dict
        The model's names of the electrodes, by the thesis's.
    touches : ndarray, shape (n, 4)
    charges_pC : ndarray, shape (n, electrodes)
        From the finite-element model.
    """

    model: Model
    electrodes: Mapping[str, str]
    touches: Array
    charges_pC: Array

    def noisy(self, noise: float, seed: int = 7) -> Array:
        """The charges with independent relative errors."""
        draw = np.random.default_rng(seed).standard_normal(self.charges_pC.shape)
        return self.charges_pC * (1.0 + noise * draw)

    @property
    def rows(self) -> list[int]:
        """Places of the electrodes in the model's charges."""
        return rows_of(self.model, self.electrodes)


@dataclass(frozen=True, eq=False)
class Errors:
    """What a way made of a trial at one noise.

    Attributes
    ----------
    way : str
    noise : float
    place_mm : ndarray, shape (n,)
        Distances from the true places; NaN where no place was found.
    force : ndarray, shape (n,)
        Relative errors of the force; NaN where it is not sought.
    within, locally : ndarray of bool, shape (n, unknown)
        Which errors are below one standard deviation: calibrated, and by the curvature of the
        likelihood alone. None where there is no noise, or no deviation is stated.
    """

    way: str
    noise: float
    place_mm: Array
    force: Array
    within: NDArray[np.bool_]
    locally: NDArray[np.bool_]


def triangulated(trial: Trial, noise: float, turned: bool) -> Errors:
    """The thesis's way, which is told the force, and the rotation if `turned`."""
    places = [
        triangulated_mm(trial.model, trial.electrodes, charges, rotation if turned else 0.0, force)
        for (*_, rotation, force), charges in zip(
            trial.touches.tolist(), trial.noisy(noise), strict=True
        )
    ]
    errors = np.linalg.norm(np.array(places) - trial.touches[:, :2], axis=1)
    none = np.full(len(errors), np.nan)
    return Errors(TURNED if turned else TRIANGULATED, noise, errors, none, _NONE, _NONE)


def located(trial: Trial, noise: float, way: str = LOCATED) -> Errors:
    """Maximum likelihood, told what it does not seek."""
    names = list(trial.electrodes.values())
    sigma = max(noise, LEAST_SIGMA)
    found = []
    for touch, charges in zip(trial.touches, trial.noisy(noise), strict=True):
        given = dict(zip(names, charges.tolist(), strict=True))
        values = dict(zip(QUANTITIES, touch.tolist(), strict=True))
        known = {name: value for name, value in values.items() if name not in SOUGHT[way]}
        found.append(locate(trial.model, given, sigma, unknown=SOUGHT[way], known=known))
    errors = np.array(
        [_error(trial, touch, one) for touch, one in zip(trial.touches, found, strict=True)]
    )
    place, force = np.hypot(errors[:, 0], errors[:, 1]), errors[:, 3] / trial.touches[:, 3]
    if not noise:
        return Errors(way, noise, place, force, _NONE, _NONE)
    sought = [QUANTITIES.index(name) for name in SOUGHT[way]]
    stated = np.array(
        [
            [list(of.deviations.values()) for of in (one, one.best)]
            if one.touches
            else np.full((2, len(sought)), np.nan)
            for one in found
        ]
    )
    within = np.abs(errors[:, None, sought]) < stated
    return Errors(way, noise, place, force, within[:, 0], within[:, 1])


def _error(trial: Trial, touch: Array, found: Location) -> Array:
    """The best touch less the true one, (4,); NaN if no search ended."""
    if not found.touches:
        return np.full(4, np.nan)
    apart, period = found.best.values - touch, period_deg(trial.model)
    apart[2] -= period * np.round(apart[2] / period)
    return apart


def bounds_mm(trial: Trial, noise: float, way: str = LOCATED, draws: int = 64) -> Array:
    """Errors (n·draws,) of the place that the Cramér-Rao bound of each touch gives.

    Normal errors with the bound's covariance: what an unbiased way could do at best.
    """
    sought = [QUANTITIES.index(name) for name in SOUGHT[way]]
    slopes = trial.model.evaluate(trial.touches)[1][:, trial.rows][:, :, sought]
    scaled = slopes / (max(noise, LEAST_SIGMA) * trial.charges_pC)[:, :, None]
    covariance = np.linalg.pinv(scaled.swapaxes(1, 2) @ scaled, hermitian=True)[:, :2, :2]
    root = np.linalg.cholesky(covariance + 1e-18 * np.eye(2))
    normal = np.random.default_rng(11).standard_normal((len(slopes), 2, draws))
    return np.linalg.norm(root @ normal, axis=1).ravel()


@dataclass(frozen=True)
class Listed:
    """How often the true touch was listed when the rotation was unknown, of how many.

    Attributes
    ----------
    touches, found, unique, undetermined : int
        All touches; those with the true one in the list; those whose list has no other likely
        one; those whose charges do not determine the rotation, and are said not to.
    """

    touches: int
    found: int
    unique: int
    undetermined: int


def listed(trial: Trial, near_mm: float = 0.1) -> Listed:
    """`locate` with the rotation unknown and exact charges.

    A true touch is found if it is listed within `near_mm`, or within three standard deviations,
    or if the touch listed nearby is said to be undetermined.
    """
    found = unique = undetermined = 0
    names = list(trial.electrodes.values())
    for touch, charges in zip(trial.touches, trial.charges_pC, strict=True):
        given = dict(zip(names, charges.tolist(), strict=True))
        result = locate(trial.model, given, LEAST_SIGMA, unknown=QUANTITIES)
        near = [one for one in result.touches if _near(one, touch, near_mm)]
        found += bool(near)
        unique += not result.ambiguous
        undetermined += any(not one.determined for one in result.touches)
    return Listed(len(trial.touches), found, unique, undetermined)


def _near(one: Touch, touch: Array, near_mm: float) -> bool:
    spread = np.hypot(one.deviations["x_mm"], one.deviations["y_mm"])
    return distance_mm(one.values, touch) < max(near_mm, 3.0 * float(spread))


def fractions(errors: Sequence[float] | Array) -> tuple[Array, Array]:
    """Errors in growing order and the share of all, failures included, that are no larger."""
    known = np.sort(np.asarray(errors)[np.isfinite(errors)])
    return known, (np.arange(len(known)) + 1.0) / max(len(errors), 1)

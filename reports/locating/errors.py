"""Errors of positions that the thesis's way and maximum likelihood find from charges."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pvdf_fem.response.model import QUANTITIES, Model, period_deg
from pvdf_fem.touch.locate import PLACE_AND_FORCE, locate
from pvdf_fem.touch.location import Location
from pvdf_fem.touch.touch import Touch
from reports.locating.models import distance_mm, rows_of, triangulated_mm

Array = NDArray[np.float64]

#: Relative standard deviations of the charges' noise; 0 stands for exact charges.
NOISES = (0.0, 0.005, 0.01, 0.02, 0.05)
#: Relative standard deviation stated for exact charges, since those of a solve have errors too.
LEAST_SIGMA = 5e-5
TRIANGULATED = "triangulation, unturned"
TURNED = "triangulation, turned"
TOLD = "locate, force known"
LOCATED = "locate"
FREE = "locate, rotation unknown"
#: Ways to find a touch, with what each of them knows.
WAYS = {
    TRIANGULATED: "the thesis's way: contours of the unturned probe at the known force",
    TURNED: "the same with contours of the probe as it is turned",
    TOLD: "maximum likelihood of the place, force and rotation known, as triangulation knows them",
    LOCATED: "maximum likelihood of place and force, the rotation known",
    FREE: "maximum likelihood of place, force and rotation: the likeliest touch",
}
#: Quantities of the touch that maximum likelihood seeks.
SOUGHT = {TOLD: ("x_mm", "y_mm"), LOCATED: PLACE_AND_FORCE, FREE: QUANTITIES}
_NONE: NDArray[np.bool_] = np.zeros((0, 0), dtype=bool)


def random_touches(count: int, seed: int, reach_mm: float, forces_N: tuple[float, float]) -> Array:
    """Draw touches (count, 4): places evenly over a disc, any rotation, forces evenly in log."""
    draw = np.random.default_rng(seed)
    places, (lowest, highest) = over_disc(draw, count, reach_mm), forces_N
    forces = lowest * (highest / lowest) ** draw.random(count)
    return np.column_stack([places, 360.0 * draw.random(count), forces])


def over_disc(random: np.random.Generator, count: int, radius_mm: float) -> Array:
    """Draw places (count, 2) evenly over a disc about the origin."""
    r, a = radius_mm * np.sqrt(random.random(count)), 2.0 * np.pi * random.random(count)
    return np.stack([r * np.cos(a), r * np.sin(a)], axis=1)


@dataclass(frozen=True, eq=False)
class Trial:
    """Touches of one probe with their exact charges.

    Attributes
    ----------
    model : Model
    electrodes : dict
        The model's names of the electrodes, by the thesis's names.
    touches : ndarray, shape (n, 4)
        x and y in mm, rotation in degrees, force in N.
    charges_pC : ndarray, shape (n, electrodes)
        Charges of the finite-element model.
    """

    model: Model
    electrodes: Mapping[str, str]
    touches: Array
    charges_pC: Array

    def noisy(self, noise: float, seed: int = 7) -> Array:
        """The charges with independent normal errors of relative size `noise`."""
        draw = np.random.default_rng(seed).standard_normal(self.charges_pC.shape)
        return self.charges_pC * (1.0 + noise * draw)

    @property
    def rows(self) -> list[int]:
        """Indices of the electrodes in the model's charges."""
        return rows_of(self.model, self.electrodes)


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors of one way on a trial at one noise.

    Attributes
    ----------
    way : str
    noise : float
    place_mm : ndarray, shape (n,)
        Distances from the true places; NaN where no place was found.
    force : ndarray, shape (n,)
        Relative errors of the force; NaN where it is not sought.
    within, locally : ndarray of bool, shape (n, unknown)
        Whether an error is below the calibrated standard deviation, and below the one from the
        curvature of the likelihood alone. Empty without noise, or if no deviation is stated.
    """

    way: str
    noise: float
    place_mm: Array
    force: Array
    within: NDArray[np.bool_]
    locally: NDArray[np.bool_]


def triangulated(trial: Trial, noise: float, turned: bool) -> Errors:
    """Errors of the thesis's way, which is told the force, and the rotation if `turned`."""
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
    """Errors of maximum likelihood, which is told the quantities that it does not seek."""
    names = list(trial.electrodes.values())
    sigma = max(noise, LEAST_SIGMA)
    locations = []
    for touch, charges in zip(trial.touches, trial.noisy(noise), strict=True):
        measured = dict(zip(names, charges.tolist(), strict=True))
        values = dict(zip(QUANTITIES, touch.tolist(), strict=True))
        known_values = {name: value for name, value in values.items() if name not in SOUGHT[way]}
        locations.append(
            locate(trial.model, measured, sigma, unknown=SOUGHT[way], known=known_values)
        )
    errors = np.array(
        [
            _error(trial, touch, location)
            for touch, location in zip(trial.touches, locations, strict=True)
        ]
    )
    place, force = np.hypot(errors[:, 0], errors[:, 1]), errors[:, 3] / trial.touches[:, 3]
    if not noise:
        return Errors(way, noise, place, force, _NONE, _NONE)
    sought = [QUANTITIES.index(name) for name in SOUGHT[way]]
    stated = np.array(
        [
            [
                list(touch_estimate.deviations.values())
                for touch_estimate in (location, location.best)
            ]
            if location.touches
            else np.full((2, len(sought)), np.nan)
            for location in locations
        ]
    )
    within = np.abs(errors[:, None, sought]) < stated
    return Errors(way, noise, place, force, within[:, 0], within[:, 1])


def _error(trial: Trial, touch: Array, location: Location) -> Array:
    """The best touch less the true one, (4,); NaN if no search ended."""
    if not location.touches:
        return np.full(4, np.nan)
    difference, period = location.best.values - touch, period_deg(trial.model)
    difference[2] -= period * np.round(difference[2] / period)
    return difference


def bounds_mm(trial: Trial, noise: float, way: str = LOCATED, draws: int = 64) -> Array:
    """Errors (n·draws,) of the place that the Cramér-Rao bound of each touch gives.

    They are drawn from normal distributions with the bound's covariance, which no unbiased way can
    fall below.
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
    """How often the true touch was listed when the rotation was unknown.

    Attributes
    ----------
    touches : int
        Number of all touches.
    found : int
        Number of touches whose list holds the true one.
    unique : int
        Number of touches whose list holds no other likely one.
    undetermined : int
        Number of touches whose charges are said not to determine the rotation.
    """

    touches: int
    found: int
    unique: int
    undetermined: int


def listed(trial: Trial, near_mm: float = 0.1) -> Listed:
    """Count the true touches among those that `locate` lists, rotation unknown, charges exact.

    A true touch is found if a touch is listed within `near_mm` of it, or within three standard
    deviations.
    """
    found = unique = undetermined = 0
    names = list(trial.electrodes.values())
    for touch, charges in zip(trial.touches, trial.charges_pC, strict=True):
        measured = dict(zip(names, charges.tolist(), strict=True))
        location = locate(trial.model, measured, LEAST_SIGMA, unknown=QUANTITIES)
        listed_nearby = [
            candidate for candidate in location.touches if _near(candidate, touch, near_mm)
        ]
        found += bool(listed_nearby)
        unique += not location.ambiguous
        undetermined += any(not candidate.determined for candidate in location.touches)
    return Listed(len(trial.touches), found, unique, undetermined)


def _near(candidate: Touch, touch: Array, near_mm: float) -> bool:
    spread = np.hypot(candidate.deviations["x_mm"], candidate.deviations["y_mm"])
    return distance_mm(candidate.values, touch) < max(near_mm, 3.0 * float(spread))


def fractions(errors: Sequence[float] | Array) -> tuple[Array, Array]:
    """Errors in growing order, and the share of all, with failures, that is no larger."""
    finite = np.sort(np.asarray(errors)[np.isfinite(errors)])
    return finite, (np.arange(len(finite)) + 1.0) / max(len(errors), 1)

"""A touch recovered from charges, of one probe or of two at once, with its uncertainty."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from scipy.special import gammaincc, gammainccinv

from pvdf_fem.arrays import Array, Mask, finite_or_none
from pvdf_fem.summary import Result, Summary

#: Charges count as unexplained if a right model gives such charges less often than this.
SIGNIFICANCE = 1e-3
#: A direction is determined if the domain along it is wider than this many standard deviations.
DETERMINED_RATIO = 3.0


def compute_p_values(chi_square: Array, freedom: int) -> Array:
    """Probabilities of a larger chi-square if the model is right; NaN without freedom."""
    if freedom <= 0:
        return np.full(len(chi_square), np.nan)
    return gammaincc(0.5 * freedom, 0.5 * chi_square)


@lru_cache(maxsize=64)
def compute_chi_square_limit(freedom: int) -> float:
    """Chi-square that a right model exceeds with the probability `SIGNIFICANCE`."""
    return float(2.0 * gammainccinv(0.5 * max(freedom, 1), SIGNIFICANCE))


def is_plausible(chi_square: Array, freedom: int, significance: float = SIGNIFICANCE) -> Mask:
    """Whether charges as far from the model's as these are common."""
    # without freedom a touch fits unless the domain's edge holds it, as one condition more
    common: Mask = ~(compute_p_values(chi_square, max(freedom, 1)) < significance)
    return common


def compute_covariance_roots(slopes: Array, extent: Array) -> tuple[Array, Mask]:
    """Square roots (..., k, k) of covariances, their columns along the principal directions, and
    which of these (..., k) the charges do not determine: there the domain's `extent` (..., k) is a
    standard deviation. `slopes` (..., electrodes, k) are slopes of the charges over deviations."""
    per_extent = slopes * extent[..., None, :]
    squares, vectors = np.linalg.eigh(per_extent.swapaxes(-1, -2) @ per_extent)
    squares = np.maximum(squares, 0.0)
    free = squares < DETERMINED_RATIO**2
    return vectors / np.sqrt(squares + free)[..., None, :] * extent[..., None], free


class TouchStatus(StrEnum):
    """What became of some charges."""

    LOCATED = "located"
    AT_EDGE = "at edge"  #: The limits of the model's domain hold the touch.
    AMBIGUOUS = "ambiguous"  #: Other touches are likely, too.
    UNEXPLAINED = "unexplained"  #: The nearest touch of the model's domain does not fit.
    #: There are fewer charges than unknown quantities, and no search is made.
    UNDETERMINED = "undetermined"
    #: No search ended: the charges fit no touch of the model's domain.
    NOT_FOUND = "no_touch_found"
    NOT_FINITE = "not_finite"
    TOO_LARGE = "too_large"  #: A charge exceeds `LARGEST_PC`.
    #: A charge below `LEAST_PC` has no deviation without noise, and if all are, no touch.
    ZERO = "zero_charge"
    OUTSIDE = "known_outside_domain"  #: The known force is outside of the model's domain.
    MALFORMED = "malformed"  #: The row of the file has not one cell for each column of the header.


#: With these a touch explains the charges.
EXPLAINED_STATUSES = (TouchStatus.LOCATED, TouchStatus.AT_EDGE, TouchStatus.AMBIGUOUS)


def decide_status(explained: bool, ambiguous: bool, at_edge: bool) -> TouchStatus:
    """What became of charges for which a touch was found."""
    if not explained:
        return TouchStatus.UNEXPLAINED
    if ambiguous:
        return TouchStatus.AMBIGUOUS
    return TouchStatus.AT_EDGE if at_edge else TouchStatus.LOCATED


@dataclass(frozen=True, eq=False, repr=False)
class Touch(Result):
    """A touch whose charges are, among touches nearby, the likeliest to give those measured."""

    quantities: tuple[str, ...]  #: Names of the model's quantities, (k,).
    unknown: tuple[str, ...]  #: The quantities that were sought; the order of all matrices.
    values: Array  #: The touch as a model takes it, (k,): mm, degrees, from 0 to the period, and N.
    #: A square root of the covariance, its columns along the principal directions, (unknown,
    #: unknown), and which of these the charges do not determine, (unknown,).
    root: Array
    free: Mask
    chi_square: float  #: Sum of the squared residuals, each divided by its standard deviation.
    #: Probability of a larger chi-square if the model is right; NaN if there are no more charges
    #: than unknown quantities.
    p_value: float
    explained: bool  #: Whether charges as far from the model's are common.
    weight: float  #: Share of this touch in the likelihood of all touches of its location.
    #: Which limits of the model's domain hold it: ``reach_mm``, ``force_N``. The true touch may lie
    #: beyond.
    at_edge: tuple[str, ...]

    @property
    def null_directions(self) -> Array:
        """Combinations of the unknown that the charges do not determine, (n, unknown).

        Each is one standard deviation long, in units of the unknown. Moved by a third of the domain
        along one of them, a touch changes its charges by less than their standard deviation.
        """
        free = self.root.T[self.free]
        largest = np.abs(free / np.sqrt(np.diag(self.covariance))).argmax(axis=1)
        return free * np.sign(np.take_along_axis(free, largest[:, None], axis=1))

    @property
    def determined(self) -> bool:
        """Whether the charges determine every unknown."""
        return not self.free.any()

    @property
    def covariance(self) -> Array:
        """Covariance (unknown, unknown) by the curvature of the likelihood at this touch.

        Covariance of the errors where the charges are nearly linear over the errors; if not, see
        `Location.covariance`. Along a direction that the charges do not determine, a prior is
        added, with the domain's extent as standard deviation.
        """
        return self.root @ self.root.T

    @property
    def deviations(self) -> dict[str, float]:
        """Standard deviations of the unknowns by `covariance`; see `Location.deviations`."""
        return dict(zip(self.unknown, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    @cached_property
    def by_name(self) -> dict[str, float]:
        """All values by the quantity's name."""
        return dict(zip(self.quantities, self.values.tolist(), strict=True))

    @property
    def x_mm(self) -> float:
        """The place of the only probe; KeyError for two: see `by_name`."""
        return self.by_name["x_mm"]

    @property
    def y_mm(self) -> float:
        """The same along y."""
        return self.by_name["y_mm"]

    @property
    def rotation_deg(self) -> float:
        """Its rotation."""
        return self.by_name["rotation_deg"]

    @property
    def force_N(self) -> float:
        """Its force."""
        return self.by_name["force_N"]

    def summary(self) -> Summary:
        """The quantities; `Location` has their errors."""
        values = ", ".join(f"{name} {value:.4g}" for name, value in self.by_name.items())
        return Summary(f"share of likelihood {self.weight:.3g}", [values])

    def to_json(self) -> dict[str, Any]:
        """Plain values for JSON, None for what is infinite; errors are left to the location."""
        return {
            **self.by_name,
            "chi_square": float(self.chi_square),
            "p_value": finite_or_none(self.p_value),
            "explained": bool(self.explained),
            "weight": self.weight,
            "determined": self.determined,
            "null_directions": [
                dict(zip(self.unknown, row, strict=True)) for row in self.null_directions.tolist()
            ],
            "at_edge": list(self.at_edge),
        }

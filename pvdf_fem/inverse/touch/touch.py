"""A located touch, of one probe or of two at once, with its uncertainty."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
from scipy.special import chdtrc, chdtri

from pvdf_fem.arrays import Array, Mask, finite_or_none
from pvdf_fem.summary import Result, Summary

#: Charges count as unexplained if a correct response gives such charges less often than this.
SIGNIFICANCE = 1e-3
#: A direction is determined if the domain along it is wider than this many standard deviations.
DETERMINED_RATIO = 3.0


def compute_p_values(chi_square: Array, degrees_of_freedom: int) -> Array:
    """Compute the probabilities of a larger chi-square if the response is correct.

    Parameters
    ----------
    chi_square : ndarray, shape (n,)
        Sums of squared whitened residuals at the minima.
    degrees_of_freedom : int
        Charges less unknown quantities.

    Returns
    -------
    ndarray, shape (n,)
        Survival function of the chi-square distribution; NaN without degrees of freedom.
    """
    if degrees_of_freedom <= 0:
        return np.full(len(chi_square), np.nan)
    # scipy.stats has the same functions, and takes half a second to import.
    p_values: Array = chdtrc(degrees_of_freedom, chi_square)
    return p_values


@lru_cache(maxsize=64)
def compute_chi_square_limit(degrees_of_freedom: int) -> float:
    """Compute the chi-square that a correct response exceeds with probability `SIGNIFICANCE`."""
    return float(chdtri(max(degrees_of_freedom, 1), SIGNIFICANCE))


def is_plausible(
    chi_square: Array, degrees_of_freedom: int, significance: float = SIGNIFICANCE
) -> Mask:
    """Return whether a correct response commonly has such a large chi-square.

    Parameters
    ----------
    chi_square : ndarray, shape (n,)
        Sums of squared whitened residuals at the minima.
    degrees_of_freedom : int
        Charges less unknown quantities. Without any the charges can be matched exactly unless the
        edge of the domain holds the touch, which is one condition: one degree of freedom is taken.
    significance : float
        Least p-value that counts as plausible.

    Returns
    -------
    ndarray of bool, shape (n,)
        True also where chi-square is NaN.
    """
    plausible: Mask = ~(compute_p_values(chi_square, max(degrees_of_freedom, 1)) < significance)
    return plausible


class CovarianceRoots(NamedTuple):
    """Square roots of covariances, by principal directions."""

    roots: Array  #: Columns are principal directions, one standard deviation long, (..., k, k).
    undetermined: Mask  #: Directions that the charges do not determine, (..., k).


def compute_covariance_roots(jacobian: Array, extents: Array) -> CovarianceRoots:
    """Compute square roots R of covariances C = R Rᵀ from the curvature of the likelihood.

    Parameters
    ----------
    jacobian : ndarray, shape (..., electrodes, k)
        Derivatives of the charges by the unknowns, over the charges' standard deviations.
    extents : ndarray, shape (..., k)
        Sizes of the response's domain along the unknowns.

    Returns
    -------
    CovarianceRoots
        Roots of the inverse information (JᵀJ)⁻¹. Along a direction that the charges determine
        to no better than a third of the domain, the extent is taken as standard deviation.

    Notes
    -----
    Principal directions are eigenvectors of SJᵀJS with the diagonal matrix S of the extents, so
    that they do not depend on units.
    """
    per_extent = jacobian * extents[..., None, :]
    information = per_extent.swapaxes(-1, -2) @ per_extent
    eigenvalues, directions = np.linalg.eigh(information)
    eigenvalues = np.maximum(eigenvalues, 0.0)
    undetermined = eigenvalues < DETERMINED_RATIO**2
    lengths = 1.0 / np.sqrt(eigenvalues + undetermined)
    return CovarianceRoots(directions * lengths[..., None, :] * extents[..., None], undetermined)


class TouchStatus(StrEnum):
    """Outcome of a search for the touch that gave some charges."""

    LOCATED = "located"
    AT_EDGE = "at edge"  #: The touch is at the limits of the response's domain.
    AMBIGUOUS = "ambiguous"  #: Other touches are likely, too.
    UNEXPLAINED = "unexplained"  #: The nearest touch of the response's domain does not fit.
    #: There are fewer charges than unknown quantities, and no search is made.
    UNDETERMINED = "undetermined"
    #: No search converged: the charges fit no touch of the response's domain.
    NOT_FOUND = "no_touch_found"
    NOT_FINITE = "not_finite"
    TOO_LARGE = "too_large"  #: A charge exceeds `LARGEST_PC`.
    #: A charge below `LEAST_PC` has no standard deviation without noise; if all charges are below
    #: it, there is no touch.
    ZERO = "zero_charge"
    OUTSIDE = "known_outside_domain"  #: The fixed force is outside of the response's domain.
    #: The row of a file does not have one cell for each column of the header.
    MALFORMED = "malformed"


#: With these a touch explains the charges.
EXPLAINED_STATUSES = (TouchStatus.LOCATED, TouchStatus.AT_EDGE, TouchStatus.AMBIGUOUS)


def decide_status(explained: bool, ambiguous: bool, at_edge: bool) -> TouchStatus:
    """Decide on the status of a search that converged.

    Parameters
    ----------
    explained : bool
        Whether the touch explains the charges.
    ambiguous : bool
        Whether other touches are likely, too.
    at_edge : bool
        Whether the touch is at a limit of the response's domain.

    Returns
    -------
    TouchStatus
        The first reason against the touch in this order, or `TouchStatus.LOCATED`.
    """
    if not explained:
        return TouchStatus.UNEXPLAINED
    if ambiguous:
        return TouchStatus.AMBIGUOUS
    return TouchStatus.AT_EDGE if at_edge else TouchStatus.LOCATED


@dataclass(frozen=True, eq=False, repr=False)
class Touch(Result):
    """A touch at a local maximum of the likelihood of the measured charges."""

    quantity_names: tuple[str, ...]  #: Names of the response's quantities, (k,).
    unknown: tuple[str, ...]  #: Quantities that were free; the order of all matrices.
    #: All quantities in their units, (k,): mm, N, and degrees from 0 to the period.
    values: Array
    #: Square root of the covariance, with principal directions as columns, (unknown, unknown).
    covariance_root: Array
    undetermined: Mask  #: Principal directions that the charges do not determine, (unknown,).
    chi_square: float  #: Sum of the squared residuals, each divided by its standard deviation.
    #: Probability of a larger chi-square if the response is correct; NaN if there are no more
    #: charges than unknown quantities.
    p_value: float
    explained: bool  #: Whether a correct response commonly has such a large chi-square.
    weight: float  #: Share of this touch in the likelihood of all touches of its location.
    #: Limits of the response's domain at which the touch is: ``reach_mm``, ``force_N``. The true
    #: touch may be beyond.
    at_edge: tuple[str, ...]

    @property
    def null_directions(self) -> Array:
        """Combinations of the unknowns that the charges do not determine, (n, unknown).

        Each is one standard deviation long, in units of the unknowns. A touch that moves by a third
        of the domain along one of them changes its charges by less than their standard deviation.
        """
        directions = self.covariance_root.T[self.undetermined]
        deviations = np.sqrt(np.diag(self.covariance))
        largest = np.abs(directions / deviations).argmax(axis=1)
        signs = np.sign(np.take_along_axis(directions, largest[:, None], axis=1))
        return directions * signs

    @property
    def determined(self) -> bool:
        """Whether the charges determine every unknown."""
        return not self.undetermined.any()

    @property
    def covariance(self) -> Array:
        """Covariance (unknown, unknown) by the curvature of the likelihood at this touch.

        It is the covariance of the errors where the charges are nearly linear over the errors; if
        not, see `Location.covariance`. Along a direction that the charges do not determine, the
        size of the domain is taken as standard deviation.
        """
        return self.covariance_root @ self.covariance_root.T

    @property
    def deviations(self) -> dict[str, float]:
        """Standard deviations of the unknowns by `covariance`; see `Location.deviations`."""
        return dict(zip(self.unknown, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    @cached_property
    def by_name(self) -> dict[str, float]:
        """All values by the quantity's name."""
        return dict(zip(self.quantity_names, self.values.tolist(), strict=True))

    @property
    def x_mm(self) -> float:
        """Place of the only probe along x; KeyError for two probes: see `by_name`."""
        return self.by_name["x_mm"]

    @property
    def y_mm(self) -> float:
        """Place of the only probe along y."""
        return self.by_name["y_mm"]

    @property
    def rotation_deg(self) -> float:
        """Rotation of the only probe."""
        return self.by_name["rotation_deg"]

    @property
    def force_N(self) -> float:
        """Force of the only probe."""
        return self.by_name["force_N"]

    def summary(self) -> Summary:
        """Return the quantities to print; `Location` prints their errors."""
        values = ", ".join(f"{name} {value:.4g}" for name, value in self.by_name.items())
        return Summary(f"share of likelihood {self.weight:.3g}", [values])

    def to_json(self) -> dict[str, Any]:
        """Return plain values for JSON, None for infinite ones; the location adds the errors."""
        directions = []
        for direction in self.null_directions.tolist():
            directions.append(dict(zip(self.unknown, direction, strict=True)))
        return {
            **self.by_name,
            "chi_square": float(self.chi_square),
            "p_value": finite_or_none(self.p_value),
            "explained": bool(self.explained),
            "weight": self.weight,
            "determined": self.determined,
            "null_directions": directions,
            "at_edge": list(self.at_edge),
        }

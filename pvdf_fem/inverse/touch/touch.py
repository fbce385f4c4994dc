"""A located touch, by one probe or by two at once, with its uncertainty."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
from scipy.special import chdtrc, chdtri

from pvdf_fem.arrays import Array, Indices, Mask, finite_or_none
from pvdf_fem.summary import Result, Summary

#: Charges count as unexplained if their p-value is below this.
SIGNIFICANCE = 1e-3
#: A direction is determined if the domain along it is wider than this many standard deviations.
DETERMINED_RATIO = 3.0


def compute_p_values(chi_square: Array, degrees_of_freedom: int | Indices) -> Array:
    """Compute p-values: the probability that a correct response has a larger chi-square.

    Parameters
    ----------
    chi_square : ndarray, shape (n,)
        Sums of squared whitened residuals at the minima.
    degrees_of_freedom : int or ndarray of int, shape (n,)
        Number of values among the charges less number of unknown quantities.

    Returns
    -------
    ndarray, shape (n,)
        Survival function of the chi-square distribution; NaN if there is no degree of freedom.

    Notes
    -----
    Charges that are limits are not counted as degrees of freedom, though their contributions
    -2 ln Φ(z) to chi-square are. These are negligible unless the charge is within two standard
    deviations of its limit or beyond it.
    """
    freedom = np.broadcast_to(degrees_of_freedom, np.shape(chi_square))
    # scipy.stats has the same function, but takes half a second to import.
    p_values: Array = chdtrc(np.maximum(freedom, 1), chi_square)
    return np.where(freedom > 0, p_values, np.nan)


@lru_cache(maxsize=64)
def compute_chi_square_limit(degrees_of_freedom: int) -> float:
    """Compute the chi-square that a correct response exceeds with probability `SIGNIFICANCE`.

    Fewer than one degree of freedom count as one.
    """
    return float(chdtri(max(degrees_of_freedom, 1), SIGNIFICANCE))


def mark_plausible(
    chi_square: Array, degrees_of_freedom: int | Indices, significance: float = SIGNIFICANCE
) -> Mask:
    """Mark values of chi-square that are small enough for the response to explain the charges.

    Parameters
    ----------
    chi_square : ndarray, shape (n,)
        Sums of squared whitened residuals at the minima.
    degrees_of_freedom : int or ndarray of int, shape (n,)
        Number of values among the charges less number of unknown quantities. Fewer than one count
        as one: the
        charges can then be matched exactly, unless the touch is at the edge of the domain, which
        imposes one condition.
    significance : float
        Minimum p-value that counts as plausible.

    Returns
    -------
    ndarray of bool, shape (n,)
        True if the p-value is not below `significance`, and also if chi-square is NaN.
    """
    freedom = np.maximum(degrees_of_freedom, 1)
    plausible: Mask = ~(compute_p_values(chi_square, freedom) < significance)
    return plausible


class CovarianceRoots(NamedTuple):
    """Square roots of covariance matrices, with their principal directions."""

    #: Matrices whose columns are principal directions, one standard deviation long;
    #: shape (..., k, k).
    roots: Array
    undetermined: Mask  #: Whether the charges do not determine each direction; shape (..., k).


def compute_covariance_roots(jacobian: Array, extents: Array) -> CovarianceRoots:
    """Compute square roots R of covariances R Rᵀ of the unknowns from derivatives of the charges.

    Parameters
    ----------
    jacobian : ndarray, shape (..., electrodes, k)
        Derivatives J of the charges with respect to the unknowns, divided by the standard
        deviations of the charges.
    extents : ndarray, shape (..., k)
        Sizes of the response's domain along the unknowns.

    Returns
    -------
    CovarianceRoots
        Square roots of (JᵀJ)⁻¹, the inverse of the curvature of the log-likelihood. A direction is
        undetermined if its standard deviation exceeds the size of the domain divided by
        `DETERMINED_RATIO`; the standard deviation is then limited to the size of the domain.

    Notes
    -----
    The principal directions are the eigenvectors v of SJᵀJS with the diagonal matrix S of the
    extents, so that they do not depend on units. A column of R is S v / √λ with the eigenvalue λ,
    or S v / √(1 + λ) if λ < `DETERMINED_RATIO`².
    """
    per_extent = jacobian * extents[..., None, :]
    information = per_extent.swapaxes(-1, -2) @ per_extent
    eigenvalues, directions = np.linalg.eigh(information)
    eigenvalues = np.maximum(eigenvalues, 0.0)
    undetermined = eigenvalues < DETERMINED_RATIO**2
    # Adding 1 limits the standard deviation of an undetermined direction to the domain.
    lengths = 1.0 / np.sqrt(eigenvalues + undetermined)
    return CovarianceRoots(directions * lengths[..., None, :] * extents[..., None], undetermined)


class TouchStatus(StrEnum):
    """Outcome of a search for the touch that explains measured charges."""

    LOCATED = "located"
    AT_EDGE = "at edge"  #: The touch is at a limit of the response's domain.
    AMBIGUOUS = "ambiguous"  #: Other touches are likely, too.
    UNEXPLAINED = "unexplained"  #: The best touch in the response's domain does not fit.
    #: There are fewer charges than unknown quantities, so that no search is made.
    UNDETERMINED = "undetermined"
    #: So many readings are clipped that the others are fewer than unknown quantities.
    CLIPPED = "clipped"
    #: No search converged: the charges fit no touch in the response's domain.
    NOT_FOUND = "no_touch_found"
    #: A known quantity is NaN or infinite, or so many readings are missing that the others are
    #: fewer than unknown quantities.
    NOT_FINITE = "not_finite"
    TOO_LARGE = "too_large"  #: A charge exceeds `MAX_READING_PC`.
    #: All charges are below `MIN_CHARGE_PC`, so that there is no touch; or one of them is, and has
    #: no standard deviation because its channel has no noise.
    ZERO = "zero_charge"
    OUTSIDE = "known_outside_domain"  #: The fixed force is outside of the response's domain.
    #: The row of a file does not have one cell for each column of the header.
    MALFORMED = "malformed"


#: Statuses of a touch that explains the charges.
EXPLAINED_STATUSES = (TouchStatus.LOCATED, TouchStatus.AT_EDGE, TouchStatus.AMBIGUOUS)


def decide_status(explained: bool, ambiguous: bool, at_edge: bool) -> TouchStatus:
    """Return the status of measured charges for which a search converged.

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
        `UNEXPLAINED`, `AMBIGUOUS` or `AT_EDGE`, whichever applies first; otherwise `LOCATED`.
    """
    if not explained:
        return TouchStatus.UNEXPLAINED
    if ambiguous:
        return TouchStatus.AMBIGUOUS
    return TouchStatus.AT_EDGE if at_edge else TouchStatus.LOCATED


@dataclass(frozen=True, eq=False, repr=False)
class Touch(Result):
    """A touch at a local maximum of the likelihood of the measured charges."""

    quantity_names: tuple[str, ...]  #: Names of the response's k quantities.
    #: Names of the free quantities, in the order of rows and columns of all matrices.
    unknown: tuple[str, ...]
    #: Values of all quantities: positions in mm in the frame of the stage, forces in N, rotations
    #: in degrees, from 0 to the period if the rotation was free; shape (k,).
    values: Array
    #: Square root of the covariance, with principal directions as columns;
    #: shape (unknown, unknown).
    covariance_root: Array
    #: Whether the charges do not determine each principal direction; shape (unknown,).
    undetermined: Mask
    chi_square: float  #: Sum of the squared residuals, each divided by its standard deviation.
    #: Probability of a larger chi-square if the response is correct; NaN unless there are more
    #: charges than unknown quantities.
    p_value: float
    explained: bool  #: Whether the touch explains the charges, see `mark_plausible`.
    #: Probability that this one of the touches of a `Location` is the true one, from 0 to 1.
    weight: float
    #: Names of the limits of the response's domain at which the touch is, ``reach_mm`` or
    #: ``force_N``; empty inside. The true touch may be beyond the limits.
    at_edge: tuple[str, ...]

    @property
    def null_directions(self) -> Array:
        """Directions in the space of the unknowns that the charges do not determine.

        An ndarray of shape (n, unknown). Each row is one standard deviation long, in the units of
        the unknowns. If the touch moves along a row by a third of the domain's size, the charges
        change by less than their standard deviation.
        """
        directions = self.covariance_root.T[self.undetermined]
        # The sign of an eigenvector is arbitrary: make the largest component positive,
        # in units of its deviation.
        deviations = np.sqrt(np.diag(self.covariance))
        column = np.abs(directions / deviations).argmax(axis=1)
        signs = np.sign(np.take_along_axis(directions, column[:, None], axis=1))
        return directions * signs

    @property
    def determined(self) -> bool:
        """Whether the charges determine every unknown."""
        return not self.undetermined.any()

    @property
    def covariance(self) -> Array:
        """Covariance of the unknowns by the curvature of the likelihood; shape (unknown, unknown).

        Other touches are not considered, and the charges are assumed to be linear within a few
        standard deviations of this touch; see also `Location.covariance`. Along a direction that
        the charges do not determine, the standard deviation is limited to the size of the domain.
        """
        return self.covariance_root @ self.covariance_root.T

    @property
    def deviations(self) -> dict[str, float]:
        """Standard deviations of the unknowns by name, from `covariance`.

        Unlike those of `Location.compute_deviations` they do not include other touches.
        """
        return dict(zip(self.unknown, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    @cached_property
    def by_name(self) -> dict[str, float]:
        """Values of all quantities, free or fixed, by name."""
        return dict(zip(self.quantity_names, self.values.tolist(), strict=True))

    @property
    def x_mm(self) -> float:
        """Position x of the only probe in mm; `KeyError` for two probes, see `by_name`."""
        return self.by_name["x_mm"]

    @property
    def y_mm(self) -> float:
        """Position y of the only probe in mm; `KeyError` for two probes."""
        return self.by_name["y_mm"]

    @property
    def rotation_deg(self) -> float:
        """Rotation of the only probe in degrees; `KeyError` for two probes."""
        return self.by_name["rotation_deg"]

    @property
    def force_N(self) -> float:
        """Force of the only probe in N; `KeyError` for two probes."""
        return self.by_name["force_N"]

    def summary(self) -> Summary:
        """Return weight and values to print; `Location.summary` has the standard deviations."""
        values = ", ".join(f"{name} {value:.4g}" for name, value in self.by_name.items())
        return Summary(f"probability {self.weight:.3g}", [values])

    def to_json(self) -> dict[str, Any]:
        """Return plain values for JSON, with None for a p-value that is NaN.

        `Location.to_json` adds standard deviations and covariance.
        """
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

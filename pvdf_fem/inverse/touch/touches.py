"""The most likely touch for each of many rows of readings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pvdf_fem.arrays import Array, Indices, Mask
from pvdf_fem.inverse.clipping import CLIPPED_ADVICE
from pvdf_fem.inverse.least_squares import SearchResult
from pvdf_fem.inverse.touch.location_problem import LocationProblem
from pvdf_fem.inverse.touch.search import describe_touches
from pvdf_fem.inverse.touch.touch import TouchStatus, decide_status
from pvdf_fem.summary import Summary, TabularResult, TextTable
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES


@dataclass(frozen=True, eq=False, repr=False)
class Touches(TabularResult):
    """The most likely touch for each of n rows of readings.

    Other touches may be nearly as likely, see `alternatives`. Numbers are NaN in rows without a
    touch.
    """

    #: Position x and y in mm, rotation in degrees and force in N of each touch; those of the best
    #: fit if the status is `TouchStatus.UNEXPLAINED`; shape (n, 4).
    values: Array
    reading: str  #: Meaning of the readings, a key of `READINGS`.
    unknown: tuple[str, ...]  #: Names of the free quantities.
    status: NDArray[np.object_]  #: `TouchStatus` of each row; shape (n,).
    #: Covariances from the curvature of the likelihood, like `Touch.covariance`;
    #: shape (n, unknown, unknown).
    covariances: Array
    #: Standard deviations from `covariances`; or, if `locate_many` was called with `calibrated`,
    #: from the posterior distribution, like `Location.deviations`; shape (n, unknown).
    deviations: Array
    #: Numbers of further likely touches, like `Location.alternatives`; NaN unless `calibrated` was
    #: set; shape (n,).
    alternatives: Array
    determined: Mask  #: Whether the charges determine every unknown; shape (n,).
    chi_square: Array  #: Sums of the squared whitened residuals; shape (n,).
    p_value: Array  #: Probabilities of a larger chi-square; shape (n,).
    #: Mistakes in the readings, in words, whose correction would let a touch explain them; empty if
    #: there is none; shape (n,).
    explanations: NDArray[np.object_]
    at_edge: Mask  #: Whether the touch is at a limit of the response's domain; shape (n,).
    #: Names of the electrodes whose readings are clipped, separated by spaces; shape (n,).
    clipped: NDArray[np.object_]
    #: Names of the electrodes whose readings are missing, separated by spaces; shape (n,).
    missing: NDArray[np.object_]

    @classmethod
    def make_empty(
        cls, status: NDArray[np.object_], unknown: tuple[str, ...], reading: str
    ) -> Touches:
        """Make results without touches, which `store` fills in later.

        Numbers are NaN and flags are false.

        Parameters
        ----------
        status : ndarray of TouchStatus, shape (n,)
            Initial status of each row. The array is not copied, and `store` changes it.
        unknown : tuple of str
            Names of the free quantities.
        reading : str
            Meaning of the readings, a key of `READINGS`.
        """
        rows = len(status)
        count = len(unknown)
        return cls(
            values=np.full((rows, len(TOUCH_QUANTITIES)), np.nan),
            reading=reading,
            unknown=unknown,
            status=status,
            covariances=np.full((rows, count, count), np.nan),
            deviations=np.full((rows, count), np.nan),
            alternatives=np.full(rows, np.nan),
            determined=np.zeros(rows, dtype=bool),
            chi_square=np.full(rows, np.nan),
            p_value=np.full(rows, np.nan),
            explanations=np.full(rows, "", dtype=object),
            at_edge=np.zeros(rows, dtype=bool),
            clipped=np.full(rows, "", dtype=object),
            missing=np.full(rows, "", dtype=object),
        )

    @property
    def explained(self) -> Mask:
        """Whether a touch explains the charges of each row; shape (n,)."""
        return np.isfinite(self.chi_square) & (self.status != TouchStatus.UNEXPLAINED)

    def store(self, rows: Indices, problem: LocationProblem, ends: SearchResult) -> None:
        """Write the touches of some rows, with their status, into the arrays of this object.

        Before that, the caller may fill in `alternatives`, which has an effect on the status, and
        deviations from the posterior distribution, which are not overwritten.

        Parameters
        ----------
        rows : ndarray of int, shape (m,)
            Indices of the rows to fill in.
        problem : LocationProblem
            The problem with the charges of these m rows.
        ends : SearchResult
            The best end point for each of these rows. A row whose search did not converge gets the
            status `TouchStatus.NOT_FOUND`.
        """
        self.status[rows[~ends.converged]] = TouchStatus.NOT_FOUND
        rows = rows[ends.converged]
        problem = problem.select_rows(np.flatnonzero(ends.converged))
        ends = ends.select(np.flatnonzero(ends.converged))
        described = describe_touches(problem, ends)
        roots = described.covariance_roots
        self.values[rows] = described.values
        self.chi_square[rows] = described.chi_square
        self.p_value[rows] = described.p_value
        self.covariances[rows] = roots @ roots.swapaxes(1, 2)
        variances = np.einsum("nuu->nu", self.covariances[rows])  # the diagonals
        by_curvature = np.sqrt(variances)
        from_posterior = self.deviations[rows]
        is_missing = np.isnan(from_posterior)
        self.deviations[rows] = np.where(is_missing, by_curvature, from_posterior)
        self.determined[rows] = ~described.undetermined.any(axis=1)
        limits = problem.find_active_limits(ends.coordinates)
        self.at_edge[rows] = [bool(names) for names in limits]
        explained = described.explained.tolist()
        ambiguous = (self.alternatives[rows] > 0).tolist()
        at_edge = self.at_edge[rows].tolist()
        self.status[rows] = list(map(decide_status, explained, ambiguous, at_edge))

    def summary(self) -> Summary:
        """Summarize how many rows are explained, with a table of the touches."""
        explained = f"{int(self.explained.sum())} of {len(self.status)} rows are explained"
        return Summary("touches", [explained], [TextTable.from_columns(self.columns())])

    def to_table(self) -> dict[str, NDArray[Any]]:
        """Return the touches as columns of a table.

        Returns
        -------
        dict of str to ndarray
            Columns of n values by name: the quantities; their deviations, NaN for fixed quantities;
            chi-square and p-value; the number of alternatives, None unless `calibrated` was set;
            the status; remarks such as ``explained if`` with a mistake in the readings,
            ``undetermined``, ``at edge`` or ``no reading of A``; and the electrodes with clipped
            readings.
        """
        deviations = np.full(self.values.shape, np.nan)
        columns = [TOUCH_QUANTITIES.index(name) for name in self.unknown]
        deviations[:, columns] = self.deviations
        table: dict[str, NDArray[Any]] = {}
        for name, values in zip(TOUCH_QUANTITIES, self.values.T, strict=True):
            table[name] = values
        for name, values in zip(TOUCH_QUANTITIES, deviations.T, strict=True):
            quantity, unit = name.rsplit("_", 1)
            table[f"{quantity}_deviation_{unit}"] = values
        counts = [None if np.isnan(count) else int(count) for count in self.alternatives]
        table["chi_square"] = self.chi_square
        table["p_value"] = self.p_value
        table["alternatives"] = np.array(counts, dtype=object)
        table["status"] = self.status
        table["remark"] = self._make_remarks()
        table["clipped"] = self.clipped
        return table

    columns = to_table

    def _make_remarks(self) -> NDArray[np.object_]:
        """Return a text of remarks for each row, separated by semicolons or empty; shape (n,)."""
        has_touch = np.isfinite(self.chi_square)
        remarks = self.explanations.copy()
        remarks[has_touch & ~self.determined] += "; undetermined"
        remarks[has_touch & self.at_edge] += "; at edge"
        has_few_channels = (self.status == TouchStatus.UNDETERMINED) & ~has_touch
        remarks[has_few_channels] += "; fewer channels than unknown quantities"
        for row in np.flatnonzero(self.missing != "").tolist():
            remarks[row] += f"; no reading of {self.missing[row]}"
        remarks[self.status == TouchStatus.CLIPPED] += f"; {CLIPPED_ADVICE}"
        return np.array([remark.removeprefix("; ") for remark in remarks], dtype=object)

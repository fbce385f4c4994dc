"""How well made-up states of the sensor explain printed errors, and how well they would any others.

A state agrees with a table if contours fail to cross in the same rows. Its misfit is the root mean
square of its errors less the printed ones; that of other states is infinite. The best of thousands
of states always fits a few numbers better than the nominal sensor does. What this is worth is told
by errors that no common cause has made: the printed ones in another order, and those of touches
that are misplaced each by itself; and by rows that are predicted from the others.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import permutations, product

import numpy as np
from scipy.stats import f as f_distribution

from pvdf_fem.arrays import Array


def misfits_mm(errors_mm: Array, printed_mm: Array) -> Array:
    """Misfit (n,) of states with errors (n, rows) to printed errors (rows,)."""
    lost = np.isnan(printed_mm)
    agrees = (np.isnan(errors_mm) == lost).all(axis=1)
    squares = (errors_mm[:, ~lost] - printed_mm[~lost]) ** 2
    return np.where(agrees, np.sqrt(squares.mean(axis=1)), np.inf)


@dataclass(frozen=True, eq=False)
class Trial:
    """Printed errors of one or more tables beside those of made-up states."""

    #: Rows of each table, one after the other.
    tables: Sequence[int]
    #: NaN where contours did not cross, (rows,).
    printed_mm: Array
    #: Errors of the sensor as the thesis takes it to be, (rows,).
    nominal_mm: Array
    #: Errors of states that share a cause, (n, rows).
    drawn_mm: Array
    #: Errors of touches that are misplaced each by itself, (m, rows).
    separate_mm: Array
    #: Number of parameters of a state.
    parameters: int

    @property
    def numbers(self) -> int:
        """Number of printed errors."""
        return int(np.isfinite(self.printed_mm).sum())

    @cached_property
    def misfits_mm(self) -> Array:
        """Misfits of the states, (n,)."""
        return misfits_mm(self.drawn_mm, self.printed_mm)

    @property
    def nominal_misfit_mm(self) -> float:
        """Misfit of the nominal sensor."""
        return float(misfits_mm(self.nominal_mm[None], self.printed_mm)[0])

    @property
    def best(self) -> int | None:
        """The state with the smallest misfit; None if no state agrees."""
        index = int(np.argmin(self.misfits_mm))
        return index if np.isfinite(self.misfits_mm[index]) else None

    @property
    def agreeing(self) -> float:
        """Share of the states that lose the same rows."""
        return float(np.isfinite(self.misfits_mm).mean())

    @property
    def better(self) -> float:
        """Share of the states whose misfit is smaller than that of the nominal sensor."""
        return float((self.misfits_mm < self.nominal_misfit_mm).mean())

    def explained(self, printed_mm: Array) -> float:
        """Share of the nominal sensor's sum of squares that the best state explains."""
        nominal, best = (
            misfits_mm(errors, printed_mm).min()
            for errors in (self.nominal_mm[None], self.drawn_mm)
        )
        return float(1.0 - (best / nominal) ** 2) if np.isfinite([best, nominal]).all() else np.nan

    @cached_property
    def reordered(self) -> float:
        """Share of the orders of each table's numbers that are fitted as well as the printed one.

        The printed order is one of them.
        """
        least = self.misfits_mm.min() + 1e-9
        best = [misfits_mm(self.drawn_mm, order).min() for order in self._orders()]
        return float(np.mean(np.array(best) <= least))

    def _orders(self) -> Iterator[Array]:
        pieces = np.split(self.printed_mm, np.cumsum(self.tables)[:-1])
        choices = [list(permutations(piece[np.isfinite(piece)])) for piece in pieces]
        places = np.flatnonzero(np.isfinite(self.printed_mm))
        for choice in product(*choices):
            order = self.printed_mm.copy()
            order[places] = np.concatenate(choice)
            yield order

    @cached_property
    def made_up(self) -> Array:
        """Shares that the best state explains of made-up tables, touches misplaced by themselves.

        Only tables count whose rows are lost where the printed ones are and which a state agrees
        with, (tables,).
        """
        lost = np.isnan(self.printed_mm)
        tables = self.separate_mm[(np.isnan(self.separate_mm) == lost).all(axis=1)]
        shares = np.array([self.explained(table) for table in tables])
        return shares[np.isfinite(shares)]

    @cached_property
    def left_out_mm(self) -> Array:
        """Errors (rows,) predicted by the state that fits the other rows best; NaN without any."""
        predicted = np.full(len(self.printed_mm), np.nan)
        agreeing = self.drawn_mm[np.isfinite(self.misfits_mm)]
        for row in np.flatnonzero(np.isfinite(self.printed_mm)) if len(agreeing) else ():
            others = np.delete(agreeing, row, axis=1), np.delete(self.printed_mm, row)
            predicted[row] = agreeing[np.argmin(misfits_mm(*others)), row]
        return predicted

    def rest_mm(self, predicted_mm: Array) -> float:
        """Root mean square of predicted less printed errors."""
        finite = np.isfinite(self.printed_mm)
        return float(np.sqrt(np.mean((predicted_mm - self.printed_mm)[finite] ** 2)))

    @property
    def others_mean_mm(self) -> Array:
        """The mean of the other numbers of the same table, (rows,)."""
        means = []
        for piece in np.split(self.printed_mm, np.cumsum(self.tables)[:-1]):
            count = np.isfinite(piece).sum()
            means.append((np.nansum(piece) - piece) / max(count - 1, 1))
        return np.concatenate(means)

    def f_test(self, share: float) -> float:
        """Probability of explaining a share by chance, if the fit were linear; NaN without rest.

        It is the F-test of the parameters against the numbers that are left over.
        """
        left = self.numbers - self.parameters
        if left < 1:
            return np.nan
        ratio = share / (1.0 - share) * left / self.parameters
        return float(f_distribution.sf(ratio, self.parameters, left))


def found_again_mm(trial: Trial, shifts_mm: Array, most: int = 200) -> Array:
    """How far the best other state's shift is from the true one, (k,).

    Tables are made up from states of the trial without any further error, so that the distances say
    what the errors of a table determine at best.
    """
    agreeing = np.flatnonzero(np.isfinite(trial.misfits_mm))
    distances = []
    for true in agreeing[:most]:
        others = agreeing[agreeing != true]
        if len(others):
            misfits = misfits_mm(trial.drawn_mm[others], trial.drawn_mm[true])
            distances.append(shifts_mm[others[np.argmin(misfits)]] - shifts_mm[true])
    return np.linalg.norm(np.reshape(distances, (-1, 2)), axis=1)

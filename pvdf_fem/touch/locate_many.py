"""The likeliest touch for each of many charges, tens of thousands a second."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pvdf_fem.touch.descent import Descent, Problem, descend
from pvdf_fem.touch.locate import (
    charge_mistakes,
    deviations,
    edges,
    extents,
    p_values,
    search,
)
from pvdf_fem.touch.starts import Nearest, nearest_of
from pvdf_fem.touch.touch import (
    DETERMINED,
    FORCE,
    QUANTITIES,
    ROTATION,
    SIGNIFICANCE,
    Model,
    X,
    Y,
    period_deg,
)

Array = NDArray[np.float64]

# Starts of the second search, where the end of the first does not explain the charges.
_MORE = 8


@dataclass(frozen=True, eq=False)
class Touches:
    """The likeliest touch found for each row of charges; other touches may be as likely.

    Attributes
    ----------
    values : ndarray, shape (n, 4)
        x and y in mm, rotation in degrees, force in N; NaN where no search ended.
    unknown : tuple of str
        What was sought; the order of the covariances.
    covariances : ndarray, shape (n, unknown, unknown)
        As for `Touch`: by the likelihood's curvature. Calibrated ones, which take other touches
        into account, are those of `Location`.
    determined : ndarray of bool, shape (n,)
        Whether the charges determine every unknown.
    chi_square, p_value : ndarray, shape (n,)
        As for `Touch`.
    at_edge : ndarray of bool, shape (n,)
        Whether the touch is held by a limit of the model's domain.
    """

    values: Array
    unknown: tuple[str, ...]
    covariances: Array
    determined: NDArray[np.bool_]
    chi_square: Array
    p_value: Array
    at_edge: NDArray[np.bool_]

    @property
    def explained(self) -> NDArray[np.bool_]:
        """Which charges a touch explains, (n,)."""
        return ~(self.p_value < SIGNIFICANCE) & np.isfinite(self.chi_square)


def locate_many(
    model: Model,
    charges_pC: Array,
    sigma: float = 0.01,
    *,
    rotations_deg: Array | None = None,
    forces_N: Array | None = None,
    electrodes: Sequence[str] | None = None,
    noise_pC: float = 0.0,
    significance: float = SIGNIFICANCE,
) -> Touches:
    """The likeliest place, and force and rotation if they are not known, for rows of charges.

    Each search starts from the touch of a table with the nearest ratios of charges. Where its end
    does not explain the charges, searches from more of them follow, and at last from everywhere, as
    in `locate`.

    Parameters
    ----------
    model : Model
    charges_pC : ndarray, shape (n, electrodes)
    sigma : float
        Relative standard deviation of all charges.
    rotations_deg, forces_N : ndarray, shape (n,), optional
        Known rotations and forces; sought if not given.
    electrodes : sequence of str, optional
        The columns of `charges_pC`; by default the model's.
    noise_pC : float
        As for `locate`.
    significance : float
        Charges count as explained if a right model gives such ones more often than this; 0 keeps
        the first search's touches, however far their charges are.

    Raises
    ------
    ValueError
        For shapes that do not match, and as `locate` for the first row.
    """
    names = tuple(electrodes or model.names)
    charges = np.asarray(charges_pC, dtype=float)
    known = {"rotations_deg": rotations_deg, "forces_N": forces_N}
    _require_rows(model, names, charges, sigma, noise_pC, known)
    columns = np.array([model.names.index(name) for name in names])
    held = {ROTATION: rotations_deg, FORCE: None if forces_N is None else np.log(forces_N)}
    sought = np.array([i for i in range(len(QUANTITIES)) if held.get(i) is None])
    spread = deviations(model, charges, np.array(sigma), noise_pC)
    problem = Problem(model, columns, charges, spread, sought)
    table = nearest_of(model, tuple(columns.tolist()), rotations_deg is not None)
    rows = np.arange(len(charges))
    ends = _nearest_end(problem, table, rows, held, 1)
    freedom = len(names) - len(sought)
    if (rows := _unexplained(ends, freedom, significance)).size:
        _improve(ends, rows, _nearest_end(problem, table, rows, held, _MORE))
    for row in _unexplained(ends, freedom, significance):
        _search_everywhere(problem, ends, int(row))
    return _touches(problem, ends, tuple(QUANTITIES[i] for i in sought))


def _require_rows(
    model: Model,
    names: tuple[str, ...],
    charges: Array,
    sigma: float,
    noise_pC: float,
    known: Mapping[str, Array | None],
) -> None:
    if charges.ndim != 2 or charges.shape[1] != len(names):
        raise ValueError(f"charges_pC of shape {charges.shape}: give (n, {len(names)})")
    for name, values in known.items():
        if values is not None and np.shape(values) != charges.shape[:1]:
            raise ValueError(f"{name} of shape {np.shape(values)}: give one per row")
    lowest, highest = model.domain.force_N
    forces = known["forces_N"]
    if forces is not None and not np.all((lowest <= forces) & (forces <= highest)):
        raise ValueError(f"forces_N: one is out of the model's {lowest:g} to {highest:g} N")
    if not np.isfinite(charges).all() or not np.all(charges.any(axis=1)):
        raise ValueError("charges_pC: a row is not finite or all zero; leave it out")
    first = dict(zip(names, charges[0].tolist(), strict=True)) if len(charges) else {}
    mistakes = [*charge_mistakes(model.names, first, sigma, noise_pC)]
    if mistakes:
        raise ValueError("\n".join(mistakes))


def _nearest_end(
    problem: Problem,
    table: Nearest,
    rows: NDArray[np.intp],
    held: Mapping[int, Array | None],
    count: int,
) -> Descent:
    """The best end of searches from so many starts, for some rows of the charges."""
    turns = held[ROTATION]
    known = None if turns is None else turns[rows]
    at = table.starts(problem.charges_pC[rows], known, count)
    for quantity, values in held.items():
        if values is not None:
            at[..., quantity] = values[rows, None]
    at = at.reshape(-1, 4)
    # neighbours one after the other share what the model reads
    order = np.lexsort((at[:, Y], at[:, X]))
    found = descend(problem, at[order], np.repeat(rows, count)[order], 0.0)
    back = np.argsort(order)
    ends = _taken(found, back)
    values = np.where(ends.arrived, ends.chi_square, np.inf).reshape(-1, count)
    best = count * np.arange(len(rows)) + values.argmin(axis=1)
    return _taken(ends, best)


def _taken(ends: Descent, rows: NDArray[np.intp]) -> Descent:
    return Descent(ends.at[rows], ends.slopes[rows], ends.chi_square[rows], ends.arrived[rows])


def _unexplained(ends: Descent, freedom: int, significance: float) -> NDArray[np.intp]:
    """Rows whose search did not end, or not where their charges are explained."""
    return np.flatnonzero(~ends.arrived | (p_values(ends.chi_square, freedom) < significance))


def _improve(ends: Descent, rows: NDArray[np.intp], found: Descent) -> None:
    """Replace ends of some rows by others that are better."""
    better = found.arrived & (~ends.arrived[rows] | (found.chi_square < ends.chi_square[rows]))
    taken = rows[better]
    ends.at[taken], ends.slopes[taken] = found.at[better], found.slopes[better]
    ends.chi_square[taken], ends.arrived[taken] = found.chi_square[better], True


def _search_everywhere(problem: Problem, ends: Descent, row: int) -> None:
    """Replace the end of a row by the best that a search from everywhere finds."""
    known = {} if ROTATION in problem.unknown else {ROTATION: float(ends.at[row, ROTATION])}
    if FORCE not in problem.unknown:
        known[FORCE] = float(np.exp(ends.at[row, FORCE]))
    found = search(problem, row, known)
    k = np.array([np.where(found.arrived, found.chi_square, np.inf).argmin()])
    _improve(ends, np.array([row]), _taken(found, k))


def _touches(problem: Problem, ends: Descent, unknown: tuple[str, ...]) -> Touches:
    values, sought = ends.at.copy(), problem.unknown
    if ROTATION in sought:
        values[:, ROTATION] %= period_deg(problem.model)
    values[:, FORCE] = np.exp(values[:, FORCE])
    scale = np.where(sought == FORCE, values[:, FORCE:], 1.0)
    extent = extents(problem.model)[sought]
    covariances, determined = _covariances(ends.slopes[:, :, sought], extent)
    covariances *= scale[:, :, None] * scale[:, None]
    values[~ends.arrived] = np.nan
    chi_square = np.where(ends.arrived, ends.chi_square, np.nan)
    held = np.array([bool(limits) for limits in edges(problem, ends.at)], dtype=bool)
    p = p_values(chi_square, len(problem.electrodes) - len(unknown))
    return Touches(values, unknown, covariances, determined, chi_square, p, held)


def _covariances(slopes: Array, extent: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Covariances (n, unknown, unknown) as a `Touch` has them, and which are determined."""
    J = slopes * extent
    values, vectors = np.linalg.eigh(J.swapaxes(1, 2) @ J)
    free = values < DETERMINED**2
    found = (vectors / (np.maximum(values, 0.0) + free)[:, None]) @ vectors.swapaxes(1, 2)
    determined: NDArray[np.bool_] = np.logical_not(free.any(axis=1))
    return found * np.outer(extent, extent), determined

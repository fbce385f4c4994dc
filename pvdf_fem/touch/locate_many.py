"""The likeliest touch for each of many charges, tens of thousands a second."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pvdf_fem.arrays import Array, Indices, Mask
from pvdf_fem.response.model import FORCE, QUANTITIES, ROTATION, Model, X, Y, period_deg
from pvdf_fem.touch.descent import Descent, descend
from pvdf_fem.touch.locate import DEFAULTS, deviations, edges, extents, p_values, search
from pvdf_fem.touch.mistakes import charge_mistakes
from pvdf_fem.touch.nearest import NearestTouches, nearest_touches
from pvdf_fem.touch.problem import Problem
from pvdf_fem.touch.touch import DETERMINED, SIGNIFICANCE


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
    determined: Mask
    chi_square: Array
    p_value: Array
    at_edge: Mask

    @property
    def explained(self) -> Mask:
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
    retries: int = 8,
) -> Touches:
    """The likeliest place, and force and rotation if they are not known, for rows of charges.

    Each search starts from the touch of a table whose charges have the nearest ratios. Where its
    end does not explain the charges, searches from several touches of the table follow, and at last
    searches from everywhere, as in `locate`.

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
        Charges count as explained if their p-value is not below this. With 0 the touches of the
        first search are kept, however far their charges are.
    retries : int
        Number of starts of the second search.

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
    table = nearest_touches(model, tuple(columns.tolist()), rotations_deg is not None)
    ends = _nearest_end(problem, table, np.arange(len(charges)), held, 1)
    freedom = len(names) - len(sought)
    if (rows := _unexplained(ends, freedom, significance)).size:
        _improve(ends, rows, _nearest_end(problem, table, rows, held, retries))
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
    table: NearestTouches,
    rows: Indices,
    held: Mapping[int, Array | None],
    count: int,
) -> Descent:
    """The best end of searches from `count` starts each, for some rows of the charges."""
    rotations = held[ROTATION]
    known = None if rotations is None else rotations[rows]
    at = table.starts(problem.charges_pC[rows], known, count)
    for quantity, values in held.items():
        if values is not None:
            at[..., quantity] = values[rows, None]
    at = at.reshape(-1, 4)
    # neighbouring touches in sequence share the coefficients that the model reads
    order = np.lexsort((at[:, Y], at[:, X]))
    ends = descend(problem, at[order], np.repeat(rows, count)[order]).take(np.argsort(order))
    best = ends.ranking.reshape(-1, count).argmin(axis=1)
    return ends.take(count * np.arange(len(rows)) + best)


def _unexplained(ends: Descent, freedom: int, significance: float) -> Indices:
    """Rows whose search was given up, or ended where the charges are not explained."""
    return np.flatnonzero(~ends.arrived | (p_values(ends.chi_square, freedom) < significance))


def _improve(ends: Descent, rows: Indices, others: Descent) -> None:
    better = others.ranking < ends.ranking[rows]
    ends.put(rows[better], others.take(np.flatnonzero(better)))


def _search_everywhere(problem: Problem, ends: Descent, row: int) -> None:
    """Replace the end of a row by the best that a search from everywhere finds."""
    known = {}
    if ROTATION not in problem.unknown:
        known[ROTATION] = float(ends.at[row, ROTATION])
    if FORCE not in problem.unknown:
        known[FORCE] = float(np.exp(ends.at[row, FORCE]))
    charges, spread = problem.charges_pC[[row]], problem.deviations_pC[[row]]
    others = search(replace(problem, charges_pC=charges, deviations_pC=spread), known, DEFAULTS)
    _improve(ends, np.array([row]), others.take(np.array([others.ranking.argmin()])))


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
    at_edge = np.array([bool(limits) for limits in edges(problem, ends.at)], dtype=bool)
    p_value = p_values(chi_square, len(problem.electrodes) - len(unknown))
    return Touches(values, unknown, covariances, determined, chi_square, p_value, at_edge)


def _covariances(slopes: Array, extent: Array) -> tuple[Array, Mask]:
    """Covariances (n, unknown, unknown) as a `Touch` has them, and which are determined."""
    J = slopes * extent
    values, vectors = np.linalg.eigh(J.swapaxes(1, 2) @ J)
    free = values < DETERMINED**2
    covariances = (vectors / (np.maximum(values, 0.0) + free)[:, None]) @ vectors.swapaxes(1, 2)
    determined: Mask = np.logical_not(free.any(axis=1))
    return covariances * np.outer(extent, extent), determined

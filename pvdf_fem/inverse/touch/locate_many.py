"""The likeliest touch for each of many charges, tens of thousands a second."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pvdf_fem.arrays import Array, Indices, Mask
from pvdf_fem.inverse.least_squares import SearchOptions, SearchResult, concatenate_results
from pvdf_fem.inverse.touch.location import Location
from pvdf_fem.inverse.touch.location_problem import LocationProblem
from pvdf_fem.inverse.touch.measurement import (
    Deviations,
    Measurement,
    get_units_pC,
)
from pvdf_fem.inverse.touch.search import (
    DEFAULT_OPTIONS,
    describe_touches,
    make_location,
    mark_explained,
    search_everywhere,
    search_rows,
)
from pvdf_fem.inverse.touch.touch import TouchStatus, decide_status
from pvdf_fem.inverse.touch.validation import LARGEST_PC, LEAST_PC, find_reading_errors
from pvdf_fem.scene.arguments import as_response, coerce
from pvdf_fem.summary import Summary, TabularResult, TextTable
from pvdf_fem.surrogate.charge_function import ChargeFunction
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, TouchColumn

#: Rows that are located together: they take some 3 kB each while searches are under way.
CHUNK_ROWS = 32768
SHORT = SearchOptions(max_steps=12)  #: Of searches with mistakes undone, few of which end.


@dataclass(frozen=True, eq=False, repr=False)
class Touches(TabularResult):
    """The likeliest touch found for each row of charges; other touches may be as likely."""

    #: x and y in mm, rotation in degrees, force in N, (n, 4); NaN, as all other numbers, unless
    #: located, or the nearest where `UNEXPLAINED`.
    values: Array
    #: What the readings were taken for, of `READINGS`, and what was sought.
    reading: str
    unknown: tuple[str, ...]
    status: NDArray[np.object_]  #: A `TouchStatus` each, (n,).
    #: Covariances (n, unknown, unknown) as for `Touch`, by the likelihood's curvature there alone.
    covariances: Array
    #: Standard deviations (n, unknown): calibrated as for `Location` if asked for, else by these.
    deviations: Array
    alternatives: Array  #: Number of other touches that are likely, (n,); NaN unless calibrated.
    #: As for `Touch`, (n,).
    determined: Mask
    chi_square: Array
    p_value: Array
    #: Mistakes in readings that would explain them where no touch does, in words, (n,).
    explanations: NDArray[np.object_]
    at_edge: Mask  #: Whether the touch is held by a limit of the model's domain, (n,).

    @classmethod
    def empty(cls, status: NDArray[np.object_], unknown: tuple[str, ...], reading: str) -> Touches:
        """Results to be filled: NaN for numbers, false for flags."""
        n, k = len(status), len(unknown)
        values, covariances, deviations, alternatives, chi_square, p_value = (
            np.full((n, *shape), np.nan) for shape in ((4,), (k, k), (k,), (), (), ())
        )
        determined, at_edge = np.zeros((2, n), dtype=bool)
        other = np.full(n, "", dtype=object)
        numbers = values, reading, unknown, status, covariances, deviations, alternatives
        return cls(*numbers, determined, chi_square, p_value, other, at_edge)

    @property
    def explained(self) -> Mask:
        """Whether a touch explains the charges, (n,)."""
        return np.isfinite(self.chi_square) & (self.status != TouchStatus.UNEXPLAINED)

    def put(self, rows: Indices, problem: LocationProblem, ends: SearchResult) -> None:
        """Write down the ends of searches for some rows."""
        self.status[rows[~ends.converged]] = TouchStatus.NOT_FOUND
        rows, ends = rows[ends.converged], ends.select(np.flatnonzero(ends.converged))
        self.values[rows], root, free, *fit, explained = describe_touches(problem, ends)
        self.chi_square[rows], self.p_value[rows] = fit
        self.covariances[rows] = root @ root.swapaxes(1, 2)
        curved = np.sqrt(np.einsum("nuu->nu", self.covariances[rows]))
        told = self.deviations[rows]  # where calibrated
        self.deviations[rows] = np.where(np.isnan(told), curved, told)
        self.determined[rows] = ~free.any(axis=1)
        self.at_edge[rows] = [
            bool(limits) for limits in problem.find_active_limits(ends.coordinates)
        ]
        reasons = explained, self.alternatives[rows] > 0, self.at_edge[rows]
        self.status[rows] = [*map(decide_status, *(of.tolist() for of in reasons))]

    def summary(self) -> Summary:
        """How many rows are located and explained, and the first and the last touches."""
        about = f"{int(self.explained.sum())} of {len(self.status)} rows are explained"
        return Summary("touches", [about], [TextTable.from_columns(self.columns())])

    def to_table(self) -> dict[str, NDArray[Any]]:
        """Columns (n,): touches, deviations (NaN where known), fit, alternatives, status, remark.

        The remark has words: ``explained if`` with mistakes in readings, ``undetermined``,
        ``at edge``.
        """
        deviations = np.full(self.values.shape, np.nan)
        deviations[:, [TOUCH_QUANTITIES.index(name) for name in self.unknown]] = self.deviations
        columns = ["_deviation_".join(name.rsplit("_", 1)) for name in TOUCH_QUANTITIES]
        found = np.isfinite(self.chi_square)
        remarks = self.explanations.copy()
        for word, rows in {"undetermined": ~self.determined, "at edge": self.at_edge}.items():
            remarks[found & rows] += f"; {word}"
        few = self.status == TouchStatus.UNDETERMINED
        remarks[few & ~found] += "; fewer channels than unknown quantities"
        counts = [None if np.isnan(count) else int(count) for count in self.alternatives]
        return {
            **dict(zip(TOUCH_QUANTITIES, self.values.T, strict=True)),
            **dict(zip(columns, deviations.T, strict=True)),
            "chi_square": self.chi_square,
            "p_value": self.p_value,
            "alternatives": np.array(counts, dtype=object),
            "status": self.status,
            "remark": np.array([remark[2:] for remark in remarks], dtype=object),
        }

    columns = to_table


def locate_many(
    model: ChargeFunction,
    charges_pC: ArrayLike | Mapping[str, ArrayLike],
    sigma: Deviations = 0.01,
    *,
    rotations_deg: ArrayLike | None = None,
    forces_N: ArrayLike | None = None,
    noise_pC: Deviations | None = None,
    reading: str | None = None,
    unit: str = "pC",
    calibrated: bool = False,
) -> Touches:
    """The likeliest place, and force and rotation if they are not known, for rows of charges.

    Each search starts from the touch of a table whose charges have the nearest ratios. Where its
    end does not explain the charges, searches from several touches of the table follow, and at last
    searches from everywhere, as in `locate`. A row that cannot be used changes no other row.

    Parameters
    ----------
    model, sigma, noise_pC, reading, unit
        As for `locate`.
    charges_pC : array_like, shape (n, electrodes), or mapping
        Rows of readings as for `locate`, of all electrodes, or the readings of all rows by the
        electrode's name, of some.
    rotations_deg, forces_N : array_like, shape (n,), optional
        Known rotations, in the frame of the scene's stage, and forces; sought if not given.
    calibrated : bool
        Find all likely touches of each row, and calibrated deviations, as `locate` does; that is
        a hundred times slower.

    Raises
    ------
    ValueError
        For shapes that do not match, and mistakes as `locate` tells them.

    Examples
    --------
    >>> response = build_response("sensor.toml", tolerance=3e-2)
    >>> readings = [[350.0, 240.0, 200.0, 230.0], [330.0, 300.0, 210.0, 240.0]]
    >>> locate_many(response, readings, sigma=0.01, reading="change").status
    """
    names, charges = _table(as_response(model), charges_pC)
    calibrated = coerce("calibrated", calibrated, bool)
    any_charges, noise = dict.fromkeys(names, math.pi), (sigma, noise_pC, reading)
    mistakes = [
        *find_reading_errors(model.scene, any_charges, *noise, model.unloaded_charges_pC, unit)
    ]
    known: dict[int, Array] = {}
    given = {
        "rotations_deg": (TouchColumn.ROTATION, rotations_deg),
        "forces_N": (TouchColumn.FORCE, forces_N),
    }
    for name, (i, values) in given.items():
        if values is not None:
            known[i] = _numbers(values, name)
            if known[i].shape != charges.shape[:1]:
                mistakes.append(f"{name} of shape {known[i].shape}: give one per row")
    if mistakes:
        raise ValueError("\n".join(mistakes))
    measurement = Measurement.from_response(model, names, *noise, unit)
    units = get_units_pC(model.scene, unit)
    charges = charges * [units[name] for name in names]
    sought = np.array([i for i in range(len(TOUCH_QUANTITIES)) if i not in known])
    status = _status(measurement, charges, known, sought)
    found = Touches.empty(status, tuple(TOUCH_QUANTITIES[i] for i in sought), measurement.reading)
    usable = np.flatnonzero(status == TouchStatus.LOCATED)
    for first in range(0, len(usable), CHUNK_ROWS):
        rows = usable[first : first + CHUNK_ROWS]
        held = _held(known, rows)
        problem = measurement.make_problem(charges[rows], sought)
        ends = search_rows(problem, held, 1)
        if (again := np.flatnonzero(~mark_explained(problem, ends))).size:
            others = search_rows(
                problem.select_rows(again), _held(known, rows[again]), DEFAULT_OPTIONS.retries
            )
            ends.replace_worse(again, others)
        strange = (
            np.arange(len(rows)) if calibrated else np.flatnonzero(~mark_explained(problem, ends))
        )
        for k in strange.tolist():
            there = _everywhere(problem, ends, held, k)
            if calibrated:
                found.alternatives[rows[k]] = there.alternatives
                if there.touches:
                    found.deviations[rows[k]] = [*there.deviations.values()]
        found.put(rows, problem, ends)
        strange = rows[~found.explained[rows]]
        told = measurement, charges[strange], sought, _held(known, strange)
        for text, _, _, which in find_explanations(*told):
            found.explanations[strange[which]] += f"; explained if {text}"
    return found


def _held(known: Mapping[int, Array], rows: Indices) -> dict[int, Array]:
    """Coordinates that some rows know, from quantities of all rows."""
    return {i: np.log(of[rows]) if i == TouchColumn.FORCE else of[rows] for i, of in known.items()}


def find_explanations(
    measurement: Measurement, readings: Array, sought: Indices, held: Mapping[int, Array]
) -> Iterator[tuple[str, LocationProblem, SearchResult, Indices]]:
    """Mistakes that explain some of the readings (n, electrodes): a text, the problem without the
    mistake, ends of searches that explain readings, and their rows."""
    for text, meant, undone in measurement.list_alternatives() if len(readings) else ():
        problem = meant.make_problem(undone(readings), sought)
        ends = search_rows(problem, held, 1, SHORT)
        rows = np.flatnonzero(mark_explained(problem, ends))
        if rows.size:
            yield text, problem, ends.select(rows), rows


def _everywhere(
    problem: LocationProblem, ends: SearchResult, held: Mapping[int, Array], k: int
) -> Location:
    """What `locate` finds for a row, and with its end so far; improves the end."""
    row, known = np.array([k]), {i: float(values[k]) for i, values in held.items()}
    alone = problem.select_rows(row)
    every = concatenate_results(
        [ends.select(row), search_everywhere(alone, known, DEFAULT_OPTIONS)]
    )
    ends.replace_worse(row, every.select(every.ranking.argsort()[:1]))
    return make_location(alone, every)


def _table(
    model: ChargeFunction, charges_pC: ArrayLike | Mapping[str, ArrayLike]
) -> tuple[tuple[str, ...], Array]:
    """Names of electrodes, and their charges (n, electrodes)."""
    if not hasattr(charges_pC, "keys"):
        names, charges = tuple(model.names), _numbers(charges_pC, "charges_pC")
        if charges.ndim != 2 or charges.shape[1] != len(names):
            raise ValueError(f"charges_pC of shape {charges.shape}: give (n, {len(names)})")
        return names, charges
    given: Any = charges_pC
    columns = {name: _numbers(given[name], f"charges_pC.{name}") for name in given}
    if len({column.shape for column in columns.values()}) > 1:
        raise ValueError("charges_pC: columns differ in length; give one charge per row")
    return tuple(columns), np.stack([*columns.values()], axis=1) if columns else np.empty((0, 0))


def _numbers(values: Any, what: str) -> Array:
    """Values as floats, NaN for None; raises `ValueError` for what is no table of numbers."""
    try:
        return np.asarray(values, dtype=float)
    except (TypeError, ValueError, OverflowError):
        advice = "give numbers, NaN where there is none"
        raise ValueError(f"{what}: {values!r:.60} is no table of numbers; {advice}") from None


def _status(
    measurement: Measurement, readings: Array, known: Mapping[int, Array], sought: Indices
) -> NDArray[np.object_]:
    """What keeps rows from being located; `TouchStatus.LOCATED` for those that can be."""
    determinable = measurement.make_problem(np.zeros_like(readings[:1]), sought).is_determinable
    usual = np.clip(readings, -LARGEST_PC, LARGEST_PC)  # numbers of any size are told, not squared
    small = np.abs(measurement.to_signals(usual)) < LEAST_PC
    lowest, highest = measurement.response.domain.force_N
    forces = known.get(TouchColumn.FORCE, np.full(len(readings), lowest))
    # the last reasons win
    reasons = {
        TouchStatus.UNDETERMINED: np.full(len(readings), not determinable),
        TouchStatus.OUTSIDE: ~((lowest <= forces) & (forces <= highest)),
        TouchStatus.ZERO: small.all(axis=1) | (small & (measurement.noise_pC == 0.0)).any(axis=1),
        TouchStatus.TOO_LARGE: (np.abs(readings) > LARGEST_PC).any(axis=1),
        TouchStatus.NOT_FINITE: ~np.isfinite([*readings.T, *known.values()]).all(axis=0),
    }
    status = np.full(len(readings), TouchStatus.LOCATED, dtype=object)
    for reason, rows in reasons.items():
        status[rows] = reason
    return status

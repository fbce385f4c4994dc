"""What the thesis names as causes of its experiments' errors, and what each does to the charges.

Every source is a random relative change of each electrode's charge. Where the geometry or the film
changes, the change comes from the finite-element model; the thesis gives few sizes, so what is
assumed is written with each source.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from pvdf_fem import Scene, solve
from pvdf_fem.maps.circuit import Circuit
from pvdf_fem.solvers.newton import Status
from pvdf_fem.touch.touch import Model
from reports.chapters.contact import pressed
from reports.common.thesis_data import Position
from reports.locating.errors import over_disc
from reports.locating.film import taped, uneven_charges
from reports.locating.models import rows_of

Array = NDArray[np.float64]
Job = Callable[[], Array]
Draw = Callable[["Pressed", np.random.Generator, int], Array]

PROBE_MM, FILM_MM = 1.0, 2.0
FORCE_SHARE = 0.02
LOAD_MOHM = (250.0, 1000.0)
TAPE_FACTORS = (4.0, 30.0, 100.0)
FREQUENCY_HZ = 20.0


@dataclass(frozen=True, eq=False)
class Changed:
    """Logarithms of charges over those of the scene as the thesis simulates it.

    Attributes
    ----------
    rest : ndarray, shape (electrodes,)
        Charges under the probe less those of the film at rest.
    film : ndarray, shape (5, electrodes)
        Coefficients of dx, dy, dx², dx dy, dy² in mm of a film displaced with its electrodes.
    stretched : ndarray, shape (3, electrodes)
        Slopes by the free strains xx, yy, xy over the even film's.
    taped : ndarray, shape (1 + factors, electrodes)
        At stiffness 1 and the `TAPE_FACTORS`.
    rigid : ndarray, shape (2, electrodes)
        Under a rigid probe, sliding and stuck.
    """

    rest: Array
    film: Array
    stretched: Array
    taped: Array
    rigid: Array


@dataclass(frozen=True, eq=False)
class Pressed:
    """A measured scene of the thesis.

    Attributes
    ----------
    row : Position
    model : Model
    electrodes : dict
        The model's name of each electrode by the thesis's.
    circuit : Circuit
        An electrode and its load, in theory.
    capacitance_pF : float
        What two electrodes have instead.
    changed : Changed
    """

    row: Position
    model: Model
    electrodes: Mapping[str, str]
    circuit: Circuit
    capacitance_pF: float
    changed: Changed

    def charges_pC(self, touches: Array) -> Array:
        """Charges (n, electrodes) of touches (n, 4)."""
        return self.model.evaluate(touches)[0][:, rows_of(self.model, self.electrodes)]


@dataclass(frozen=True)
class Source:
    """A source of errors: its name, where the thesis names it, what is assumed, its draws."""

    name: str
    place: str
    assumed: str
    draw: Draw


def changes(scene: Scene, workers: Callable[[Sequence[Job]], list[Array]]) -> Changed:
    """The changes of a scene's charges, by finite elements.

    `workers` runs functions and gives their results, in several processes if it likes.
    """
    turns = np.radians(np.arange(0, 360, 45))
    offsets = FILM_MM * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    steps = 0.5 * np.concatenate([np.eye(3), -np.eye(3)])
    displaced = [_displaced(scene, at) for at in offsets]
    rigid = [pressed(scene, contact) for contact in ("sliding", "stuck")]
    resting = scene.with_(probe=None)
    jobs = [partial(_solved, one) for one in (scene, resting, *displaced, *rigid)]
    jobs += [partial(_stretched, scene, step) for step in steps]
    jobs.append(partial(uneven_charges, taped(scene), factors=(1.0, *TAPE_FACTORS)))
    base, rest, *others, tape = workers(jobs)
    moved, punched, stretched = np.split(np.log(np.array(others)), [len(offsets), len(offsets) + 2])
    return Changed(
        np.log1p(-rest / base),
        np.linalg.lstsq(_powers(offsets), moved - np.log(base))[0],
        stretched[:3] - stretched[3:],
        np.log(tape / tape[0]),
        punched - np.log(base),
    )


def _solved(scene: Scene) -> Array:
    solution = solve(scene)
    if solution.status is not Status.CONVERGED:
        raise RuntimeError(f"a scene did not converge: {solution.status}")
    return np.array(list(solution.charges_pC.values()))


def _powers(offsets_mm: Array) -> Array:
    """Of displacements (n, 2), as in `Changed.film`, (n, 5)."""
    x, y = offsets_mm.T
    return np.stack([x, y, x * x, x * y, y * y], axis=1)


def _displaced(scene: Scene, offset_mm: Array) -> Scene:
    dx, dy = offset_mm.tolist()
    moved = [
        {**e.model_dump(mode="json"), "x_mm": e.x_mm + dx, "y_mm": e.y_mm + dy}
        for e in scene.electrode_list
    ]
    return scene.with_(electrodes=moved)


def _stretched(scene: Scene, step: Array) -> Array:
    """Charges with the free strain changed by a step (3,) of the even film's."""
    even = scene.film.thermal_strain
    return uneven_charges(scene, even * (np.array([1.0, 1.0, 0.0]) + step))[0]


# -------------------------------------------------------------------------------------- draws


def _probe(scene: Pressed, random: np.random.Generator, count: int) -> Array:
    touches = np.tile(scene.row.touch, (count, 1))
    touches[:, :2] += over_disc(random, count, PROBE_MM)
    return scene.charges_pC(touches) / scene.charges_pC(scene.row.touch[None])


def _film(scene: Pressed, random: np.random.Generator, count: int) -> Array:
    return np.exp(_powers(over_disc(random, count, FILM_MM)) @ scene.changed.film)


def _capacitance(scene: Pressed, random: np.random.Generator, count: int) -> Array:
    """Two electrodes, no one knows which, read with the capacitance of theory."""
    small = Circuit(1e-12 * scene.capacitance_pF, scene.circuit.load_resistance)
    higher = abs(small.voltage(1.0, FREQUENCY_HZ)) / abs(scene.circuit.voltage(1.0, FREQUENCY_HZ))
    number = len(scene.electrodes)
    pairs = np.ones((number * (number - 1) // 2, number))
    for row, pair in zip(pairs, combinations(range(number), 2), strict=True):
        row[list(pair)] = higher
    return pairs[random.integers(len(pairs), size=count)]


def _load(scene: Pressed, random: np.random.Generator, count: int) -> Array:
    """All electrodes alike: the true resistance is not the one used."""
    lowest, highest = LOAD_MOHM
    used = abs(scene.circuit.parallel_load(FREQUENCY_HZ))
    true = [
        abs(Circuit(scene.circuit.capacitance, 1e6 * R).parallel_load(FREQUENCY_HZ)) / used
        for R in lowest * (highest / lowest) ** random.random(count)
    ]
    return np.tile(np.array(true)[:, None], (1, len(scene.electrodes)))


def _force(scene: Pressed, random: np.random.Generator, count: int) -> Array:
    touches = np.tile(scene.row.touch, (count, 1))
    touches[:, 3] *= 1.0 + FORCE_SHARE * random.standard_normal(count)
    return scene.charges_pC(touches) / scene.charges_pC(scene.row.touch[None])


def _tapes(scene: Pressed, random: np.random.Generator, count: int) -> Array:
    known = np.log([1.0, *TAPE_FACTORS])
    at = known[1] + (known[-1] - known[1]) * random.random(count)
    logs = [np.interp(at, known, column) for column in scene.changed.taped.T]
    return np.exp(np.stack(logs, axis=1))


def _pretension(scene: Pressed, random: np.random.Generator, count: int) -> Array:
    first, second = 2.0 * random.random((2, count))
    mean, half = 0.5 * (first + second), 0.5 * (first - second)
    turn = 2.0 * np.pi * random.random(count)
    steps = [mean + half * np.cos(turn) - 1.0, mean - half * np.cos(turn) - 1.0]
    steps.append(2.0 * half * np.sin(turn))  # engineering shear
    return np.exp(np.stack(steps, axis=1) @ scene.changed.stretched)


def _rigid(scene: Pressed, random: np.random.Generator, count: int) -> Array:
    t = random.random((count, 1))
    return np.exp((1.0 - t) * scene.changed.rigid[0] + t * scene.changed.rigid[1])


def _rest(scene: Pressed, random: np.random.Generator, count: int) -> Array:
    return np.tile(np.exp(scene.changed.rest), (count, 1))


#: In the thesis's words, then ours.
SOURCES = (
    Source(
        "probe placed",
        "6.1, item 11",
        f"anywhere within {PROBE_MM:g} mm of the place meant",
        _probe,
    ),
    Source(
        "film placed",
        "6.1, item 11",
        f"electrodes anywhere within {FILM_MM:g} mm; the thesis says more than the probe",
        _film,
    ),
    Source(
        "capacitances",
        "6.1, item 10",
        "two electrodes of 23 pF, any two, read as 35 pF, load in parallel",
        _capacitance,
    ),
    Source(
        "load resistance",
        "6.1, item 13; App. 5",
        f"{LOAD_MOHM[0]:g} to {LOAD_MOHM[1]:g} MΩ, logarithmically even, read as 500 MΩ",
        _load,
    ),
    Source(
        "force fluctuates",
        "6.1, item 12",
        f"normal, {100 * FORCE_SHARE:g} %; the thesis says small",
        _force,
    ),
    Source(
        "tapes stiffen",
        "6.1, item 9",
        f"a strip of 5 mm from each electrode to the rim, {TAPE_FACTORS[0]:g} (adhesive) to "
        f"{TAPE_FACTORS[-1]:g} (copper of 50 µm) times as stiff as the film",
        _tapes,
    ),
    Source(
        "uneven pretension",
        "6.1, item 8",
        "principal strains of 0 to 2 times the simulated one, any direction, no wrinkles",
        _pretension,
    ),
    Source("rigid probe", "5.2", "between sliding and stuck, simulated as a pressure", _rigid),
    Source("charge at rest", "not named", "not seen at 20 Hz, but in the simulated charges", _rest),
)

"""The causes that the thesis names for its experiments' errors, and their effects on the charges.

Every source is a random relative change of each electrode's charge. Where the geometry or the film
changes, the change comes from the finite-element model. The thesis gives few sizes; those that are
assumed instead stand in `Assumptions` and with each source.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from pvdf_fem import Scene
from pvdf_fem.response.model import Model
from reports.chapters.contact import pressed
from reports.common.thesis_data import Position
from reports.locating.errors import over_disc
from reports.locating.film import taped, uneven_charges
from reports.locating.models import rows_of
from reports.locating.transducer import (
    CONDITIONS,
    Job,
    TransducerChanges,
    solved_charges,
    transducer_changes,
)
from reports.thesis_methods.circuit import Circuit

Array = NDArray[np.float64]
Draw = Callable[["MeasuredScene", np.random.Generator, int], Array]


@dataclass(frozen=True)
class Assumptions:
    """Sizes of the sources of error.

    Attributes
    ----------
    probe_mm, film_mm : float
        Largest distances of the probe, and of the film with its electrodes, from the places meant.
    force_share : float
        Relative standard deviation of the force.
    load_MOhm : (float, float)
        Smallest and largest load resistance.
    tape_factors : tuple of float
        Stiffness of the tapes over the film's: adhesive, a value between, copper of 50 µm.
    kelvins : float
        Standard deviation of the probe's temperature over that of the film.
    d33_pC_N : (float, float)
        Smallest and largest size of d33, in pC/N.
    varied : float
        Standard deviation of the rim's displacements that are not the same all round, over the one
        by which the simulated cooling stretches the film.
    """

    probe_mm: float = 1.0
    film_mm: float = 2.0
    force_share: float = 0.02
    load_MOhm: tuple[float, float] = (250.0, 1000.0)
    tape_factors: tuple[float, ...] = (4.0, 30.0, 100.0)
    kelvins: float = 1.0
    d33_pC_N: tuple[float, float] = (10.0, 30.0)
    varied: float = 0.5


ASSUMED = Assumptions()


@dataclass(frozen=True, eq=False)
class Changed:
    """Logarithms of charges over those of the scene as the thesis simulates it.

    Attributes
    ----------
    rest : ndarray, shape (electrodes,)
        Logarithms for the charges less those of the film at rest.
    film : ndarray, shape (5, electrodes)
        Coefficients of dx, dy, dx², dx dy, dy² in mm, by which the film and its electrodes are
        displaced.
    stretched : ndarray, shape (3, electrodes)
        Slopes by the free strains xx, yy, xy, in units of the even film's strain.
    taped : ndarray, shape (1 + factors, electrodes)
        Logarithms for tapes of stiffness 1 and of the `Assumptions.tape_factors`.
    rigid : ndarray, shape (2, electrodes)
        Logarithms for a rigid probe, sliding and stuck.
    transducer : TransducerChanges
        Of coupling, heat, air, the thickness direction, tapes on electrodes and the rim.
    """

    rest: Array
    film: Array
    stretched: Array
    taped: Array
    rigid: Array
    transducer: TransducerChanges


@dataclass(frozen=True, eq=False)
class MeasuredScene:
    """A measured scene of the thesis.

    Attributes
    ----------
    row : Position
    model : Model
    electrodes : dict
        The model's name of each electrode by the thesis's name.
    circuit : Circuit
        An electrode with the capacitance of theory, and its load.
    capacitance_pF : float
        Measured capacitance of two of the electrodes.
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
    """A source of errors.

    Attributes
    ----------
    name : str
    place : str
        Where the thesis names it.
    assumed : str
        Size that is assumed, in words.
    draw : callable
        From a scene, a random generator and a count to factors of the charges,
        (count, electrodes).
    """

    name: str
    place: str
    assumed: str
    draw: Draw


def changes(scene: Scene, workers: Callable[[Sequence[Job]], list[Array]]) -> Changed:
    """Compute the changes of a scene's charges by finite elements.

    Parameters
    ----------
    scene : Scene
    workers : callable
        Runs functions and gives their results in order, perhaps in several processes.
    """
    turns = np.radians(np.arange(0, 360, 45))
    offsets = ASSUMED.film_mm * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    steps = 0.5 * np.concatenate([np.eye(3), -np.eye(3)])
    displaced = [_displaced(scene, at) for at in offsets]
    rigid = [pressed(scene, contact) for contact in ("sliding", "stuck")]
    resting = scene.with_(probe=None)
    jobs = [
        partial(solved_charges, changed_scene)
        for changed_scene in (scene, resting, *displaced, *rigid)
    ]
    jobs += [partial(_stretched, scene, step) for step in steps]
    jobs.append(partial(uneven_charges, taped(scene), factors=(1.0, *ASSUMED.tape_factors)))
    simulated, at_rest, *changed, with_tapes = workers(jobs)
    moved, punched, stretched = np.split(
        np.log(np.array(changed)), [len(offsets), len(offsets) + 2]
    )
    return Changed(
        np.log1p(-at_rest / simulated),
        np.linalg.lstsq(_powers(offsets), moved - np.log(simulated))[0],
        stretched[:3] - stretched[3:],
        np.log(with_tapes / with_tapes[0]),
        punched - np.log(simulated),
        transducer_changes(scene, workers),
    )


def _powers(offsets_mm: Array) -> Array:
    """The powers of displacements (n, 2) that `Changed.film` has coefficients of, (n, 5)."""
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
    """Charges after a change of the free strain by `step` (3,), in units of the even strain."""
    even = -scene.film.strain_at_rest
    return uneven_charges(scene, even + even[0] * step)[0]


# -------------------------------------------------------------------------------------- draws


def _probe(scene: MeasuredScene, random: np.random.Generator, count: int) -> Array:
    touches = np.tile(scene.row.touch, (count, 1))
    touches[:, :2] += over_disc(random, count, ASSUMED.probe_mm)
    return scene.charges_pC(touches) / scene.charges_pC(scene.row.touch[None])


def _film(scene: MeasuredScene, random: np.random.Generator, count: int) -> Array:
    return np.exp(_powers(over_disc(random, count, ASSUMED.film_mm)) @ scene.changed.film)


def _capacitance(scene: MeasuredScene, random: np.random.Generator, count: int) -> Array:
    """Read two random electrodes with the capacitance of theory instead of the measured one."""
    small = Circuit(1e-12 * scene.capacitance_pF, scene.circuit.load_resistance)
    small_voltage, voltage = (
        abs(circuit.voltage(1.0, CONDITIONS.frequency_Hz)) for circuit in (small, scene.circuit)
    )
    number = len(scene.electrodes)
    pairs = np.ones((number * (number - 1) // 2, number))
    for row, pair in zip(pairs, combinations(range(number), 2), strict=True):
        row[list(pair)] = small_voltage / voltage
    return pairs[random.integers(len(pairs), size=count)]


def _load(scene: MeasuredScene, random: np.random.Generator, count: int) -> Array:
    """Read all electrodes with a load resistance that is not the true one."""
    lowest, highest = ASSUMED.load_MOhm
    assumed = abs(scene.circuit.parallel_load(CONDITIONS.frequency_Hz))
    ratios = [
        abs(Circuit(scene.circuit.capacitance, 1e6 * R).parallel_load(CONDITIONS.frequency_Hz))
        / assumed
        for R in lowest * (highest / lowest) ** random.random(count)
    ]
    return np.tile(np.array(ratios)[:, None], (1, len(scene.electrodes)))


def _force(scene: MeasuredScene, random: np.random.Generator, count: int) -> Array:
    touches = np.tile(scene.row.touch, (count, 1))
    touches[:, 3] *= 1.0 + ASSUMED.force_share * random.standard_normal(count)
    return scene.charges_pC(touches) / scene.charges_pC(scene.row.touch[None])


def _tapes(scene: MeasuredScene, random: np.random.Generator, count: int) -> Array:
    log_factors = np.log([1.0, *ASSUMED.tape_factors])
    log_factor = log_factors[1] + (log_factors[-1] - log_factors[1]) * random.random(count)
    logs = [np.interp(log_factor, log_factors, column) for column in scene.changed.taped.T]
    return np.exp(np.stack(logs, axis=1))


def _pretension(scene: MeasuredScene, random: np.random.Generator, count: int) -> Array:
    first_principal, second_principal = 2.0 * random.random((2, count))
    mean = 0.5 * (first_principal + second_principal)
    half = 0.5 * (first_principal - second_principal)
    turn = 2.0 * np.pi * random.random(count)
    steps = [mean + half * np.cos(turn) - 1.0, mean - half * np.cos(turn) - 1.0]
    steps.append(2.0 * half * np.sin(turn))  # engineering shear
    return np.exp(np.stack(steps, axis=1) @ scene.changed.stretched)


def _rigid(scene: MeasuredScene, random: np.random.Generator, count: int) -> Array:
    t = random.random((count, 1))
    return np.exp((1.0 - t) * scene.changed.rigid[0] + t * scene.changed.rigid[1])


def _rest(scene: MeasuredScene, random: np.random.Generator, count: int) -> Array:
    return np.tile(np.exp(scene.changed.rest), (count, 1))


def _across(scene: MeasuredScene, random: np.random.Generator, count: int) -> Array:
    low, high = ASSUMED.d33_pC_N
    times = (low + (high - low) * random.random((count, 1))) / abs(CONDITIONS.d33_pC_N)
    return 1.0 + times * np.expm1(scene.changed.transducer.across)


def _open(scene: MeasuredScene, random: np.random.Generator, count: int) -> Array:
    return np.exp(random.random((count, 1)) * scene.changed.transducer.open)


def _warm(scene: MeasuredScene, random: np.random.Generator, count: int) -> Array:
    kelvins = ASSUMED.kelvins * random.standard_normal((count, 1))
    return 1.0 + kelvins * np.expm1(scene.changed.transducer.warm)


def _air(scene: MeasuredScene, random: np.random.Generator, count: int) -> Array:
    forces = np.log(CONDITIONS.forces_N)
    mean_force = forces[0] + (forces[-1] - forces[0]) * random.random(count)
    columns = scene.changed.transducer.air.T
    return np.exp(np.stack([np.interp(mean_force, forces, logs) for logs in columns], axis=1))


def _covered(scene: MeasuredScene, random: np.random.Generator, count: int) -> Array:
    overlaps = random.random((count, len(scene.electrodes)))
    return np.exp(overlaps * scene.changed.transducer.covered)


def _varied(scene: MeasuredScene, random: np.random.Generator, count: int) -> Array:
    steps = ASSUMED.varied * random.standard_normal((count, 4))
    return np.exp(steps @ scene.changed.transducer.varied)


#: Sources that the thesis names, and last those that it does not name.
SOURCES = (
    Source(
        "probe placed",
        "6.1, item 11",
        f"anywhere within {ASSUMED.probe_mm:g} mm of the place meant",
        _probe,
    ),
    Source(
        "film placed",
        "6.1, item 11",
        f"electrodes anywhere within {ASSUMED.film_mm:g} mm; the thesis says more than the probe",
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
        f"{ASSUMED.load_MOhm[0]:g} to {ASSUMED.load_MOhm[1]:g} MΩ, logarithmically even, read as "
        "500 MΩ",
        _load,
    ),
    Source(
        "force fluctuates",
        "6.1, item 12",
        f"normal, {100 * ASSUMED.force_share:g} %; the thesis says small",
        _force,
    ),
    Source(
        "tapes stiffen",
        "6.1, item 9",
        f"a strip of 5 mm from each electrode to the rim, {ASSUMED.tape_factors[0]:g} (adhesive) "
        f"to {ASSUMED.tape_factors[-1]:g} (copper of 50 µm) times as stiff as the film",
        _tapes,
    ),
    Source(
        "uneven pretension",
        "6.1, item 8",
        "principal strains of 0 to 2 times the simulated one, any direction, no wrinkles",
        _pretension,
    ),
    Source(
        "tapes on electrodes",
        "6.1, item 9",
        f"over the outer 0 to {CONDITIONS.overlap_mm:g} mm of each electrode, each by itself, "
        f"50 µm of {CONDITIONS.tape_GPa:g} GPa on both sides",
        _covered,
    ),
    Source(
        "pretension varies",
        "6.1, item 8",
        "the rim moved by cos θ, sin θ, cos 3θ, sin 3θ, each normal, half as far as the simulated "
        "cooling stretches",
        _varied,
    ),
    Source(
        "thickness direction",
        "3.1, 6.2",
        f"d33 of -{ASSUMED.d33_pC_N[0]:g} to -{ASSUMED.d33_pC_N[1]:g} pC/N under the probe, "
        "simulated without",
        _across,
    ),
    Source(
        "voltages of electrodes",
        "App. 2",
        "from short to open, simulated short; they stiffen the film",
        _open,
    ),
    Source(
        "touch is warm",
        "6.1, item 15",
        f"normal, {ASSUMED.kelvins:g} K over the film, {1e3 * CONDITIONS.contact_s:g} ms (half a "
        "period)",
        _warm,
    ),
    Source(
        "air and time",
        "6.1, item 6",
        f"{CONDITIONS.frequency_Hz:g} Hz in air about {CONDITIONS.forces_N[0]:g} to "
        f"{CONDITIONS.forces_N[-1]:g} N, simulated as static",
        _air,
    ),
    Source("rigid probe", "5.2", "between sliding and stuck, simulated as a pressure", _rigid),
    Source("charge at rest", "not named", "not seen at 20 Hz, but in the simulated charges", _rest),
)

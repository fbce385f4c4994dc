"""What was measured: readings of electrodes, which stand for charges and have errors of their own;
and what is wrong with readings and quantities that a touch is to be located from, in sentences.

A reading in nominal pC is gain x charge + offset, its gain and offset being those of the channel in
the scene's readout, and the charge either all of it (`total`) or what the touch adds to that of the
stretched film (`change`), as an amplifier sees it that was zeroed before the touch.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.electrodes.channel import READINGS, list_units_pC, make_channels
from pvdf_fem.electrodes.misreadings import list_misreadings
from pvdf_fem.inverse.touch.location_problem import LocationProblem
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.stage import Stage
from pvdf_fem.surrogate.charge_function import (
    ChargeFunction,
    UnloadedCharges,
    compute_unloaded_charges_pC,
)
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, Domain

LARGEST_PC = 1e12  #: Readings beyond this many pC are in another unit, or none.
LEAST_PC = 1e-12  #: Charges or changes below this many pC count as zero.
UNITS = ("pC", "V")  #: Of readings.
#: Standard deviations, one for all electrodes or one by electrode.
Deviations = float | Mapping[str, float]


@dataclass(frozen=True, eq=False)
class Measurement:
    """How charges follow from readings of some electrodes, and with which errors. Arrays are
    (electrodes,)."""

    response: ChargeFunction
    electrodes: Indices  #: Of the electrodes in the model.
    reading: str  #: Of `READINGS`.
    unit: str  #: Of `list_units_pC`, in which readings were given.
    gains: Array
    offsets_pC: Array
    rest_pC: Array  #: Charges of the film without a touch; NaN where it has none.
    rest_errors_pC: Array  #: Their estimated errors.
    sigma: Array  #: Standard deviation over the charge or the change, whichever is read.
    noise_pC: Array  #: Standard deviation of a reading besides.

    @classmethod
    def from_response(
        cls,
        model: ChargeFunction,
        names: Sequence[str],
        sigma: Deviations,
        noise_pC: Deviations | None,
        reading: str | None,
        unit: str = "pC",
    ) -> Measurement:
        """Measurement of named electrodes; `noise_pC` and `reading` are by default the readout's.
        Raises `UnloadedFilmError` for changes of a film without charges at rest."""
        electrodes = np.array([model.names.index(name) for name in names])
        by_name = get_channel_values(model.scene)
        gains, offsets, noise = np.array([by_name[name] for name in names]).T
        if noise_pC is not None:
            noise = _by_name(noise_pC, names)
        relative = _by_name(sigma, names)
        if not (model.error_bound or (relative + noise).all()):
            raise ValueError("sigma = 0: the model has no error of its own; give a positive one")
        if reading is None:
            reading = get_reading(model.scene)
        rest = compute_unloaded_charges(model, reading)[:, electrodes]
        columns = gains, offsets, *rest, relative, noise
        return cls(model, electrodes, reading, unit, *columns)

    def list_misreadings(self) -> Iterator[tuple[str, Measurement, Callable[[Array], Array]]]:
        """Mistakes in readings: a text, what readings are without it, and what undoes it."""
        if not np.isnan(self.rest_pC).any():
            (reading,) = READINGS.keys() - {self.reading}
            yield f"readings are {READINGS[reading]}", replace(self, reading=reading), np.asarray
        given = [make_channels(self.response.scene)[i] for i in self.electrodes]
        for mistake in list_misreadings(given, self.unit):
            if mistake.exchanged <= 2:
                yield mistake.text, self, mistake.undone

    def problem(self, readings_pC: Array, unknown: Indices) -> LocationProblem:
        """The problem of the touches that gave readings (n, electrodes)."""
        charges = self.signals(readings_pC) + self.zero_pC
        # an error evenly distributed within the bound
        model_error = self.response.error_bound / math.sqrt(3.0)
        variance = np.square(self.noise(charges)) + np.square(model_error * charges)
        if self.reading == "change":
            variance += np.square(self.rest_errors_pC)
        stage = self.response.scene.stage or Stage()
        given = self.response, self.electrodes, charges, np.sqrt(variance)
        return LocationProblem(*given, unknown, stage, self.reading)

    @property
    def zero_pC(self) -> Array:
        """Charges (electrodes,) that the channels read as zero."""
        return self.rest_pC if self.reading == "change" else np.zeros(len(self.rest_pC))

    def signals(self, readings_pC: Array) -> Array:
        """The charges or changes that readings stand for, in pC."""
        return np.asarray((readings_pC - self.offsets_pC) / self.gains)

    def readings(self, charges_pC: Array) -> Array:
        """Readings in nominal pC of charges (n, electrodes)."""
        return np.asarray(self.offsets_pC + self.gains * (charges_pC - self.zero_pC))

    def noise(self, charges_pC: Array) -> Array:
        """Standard deviations in pC, over the gain, of readings of charges (n, electrodes)."""
        signals = charges_pC - self.zero_pC
        return np.asarray(np.hypot(self.sigma * signals, self.noise_pC / self.gains))


@lru_cache(maxsize=8)
def get_channel_values(scene: Scene) -> dict[str, tuple[float, float, float]]:
    """Gain, and offset and noise in nominal pC, of each electrode."""
    units = {c: 1e12 * c.capacitance for c in make_channels(scene)}
    return {c.name: (c.gain, unit * c.offset, unit * c.noise) for c, unit in units.items()}


def get_units_pC(scene: Scene, unit: str) -> dict[str, float]:
    """A unit of readings in nominal pC, by electrode; 1 for what is none."""
    wired = make_channels(scene)
    units = list_units_pC(wired)
    return {c.name: of for c, of in zip(wired, units.get(unit, units["pC"]).tolist(), strict=True)}


def get_reading(scene: Scene) -> str:
    """What readings of a scene are, of `READINGS`: what its readout says, or else charges."""
    return scene.readout.reading if scene.readout else "total"


def compute_unloaded_charges(model: ChargeFunction, reading: str) -> Array:
    """Return the charges of the unloaded film and their errors in pC, (2, electrodes).

    They are those of the response if it has them, else they are computed.
    """
    return (
        compute_unloaded_charges_pC(model.scene, reading)
        if model.unloaded_charges_pC is None
        else np.array(model.unloaded_charges_pC)
    )


def _by_name(values: Deviations, names: Sequence[str]) -> Array:
    given = [values[n] for n in names] if isinstance(values, Mapping) else [values] * len(names)
    return np.array(given, dtype=float)


def get_centre_mm(scene: Scene) -> tuple[float, float]:
    """Place of the film's centre in the frame of the scene's stage."""
    return (scene.stage.x_mm, scene.stage.y_mm) if scene.stage else (0.0, 0.0)


def as_float(value: Any) -> float:
    """A value as a float; NaN for a text and what else is no number."""
    try:
        return math.nan if isinstance(value, str | bytes) else float(value)
    except (TypeError, ValueError, OverflowError):
        return math.nan


def find_reading_errors(
    scene: Scene,
    charges_pC: Mapping[str, Any],
    sigma: Deviations,
    noise_pC: Deviations | None = None,
    reading: str | None = None,
    known_at_rest: UnloadedCharges | None = None,
    unit: str = "pC",
) -> Iterator[str]:
    """What is wrong with readings, their unit and their deviations. Whether there are charges at
    rest is asked unless they are known."""
    by_name = get_channel_values(scene)
    if unit not in UNITS:
        yield f"unit = {unit}: choose from {', '.join(UNITS)}"
    elif unit == "V" and scene.readout is None:
        yield "unit = V: the scene has no [readout]; add one, or give pC"
    if not isinstance(charges_pC, Mapping):
        name = next(iter(by_name))
        yield f"charges = {charges_pC!r:.60}: give a dict by electrode, {{{name!r}: 700.0}}"
        return
    if not charges_pC:
        yield f"charges: none given; give some of {', '.join(by_name)}"
    for name, charge in charges_pC.items():
        if name not in by_name:
            yield f"charges.{name}: no such electrode; choose from {', '.join(by_name)}"
        elif not abs(as_float(charge)) <= LARGEST_PC:
            yield f"charges.{name} = {_shown(charge)}: give a charge in pC"
        elif abs(as_float(charge) - by_name[name][1]) < LEAST_PC:
            noise = noise_pC.get(name) if isinstance(noise_pC, Mapping) else noise_pC
            if not (by_name[name][2] if noise is None else noise):
                reason = "a charge of 0 has no deviation without noise_pC"
                yield f"charges.{name} = {charge:g}: {reason}; give that of the amplifier"
    yield from _find_deviation_errors(
        "sigma", sigma, charges_pC, 1.0, "a share of the charge, 0 to 1"
    )
    if noise_pC is not None:
        what = "a standard deviation in pC, not negative"
        yield from _find_deviation_errors("noise_pC", noise_pC, charges_pC, math.inf, what)
    if reading not in (None, *READINGS):
        yield f"reading = {reading}: choose from {', '.join(READINGS)}"
    if known_at_rest is None:
        yield from _find_unloaded_errors(scene, reading or get_reading(scene))


def _find_unloaded_errors(scene: Scene, reading: str) -> Iterator[str]:
    from pvdf_fem.solver.adaptive import UnloadedFilmError  # with gmsh

    try:
        compute_unloaded_charges_pC(scene, reading)
    except UnloadedFilmError as error:
        yield from error.problems


def _find_deviation_errors(
    what: str, given: Deviations, charges_pC: Mapping[str, Any], most: float, wanted: str
) -> Iterator[str]:
    by_name = given if isinstance(given, Mapping) else {"": given}
    for name in charges_pC if isinstance(given, Mapping) else ():
        if name not in by_name:
            yield f"{what}.{name}: missing; give one for each charge, or one number for all"
    for name, value in by_name.items():
        if not (0.0 <= as_float(value) <= most and as_float(value) < math.inf):
            yield f"{what}{'.' * bool(name)}{name} = {_shown(value)}: give {wanted}"


def _shown(value: Any) -> str:
    return repr(value) if isinstance(value, str | bytes) else str(value)


def find_quantity_errors(
    domain: Domain,
    unknown: Sequence[str],
    known: Mapping[str, float],
    default: Mapping[str, float],
    centre_mm: Sequence[float] = (0.0, 0.0),
) -> Iterator[str]:
    """What is wrong with the quantities sought and known. `default` has the scene's values of what
    is neither sought nor in `known`; `get_centre_mm` is the place of the film's centre in the same
    frame."""
    names = ", ".join(TOUCH_QUANTITIES)
    if not unknown:
        yield f"unknown: nothing is sought; choose from {names}"
    for name in dict.fromkeys([*unknown, *known]):
        if name not in TOUCH_QUANTITIES:
            yield f"{name}: no quantity of a touch; choose from {names}"
        elif name in unknown and name in known:
            yield f"{name}: both sought and known; remove one"
        elif name in known and not math.isfinite(as_float(known[name])):
            yield f"known.{name} = {_shown(known[name])}: give a finite number"
    fixed = {n: as_float(v) for n, v in {**default, **known}.items() if n not in unknown}
    reach, (lowest, highest) = domain.reach_mm, domain.force_N
    places = {n: fixed[n] for n in TOUCH_QUANTITIES[:2] if n in fixed}
    centre = {"x_mm": centre_mm[0], "y_mm": centre_mm[1]}
    if math.hypot(*(value - centre[n] for n, value in places.items())) > reach:
        place = ", ".join(f"{n} = {value:g}" for n, value in places.items())
        yield f"known {place}: beyond the {reach:g} mm that the model reaches; build a larger one"
    if not lowest <= fixed.get("force_N", lowest) <= highest:
        yield (
            f"known force_N = {fixed['force_N']:g}: out of the model's {lowest:g} to {highest:g} "
            "N; build one for it"
        )

"""What was measured: readings of electrodes, which stand for charges and have errors of their own.

A reading in nominal pC is gain x charge + offset, its gain and offset being those of the channel in
the scene's readout, and the charge either all of it (`total`) or what the touch adds to that of the
stretched film (`change`), as an amplifier sees it that was zeroed before the touch.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.charges.rest import rest_charges
from pvdf_fem.readout.channel import channels
from pvdf_fem.response.model import QUANTITIES, Domain, Model
from pvdf_fem.scene.scene import Scene
from pvdf_fem.touch.problem import Problem, along_stage, centre_mm

#: Readings beyond this many pC are in another unit, or none.
LARGEST_PC = 1e12
#: Charges or changes below this many pC count as zero.
LEAST_PC = 1e-12
#: What a reading may be of, and how that is called.
READINGS = {"total": "total charges", "change": "changes"}

#: Standard deviations, one for all electrodes or one by electrode.
Deviations = float | Mapping[str, float]


@dataclass(frozen=True, eq=False)
class Measurement:
    """How charges follow from readings of some electrodes, and with which errors.

    Arrays are (electrodes,).
    """

    model: Model
    #: Of the electrodes in the model.
    electrodes: Indices
    #: Of `READINGS`.
    reading: str
    gains: Array
    offsets_pC: Array
    #: Charges of the film without a touch.
    rest_pC: Array
    #: Standard deviation over the charge or the change, whichever is read.
    sigma: Array
    #: Standard deviation of a reading besides.
    noise_pC: Array

    @classmethod
    def of(
        cls,
        model: Model,
        names: Sequence[str],
        sigma: Deviations,
        noise_pC: Deviations | None,
        reading: str | None,
    ) -> Measurement:
        """That of readings by name; what is None is that of the scene's readout.

        Raises `ValueError` if there is no deviation at all.
        """
        electrodes = np.array([model.names.index(name) for name in names])
        gains, offsets, noise, rest = _channel_columns(model)[:, electrodes]
        if noise_pC is not None:
            noise = _by_name(noise_pC, names)
        measured = cls(
            along_stage(model),
            electrodes,
            reading or default_reading(model.scene),
            gains,
            offsets,
            rest,
            _by_name(sigma, names),
            noise,
        )
        if not (model.error_bound or (measured.sigma + noise).all()):
            raise ValueError("sigma = 0: the model has no error of its own; give a positive one")
        return measured

    @property
    def other(self) -> Measurement:
        """The same readings, taken for the other of `READINGS`."""
        (reading,) = READINGS.keys() - {self.reading}
        return replace(self, reading=reading)

    def problem(self, readings_pC: Array, unknown: Indices) -> Problem:
        """The problem of the touches that gave readings (n, electrodes)."""
        signals = self.signals(readings_pC)
        charges = signals + self.rest_pC if self.reading == "change" else signals
        # an error evenly distributed within the bound
        model_error = self.model.error_bound / math.sqrt(3.0)
        variance = np.square(self.sigma * signals) + np.square(self.noise_pC / self.gains)
        spread = np.sqrt(variance + np.square(model_error * charges))
        return Problem(self.model, self.electrodes, charges, spread, unknown)

    def signals(self, readings_pC: Array) -> Array:
        """The charges or changes that readings stand for, in pC."""
        signals: Array = (readings_pC - self.offsets_pC) / self.gains
        return signals


@lru_cache(maxsize=8)
def _channel_columns(model: Model) -> Array:
    """Gains, offsets, noise and rest charges in pC, (4, electrodes) of a model."""
    rest = rest_charges(model.scene)
    by_name = {
        channel.name: (
            channel.gain,
            1e12 * channel.capacitance * channel.offset,
            1e12 * channel.capacitance * channel.noise,
            1e12 * charge,
        )
        for channel, charge in zip(channels(model.scene), rest.tolist(), strict=True)
    }
    return np.array([by_name[name] for name in model.names]).T


def _by_name(values: Deviations, names: Sequence[str]) -> Array:
    given = [values[n] for n in names] if isinstance(values, Mapping) else [values] * len(names)
    return np.array(given, dtype=float)


def default_reading(scene: Scene) -> str:
    """What readings of a scene are of unless it is said: of its readout, or else in total."""
    return scene.readout.reading if scene.readout else "total"


def number(value: Any) -> float:
    """A value as a float; NaN for a text and what else is no number."""
    try:
        return math.nan if isinstance(value, str | bytes) else float(value)
    except (TypeError, ValueError, OverflowError):
        return math.nan


def charge_mistakes(
    scene: Scene,
    charges_pC: Mapping[str, Any],
    sigma: Deviations,
    noise_pC: Deviations | None = None,
    reading: str | None = None,
) -> Iterator[str]:
    """What is wrong with readings and their deviations."""
    by_name = {channel.name: channel for channel in channels(scene)}
    if not charges_pC:
        yield f"charges: none given; give some of {', '.join(by_name)}"
    for name, charge in charges_pC.items():
        noise = _of(noise_pC, name)
        if name not in by_name:
            yield f"charges.{name}: no such electrode; choose from {', '.join(by_name)}"
        elif not abs(number(charge)) <= LARGEST_PC:
            yield f"charges.{name} = {_shown(charge)}: give a number of pC"
        elif not (by_name[name].noise if noise is None else noise):
            channel = by_name[name]
            if number(charge) == 1e12 * channel.capacitance * channel.offset:
                yield (
                    f"charges.{name} = {charge}: has no relative deviation; give noise_pC, that of "
                    "the amplifier"
                )
    yield from _deviation_mistakes("sigma", sigma, charges_pC, 1.0, "a share of the charge, 0 to 1")
    if noise_pC is not None:
        what = "a standard deviation in pC, not negative"
        yield from _deviation_mistakes("noise_pC", noise_pC, charges_pC, math.inf, what)
    if reading not in (None, *READINGS):
        yield f"reading = {reading}: choose from {', '.join(READINGS)}"


def _deviation_mistakes(
    what: str, given: Deviations, charges_pC: Mapping[str, Any], most: float, wanted: str
) -> Iterator[str]:
    by_name = given if isinstance(given, Mapping) else {"": given}
    for name in charges_pC if isinstance(given, Mapping) else ():
        if name not in by_name:
            yield f"{what}.{name}: missing; give one for each charge, or one number for all"
    for name, value in by_name.items():
        if not (0.0 <= number(value) <= most and number(value) < math.inf):
            yield f"{what}{'.' * bool(name)}{name} = {_shown(value)}: give {wanted}"


def _of(values: Deviations | None, name: str) -> Any:
    return values.get(name) if isinstance(values, Mapping) else values


def _shown(value: Any) -> str:
    return repr(value) if isinstance(value, str | bytes) else str(value)


def known_mistakes(
    domain: Domain,
    unknown: Sequence[str],
    known: Mapping[str, float],
    default: Mapping[str, float],
    scene: Scene,
) -> Iterator[str]:
    """What is wrong with the quantities sought and known, in the frame of the scene's stage.

    `default` has the scene's values of what is neither sought nor in `known`.
    """
    names = ", ".join(QUANTITIES)
    if not unknown:
        yield f"unknown: nothing is sought; choose from {names}"
    for name in dict.fromkeys([*unknown, *known]):
        if name not in QUANTITIES:
            yield f"{name}: no quantity of a touch; choose from {names}"
        elif name in unknown and name in known:
            yield f"{name}: both sought and known; remove one"
        elif name in known and not math.isfinite(number(known[name])):
            yield f"known.{name} = {_shown(known[name])}: give a finite number"
    fixed = {n: number(v) for n, v in {**default, **known}.items() if n not in unknown}
    reach, (lowest, highest) = domain.reach_mm, domain.force_N
    places = {n: fixed[n] for n in QUANTITIES[:2] if n in fixed}
    centre = dict(zip(QUANTITIES, centre_mm(scene).tolist(), strict=False))
    if math.hypot(*(value - centre[n] for n, value in places.items())) > reach:
        place = ", ".join(f"{n} = {value:g}" for n, value in places.items())
        yield f"known {place}: beyond the {reach:g} mm that the model reaches; build a larger one"
    if not lowest <= fixed.get("force_N", lowest) <= highest:
        yield (
            f"known force_N = {fixed['force_N']:g}: out of the model's {lowest:g} to {highest:g} "
            "N; build one for it"
        )

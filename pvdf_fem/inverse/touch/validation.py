"""Validation errors of readings, and of the free and fixed quantities of a touch.

The functions yield one line ``key = value: reason; advice`` for each mistake, so that all mistakes
can be reported at once.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from pvdf_fem.electrodes.channel import READINGS, find_unit_errors
from pvdf_fem.inverse.touch.measurement import (
    ChannelValues,
    Deviations,
    get_channel_values,
    get_reading,
)
from pvdf_fem.scene.scene import Scene
from pvdf_fem.surrogate.charge_function import UnloadedCharges, compute_unloaded_charges_pC
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, Domain

MAX_READING_PC = 1e12  #: Maximum magnitude of a reading in pC; larger ones are in another unit.
MIN_CHARGE_PC = 1e-12  #: Charges or changes with a smaller magnitude in pC count as zero.


def as_float(value: Any) -> float:
    """Convert a number to a float; return NaN for a string or for what `float` does not accept."""
    if isinstance(value, str | bytes):
        return math.nan
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        return math.nan


def find_reading_errors(
    scene: Scene,
    readings: Mapping[str, Any],
    sigma: Deviations,
    noise_pC: Deviations | None = None,
    reading: str | None = None,
    unloaded_charges: UnloadedCharges | None = None,
    unit: str | None = None,
) -> Iterator[str]:
    """Yield an error message for each mistake in readings, their unit and standard deviations.

    Parameters
    ----------
    scene : Scene
        Scene with the electrodes and their readout.
    readings : mapping
        Readings in nominal pC (volts times the channel's nominal capacitance) by electrode.
    sigma : float or mapping
        Standard deviation as a fraction of the signal, for all electrodes or by electrode.
    noise_pC : float, mapping or None
        Further standard deviation in nominal pC; None for that of the readout.
    reading : str or None
        Meaning of the readings, a key of `READINGS`; None for that of the readout.
    unloaded_charges : UnloadedCharges, optional
        Charges of the unloaded film if a response stores them. By default the unloaded film is
        solved if `reading` requires it.
    unit : str, optional
        Unit in which the user gave the readings. Default: that of `get_reading_unit`.

    Yields
    ------
    str
        One line for each mistake. If `readings` is not a mapping, only the unit is validated, too.
    """
    channels = get_channel_values(scene)
    names = ", ".join(channels)
    yield from find_unit_errors(scene, unit)
    if not isinstance(readings, Mapping):
        example = f"{{{next(iter(channels))!r}: 700.0}}"
        yield f"readings = {readings!r:.60}: must be a dict by electrode, such as {example}"
        return
    if not readings:
        yield f"readings: must not be empty; give the readings of some of {names}"
    for name, value in readings.items():
        if name not in channels:
            yield f"readings.{name}: no such electrode; choose from {names}"
            continue
        noise = noise_pC.get(name) if isinstance(noise_pC, Mapping) else noise_pC
        reason = _explain_bad_reading(value, channels[name], noise)
        if reason:
            yield f"readings.{name} = {_format_value(value)}: {reason}"
    yield from _find_deviation_errors("sigma", sigma, readings, max_value=1.0)
    if noise_pC is not None:
        yield from _find_deviation_errors("noise_pC", noise_pC, readings, max_value=math.inf)
    if reading is not None and reading not in READINGS:
        yield f"reading = {reading}: choose from {', '.join(READINGS)}"
    if unloaded_charges is None:
        yield from _find_unloaded_film_errors(scene, reading or get_reading(scene))


def _explain_bad_reading(value: Any, channel: ChannelValues, noise_pC: float | None) -> str:
    """Return the reason why the reading of one electrode is invalid, with advice.

    Parameters
    ----------
    value : object
        The reading, in nominal pC (volts times the channel's nominal capacitance) if it is a
        number.
    channel : ChannelValues
        Gain, offset and noise of the electrode's channel.
    noise_pC : float or None
        Standard deviation of the reading in nominal pC; None for that of the channel.

    Returns
    -------
    str
        Reason and advice; empty for a valid reading.
    """
    number = as_float(value)
    if not abs(number) <= MAX_READING_PC:
        return f"must be a number of pC, at most {MAX_READING_PC:g}; check the unit"
    if noise_pC is None:
        noise_pC = channel.noise_pC
    if abs(number - channel.offset_pC) < MIN_CHARGE_PC and not noise_pC:
        return "a charge of 0 has no standard deviation without noise; give noise_pC"
    return ""


def _find_deviation_errors(
    key: str, deviations: Deviations, readings: Mapping[str, Any], max_value: float
) -> Iterator[str]:
    """Yield an error message for each mistake in the standard deviations of readings.

    Parameters
    ----------
    key : str
        Name of the argument, for the messages.
    deviations : float or mapping
        A standard deviation for all electrodes, or standard deviations by electrode.
    readings : mapping
        Readings by electrode. A mapping of deviations must have one for each of them.
    max_value : float
        Maximum deviation: 1 for a fraction of the charge, infinity for a deviation in pC.
    """
    values: dict[str, Any] = {key: deviations}
    if isinstance(deviations, Mapping):
        values = {f"{key}.{name}": value for name, value in deviations.items()}
        for name in readings:
            if name not in deviations:
                advice = "give one for each electrode, or one number for all"
                yield f"{key}.{name}: is required; {advice}"
    for name, value in values.items():
        number = as_float(value)
        if not (0.0 <= number <= max_value and math.isfinite(number)):
            allowed = "zero or a positive number of pC"
            if max_value == 1.0:
                allowed = "a fraction of the charge, from 0 to 1"
            yield f"{name} = {_format_value(value)}: must be {allowed}"


def _find_unloaded_film_errors(scene: Scene, reading: str) -> Iterator[str]:
    """Yield messages if `reading` is ``change`` and the film has no equilibrium without a load."""
    from pvdf_fem.solver.adaptive import UnloadedFilmError  # imports gmsh

    try:
        compute_unloaded_charges_pC(scene, reading)
    except UnloadedFilmError as error:
        yield from error.problems


def _format_value(value: Any) -> str:
    """Format a value as in Python code, with strings in quotes."""
    return repr(value) if isinstance(value, str | bytes) else str(value)


def find_quantity_errors(
    domain: Domain,
    unknown: Sequence[str],
    known: Mapping[str, float],
    default: Mapping[str, float],
    centre_mm: Sequence[float] = (0.0, 0.0),
) -> Iterator[str]:
    """Yield an error message for each mistake in the free and fixed quantities of a touch.

    Parameters
    ----------
    domain : Domain
        Domain of the response, in which the fixed quantities must lie.
    unknown : sequence of str
        Names of the free quantities.
    known : mapping
        Values of fixed quantities by name, in the frame of the scene's stage.
    default : mapping
        Values of the scene by name, for quantities that are neither in `unknown` nor in `known`.
    centre_mm : sequence of two floats
        Position x, y of the film's centre in the same frame.

    Yields
    ------
    str
        One line for each mistake.
    """
    names = ", ".join(TOUCH_QUANTITIES)
    if not unknown:
        yield f"unknown: must not be empty; choose from {names}"
    for name in dict.fromkeys([*unknown, *known]):
        if name not in TOUCH_QUANTITIES:
            yield f"{name}: is not a quantity of a touch; choose from {names}"
        elif name in unknown and name in known:
            yield f"{name}: is both unknown and known; remove it from one of the two"
        elif name in known and not math.isfinite(as_float(known[name])):
            yield f"known.{name} = {_format_value(known[name])}: must be a finite number"
    fixed = {}
    for name, value in {**default, **known}.items():
        if name not in unknown:
            fixed[name] = as_float(value)
    yield from _find_domain_errors(domain, fixed, centre_mm)


def _find_domain_errors(
    domain: Domain, fixed: Mapping[str, float], centre_mm: Sequence[float]
) -> Iterator[str]:
    """Yield an error message for a fixed position or force outside of a response's domain.

    Parameters
    ----------
    domain : Domain
        Domain of the response.
    fixed : mapping
        Values of the fixed quantities by name, in the frame of the scene's stage.
    centre_mm : sequence of two floats
        Position x, y of the film's centre in the same frame.
    """
    positions = []
    offsets_mm = []
    for name, centre in zip(("x_mm", "y_mm"), centre_mm, strict=True):
        if name in fixed:
            positions.append(f"{name} = {fixed[name]:g}")
            offsets_mm.append(fixed[name] - centre)
    if math.hypot(*offsets_mm) > domain.reach_mm:
        reach = f"{domain.reach_mm:g} mm from the centre, the reach of the response"
        advice = "build a response with a larger reach_mm"
        yield f"known {', '.join(positions)}: beyond {reach}; {advice}"
    lowest, highest = domain.force_N
    if not lowest <= fixed.get("force_N", lowest) <= highest:
        forces = f"the response's forces, {lowest:g} to {highest:g} N"
        advice = "build a response for this force"
        yield f"known force_N = {fixed['force_N']:g}: outside of {forces}; {advice}"

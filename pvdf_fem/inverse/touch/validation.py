"""Validation errors of readings, and of the quantities of a touch that are free or fixed.

Each function yields one line ``key = value: reason; advice`` for each mistake, so that all mistakes
are reported at once.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from pvdf_fem.electrodes.channel import READINGS
from pvdf_fem.inverse.touch.measurement import (
    ChannelValues,
    Deviations,
    get_channel_values,
    get_reading,
)
from pvdf_fem.scene.scene import Scene
from pvdf_fem.surrogate.charge_function import UnloadedCharges, compute_unloaded_charges_pC
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, Domain

LARGEST_PC = 1e12  #: Readings beyond this many pC are in another unit, or meaningless.
LEAST_PC = 1e-12  #: Charges or changes below this many pC count as zero.
UNITS = ("pC", "V")  #: Units of readings.


def as_float(value: Any) -> float:
    """Return a value as a float; NaN for a text and for everything else that is not a number."""
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
    unit: str = "pC",
) -> Iterator[str]:
    """Find validation errors of readings, their unit and their standard deviations.

    Parameters
    ----------
    scene : Scene
        Scene with the electrodes and their readout.
    readings : mapping
        Readings in nominal pC by electrode.
    sigma : float or mapping
        Standard deviation over the signal, for all electrodes or by electrode.
    noise_pC : float, mapping or None
        Further standard deviation in pC; None for that of the readout.
    reading : str or None
        Meaning of the readings, of `READINGS`; None for that of the readout.
    unloaded_charges : UnloadedCharges, optional
        Charges of the unloaded film, if a response has them. Without them it is tested whether the
        film has any, as changes need them.
    unit : str
        Unit in which the readings were given.

    Yields
    ------
    str
        One line for each mistake.
    """
    channels = get_channel_values(scene)
    names = ", ".join(channels)
    if unit not in UNITS:
        yield f"unit = {unit}: choose from {', '.join(UNITS)}"
    elif unit == "V" and scene.readout is None:
        yield "unit = V: the scene has no [readout]; add one, or give readings in pC"
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
    yield from _find_deviation_errors("sigma", sigma, readings, most=1.0)
    if noise_pC is not None:
        yield from _find_deviation_errors("noise_pC", noise_pC, readings, most=math.inf)
    if reading is not None and reading not in READINGS:
        yield f"reading = {reading}: choose from {', '.join(READINGS)}"
    if unloaded_charges is None:
        yield from _find_unloaded_errors(scene, reading or get_reading(scene))


def _explain_bad_reading(value: Any, channel: ChannelValues, noise_pC: float | None) -> str:
    """Return why one reading is invalid, with advice.

    Parameters
    ----------
    value : object
        The reading in nominal pC, if it is a number.
    channel : ChannelValues
        The electrode's channel.
    noise_pC : float or None
        Standard deviation in pC; None for that of the channel.

    Returns
    -------
    str
        Reason and advice; empty for a valid reading.
    """
    number = as_float(value)
    if not abs(number) <= LARGEST_PC:
        return f"must be a number of pC, at most {LARGEST_PC:g}; check the unit"
    if noise_pC is None:
        noise_pC = channel.noise_pC
    if abs(number - channel.offset_pC) < LEAST_PC and not noise_pC:
        return "a charge of 0 has no standard deviation without noise; give noise_pC"
    return ""


def _find_deviation_errors(
    key: str, deviations: Deviations, readings: Mapping[str, Any], most: float
) -> Iterator[str]:
    """Find validation errors of standard deviations.

    Parameters
    ----------
    key : str
        Name of the argument.
    deviations : float or mapping
        A standard deviation for all electrodes or by electrode.
    readings : mapping
        Readings by electrode, each of which needs a deviation.
    most : float
        Largest deviation: 1 for a share of the charge, infinity for pC.
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
        if not (0.0 <= number <= most and math.isfinite(number)):
            allowed = "zero or a positive number of pC"
            if most == 1.0:
                allowed = "a share of the charge, from 0 to 1"
            yield f"{name} = {_format_value(value)}: must be {allowed}"


def _find_unloaded_errors(scene: Scene, reading: str) -> Iterator[str]:
    """Find why a film has no charges without a load, where they are necessary."""
    from pvdf_fem.solver.adaptive import UnloadedFilmError  # imports gmsh

    try:
        compute_unloaded_charges_pC(scene, reading)
    except UnloadedFilmError as error:
        yield from error.problems


def _format_value(value: Any) -> str:
    """Return a value as a user has written it, texts in quotes."""
    return repr(value) if isinstance(value, str | bytes) else str(value)


def find_quantity_errors(
    domain: Domain,
    unknown: Sequence[str],
    known: Mapping[str, float],
    default: Mapping[str, float],
    centre_mm: Sequence[float] = (0.0, 0.0),
) -> Iterator[str]:
    """Find validation errors of the free and the fixed quantities of a touch.

    Parameters
    ----------
    domain : Domain
        Domain of the response.
    unknown : sequence of str
        Names of the free quantities.
    known : mapping
        Values of fixed quantities by name, in the frame of the scene's stage.
    default : mapping
        The scene's values of quantities that are neither in `unknown` nor in `known`.
    centre_mm : sequence of two floats
        Place of the film's centre in the same frame.

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
            yield f"{name}: not a quantity of a touch; choose from {names}"
        elif name in unknown and name in known:
            yield f"{name}: both unknown and known; remove it from one of the two"
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
    """Find fixed quantities outside of a response's domain.

    Parameters
    ----------
    domain : Domain
        The domain.
    fixed : mapping
        Fixed quantities by name, in the frame of the scene's stage.
    centre_mm : sequence of two floats
        Place of the film's centre in the same frame.
    """
    places = []
    offsets_mm = []
    for name, centre in zip(("x_mm", "y_mm"), centre_mm, strict=True):
        if name in fixed:
            places.append(f"{name} = {fixed[name]:g}")
            offsets_mm.append(fixed[name] - centre)
    if math.hypot(*offsets_mm) > domain.reach_mm:
        reach = f"the {domain.reach_mm:g} mm that the response reaches"
        yield f"known {', '.join(places)}: beyond {reach}; build one with a larger reach_mm"
    lowest, highest = domain.force_N
    if not lowest <= fixed.get("force_N", lowest) <= highest:
        forces = f"the response's {lowest:g} to {highest:g} N"
        yield f"known force_N = {fixed['force_N']:g}: outside of {forces}; build one for this force"

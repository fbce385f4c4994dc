"""What is wrong with readings and quantities that a touch is to be located from, in sentences."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from pvdf_fem.readout.channel import READINGS
from pvdf_fem.response.model import QUANTITIES, Domain
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solution.solve import RestError
from pvdf_fem.touch.measurement import Deviations, electrode_columns, reading_of, rest_of

LARGEST_PC = 1e12  #: Readings beyond this many pC are in another unit, or none.
LEAST_PC = 1e-12  #: Charges or changes below this many pC count as zero.


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
    by_name = electrode_columns(scene)
    if not charges_pC:
        yield f"charges: none given; give some of {', '.join(by_name)}"
    for name, charge in charges_pC.items():
        if name not in by_name:
            yield f"charges.{name}: no such electrode; choose from {', '.join(by_name)}"
        elif not abs(number(charge)) <= LARGEST_PC:
            yield f"charges.{name} = {_shown(charge)}: give a charge in pC"
        elif abs(number(charge) - by_name[name][1]) < LEAST_PC:
            noise = noise_pC.get(name) if isinstance(noise_pC, Mapping) else noise_pC
            if not (by_name[name][2] if noise is None else noise):
                reason = "a charge of 0 has no deviation without noise_pC"
                yield f"charges.{name} = {charge:g}: {reason}; give that of the amplifier"
    yield from _deviation_mistakes("sigma", sigma, charges_pC, 1.0, "a share of the charge, 0 to 1")
    if noise_pC is not None:
        what = "a standard deviation in pC, not negative"
        yield from _deviation_mistakes("noise_pC", noise_pC, charges_pC, math.inf, what)
    if reading not in (None, *READINGS):
        yield f"reading = {reading}: choose from {', '.join(READINGS)}"
    try:
        rest_of(scene, reading or reading_of(scene))
    except RestError as error:
        yield from error.problems


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


def _shown(value: Any) -> str:
    return repr(value) if isinstance(value, str | bytes) else str(value)


def known_mistakes(
    domain: Domain,
    unknown: Sequence[str],
    known: Mapping[str, float],
    default: Mapping[str, float],
    centre_mm: Sequence[float] = (0.0, 0.0),
) -> Iterator[str]:
    """What is wrong with the quantities sought and known. `default` has the scene's values of what
    is neither sought nor in `known`; `centre_mm` is the place of the film's centre in the same
    frame."""
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
    centre = {"x_mm": centre_mm[0], "y_mm": centre_mm[1]}
    if math.hypot(*(value - centre[n] for n, value in places.items())) > reach:
        place = ", ".join(f"{n} = {value:g}" for n, value in places.items())
        yield f"known {place}: beyond the {reach:g} mm that the model reaches; build a larger one"
    if not lowest <= fixed.get("force_N", lowest) <= highest:
        yield (
            f"known force_N = {fixed['force_N']:g}: out of the model's {lowest:g} to {highest:g} "
            "N; build one for it"
        )

"""What is wrong with charges and quantities that a touch is to be located from, in sentences."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from pvdf_fem.response.model import QUANTITIES, Domain

#: Charges beyond this many pC are in another unit, or none.
LARGEST_PC = 1e12
#: Charges below this many pC count as zero.
LEAST_PC = 1e-12


def charge_mistakes(
    names: Sequence[str],
    charges_pC: Mapping[str, float],
    sigma: float | Mapping[str, float],
    noise_pC: float,
) -> Iterator[str]:
    """What is wrong with measured charges and their deviations."""
    if not charges_pC:
        yield f"charges: none given; give some of {', '.join(names)}"
    for name, charge in charges_pC.items():
        if name not in names:
            yield f"charges.{name}: no such electrode; choose from {', '.join(names)}"
        elif not abs(charge) <= LARGEST_PC:
            yield f"charges.{name} = {charge}: give a charge in pC"
    by_name = sigma if isinstance(sigma, Mapping) else {"": sigma}
    for name in charges_pC if isinstance(sigma, Mapping) else ():
        if name not in by_name:
            yield f"sigma.{name}: missing; give one for each charge, or one number for all"
    for name, value in by_name.items():
        if not 0.0 <= value <= 1.0:
            yield f"sigma{'.' * bool(name)}{name} = {value}: give a share of the charge, 0 to 1"
    if not 0.0 <= noise_pC < math.inf:
        yield f"noise_pC = {noise_pC}: give a standard deviation in pC, not negative"
    elif not noise_pC and any(charge == 0.0 for charge in charges_pC.values()):
        yield "noise_pC = 0: a charge of 0 has no deviation then; give that of the amplifier"


def deviation_mistakes(
    error_bound: float, sigma: float | Mapping[str, float], noise_pC: float
) -> Iterator[str]:
    """Whether there is no standard deviation at all."""
    least = min(sigma.values(), default=0.0) if isinstance(sigma, Mapping) else sigma
    if not (error_bound or noise_pC or least):
        yield "sigma = 0: the model has no error of its own; give a positive one"


def known_mistakes(
    domain: Domain, unknown: Sequence[str], known: Mapping[str, float], default: Mapping[str, float]
) -> Iterator[str]:
    """What is wrong with the quantities sought and known.

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
        elif name in known and not math.isfinite(known[name]):
            yield f"known.{name} = {known[name]}: give a finite number"
    fixed = {n: v for n, v in {**default, **known}.items() if n not in unknown}
    reach, (lowest, highest) = domain.reach_mm, domain.force_N
    distance = math.hypot(fixed.get("x_mm", 0.0), fixed.get("y_mm", 0.0))
    if distance > reach:
        place = ", ".join(f"{n} = {fixed[n]:g}" for n in ("x_mm", "y_mm") if n in fixed)
        yield f"known {place}: beyond the {reach:g} mm that the model reaches; build a larger one"
    if not lowest <= fixed.get("force_N", lowest) <= highest:
        yield (
            f"known force_N = {fixed['force_N']:g}: out of the model's {lowest:g} to {highest:g} "
            "N; build one for it"
        )

"""Air and time: modes of the thesis's film, charges at 20 Hz and by a tap of 10 ms."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from pvdf_fem import Scene, modes, respond, solve, transient
from pvdf_fem.dynamics.forced import half_sine
from reports.chapters.transducer.effects import BESIDE_MM, touch

#: What is about the film: the words of the table, and the scene's table.
AIR: dict[str, dict[str, Any] | None] = {
    "in vacuum": None,
    "in free air": {"baffle": False},
    "in air, baffled": {"baffle": True},
}
#: Loads in N about which the film moves; zero is the untouched film.
LOADS_N = (0.0, 0.01, 0.1, 1.0)
TAP_S = 0.01
#: The air of taps, and up to which frequency in Hz modes answer them, ten times that of the tap.
TAPPED, TAP_HZ = "in air, baffled", 500.0
#: Relative tolerance of frequencies and of charges.
TOLERANCE = 1e-3


def scene(force_N: float, air: str) -> Scene:
    """A pressure that keeps its direction, since one that follows has no modes."""
    pressed = touch(BESIDE_MM, force_N or 1.0, "dead", **{"numerics.tolerance": TOLERANCE})
    return pressed if AIR[air] is None else pressed.with_(air=AIR[air])


@dataclass(frozen=True)
class Motion:
    """How the film moves about a load, by the words of `AIR`."""

    force_N: float
    first_Hz: dict[str, float]
    #: Largest charge at the excitation's frequency over the static one, less one, in percent;
    #: empty without a touch.
    excess_percent: dict[str, float]
    #: Largest peak of a charge by a small half-sine of `TAP_S` over a static one, less one, in
    #: percent, with the air of `TAPPED`; NaN without a touch.
    tap_percent: float


def motion(force_N: float, frequency_Hz: float) -> Motion:
    """Motion about a load."""
    surrounded = {air: scene(force_N, air) for air in AIR}
    first: dict[str, float] = {}
    for air in list(AIR)[1:]:
        result = modes(surrounded[air], count=1, loaded=force_N > 0.0)
        in_air = result.frequencies_in_air_Hz
        assert in_air is not None
        first |= {"in vacuum": float(result.frequencies_Hz[0]), air: float(in_air[0])}
    if not force_N:
        return Motion(force_N, first, {}, math.nan)
    solutions = {air: solve(pressed) for air, pressed in surrounded.items()}
    responses = {air: respond(s, [0.0, frequency_Hz]) for air, s in solutions.items()}
    rates = {air: np.abs([*r.charges_pC_N.values()]) for air, r in responses.items()}
    excess = {air: 100.0 * float((Q[:, 1] / Q[:, 0] - 1.0).max()) for air, Q in rates.items()}
    small_N, times = 1e-3 * force_N, np.linspace(0.0, 2.0 * TAP_S, 201)
    tapped = transient(solutions[TAPPED], half_sine(small_N, TAP_S), times, TAP_HZ).charges_pC
    peaks = np.max([*tapped.values()], axis=1) / (small_N * rates[TAPPED][:, 0])
    return Motion(force_N, first, excess, 100.0 * float(peaks.max() - 1.0))

"""Texts of the transducer's section: what each effect does, and what the thesis says of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from reports.chapters.transducer.effects import (
    BESIDE_MM,
    BY_NAME,
    D33_PC_N,
    EFFECTS,
    FINGERS,
    ON_PART_MM,
    ON_WHOLE_MM,
    WARM,
    Place,
    finger,
)
from reports.chapters.transducer.moving import AIR, TAP_S, Motion
from reports.chapters.transducer.taped import Explained
from reports.common.page import joined, signed


def at(place: Place) -> str:
    return f"({place[0]:g}, {place[1]:g}) mm"


def pressure_pC(place: Place) -> tuple[float, float]:
    """A's charge by d33 in pC, and in percent of that by the force."""
    effect = BY_NAME["thickness direction"]
    added = (effect.charges_pC(place) - effect.plain_pC(place))[0]
    return float(added), float(effect.percent(place)[0])


def electric_text() -> str:
    open_, cable, high = (
        BY_NAME[name].percent(BESIDE_MM).max()
        for name in ("electrodes open", "electrodes on 100 pF", "electrodes open, 23 pC/N")
    )
    part, whole = pressure_pC(ON_PART_MM), pressure_pC(ON_WHOLE_MM)
    return (
        "Voltages (App. 2): electrodes that no charge amplifier keeps at zero stiffen the film, "
        f"and its charges grow by up to {open_:.2f} % when they are open, and {cable:.3f} % with "
        f"100 pF of cable; with 23 pC/N by {high:.1f} %. All grow nearly alike, so that the place "
        f"stays and the force is read too large. Thickness direction (3.1.1): with {-D33_PC_N:g} "
        f"pC/N the pressure adds {part[0]:.2f} pC, {part[1]:.3f} % of A's charge, when the probe "
        f"covers a part of A, and {whole[0]:.1f} pC, {whole[1]:.2f} %, when it lies at its centre. "
        "The thesis claims none; what it claims is not so, but the charge is too small to matter."
    )


def heat_text() -> str:
    on = [f"{signed(e.percent(ON_PART_MM)[0], 0)} %" for e in FINGERS]
    whole = [f"{signed(finger(t).percent(ON_WHOLE_MM)[0], 0)} %" for t in (0.01, 1.0)]
    others = max(np.abs(e.percent(p)[1:]).max() for e in FINGERS for p in (BESIDE_MM, ON_PART_MM))
    late, warm, centre = FINGERS[-1], WARM.found(BESIDE_MM), WARM.found((0.0, 0.0))
    loose = BY_NAME["film 1 K warmer: tension alone"].percent(BESIDE_MM)
    return (
        "Heat (6.1, item 15: it may dominate). A finger that is 10 K warmer and covers a part of A "
        f"changes A's charge by {joined(on)} in 10 ms, 100 ms and 1 s; at the centre of A by "
        f"{joined(whole)} in 10 ms and 1 s, as much as 1 N makes. So it dominates where a finger "
        "is on an electrode, and only there: the loss of tension below it changes the charges of "
        f"the others by {others:.2f} % at most. With a cold film, locate takes the finger after "
        f"1 s for one {late.shift_mm(ON_PART_MM):.2f} mm away where it covers a part of A, and for "
        f"one {late.shift_mm(BESIDE_MM):.2f} mm away beside A, and the fit does not show it (p = "
        f"{late.found(ON_PART_MM).p_value:.2f} and {late.found(BESIDE_MM).p_value:.2f}). A film "
        f"that is 1 K warmer as a whole loses {span(WARM.percent(BESIDE_MM))} % of its charges, "
        f"by its tension alone {span(loose)} %. Beside A the fit tells that the model is wrong "
        f"(p = {warm.p_value:.2g}; {WARM.shift_mm(BESIDE_MM):.1f} mm away, {warm.force_N:.2f} N). "
        f"At the centre, where all charges are alike, 1 N reads as {centre.force_N:.2f} N, with "
        f"p = {centre.p_value:.2f}."
    )


def span(percent: np.ndarray) -> str:
    """Range of the sizes of changes."""
    sizes = np.sort(np.abs(percent))
    return f"{sizes[0]:.2g} to {sizes[-1]:.2g}"


def air_text(motions: list[Motion], frequency_Hz: float) -> str:
    rest, light, full = motions[0], motions[1], motions[-1]
    free, baffled = list(AIR)[1:]
    return (
        f"Air (6.1, item 6: 117 Hz, so that {frequency_Hz:g} Hz is quasi-static). The untouched "
        f"film sounds at {rest.first_Hz['in vacuum']:.1f} Hz in a vacuum, but in air at "
        f"{rest.first_Hz[free]:.1f} Hz, or {rest.first_Hz[baffled]:.1f} Hz with its rim in a "
        f"baffle. Under 1 N it is in air at {full.first_Hz[free]:.0f} and "
        f"{full.first_Hz[baffled]:.0f} Hz: the conclusion holds, since the force stretches the "
        f"film. A force that oscillates about 1 N at {frequency_Hz:g} Hz makes "
        f"{full.excess_percent[baffled]:.2f} % more charge than a static one, about "
        f"{light.force_N:g} N {light.excess_percent[baffled]:.1f} %. What "
        f"a small further tap adds, a half-sine of {1e3 * TAP_S:g} ms, peaks {full.tap_percent:.0f}"
        f" % above what a static force adds to 1 N, and {light.tap_percent:.0f} % above what it "
        f"adds to {light.force_N:g} N: light taps are not quasi-static."
    )


def tape_text(by_tape: dict[str, Explained]) -> str:
    over, beyond = (BY_NAME[f"tape {where} each electrode"] for where in ("over", "beyond"))
    shares = [found.shares for found in by_tape.values()]
    errors = [rms(found.taped_mm) for found in by_tape.values()]
    first = next(iter(by_tape.values()))
    verdict = (
        "and so explain a part of it"
        if any(share > by_mean for share, by_mean in shares)
        else "and so do not explain which touch errs by how much"
    )
    return (
        "Tapes (6.1, item 9: they could well account for the differences). A tape of 50 µm and "
        f"3 GPa over an electrode takes {span(over.percent(BESIDE_MM))} % of its charge, from "
        "each nearly the same; one that begins beyond it draws stress onto it, and adds "
        f"{span(beyond.percent(BESIDE_MM))} %. The thesis prints distances of the places found "
        "from those meant, no charges: so its touches are computed with tapes (as membranes: the "
        "bending of tapes on one side may change charges as much again), and its method "
        "finds their places after one common factor has been taken out. Tapes make its errors "
        f"{min(errors):.2f} to {max(errors):.2f} mm (root mean square), where "
        f"{rms(first.measured_mm):.2f} mm were measured and {rms(first.plain_mm):.2f} mm are its "
        "own: in size they could well be the cause. Of the squares that its own errors leave they "
        f"take away {percents([share for share, _ in shares])}; one and the same error in all "
        f"rows would take away {percents([max(by_mean for _, by_mean in shares)])}. They follow "
        f"the measured ones with a correlation of {correlations(by_tape)}, {verdict}."
    )


def percents(shares: Sequence[float]) -> str:
    return joined([f"{100.0 * share:.0f} %" for share in shares])


def correlations(by_tape: dict[str, Explained]) -> str:
    pairs = [found.correlation for found in by_tape.values()]
    return joined([f"{signed(r, 2)} (p = {chance:.2f})" for r, chance in pairs])


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(np.square(values))))


def tension_text() -> str:
    uneven, oval = EFFECTS[-2], EFFECTS[-1]
    worst = [np.abs(effect.percent(BESIDE_MM)).max() for effect in (uneven, oval)]
    return (
        "Tension (6.1, item 8: it was not uniform). Under 1 N the film's own tension counts for "
        f"little: 10 % less of it along x and 10 % more along y change charges by {worst[0]:.2g} % "
        f"and the place by {1e3 * uneven.shift_mm(BESIDE_MM):.1f} µm, a rim that is 1 µm out of "
        f"round by {worst[1]:.2g} % and {1e3 * oval.shift_mm(BESIDE_MM):.1f} µm."
    )

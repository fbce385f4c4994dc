"""Chapter of the thesis report: the whole transducer, effect by effect.

The thesis left out, guessed or blamed what makes a film a transducer: voltages, heat, the thickness
direction, air, tapes, an uneven tension. Each is turned on by keys of the scene.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pvdf_fem import Scene
from reports.chapters.transducer import moving
from reports.chapters.transducer.effects import (
    BESIDE_MM,
    D33_PC_N,
    EFFECTS,
    NOISE,
    ON_PART_MM,
    ON_WHOLE_MM,
    Effect,
    Found,
    Place,
    finger,
)
from reports.chapters.transducer.figures import Bar, heat_picture, sizes_picture
from reports.chapters.transducer.moving import AIR, LOADS_N, TAP_S, TAPPED, Motion
from reports.chapters.transducer.taped import Explained, contour_scenes, explained, measured_rows
from reports.common.chapter import Chapter, Content
from reports.common.page import Cell, Column, Picture, Table, joined, signed
from reports.common.results import Results
from reports.common.thesis_data import Thesis

BY_NAME = {effect.name: effect for effect in EFFECTS}
#: Effects that are not the same with the probe on an electrode.
ON_ELECTRODE = tuple(e for e in EFFECTS if e.key.startswith(("film.d33", "probe.", "film.warming")))
FINGERS = tuple(effect for effect in EFFECTS if effect.key == "probe.temperature_K")
WARM = BY_NAME["film 1 K warmer"]
#: Times of contact in s of the figure.
CURVE_S = (0.001, 0.01, 0.03, 0.1, 0.3, 1.0)
PLACES = {
    "on the whole of A": ON_WHOLE_MM,
    "on a part of A": ON_PART_MM,
    "beside A": BESIDE_MM,
}
#: Effects of a quick report.
QUICK = tuple(BY_NAME[n] for n in ("electrodes open", "thickness direction", "film 1 K warmer"))


def _quick(thesis: Thesis) -> bool:
    return len(thesis.angles_deg["A"]) == 1


def _scenes(thesis: Thesis) -> list[Scene]:
    return [] if _quick(thesis) else contour_scenes(thesis)


def _compose(thesis: Thesis, results: Results, out: Path) -> Content:
    text = (
        "The thesis left these out, guessed their size, or blamed them for its errors. Each is "
        "turned on by keys of the scene. The triangle of 7 mm presses with 1 N, with its base just "
        f"short of electrode A, at {_at(BESIDE_MM)} (section 3.1.2), or on a part of A, at "
        f"{_at(ON_PART_MM)}. Charges are changes by the touch, as a zeroed amplifier reads them."
    )
    if _quick(thesis):
        return Content([text], [_few_table()])
    frequency_Hz = thesis.parameters["experiment"]["excitation_frequency"]["value"]
    motions = [moving.motion(force_N, frequency_Hz) for force_N in LOADS_N]
    by_tape = explained(thesis, results)
    error_mm, error_percent = _measuring_error(thesis)
    sizes_picture(_bars(), error_percent, error_mm, out / "transducer.svg")
    shares = {
        name: [float(finger(t).percent(place)[0]) for t in CURVE_S]
        for name, place in PLACES.items()
    }
    heat_picture(CURVE_S, shares, NOISE, out / "finger_heat.svg")
    return Content(
        [
            text,
            _electric_text(),
            _heat_text(),
            _air_text(motions, frequency_Hz),
            _tape_text(by_tape),
            _tension_text(),
        ],
        [
            Picture("transducer.svg", _sizes_caption(thesis)),
            _effects_table(),
            Picture("finger_heat.svg", _heat_caption()),
            _heat_table(),
            _motion_table(motions, frequency_Hz),
            _tape_table(thesis, by_tape),
        ],
    )


def _at(place: Place) -> str:
    return f"({place[0]:g}, {place[1]:g}) mm"


def _measuring_error(thesis: Thesis) -> tuple[float, float]:
    """Root mean square of the thesis's measured errors in mm, and its discrepancy in percent."""
    errors = [row.error_mm for row in measured_rows(thesis)]
    stated = thesis.parameters["experiment"]["theory_experiment_discrepancy"]["value"]
    return float(np.sqrt(np.nanmean(np.square(errors)))), float(stated)


# ------------------------------------------------------------------------------------- overview


def _bars() -> list[Bar]:
    def sizes(effect: Effect, place: Place) -> tuple[float, float]:
        return float(np.abs(effect.percent(place)).max()), effect.shift_mm(place)

    nothing = (math.nan, math.nan)
    return [
        Bar(e.name, *sizes(e, BESIDE_MM), *(sizes(e, ON_PART_MM) if e in ON_ELECTRODE else nothing))
        for e in EFFECTS
    ]


def _sizes_caption(thesis: Thesis) -> str:
    return (
        "Largest change of a charge, and shift of the place that is found with a model of the film "
        f"without the effect. Bars: probe at {_at(BESIDE_MM)}, those beyond the thesis's error in "
        f"red; rings: on a part of A, at {_at(ON_PART_MM)}. Dashed: the thesis's discrepancy "
        "between theory and experiment (5.4), and the root mean square of its measured errors "
        "(Tables 5.1, 5.2)."
    )


def _charge_columns(group: str) -> list[Column]:
    return [Column(f"{n}_percent", f"{n} (%)", 3, group, signed=True) for n in "ABCD"]


def _few_table() -> Table:
    columns = [
        Column("effect", "effect"),
        Column("key", "key"),
        *_charge_columns(f"at {_at(ON_PART_MM)}"),
    ]
    rows: list[list[Cell]] = [[e.name, e.key, *e.percent(ON_PART_MM).tolist()] for e in QUICK]
    return Table("transducer", "What some effects do to charges.", columns, rows)


def _effects_table() -> Table:
    beside, on = f"at {_at(BESIDE_MM)}", f"at {_at(ON_PART_MM)}"
    columns = [
        Column("effect", "effect"),
        Column("key", "key"),
        *_charge_columns(beside),
        Column("shift_mm", "shift (mm)", 4, beside),
        Column("force_percent", "force (%)", 2, beside, signed=True),
        Column("p_value", "p", None, beside),
        Column("A_on_percent", "A (%)", 3, on, signed=True),
        Column("shift_on_mm", "shift (mm)", 4, on),
    ]
    rows: list[list[Cell]] = []
    for effect in EFFECTS:
        best, force_N = effect.found(BESIDE_MM), effect.model(BESIDE_MM).load.force_N or 1.0
        row: list[Cell] = [effect.name, effect.key, *effect.percent(BESIDE_MM).tolist()]
        row += [effect.shift_mm(BESIDE_MM), 100.0 * (best.force_N / force_N - 1.0)]
        row.append(_rounded(best.p_value))
        if effect in ON_ELECTRODE:
            row += [float(effect.percent(ON_PART_MM)[0]), effect.shift_mm(ON_PART_MM)]
        else:
            row += [None, None]
        rows.append(row)
    caption = (
        "Changes of charges by each effect, and the touch that locate finds of them with a model "
        f"of the film without the effect: shift of the place, change of the force, and the "
        f"probability p of a worse agreement at {100 * NOISE:g} % of noise."
    )
    return Table("transducer", caption, columns, rows)


def _rounded(p_value: float) -> float:
    return float(f"{p_value:.2g}")


# --------------------------------------------------------------------------- coupling, pressure


def _electric_text() -> str:
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


def pressure_pC(place: Place) -> tuple[float, float]:
    """A's charge by d33 in pC, and in percent of that by the force."""
    effect = BY_NAME["thickness direction"]
    added = (effect.charges_pC(place) - effect.plain_pC(place))[0]
    return float(added), float(effect.percent(place)[0])


# ----------------------------------------------------------------------------------------- heat


def _heat_text() -> str:
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
        f"that is 1 K warmer as a whole loses {_span(WARM.percent(BESIDE_MM))} % of its charges, "
        f"by its tension alone {_span(loose)} %. Beside A the fit tells that the model is wrong "
        f"(p = {warm.p_value:.2g}; {WARM.shift_mm(BESIDE_MM):.1f} mm away, {warm.force_N:.2f} N). "
        f"At the centre, where all charges are alike, 1 N reads as {centre.force_N:.2f} N, with "
        f"p = {centre.p_value:.2f}."
    )


def _span(percent: np.ndarray) -> str:
    """Range of the sizes of changes."""
    sizes = np.sort(np.abs(percent))
    return f"{sizes[0]:.2g} to {sizes[-1]:.2g}"


def _heat_caption() -> str:
    return (
        "A finger 10 K warmer than the film: charge of A by its heat, over that of its force of "
        "1 N. At first the loss of tension adds some charge beside A, before the heat arrives "
        f"there. Grey: {100 * NOISE:g} % of noise."
    )


def _heat_table() -> Table:
    columns = [
        Column("effect", "heat"),
        Column("place", "probe"),
        Column("force_pC", "by force (pC)", 1, "charge of A"),
        Column("heat_pC", "by heat (pC)", 1, "charge of A", signed=True),
        Column("share_percent", "share (%)", 2, "charge of A", signed=True),
        Column("shift_mm", "shift (mm)", 3, "found with a cold film"),
        Column("found_N", "force (N)", 3, "found with a cold film"),
        Column("p_value", "p", None, "found with a cold film"),
    ]
    rows: list[list[Cell]] = []
    for effect in (*FINGERS, WARM):
        for name, place in list(PLACES.items())[1:]:
            force, share = float(effect.plain_pC(place)[0]), effect.percent(place)[0]
            best: Found = effect.found(place)
            row: list[Cell] = [effect.name, name, force, 0.01 * share * force, float(share)]
            rows.append([*row, effect.shift_mm(place), best.force_N, _rounded(best.p_value)])
    caption = (
        "Charge of A by heat, and the touch of 1 N as it is found with a model of a cold film."
    )
    return Table("transducer_heat", caption, columns, rows)


# ----------------------------------------------------------------------------------------- air


def _air_text(motions: list[Motion], frequency_Hz: float) -> str:
    rest, *_, lightest, full = motions[0], motions[1], motions[-1]
    free, baffled = list(AIR)[1:]
    return (
        f"Air (6.1, item 6: 117 Hz, so that {frequency_Hz:g} Hz is quasi-static). The untouched "
        f"film sounds at {rest.first_Hz['in vacuum']:.1f} Hz in a vacuum, but in air at "
        f"{rest.first_Hz[free]:.1f} Hz, or {rest.first_Hz[baffled]:.1f} Hz with its rim in a "
        f"baffle. Under 1 N it is at {full.first_Hz[free]:.0f} and {full.first_Hz[baffled]:.0f} "
        f"Hz: the conclusion holds, since the force stretches the film. A force that oscillates "
        f"about 1 N at {frequency_Hz:g} Hz makes {full.excess_percent[baffled]:.2f} % more charge "
        f"than a static one, about {lightest.force_N:g} N {lightest.excess_percent[baffled]:.1f} "
        f"%. A light tap of {1e3 * TAP_S:g} ms, a half-sine, peaks {full.tap_percent:.0f} % above "
        f"a static force about 1 N, and {lightest.tap_percent:.0f} % above it about "
        f"{lightest.force_N:g} N."
    )


def _motion_table(motions: list[Motion], frequency_Hz: float) -> Table:
    columns = [
        Column("force_N", "about (N)", None),
        *(Column(f"first_{i}_Hz", air, 1, "first mode (Hz)") for i, air in enumerate(AIR)),
        *(
            Column(f"excess_{i}_percent", air, 2, f"charge at {frequency_Hz:g} Hz (%)", signed=True)
            for i, air in enumerate(AIR)
        ),
        Column("tap_percent", TAPPED, 1, f"peak of a tap of {1e3 * TAP_S:g} ms (%)", signed=True),
    ]
    rows: list[list[Cell]] = [
        [
            m.force_N,
            *(m.first_Hz[air] for air in AIR),
            *(m.excess_percent.get(air) for air in AIR),
            m.tap_percent,
        ]
        for m in motions
    ]
    caption = (
        f"First mode about loads of the triangle at {_at(BESIDE_MM)}, and what small further "
        "forces make of charges, compared with static ones; the electrode where it is most."
    )
    return Table("transducer_air", caption, columns, rows)


# --------------------------------------------------------------------------------------- tapes


def _tape_text(by_tape: dict[str, Explained]) -> str:
    over, beyond = (BY_NAME[f"tape {where} each electrode"] for where in ("over", "beyond"))
    shares = [found.shares for found in by_tape.values()]
    errors = [_rms(found.taped_mm) for found in by_tape.values()]
    first = next(iter(by_tape.values()))
    verdict = (
        "and so explain a part of it"
        if any(share > by_mean for share, by_mean in shares)
        else "and so do not explain which touch errs by how much"
    )
    return (
        "Tapes (6.1, item 9: they could well account for the differences). A tape of 50 µm and "
        f"3 GPa over an electrode takes {_span(over.percent(BESIDE_MM))} % of its charge, from "
        "each nearly the same; one that begins beyond it draws stress onto it, and adds "
        f"{_span(beyond.percent(BESIDE_MM))} %. The thesis prints distances of the places found "
        "from those meant, no charges: so its touches are computed with tapes, and its method "
        "finds their places after one common factor has been taken out. Tapes make its errors "
        f"{min(errors):.2f} to {max(errors):.2f} mm (root mean square), where "
        f"{_rms(first.measured_mm):.2f} mm were measured and {_rms(first.plain_mm):.2f} mm are its "
        "own: in size they could well be the cause. Of the squares that its own errors leave they "
        f"take away {_percents([share for share, _ in shares])}; one and the same error in all "
        f"rows would take away {_percents([max(by_mean for _, by_mean in shares)])}. They follow "
        f"the measured ones with a correlation of {_correlations(by_tape)}, {verdict}."
    )


def _percents(shares: Sequence[float]) -> str:
    return joined([f"{100.0 * share:.0f} %" for share in shares])


def _correlations(by_tape: dict[str, Explained]) -> str:
    pairs = [found.correlation for found in by_tape.values()]
    return joined([f"{signed(r, 2)} (p = {chance:.2f})" for r, chance in pairs])


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(np.square(values))))


def _tape_table(thesis: Thesis, by_tape: dict[str, Explained]) -> Table:
    columns = [
        Column("case", "case"),
        Column("place", "place"),
        Column("measured_mm", "measured (mm)", 3),
        Column("plain_mm", "without tapes (mm)", 3),
        *(
            Column(f"{kind}_{i}_mm", label, 2, name)
            for i, name in enumerate(by_tape)
            for kind, label in (("error", "error (mm)"), ("shift", "shift (mm)"))
        ),
    ]
    rows: list[list[Cell]] = []
    for i, row in enumerate(measured_rows(thesis)):
        own = float(next(iter(by_tape.values())).plain_mm[i])
        line: list[Cell] = [row.case, f"{row.probe}, {row.position}", row.error_mm, own]
        for found in by_tape.values():
            line += [float(found.taped_mm[i]), float(found.shifts_mm[i])]
        rows.append(line)
    plain = next(iter(by_tape.values()))
    total: list[Cell] = ["root mean square", "", _rms(plain.measured_mm), _rms(plain.plain_mm)]
    for found in by_tape.values():
        total += [_rms(found.taped_mm), _rms(found.shifts_mm)]
    rows.append(total)
    caption = "Tables 5.1 and 5.2: errors of places by the thesis's method from charges with tapes."
    return Table("transducer_tapes", caption, columns, rows)


# ------------------------------------------------------------------------------------- tension


def _tension_text() -> str:
    uneven, oval = EFFECTS[-2], EFFECTS[-1]
    worst = [np.abs(effect.percent(BESIDE_MM)).max() for effect in (uneven, oval)]
    return (
        "Tension (6.1, item 8: it was not uniform). Under 1 N the film's own tension counts for "
        f"little: 10 % less of it along x and 10 % more along y change charges by {worst[0]:.2g} % "
        f"and the place by {1e3 * uneven.shift_mm(BESIDE_MM):.1f} µm, a rim that is 1 µm out of "
        f"round by {worst[1]:.2g} % and {1e3 * oval.shift_mm(BESIDE_MM):.1f} µm."
    )


TRANSDUCER_CHAPTER = Chapter(
    "transducer",
    "Chapter 6: what the thesis left out of the transducer",
    (),
    _scenes,
    _compose,
)

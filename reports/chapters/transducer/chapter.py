"""Chapter of the thesis report: the whole transducer, effect by effect.

The thesis left out, guessed or blamed what makes a film a transducer: voltages, heat, the thickness
direction, air, tapes, an uneven tension. Each is turned on by keys of the scene.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from pvdf_fem import Scene
from reports.chapters.transducer import moving
from reports.chapters.transducer.effects import (
    BESIDE_MM,
    BY_NAME,
    EFFECTS,
    FINGERS,
    NOISE,
    ON_ELECTRODE,
    ON_PART_MM,
    ON_WHOLE_MM,
    WARM,
    Effect,
    Found,
    Place,
    finger,
)
from reports.chapters.transducer.figures import Bar, heat_picture, sizes_picture
from reports.chapters.transducer.moving import AIR, LOADS_N, TAP_S, TAPPED, Motion
from reports.chapters.transducer.taped import Explained, contour_scenes, explained, measured_rows
from reports.chapters.transducer.texts import (
    air_text,
    at,
    electric_text,
    heat_text,
    rms,
    tape_text,
    temperature_text,
    tension_text,
)
from reports.common.chapter import Chapter, Content
from reports.common.page import Cell, Column, Picture, Table
from reports.common.results import Results
from reports.common.thesis_data import Thesis

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
        f"short of electrode A, at {at(BESIDE_MM)} (section 3.1.2), or on a part of A, at "
        f"{at(ON_PART_MM)}. Charges are changes by the touch, as a zeroed amplifier reads them."
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
            electric_text(),
            heat_text(),
            temperature_text(),
            air_text(motions, frequency_Hz),
            tape_text(by_tape),
            tension_text(),
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


def _measuring_error(thesis: Thesis) -> tuple[float, float]:
    """Root mean square of the thesis's measured errors in mm, and its discrepancy in percent."""
    errors = np.array([row.error_mm for row in measured_rows(thesis)])
    stated = thesis.parameters["experiment"]["theory_experiment_discrepancy"]["value"]
    return rms(errors), float(stated)


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
        f"without the effect. Bars: probe at {at(BESIDE_MM)}, those beyond the thesis's error in "
        f"red; rings: on a part of A, at {at(ON_PART_MM)}. Dashed: the thesis's discrepancy "
        "between theory and experiment (5.4), and the root mean square of its measured errors "
        "(Tables 5.1, 5.2)."
    )


def _charge_columns(group: str) -> list[Column]:
    return [Column(f"{n}_percent", f"{n} (%)", 3, group, signed=True) for n in "ABCD"]


def _few_table() -> Table:
    columns = [
        Column("effect", "effect"),
        Column("key", "key"),
        *_charge_columns(f"at {at(ON_PART_MM)}"),
    ]
    rows: list[list[Cell]] = [[e.name, e.key, *e.percent(ON_PART_MM).tolist()] for e in QUICK]
    return Table("transducer", "What some effects do to charges.", columns, rows)


def _effects_table() -> Table:
    beside, on = f"at {at(BESIDE_MM)}", f"at {at(ON_PART_MM)}"
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


# ----------------------------------------------------------------------------------------- heat


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
        f"First mode about loads of the triangle at {at(BESIDE_MM)}, and what small further "
        "forces make of charges, compared with static ones; the electrode where it is most."
    )
    return Table("transducer_air", caption, columns, rows)


# --------------------------------------------------------------------------------------- tapes


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
    total: list[Cell] = ["root mean square", "", rms(plain.measured_mm), rms(plain.plain_mm)]
    for found in by_tape.values():
        total += [rms(found.taped_mm), rms(found.shifts_mm)]
    rows.append(total)
    caption = "Tables 5.1 and 5.2: errors of places by the thesis's method from charges with tapes."
    return Table("transducer_tapes", caption, columns, rows)


TRANSDUCER_CHAPTER = Chapter(
    "transducer",
    "Chapter 6: what the thesis left out of the transducer",
    (),
    _scenes,
    _compose,
)

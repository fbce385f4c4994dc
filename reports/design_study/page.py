"""The sections of the design study: tables, pictures, and sentences with the numbers found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from reports.common.page import Cell, Column, Picture, Section, Table
from reports.design_study.choice import (
    INDIFFERENCE,
    OVERLOAD,
    STRENGTH_MPA,
    Choice,
    Recommendation,
    Step,
    ring_label,
    worst_mm,
)
from reports.design_study.figures import (
    Film,
    film_picture,
    maps_picture,
    spacing_picture,
    steps_picture,
)
from reports.design_study.sensor import PROBE_RADIUS_MM, Sensor
from reports.design_study.study import (
    LIGHT_N,
    QUANTILE,
    THESIS,
    TURNS_DEG,
    Performance,
    Study,
    drawn,
    light,
    poled,
    rings,
    shapes,
    thicknesses,
)

MAPS, SPACING, STEPS = "maps.svg", "spacing.svg", "recommended.svg"
THICKNESS, PRETENSION = "thickness.svg", "pretension.svg"
MOST = f"{100 * QUANTILE:.0f} %"


def introduction(study: Study) -> list[str]:
    """What is studied, and by which measure."""
    noise = study.noise
    return [
        "What the charges of a sensor tell about a touch, by its design. A round probe of "
        f"{PROBE_RADIUS_MM:g} mm radius presses with 1 N, or lightly with {LIGHT_N:g} N; unless "
        "something else is said, film and electrodes are the thesis's: four squares of "
        f"{THESIS.width_mm:g} mm, {THESIS.spacing_mm:g} mm apart, on {THESIS.thickness_um:g} µm "
        "of biaxial film cooled by 1 K.",
        "Noise: the errors of the charges are independent and normal, each with a standard "
        f"deviation of {100 * noise.relative:g} % of what the touch adds to the charge, and "
        f"{noise.floor_pC:g} pC of the amplifier, added in quadrature. The Jacobian J of the "
        "charges by x, y and force gives the information Jᵀ Σ⁻¹ J; its inverse is the least "
        "covariance that an unbiased estimate of the three can have. The position error is the "
        "root mean square distance between estimated and true place, the force being unknown too.",
        f"A design is judged by the position error that it keeps on {MOST} of the working area, "
        f"the disc of {study.axes.working_mm:g} mm radius about the film's centre. Near a few "
        "lines the Jacobian is singular, and the error has no bound; and whether two distant "
        "places give the same charges is a question that a Jacobian does not answer.",
    ]


def number_of_electrodes(study: Study, out: Path) -> Section:
    """Spacing, size and number of the electrodes."""
    spacing_picture(study, out / SPACING)
    every = [one for n in study.axes.counts for one in rings(study, n)]
    best = {n: study.best(rings(study, n)) for n in study.axes.counts}
    told = [
        f"{n} electrodes: {one.position_mm:.2f} mm at {ring_label(one.sensor)}"
        for n, one in best.items()
    ]
    table = Table(
        "electrodes",
        "All spacings and sizes for which the electrodes have room.",
        [
            Column("count", "electrodes", 0),
            Column("spacing_mm", "spacing (mm)", None),
            Column("side_mm", "side (mm)", None),
            *_PERFORMANCE,
        ],
        [[s.count, s.spacing_mm, s.width_mm, *_cells(study.performance(s))] for s in every],
    )
    text = f"The smallest position errors: {'; '.join(told)}."
    return Section(
        "electrodes",
        "Number, spacing and size of the electrodes",
        [text],
        [
            Picture(
                SPACING,
                "Position error under 1 N against the spacing, where the electrodes have room.",
            ),
            table,
        ],
    )


def maps(study: Study, recommended: Sensor, out: Path) -> Section:
    """Maps of the position error."""
    shown = {
        **{
            f"{n} electrodes, biaxial": replace(THESIS, count=n, turn_deg=TURNS_DEG[n])
            for n in study.axes.counts
        },
        "uniaxial, on drawn axis": drawn(THESIS),
        "uniaxial, at 45° to it": replace(drawn(THESIS), turn_deg=45.0),
        "recommended": recommended,
    }
    shown = {title: one for title, one in shown.items() if study.is_possible(one)}
    study.solve(shown.values())
    maps_picture(study, shown, out / MAPS)
    caption = (
        f"Position error under 1 N by the place of the probe, with that kept on {MOST} of the "
        "area. Orange: electrodes; the drawn axis of uniaxial film is x."
    )
    return Section("maps", "Resolution over the film", [], [Picture(MAPS, caption)])


def film(study: Study, recommended: Recommendation, out: Path) -> Section:
    """Thickness and pretension."""
    thick = thicknesses(study.axes)
    tight = [one.sensor for one in recommended.temperature.candidates]
    film_picture(
        study,
        [Film(one.thickness_um, one) for one in thick],
        "thickness (µm)",
        recommended.thickness.taken.sensor,
        out / THICKNESS,
    )
    film_picture(
        study,
        [Film(-one.temperature_change_K, one) for one in tight],
        "cooling (K)",
        recommended.temperature.taken.sensor,
        out / PRETENSION,
    )
    pictures = [
        Picture(name, f"Against {what}; dotted: the recommended value.")
        for name, what in ((THICKNESS, "the thickness"), (PRETENSION, "the cooling"))
    ]
    thin, thickest = (study.performance(light(one)) for one in (thick[0], thick[-1]))
    text = (
        f"Under {LIGHT_N:g} N the position error goes from {thin.position_mm:.2f} mm at "
        f"{thick[0].thickness_um:g} µm to {thickest.position_mm:.2f} mm at "
        f"{thick[-1].thickness_um:g} µm, as the charge per force goes from "
        f"{thin.sensitivity_pC_N:.0f} to {thickest.sensitivity_pC_N:.0f} pC/N; under 1 N from "
        f"{study.performance(thick[0]).position_mm:.2f} to "
        f"{study.performance(thick[-1]).position_mm:.2f} mm. The stress under 1 N is "
        f"{study.stress_MPa(thick[0], 1.0):.0f} and {study.stress_MPa(thick[-1], 1.0):.0f} MPa."
    )
    table = _film_table(study, list(dict.fromkeys([*thick, *tight])))
    return Section("film", "Thickness and pretension", [text], [*pictures, table])


def _film_table(study: Study, sensors: Sequence[Sensor]) -> Table:
    columns = [
        Column("thickness_um", "film (µm)", None),
        Column("cooling_K", "cooling (K)", None),
        *_AT_BOTH_FORCES,
        Column("stress_1_N_MPa", "1 N", 1, "stress (MPa)"),
        Column("stress_overload_MPa", f"{OVERLOAD:g} N", 1, "stress (MPa)"),
    ]
    rows: list[list[Cell]] = []
    for one in sensors:
        stress = study.stress_MPa(one, 1.0), study.stress_MPa(one, OVERLOAD)
        soft = _cells(study.performance(light(one)))
        firm = _cells(study.performance(one))
        rows.append([one.thickness_um, -one.temperature_change_K, *firm, *soft, *stress])
    caption = "Thickness and pretension of the film under the thesis's electrodes."
    return Table("films", caption, columns, rows)


def recommendation(found: Recommendation, out: Path) -> Section:
    """The recommended sensor and its reasons."""
    steps, sensor = found.steps, found.sensor
    firm, soft = (np.array([getattr(s, k).position_mm for s in steps]) for k in ("firm", "soft"))
    steps_picture([step.label for step in steps], firm, soft, out / STEPS)
    first, last = steps[0], steps[-1]
    told = [
        f"Recommended: {sensor.count} electrodes, {ring_label(sensor)}, on "
        f"{_poling(sensor)} film of {sensor.thickness_um:g} µm cooled by "
        f"{-sensor.temperature_change_K:g} K. Its position error is "
        f"{first.firm.position_mm:.2f} mm under 1 N and {first.soft.position_mm:.2f} mm under "
        f"{LIGHT_N:g} N, against {last.firm.position_mm:.2f} and {last.soft.position_mm:.2f} mm "
        f"of the thesis's sensor; that of the force {first.firm.force_percent:.1f} and "
        f"{first.soft.force_percent:.1f} %, against {last.firm.force_percent:.1f} and "
        f"{last.soft.force_percent:.1f} %.",
        *_reasons(found),
    ]
    table = Table(
        "recommended",
        "The recommended sensor, the same with one choice as the thesis has it, and the thesis's.",
        [
            Column("sensor", "sensor"),
            *_AT_BOTH_FORCES,
            Column("stress_overload_MPa", f"stress at {OVERLOAD:g} N (MPa)", 1),
        ],
        [_step_row(step) for step in steps],
    )
    picture = Picture(STEPS, "The recommended sensor, and what undoing one choice makes of it.")
    return Section("recommendation", "Recommended design", told, [picture, table])


def _reasons(found: Recommendation) -> list[str]:
    count, near = found.count, f"{100 * (INDIFFERENCE - 1.0):.0f} %"
    per_root = "; ".join(f"{one.label}: {one.merit:.2f} mm" for one in count.candidates)
    films = [one for one in found.thickness.candidates if not one.admissible]
    refused = ", ".join(one.label.split(",")[0] for one in films) or "none"
    return [
        f"Number: {count.taken.label}, whose error times the root of the number is least, so that "
        f"they gain more than averaging would ({per_root}).",
        f"Spacing and size: {found.ring.taken.label}, the most charge per force among those "
        f"within {near} of the least error ({_least(found.ring)}).",
        f"Poling: {found.poling.taken.label}; {_all(found.poling)}. Biaxial film is preferred "
        f"unless the other is better by more than {near}, as on drawn film the charges under a "
        "long probe depend on its direction to the drawn axis too; all this is for a round one.",
        f"Thickness: {found.thickness.taken.label.split(',')[0]}, the least error of the worse of "
        f"both forces ({_all(found.thickness)}) among films whose stress under {OVERLOAD:g} N is "
        f"below {STRENGTH_MPA:g} MPa, the lowest strength that the supplier gives; refused for "
        f"it: {refused}.",
        f"Pretension: {-found.temperature.taken.sensor.temperature_change_K:g} K, the tightest "
        f"film within {near} of the least error ({_all(found.temperature)}), as a film that warms "
        "by its cooling is slack.",
    ]


def _least(choice: Choice) -> str:
    best = min(choice.candidates, key=lambda one: (np.isnan(one.merit), one.merit))
    return f"{best.merit:.2f} mm at {best.label}; {choice.taken.merit:.2f} mm here"


def _all(choice: Choice) -> str:
    return "; ".join(f"{one.label}: {one.merit:.2f} mm" for one in choice.candidates)


def future_work(study: Study, found: Recommendation) -> Section:
    """The parameters that section 6.3 of the thesis leaves to others, one after the other."""
    here = study.performance(THESIS)
    same = [s for s in rings(study, THESIS.count) if s.width_mm == THESIS.width_mm]
    sized = [s for s in rings(study, THESIS.count) if s.ring_mm == THESIS.ring_mm]
    best = study.best(same)
    text = [
        "Section 6.3 of the thesis, item 3, names design parameters to be investigated. Position "
        "errors under 1 N:",
        f"Distance between opposite elements: four of {THESIS.width_mm:g} mm do best at "
        f"{best.sensor.spacing_mm:g} mm, {best.position_mm:.2f} mm, against "
        f"{here.position_mm:.2f} mm at the thesis's {THESIS.spacing_mm:g} mm. At the film's "
        f"centre the error is {_trend(study, same)}.",
        f"Dimensions of each element, at {THESIS.spacing_mm:g} mm: {_sizes(study, sized)}.",
        *_directions(study),
        f"Shapes, of one area: {_named(study, shapes())}.",
        f"Beyond the list: number of electrodes, thickness and pretension, see above; together "
        f"with these the worse of both forces' errors goes from {worst_mm(study, THESIS):.2f} mm "
        f"to {worst_mm(study, found.sensor):.2f} mm.",
    ]
    table = Table(
        "shapes",
        "Shapes and orientations of four electrodes, and their place on drawn film (d31 = 18, "
        "d32 = 2 pC/N).",
        [Column("sensor", "sensor"), *_PERFORMANCE],
        [[name, *_cells(study.performance(one))] for name, one in {**shapes(), **poled()}.items()],
    )
    title = "The thesis's future work (section 6.3, item 3)"
    return Section("future-work", title, text, [table])


def _directions(study: Study) -> list[str]:
    uniaxial = {name: one for name, one in poled().items() if not one.is_biaxial}
    on, turned = (study.performance(replace(drawn(THESIS), turn_deg=a)) for a in (0.0, 45.0))
    return [
        "Locations and orientations with respect to the drawn and transverse directions: on "
        "biaxial film, as elastic as here in all directions, there is none. On drawn film "
        f"{_named(study, uniaxial)}. At the film's centre four on the axes keep "
        f"{on.position_centre_mm:.2f} mm and four at 45° {turned.position_centre_mm:.2f} mm. "
        "That is for a round probe: the thesis's objection to uniaxial film, that its charges "
        "depend on the probe's shape and direction, stands beside it.",
    ]


def _trend(study: Study, sensors: Sequence[Sensor]) -> str:
    ends = [study.performance(one) for one in (sensors[0], sensors[-1])]
    return ", ".join(
        f"{one.position_centre_mm:.2f} mm at {one.sensor.spacing_mm:g} mm" for one in ends
    )


def _sizes(study: Study, sensors: Sequence[Sensor]) -> str:
    found = [study.performance(one) for one in sensors]
    return "; ".join(
        f"{one.position_mm:.2f} mm and {one.sensitivity_pC_N:.0f} pC/N for a side of "
        f"{one.sensor.width_mm:g} mm"
        for one in found
    )


def _named(study: Study, sensors: Mapping[str, Sensor]) -> str:
    return "; ".join(f"{n}: {study.performance(s).position_mm:.2f} mm" for n, s in sensors.items())


# ------------------------------------------------------------------------------------ the pieces

_PERFORMANCE = [
    Column("position_mm", f"position error, {MOST} (mm)", 2),
    Column("position_median_mm", "median (mm)", 2),
    Column("position_centre_mm", "centre (mm)", 2),
    Column("force_percent", f"force error, {MOST} (%)", 1),
    Column("sensitivity_pC_N", "charge per force (pC/N)", 0),
    Column("slope_pC_mm", "charge per place (pC/mm)", 1),
]
_AT_BOTH_FORCES = [
    replace(column, key=f"{column.key}_{key}", group=force)
    for key, force in (("firm", "1 N"), ("light", f"{LIGHT_N:g} N"))
    for column in _PERFORMANCE
]


def _cells(one: Performance) -> list[Cell]:
    return [getattr(one, column.key) for column in _PERFORMANCE]


def _step_row(step: Step) -> list[Cell]:
    return [step.label, *_cells(step.firm), *_cells(step.soft), step.stress_MPa]


def _poling(sensor: Sensor) -> str:
    return "biaxial" if sensor.is_biaxial else "uniaxial"

"""The sections of the design study: tables, pictures, and sentences with their numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from reports.common.page import Cell, Column, Picture, Section, Table
from reports.design_study.choice import (
    INDIFFERENCE,
    OVERLOAD_N,
    STRENGTH_MPA,
    Decision,
    Recommendation,
    Step,
    ring_label,
    worst_mm,
)
from reports.design_study.figures import (
    FilmOnAxis,
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

MAPS = "maps.svg"
SPACING = "spacing.svg"
STEPS = "recommended.svg"
THICKNESS = "thickness.svg"
PRETENSION = "pretension.svg"
MOST = f"{100 * QUANTILE:.0f} %"


def introduction(study: Study) -> list[str]:
    """Paragraphs that say what is studied, and by which measure."""
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
    """Section on spacing, size and number of the electrodes."""
    spacing_picture(study, out / SPACING)
    sensors = [performance for n in study.axes.counts for performance in rings(study, n)]
    best = {n: study.best(rings(study, n)) for n in study.axes.counts}
    best_by_count = [
        f"{n} electrodes: {performance.position_mm:.2f} mm at {ring_label(performance.sensor)}"
        for n, performance in best.items()
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
        [[s.count, s.spacing_mm, s.width_mm, *_cells(study.performance(s))] for s in sensors],
    )
    text = f"The smallest position errors: {'; '.join(best_by_count)}."
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
    """Section with maps of the position error."""
    sensors = {
        **{
            f"{n} electrodes, biaxial": replace(THESIS, count=n, turn_deg=TURNS_DEG[n])
            for n in study.axes.counts
        },
        "uniaxial, on drawn axis": drawn(THESIS),
        "uniaxial, at 45° to it": replace(drawn(THESIS), turn_deg=45.0),
        "recommended": recommended,
    }
    sensors = {title: sensor for title, sensor in sensors.items() if study.is_possible(sensor)}
    study.solve(sensors.values())
    maps_picture(study, sensors, out / MAPS)
    caption = (
        f"Position error under 1 N by the place of the probe, with that kept on {MOST} of the "
        "area. Orange: electrodes; the drawn axis of uniaxial film is x."
    )
    return Section("maps", "Resolution over the film", [], [Picture(MAPS, caption)])


def film(study: Study, recommended: Recommendation, out: Path) -> Section:
    """Section on thickness and pretension of the film."""
    by_thickness = thicknesses(study.axes)
    by_cooling = [cooled.sensor for cooled in recommended.temperature.alternatives]
    film_picture(
        study,
        [FilmOnAxis(sensor.thickness_um, sensor) for sensor in by_thickness],
        "thickness (µm)",
        recommended.thickness.taken.sensor,
        out / THICKNESS,
    )
    film_picture(
        study,
        [FilmOnAxis(-sensor.temperature_change_K, sensor) for sensor in by_cooling],
        "cooling (K)",
        recommended.temperature.taken.sensor,
        out / PRETENSION,
    )
    pictures = [
        Picture(name, f"Against {what}; dotted: the recommended value.")
        for name, what in ((THICKNESS, "the thickness"), (PRETENSION, "the cooling"))
    ]
    thinnest, thickest = (
        study.performance(light(sensor)) for sensor in (by_thickness[0], by_thickness[-1])
    )
    text = (
        f"Under {LIGHT_N:g} N the position error goes from {thinnest.position_mm:.2f} mm at "
        f"{by_thickness[0].thickness_um:g} µm to {thickest.position_mm:.2f} mm at "
        f"{by_thickness[-1].thickness_um:g} µm, as the charge per force goes from "
        f"{thinnest.sensitivity_pC_N:.0f} to {thickest.sensitivity_pC_N:.0f} pC/N; under 1 N from "
        f"{study.performance(by_thickness[0]).position_mm:.2f} to "
        f"{study.performance(by_thickness[-1]).position_mm:.2f} mm. The stress under 1 N is "
        f"{study.stress_MPa(by_thickness[0], 1.0):.0f} and "
        f"{study.stress_MPa(by_thickness[-1], 1.0):.0f} MPa."
    )
    table = _film_table(study, list(dict.fromkeys([*by_thickness, *by_cooling])))
    return Section("film", "Thickness and pretension", [text], [*pictures, table])


def _film_table(study: Study, sensors: Sequence[Sensor]) -> Table:
    columns = [
        Column("thickness_um", "film (µm)", None),
        Column("cooling_K", "cooling (K)", None),
        *_AT_BOTH_FORCES,
        Column("stress_1_N_MPa", "1 N", 1, "stress (MPa)"),
        Column("stress_overload_MPa", f"{OVERLOAD_N:g} N", 1, "stress (MPa)"),
    ]
    rows: list[list[Cell]] = []
    for sensor in sensors:
        stress = study.stress_MPa(sensor, 1.0), study.stress_MPa(sensor, OVERLOAD_N)
        soft = _cells(study.performance(light(sensor)))
        firm = _cells(study.performance(sensor))
        rows.append([sensor.thickness_um, -sensor.temperature_change_K, *firm, *soft, *stress])
    caption = "Thickness and pretension of the film under the thesis's electrodes."
    return Table("films", caption, columns, rows)


def recommendation(recommended: Recommendation, out: Path) -> Section:
    """Section on the recommended sensor and the reasons for it."""
    steps, sensor = recommended.steps, recommended.sensor
    firm, soft = (np.array([getattr(s, k).position_mm for s in steps]) for k in ("firm", "soft"))
    steps_picture([step.label for step in steps], firm, soft, out / STEPS)
    best, thesis = steps[0], steps[-1]
    paragraphs = [
        f"Recommended: {sensor.count} electrodes, {ring_label(sensor)}, on {_poling(sensor)} film "
        f"of {sensor.thickness_um:g} µm cooled by {-sensor.temperature_change_K:g} K. Its "
        f"position error is {best.firm.position_mm:.2f} mm under 1 N and "
        f"{best.soft.position_mm:.2f} mm under {LIGHT_N:g} N, against "
        f"{thesis.firm.position_mm:.2f} and {thesis.soft.position_mm:.2f} mm of the thesis's "
        f"sensor; that of the force {best.firm.force_percent:.1f} and "
        f"{best.soft.force_percent:.1f} %, against {thesis.firm.force_percent:.1f} and "
        f"{thesis.soft.force_percent:.1f} %.",
        *_reasons(recommended),
    ]
    table = Table(
        "recommended",
        "The recommended sensor, the same with one choice as the thesis has it, and the thesis's.",
        [
            Column("sensor", "sensor"),
            *_AT_BOTH_FORCES,
            Column("stress_overload_MPa", f"stress at {OVERLOAD_N:g} N (MPa)", 1),
        ],
        [_step_row(step) for step in steps],
    )
    picture = Picture(STEPS, "The recommended sensor, and what undoing one choice makes of it.")
    return Section("recommendation", "Recommended design", paragraphs, [picture, table])


def _reasons(recommended: Recommendation) -> list[str]:
    count, tolerated = recommended.count, f"{100 * (INDIFFERENCE - 1.0):.0f} %"
    merits = "; ".join(
        f"{alternative.label}: {alternative.merit:.2f} mm" for alternative in count.alternatives
    )
    inadmissible = [
        alternative
        for alternative in recommended.thickness.alternatives
        if not alternative.admissible
    ]
    refused = ", ".join(alternative.label.split(",")[0] for alternative in inadmissible) or "none"
    return [
        f"Number: {count.taken.label}, whose error times the root of the number is least, so that "
        f"they gain more than averaging would ({merits}).",
        f"Spacing and size: {recommended.ring.taken.label}, the most charge per force among those "
        f"within {tolerated} of the least error ({_least(recommended.ring)}).",
        f"Poling: {recommended.poling.taken.label}; {_all(recommended.poling)}. Biaxial film is "
        f"preferred unless the other is better by more than {tolerated}, as on drawn film the "
        "charges under a long probe depend on its direction to the drawn axis too; all this is "
        "for a round one.",
        f"Thickness: {recommended.thickness.taken.label.split(',')[0]}, the least error of the "
        f"worse of both forces ({_all(recommended.thickness)}) among films whose stress under "
        f"{OVERLOAD_N:g} N is below {STRENGTH_MPA:g} MPa, the lowest strength that the supplier "
        f"gives; refused for it: {refused}.",
        f"Pretension: {-recommended.temperature.taken.sensor.temperature_change_K:g} K, the "
        f"tightest film within {tolerated} of the least error ({_all(recommended.temperature)}), "
        "as a film that warms by its cooling is slack.",
    ]


def _least(choice: Decision) -> str:
    best = min(
        choice.alternatives,
        key=lambda alternative: (np.isnan(alternative.merit), alternative.merit),
    )
    return f"{best.merit:.2f} mm at {best.label}; {choice.taken.merit:.2f} mm here"


def _all(choice: Decision) -> str:
    return "; ".join(
        f"{alternative.label}: {alternative.merit:.2f} mm" for alternative in choice.alternatives
    )


def future_work(study: Study, recommended: Recommendation) -> Section:
    """Section on the parameters that section 6.3 of the thesis leaves to future work."""
    thesis = study.performance(THESIS)
    by_spacing = [s for s in rings(study, THESIS.count) if s.width_mm == THESIS.width_mm]
    by_side = [s for s in rings(study, THESIS.count) if s.ring_mm == THESIS.ring_mm]
    best = study.best(by_spacing)
    text = [
        "Section 6.3 of the thesis, item 3, names design parameters to be investigated. Position "
        "errors under 1 N:",
        f"Distance between opposite elements: four of {THESIS.width_mm:g} mm do best at "
        f"{best.sensor.spacing_mm:g} mm, {best.position_mm:.2f} mm, against "
        f"{thesis.position_mm:.2f} mm at the thesis's {THESIS.spacing_mm:g} mm. At the film's "
        f"centre the error is {_trend(study, by_spacing)}.",
        f"Dimensions of each element, at {THESIS.spacing_mm:g} mm: {_sizes(study, by_side)}.",
        *_directions(study),
        f"Shapes, of one area: {_named(study, shapes())}.",
        f"Beyond the list: number of electrodes, thickness and pretension, see above; together "
        f"with these the worse of both forces' errors goes from {worst_mm(study, THESIS):.2f} mm "
        f"to {worst_mm(study, recommended.sensor):.2f} mm.",
    ]
    table = Table(
        "shapes",
        "Shapes and orientations of four electrodes, and their place on drawn film (d31 = 18, "
        "d32 = 2 pC/N).",
        [Column("sensor", "sensor"), *_PERFORMANCE],
        [
            [name, *_cells(study.performance(sensor))]
            for name, sensor in {**shapes(), **poled()}.items()
        ],
    )
    title = "The thesis's future work (section 6.3, item 3)"
    return Section("future-work", title, text, [table])


def _directions(study: Study) -> list[str]:
    uniaxial = {name: sensor for name, sensor in poled().items() if not sensor.is_biaxial}
    on_axes, turned = (study.performance(replace(drawn(THESIS), turn_deg=a)) for a in (0.0, 45.0))
    return [
        "Locations and orientations with respect to the drawn and transverse directions: on "
        "biaxial film, as elastic as here in all directions, there is none. On drawn film "
        f"{_named(study, uniaxial)}. At the film's centre four on the axes keep "
        f"{on_axes.position_centre_mm:.2f} mm and four at 45° {turned.position_centre_mm:.2f} mm. "
        "That is for a round probe: the thesis's objection to uniaxial film, that its charges "
        "depend on the probe's shape and direction, stands beside it.",
    ]


def _trend(study: Study, sensors: Sequence[Sensor]) -> str:
    ends = [study.performance(performance) for performance in (sensors[0], sensors[-1])]
    return ", ".join(
        f"{performance.position_centre_mm:.2f} mm at {performance.sensor.spacing_mm:g} mm"
        for performance in ends
    )


def _sizes(study: Study, sensors: Sequence[Sensor]) -> str:
    performances = [study.performance(performance) for performance in sensors]
    return "; ".join(
        f"{performance.position_mm:.2f} mm and {performance.sensitivity_pC_N:.0f} pC/N for a side "
        f"of {performance.sensor.width_mm:g} mm"
        for performance in performances
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


def _cells(performance: Performance) -> list[Cell]:
    return [getattr(performance, column.key) for column in _PERFORMANCE]


def _step_row(step: Step) -> list[Cell]:
    return [step.label, *_cells(step.firm), *_cells(step.soft), step.stress_MPa]


def _poling(sensor: Sensor) -> str:
    return "biaxial" if sensor.is_biaxial else "uniaxial"

"""How far the numbers of the design study can be trusted: finer lattices, and bending."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from reports.common.page import Cell, Column, Section, Table
from reports.design_study.choice import Recommendation
from reports.design_study.sensor import Sensor
from reports.design_study.study import LIGHT_N, THESIS, Study, light


def checks(study: Study, recommended: Recommendation, *, quick: bool) -> Section:
    """Compute position errors again, with smaller steps and tolerance, and with bending."""
    lattice = study.lattice
    finer = Study(study.results, lattice.finer(), study.axes, study.noise)
    # Bending needs fine meshes. To save time both films are compared on every other circle only.
    coarse = replace(lattice, pitch_mm=2.0 * lattice.pitch_mm)
    coarser = Study(study.results, coarse, study.axes, study.noise)
    thick = replace(THESIS, thickness_um=max(study.axes.thicknesses_um))
    soft, bent = light(recommended.sensor), replace(thick, bending=True)
    cases = [
        ("thesis's, 1 N", (study, THESIS), (finer, THESIS)),
        (f"recommended, {LIGHT_N:g} N", (study, soft), (finer, soft)),
        (f"{thick.thickness_um:g} µm, 1 N, with bending", (coarser, thick), (coarser, bent)),
    ]
    rows: list[list[Cell]] = []
    for label, studied, recomputed in cases[: 1 if quick else None]:
        for case_study, sensor in (studied, recomputed):
            case_study.solve([sensor])
        rows.append([label, *_compared(studied, recomputed)])
    columns = [
        Column("case", "sensor"),
        Column("position_mm", "in the study (mm)", 3),
        Column("position_again_mm", "again (mm)", 3),
        Column("median_difference_percent", "median (%)", 2, "difference over the places"),
        Column("large_difference_percent", "in 95 % (%)", 2, "difference over the places"),
    ]
    table = Table(
        "checks", "The study's position errors, and the same computed again.", columns, rows
    )
    fine = lattice.finer()
    text = [
        "The Jacobian comes from charges at places of the probe on circles "
        f"{lattice.pitch_mm:g} mm apart, every {360.0 / lattice.angle_count:g}°, by splines and "
        f"Fourier series, and from forces {100 * lattice.force_step:g} % up and down. Computed "
        f"again with {fine.pitch_mm:g} mm, {360.0 / fine.angle_count:g}°, "
        f"{100 * fine.force_step:g} % and charges to {fine.tolerance:g} instead of "
        f"{lattice.tolerance:g}, position errors change by what the table says.",
        "The films are membranes. The last line tells what bending makes of the thickest one.",
    ]
    return Section("checks", "How exact these numbers are", text[: 1 if quick else 2], [table])


def _compared(studied: tuple[Study, Sensor], recomputed: tuple[Study, Sensor]) -> list[Cell]:
    cases = studied, recomputed
    study_errors, recomputed_errors = (
        case_study.linearisation(sensor, case_study.axes.places_mm).position_errors_mm(
            case_study.noise
        )
        for case_study, sensor in cases
    )
    apart = 100.0 * np.abs(recomputed_errors / study_errors - 1.0)
    errors = [case_study.performance(sensor).position_mm for case_study, sensor in cases]
    return [*errors, float(np.median(apart)), float(np.quantile(apart, 0.95))]

"""Parts of the thesis report: chapter 5, section 6.1 and appendix 5, the experiments.

What the printed measurements say by themselves, the measuring circuit, the film's resonance, and
those parts of a charge that a simulation has and a measurement has not, or the other way round.
"""

from __future__ import annotations

import math
from cmath import phase
from collections.abc import Callable
from pathlib import Path

import numpy as np

from pvdf_fem import Scene
from pvdf_fem.maps.circuit import Circuit, dynamic_factor, film_capacitance, voltage_ratio
from pvdf_fem.output.figures import (
    COLOURS,
    GREY,
    LABEL_SIZE,
    Series,
    label_curves,
    new_figure,
    save,
    style,
)
from pvdf_fem.solution.modes import modes
from pvdf_fem.solvers.newton import Status
from reports.common.page import Cell, Column, Picture, Table
from reports.common.part import Content, Part
from reports.common.results import MATERIAL, Results
from reports.common.thesis_data import Position, Thesis
from reports.common.thesis_scene import thesis_scene

#: Both readings of App. 5's divider, named by where the load resistance is.
READINGS: dict[str, Callable[[Circuit, float], complex]] = {
    "load in parallel": Circuit.parallel_load,
    "load in series": Circuit.series_load,
}


# ------------------------------------------------------------------------- measured positions


def _measured_positions(thesis: Thesis, results: Results, out: Path) -> Content:
    measured = [p for p in thesis.positions if p.kind == "experimental"]
    simulated = [p for p in thesis.positions if p.kind == "simulated"]
    rows: list[list[Cell]] = [_position_row(p, _same_place(p, simulated)) for p in measured]
    columns = [
        Column("case", "measured case"),
        Column("place", "place"),
        Column("measured_mm", "error measured (mm)", 3),
        Column("simulated_case", "simulated case of the same place"),
        Column("simulated_mm", "error simulated (mm)", 3),
        Column("measured_over_simulated", "measured/simulated", 2),
    ]
    caption = "Tables 5.1 and 5.2: the thesis's measured errors beside its simulated ones."
    table = Table("measured_positions", caption, columns, rows)
    return Content([*_error_texts(thesis, measured, simulated), _header_text()], [table])


def _same_place(measured: Position, simulated: list[Position]) -> Position | None:
    """The simulated row of the same probe at the same place, the biaxial film at 1 N."""
    key = (measured.probe, measured.x_mm, measured.y_mm, measured.rotation_deg)
    for p in simulated:
        same = (p.probe, p.x_mm, p.y_mm, p.rotation_deg) == key
        if same and p.film == "biaxial" and p.force_N == measured.force_N and p.layout == "3":
            return p
    return None


def _position_row(measured: Position, simulated: Position | None) -> list[Cell]:
    head: list[Cell] = [measured.case, f"{measured.probe}, {measured.position}", measured.error_mm]
    if simulated is None:
        return [*head, None, None, None]
    error = simulated.error_mm
    return [*head, simulated.case, error, measured.error_mm / error]


def _error_texts(thesis: Thesis, measured: list[Position], simulated: list[Position]) -> list[str]:
    errors = np.array([p.error_mm for p in measured])
    known = errors[np.isfinite(errors)]
    large = [p for p in simulated if p.error_mm > 1.0]
    lost = [p for p in simulated if math.isnan(p.error_mm)]
    films = ", ".join(sorted({p.film for p in large}))
    texts = []
    if large or lost:
        texts.append(
            "Sections 5.3.1 and 5.3.2 call all theoretical errors smaller than 1 mm. Of "
            f"{len(simulated)} simulated positions {len(large)} are larger (film: {films}; up to "
            f"{max((p.error_mm for p in large), default=math.nan):g} mm), and {len(lost)} are "
            "printed as not intersecting."
        )
    if known.size:
        placement = thesis.parameters["experiment"]["probe_placement_error"]["value"]
        stated = thesis.parameters["experiment"]["theory_experiment_discrepancy"]["value"]
        texts.append(
            f"Section 5.4 gives a mean discrepancy of {stated:g} % between theory and experiment, "
            "without a rule; the last column shows no such number. The mean of the "
            f"{known.size} measured errors is {known.mean():.3f} mm."
        )
        texts.append(
            f"Section 6.1 admits that the probe is placed with an error of {placement:g} mm or "
            f"more. {int((known < placement).sum())} of the {known.size} measured errors are "
            "smaller than that, and so cannot be told from zero."
        )
    return texts


def _header_text() -> str:
    return (
        "The headers of Tables 3.5, 5.1 and 5.2 say three electrodes; the sensor built, and the "
        "text about them, have four. Figs 5.7 and 5.11 are captioned charge and described as "
        "voltage. Causes of the errors that 5.3.1 announces for 5.4 are in 6.1."
    )


# ------------------------------------------------------------------------------------ circuit


def thesis_circuit(thesis: Thesis) -> Circuit:
    """An electrode of the thesis with its load."""
    geometry, film = thesis.parameters["geometry"], thesis.parameters["film"]["biaxial"]
    capacitance = film_capacitance(
        1e-6 * geometry["electrode_area"]["value"],
        1e-6 * geometry["film_thickness"]["value"],
        film["dielectric_constant"]["value"],
    )
    return Circuit(capacitance, 1e6 * thesis.parameters["circuit"]["load_resistance"]["value"])


def frequency_of(circuit: Circuit, reactance: float) -> float:
    """Frequency in Hz at which the electrode has a reactance in Ω."""
    return 1.0 / (2.0 * math.pi * reactance * circuit.capacitance)


def _circuit(thesis: Thesis, results: Results, out: Path) -> Content:
    _circuit_picture(thesis, out / "circuit.svg")
    caption = (
        "App. 5: voltage over the source's against frequency, for both readings of the divider; "
        "ring: the thesis's value. The thesis measures at 20 Hz; below 10 Hz its signal was lost "
        "in noise."
    )
    return Content(
        [*_circuit_texts(thesis), *_capacitance_texts(thesis)],
        [Picture("circuit.svg", caption), _circuit_table(thesis)],
    )


def _circuit_texts(thesis: Thesis) -> list[str]:
    circuit, printed = thesis_circuit(thesis), thesis.parameters["circuit"]
    f = thesis.parameters["experiment"]["excitation_frequency"]["value"]
    X = printed["reactance_printed"]["value"]
    at = frequency_of(circuit, 1e6 * X)
    C = 1e12 * circuit.capacitance * at / f
    low = (thesis.parameters["experiment"]["noise_limit_frequency"]["value"], 5.0, 2.0)
    series, parallel = (
        ", ".join(f"{abs(reading(circuit, each)):.2f}" for each in low)
        for reading in (Circuit.series_load, Circuit.parallel_load)
    )
    frequencies = ", ".join(f"{each:g}" for each in low)
    return [
        f"The reactance printed for {f:g} Hz, {X} MΩ, is not that of "
        f"{1e12 * circuit.capacitance:.3f} pF, which has {1e-6 * circuit.reactance(f):.2f} MΩ. It "
        f"belongs to {at:.2f} Hz, or to {C:.2f} pF. The factor {printed['attenuation']['value']} "
        "follows from the printed reactance; with the right one the same formula gives "
        f"{abs(circuit.series_load(f)):.3f}.",
        "The formula is that of a load in series with the source, the voltage taken across the "
        "film's capacitance: a low pass. An amplifier's input resistance loads the source in "
        f"parallel, which is a high pass: {abs(circuit.parallel_load(f)):.3f} at {f:g} Hz. What "
        f"the thesis observes speaks for the latter: at {frequencies} Hz the parallel load passes "
        f"{parallel}, the series load {series}, so that only the former loses the signal at low "
        "frequencies.",
        "That the resistance should be as low as possible (6.1, item 13) follows from the series "
        "formula. For a parallel load the opposite is true: the voltage tends to zero with it. "
        f"The time constant, {1e3 * circuit.time_constant:.1f} ms, is also the fraction of a "
        "second within which a static charge is lost (6.1, item 1).",
    ]


def _capacitance_texts(thesis: Thesis) -> list[str]:
    circuit, printed = thesis_circuit(thesis), thesis.parameters["circuit"]
    f = thesis.parameters["experiment"]["excitation_frequency"]["value"]
    measured = printed["capacitance_measured_two_electrodes"]["value"]
    small = Circuit(1e-12 * measured, circuit.load_resistance)
    low = 100.0 * (1.0 - small.capacitance / circuit.capacitance)
    open_, loaded = voltage_ratio(small, circuit), voltage_ratio(small, circuit, f)
    ratio = _contrast_of_thesis(thesis)
    against = (
        f", against {100 * (ratio - 1):.1f} % between A and B in Table 4.1 at 0°"
        if math.isfinite(ratio)
        else ""
    )
    return [
        f"Two electrodes have {measured:g} pF, {low:.1f} % less than theory (6.1 says "
        f"{printed['capacitance_deficit_stated']['value']:g} %, App. 5 calls all four close to "
        f"it). For equal charges their voltages are {100 * (open_ - 1):.0f} % higher on an open "
        f"circuit, and {100 * (loaded - 1):.0f} % at {f:g} Hz with the load in parallel{against}. "
        "That charge or voltage makes no difference (5.3.1) holds only with a calibration of "
        "each electrode."
    ]


def _contrast_of_thesis(thesis: Thesis) -> float:
    """A over B of the centred rectangle at 0°; NaN when the rows are not there."""
    rows = {c.electrode: c.charge_pC for c in thesis.charges if c.case == "t41_r0"}
    return rows["A"] / rows["B"] if {"A", "B"} <= rows.keys() else math.nan


def _circuit_table(thesis: Thesis) -> Table:
    circuit, printed = thesis_circuit(thesis), thesis.parameters["circuit"]
    f = thesis.parameters["experiment"]["excitation_frequency"]["value"]
    X = printed["reactance_printed"]["value"]
    at = frequency_of(circuit, 1e6 * X)
    series, parallel = circuit.series_load(f), circuit.parallel_load(f)
    equal = 100.0 * (1.0 - abs(circuit.series_load(circuit.corner_frequency)))
    C, factor = printed["capacitance_theory"]["value"], printed["attenuation"]["value"]
    loss = printed["drop_if_RL_equals_XC"]["value"]
    rows: list[list[Cell]] = [
        ["capacitance of an electrode (pF)", C, 1e12 * circuit.capacitance],
        [f"reactance at {f:g} Hz (MΩ)", X, 1e-6 * circuit.reactance(f)],
        ["frequency of the printed reactance (Hz)", f, at],
        ["load in series: factor, printed reactance", factor, abs(circuit.series_load(at))],
        [f"load in series: factor at {f:g} Hz", None, abs(series)],
        [f"load in series: phase at {f:g} Hz (°)", None, math.degrees(phase(series))],
        ["load in parallel: factor, printed reactance", None, abs(circuit.parallel_load(at))],
        [f"load in parallel: factor at {f:g} Hz", None, abs(parallel)],
        [f"load in parallel: phase at {f:g} Hz (°)", None, math.degrees(phase(parallel))],
        ["loss if load and reactance are equal (%)", loss, equal],
        ["corner frequency (Hz)", None, circuit.corner_frequency],
        ["time constant (ms)", None, 1e3 * circuit.time_constant],
    ]
    columns = [
        Column("quantity", "quantity"),
        Column("thesis", "thesis", None),
        Column("ours", "ours", 3),
    ]
    return Table("circuit", "App. 5: the measuring circuit.", columns, rows)


def _circuit_picture(thesis: Thesis, path: Path) -> None:
    circuit, experiment = thesis_circuit(thesis), thesis.parameters["experiment"]
    f = np.geomspace(1.0, 200.0, 200)
    inks, ticks = COLOURS[: len(READINGS)], (1, 2, 5, 10, 20, 50, 100, 200)
    with style():
        figure = new_figure(160, 120)
        above, below = figure.subplots(2, sharex=True)
        for ax in (above, below):
            for key in ("excitation_frequency", "noise_limit_frequency"):
                ax.axvline(experiment[key]["value"], color=GREY, lw=0.8, ls=(0, (4, 3)))
        for ax, part in ((above, np.abs), (below, lambda z: np.degrees(np.angle(z)))):
            lines = [
                Series(name, f, part(np.array([reading(circuit, each) for each in f])))
                for name, reading in READINGS.items()
            ]
            for one, ink in zip(lines, inks, strict=True):
                ax.plot(one.x, one.y, color=ink)
            ax.set_xscale("log")
            ax.set_xticks(ticks, [str(tick) for tick in ticks])
            ax.set_xlim(1.0, 200.0)
            label_curves(ax, lines, inks)
        at = experiment["excitation_frequency"]["value"]
        printed = thesis.parameters["circuit"]["attenuation"]["value"]
        above.plot(at, printed, "o", mfc="none", mec=inks[1], mew=1.1)
        above.annotate("thesis", (at, printed), (5, 3), textcoords="offset points", size=LABEL_SIZE)
        above.set(ylabel="voltage over source voltage", ylim=(0.0, 1.05))
        below.set(ylabel="phase (°)", xlabel="frequency (Hz)", yticks=(-90, -45, 0, 45, 90))
        save(figure, path)


# ----------------------------------------------------------------------- dynamics and statics


def _rectangle() -> Scene:
    return thesis_scene("4", "rect14x7").with_(**{"numerics.observable": MATERIAL})


def _charge_scenes(thesis: Thesis) -> list[Scene]:
    return [_rectangle(), _rectangle().with_(probe=None)]


def _charge_parts(thesis: Thesis, results: Results, out: Path) -> Content:
    dynamics = _mode_table(thesis)
    return Content(
        [*_mode_texts(thesis, dynamics), *_static_texts(thesis, results)],
        [dynamics, _static_table(thesis, results)],
    )


def _mode_table(thesis: Thesis) -> Table:
    f = thesis.parameters["experiment"]["excitation_frequency"]["value"]
    printed = thesis.parameters["experiment"]["first_natural_frequency"]["value"]
    scene = _rectangle()
    states = (
        ("no force", scene, False, printed),
        ("about 1 N", scene, True, None),
        ("about 1 N, no cooling", scene.with_(**{"film.temperature_change_K": 0.0}), True, None),
    )
    rows: list[list[Cell]] = []
    for name, state, loaded, thesis_Hz in states:
        found = modes(state, count=1, loaded=loaded)
        done = found.status is Status.CONVERGED
        first = float(found.frequencies_Hz[0]) if done else math.nan
        factor = dynamic_factor(f, first) if done else math.nan
        rows.append([name, thesis_Hz, first, factor, str(found.status)])
    columns = [
        Column("state", "state of the film"),
        Column("thesis_Hz", "thesis (Hz)", None),
        Column("first_mode_Hz", "first mode (Hz)", 1),
        Column("dynamic_factor", f"dynamic factor at {f:g} Hz", 4),
        Column("status", "status"),
    ]
    caption = "First mode of vibration, the rectangle at the centre, and what it does to a charge."
    return Table("first_mode", caption, columns, rows)


def _mode_texts(thesis: Thesis, table: Table) -> list[str]:
    printed = thesis.parameters["experiment"]["first_natural_frequency"]["value"]
    first, factor = (float(cell) for cell in table.rows[0][2:4] if isinstance(cell, float))
    if math.isnan(first):
        return []
    return [
        f"The first natural frequency of {printed:g} Hz (6.1, item 6) is right for a film cooled "
        f"by 1 K: {first:.2f} Hz, which makes the response at 20 Hz {100 * (factor - 1):.1f} % "
        "larger than a static one. Item 8 says that the cooling could not be done, so the film "
        "tested did not have this tension. But the force itself stretches it, cooled or not: while "
        "the probe presses, the response is static for another reason than the thesis's. Tapes as "
        "heavy as the film (item 9) are not in these numbers."
    ]


def _static_charges(thesis: Thesis, results: Results) -> dict[str, float]:
    """Charges in pC of A: at 1 N, at rest, and per kelvin by the pyroelectric effect."""
    pressed, rest = (results[scene].charge_pC("A") for scene in _charge_scenes(thesis))
    film, geometry = thesis.parameters["film"]["biaxial"], thesis.parameters["geometry"]
    pyro = film["pyro_p3"]["value"] * geometry["electrode_area"]["value"]  # µC/(m² K) · mm² = pC/K
    return {
        "charge of A, rectangle at the centre, 1 N": pressed,
        "of it at rest, from the pretension": rest,
        "pyroelectric charge of 1 K": pyro,
    }


def _static_table(thesis: Thesis, results: Results) -> Table:
    charges = _static_charges(thesis, results)
    whole = next(iter(charges.values()))
    rows: list[list[Cell]] = [[k, v, 100.0 * v / whole] for k, v in charges.items()]
    columns = [Column("part", "part"), Column("charge_pC", "charge (pC)")]
    columns.append(Column("share_percent", "share of the charge at 1 N (%)"))
    return Table("static_charges", "Parts of a charge that a measurement lacks.", columns, rows)


def _static_texts(thesis: Thesis, results: Results) -> list[str]:
    whole, rest, pyro = _static_charges(thesis, results).values()
    limit = thesis.parameters["loading"]["material_linearity_limit"]["value"]
    area = thesis.parameters["geometry"]["electrode_area"]["value"]
    d31 = thesis.parameters["film"]["biaxial"]["d31"]["value"]
    texts = [] if math.isnan(rest / whole) else _lacking_texts(whole, rest, pyro)
    largest = max(thesis.from_("Table 4.5"), key=lambda c: c.charge_pC, default=None)
    if largest is not None:
        stress = largest.charge_pC / d31 / area  # pC / (pC/N · mm²) = MPa
        texts.append(
            f"Section 2.1.4 limits the film's linearity to {limit:g} MPa. The charge of "
            f"{largest.charge_pC:.1f} pC at {largest.force_N:g} N means σx + σy = {stress:.1f} "
            "MPa at the electrode, and more below the probe."
        )
    return texts


def _lacking_texts(whole: float, rest: float, pyro: float) -> list[str]:
    return [
        f"The simulated charges contain {rest:.1f} pC of the pretension, {100 * rest / whole:.0f} "
        "% at 1 N, which no measurement at 20 Hz sees. The film can only be pushed, but the "
        "preload of the sine of 1 N is not given, nor whether 1 N is its peak or its whole swing; "
        "and as charges grow with a power of the force of about 2/3, a sine of force is not a "
        "sine of charge.",
        "The pyroelectric effect is ignored in all simulations (6.1, item 15). With the "
        f"coefficient of App. 1 it is {pyro:.0f} pC per kelvin, {100 * pyro / whole:.0f} % of the "
        "charge at 1 N. The cooling by 1 K that makes the pretension would itself give this.",
    ]


MEASURED_POSITIONS_PART = Part(
    "measured-positions",
    "Tables 5.1 and 5.2: measured positions",
    ("Table 5.1", "Table 5.2"),
    lambda thesis: [],
    _measured_positions,
)
CIRCUIT_PART = Part(
    "circuit",
    "Appendix 5: the measuring circuit",
    ("Fig. App5-1", "Fig. App5-2", "Fig. App5-3"),
    lambda thesis: [],
    _circuit,
)
CHARGE_PARTS_PART = Part(
    "charge-parts",
    "Section 6.1: resonance, and what a measurement lacks",
    (),
    _charge_scenes,
    _charge_parts,
)

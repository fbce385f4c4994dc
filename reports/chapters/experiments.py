"""Chapters of the thesis report: chapter 5, section 6.1 and appendix 5, the experiments.

The chapters show what the printed measurements say by themselves, the measuring circuit, the
film's resonance, and the parts of a charge that only a simulation or only a measurement contains.
"""

from __future__ import annotations

import math
from cmath import phase
from collections.abc import Callable
from pathlib import Path

import numpy as np

from pvdf_fem import Scene, solve
from pvdf_fem.dynamics.modes import modes
from pvdf_fem.output.figures import COLOURS, GREY, LABEL_SIZE
from pvdf_fem.readout.channel import electrode_capacitance
from pvdf_fem.scene.scene import Numerics
from pvdf_fem.solvers.status import Status
from reports.common.chapter import Chapter, Content
from reports.common.charge_figures import Series, label_curves
from reports.common.figures import LEVEL_DASHES, drawing
from reports.common.page import Cell, Column, Picture, Table
from reports.common.results import MATERIAL, Results
from reports.common.thesis_data import SHAPES, Position, Thesis
from reports.common.thesis_scene import scene_of, thesis_scene
from reports.thesis_methods.circuit import Circuit, dynamic_factor, voltage_ratio

#: Both readings of the voltage divider of App. 5, named by the place of the load resistance.
READINGS: dict[str, Callable[[Circuit, float], complex]] = {
    "load in parallel": Circuit.parallel_load,
    "load in series": Circuit.series_load,
}


# ------------------------------------------------------------------------- measured positions


def _measured_positions(thesis: Thesis, results: Results, out: Path) -> Content:
    measured = [position for position in thesis.positions if position.kind == "experimental"]
    simulated = [position for position in thesis.positions if position.kind == "simulated"]
    rows: list[list[Cell]] = [
        _position_row(position, _same_place(position, simulated)) for position in measured
    ]
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
    """The simulation of the same probe and place with three electrodes on the biaxial film."""
    key = (measured.probe, measured.x_mm, measured.y_mm, measured.rotation_deg)
    for position in simulated:
        same = (position.probe, position.x_mm, position.y_mm, position.rotation_deg) == key
        if (
            same
            and position.film == "biaxial"
            and position.force_N == measured.force_N
            and position.layout == "3"
        ):
            return position
    return None


def _position_row(measured: Position, simulated: Position | None) -> list[Cell]:
    cells: list[Cell] = [
        measured.case,
        f"{SHAPES[measured.probe]}, {measured.position}",
        measured.error_mm,
    ]
    if simulated is None:
        return [*cells, None, None, None]
    error = simulated.error_mm
    return [*cells, simulated.case, error, measured.error_mm / error]


def _error_texts(thesis: Thesis, measured: list[Position], simulated: list[Position]) -> list[str]:
    errors = np.array([position.error_mm for position in measured])
    finite = errors[np.isfinite(errors)]
    large = [position for position in simulated if position.error_mm > 1.0]
    failed = [position for position in simulated if math.isnan(position.error_mm)]
    films = ", ".join(sorted({position.film for position in large}))
    texts = []
    if large or failed:
        texts.append(
            "Sections 5.3.1 and 5.3.2 call all theoretical errors smaller than 1 mm. Of "
            f"{len(simulated)} simulated positions {len(large)} are larger (film: {films}; up to "
            f"{max((position.error_mm for position in large), default=math.nan):g} mm), and "
            f"{len(failed)} are printed as not intersecting."
        )
    if finite.size:
        placement = thesis.parameters["experiment"]["probe_placement_error"]["value"]
        stated = thesis.parameters["experiment"]["theory_experiment_discrepancy"]["value"]
        texts.append(
            f"Section 5.4 gives a mean discrepancy of {stated:g} % between theory and experiment, "
            "without a rule; the last column shows no such number. The mean of the "
            f"{finite.size} measured errors is {finite.mean():.3f} mm."
        )
        texts.append(
            f"Section 6.1 admits that the probe is placed with an error of {placement:g} mm or "
            f"more. {int((finite < placement).sum())} of the {finite.size} measured errors are "
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
    """The circuit of an electrode of the thesis with its load."""
    geometry, film = thesis.parameters["geometry"], thesis.parameters["film"]["biaxial"]
    capacitance = electrode_capacitance(
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
    excitation_Hz = thesis.parameters["experiment"]["excitation_frequency"]["value"]
    reactance = printed["reactance_printed"]["value"]
    printed_at_Hz = frequency_of(circuit, 1e6 * reactance)
    capacitance_pF = 1e12 * circuit.capacitance * printed_at_Hz / excitation_Hz
    frequencies = (thesis.parameters["experiment"]["noise_limit_frequency"]["value"], 5.0, 2.0)
    series, parallel = (
        ", ".join(f"{abs(reading(circuit, frequency)):.2f}" for frequency in frequencies)
        for reading in (Circuit.series_load, Circuit.parallel_load)
    )
    listed = ", ".join(f"{frequency:g}" for frequency in frequencies)
    return [
        f"The reactance printed for {excitation_Hz:g} Hz, {reactance} MΩ, is not that of "
        f"{1e12 * circuit.capacitance:.3f} pF, which has "
        f"{1e-6 * circuit.reactance(excitation_Hz):.2f} MΩ. It belongs to {printed_at_Hz:.2f} Hz, "
        f"or to {capacitance_pF:.2f} pF. The factor {printed['attenuation']['value']} follows from "
        "the printed reactance; with the right one the same formula gives "
        f"{abs(circuit.series_load(excitation_Hz)):.3f}.",
        "The formula is that of a load in series with the source, the voltage taken across the "
        "film's capacitance: a low pass. An amplifier's input resistance loads the source in "
        f"parallel, which is a high pass: {abs(circuit.parallel_load(excitation_Hz)):.3f} at "
        f"{excitation_Hz:g} Hz. The observations of the thesis agree with the latter: at {listed} "
        f"Hz the parallel load passes {parallel}, the series load {series}, so that only the "
        "former loses the signal at low frequencies.",
        "That the resistance should be as low as possible (6.1, item 13) follows from the series "
        "formula. For a parallel load the opposite is true: the voltage tends to zero with it. "
        f"The time constant, {1e3 * circuit.time_constant:.1f} ms, is also the fraction of a "
        "second within which a static charge is lost (6.1, item 1).",
    ]


def _capacitance_texts(thesis: Thesis) -> list[str]:
    circuit, printed = thesis_circuit(thesis), thesis.parameters["circuit"]
    excitation_Hz = thesis.parameters["experiment"]["excitation_frequency"]["value"]
    measured = printed["capacitance_measured_two_electrodes"]["value"]
    measured_circuit = Circuit(1e-12 * measured, circuit.load_resistance)
    deficit_percent = 100.0 * (1.0 - measured_circuit.capacitance / circuit.capacitance)
    open_, loaded = (
        voltage_ratio(measured_circuit, circuit),
        voltage_ratio(measured_circuit, circuit, excitation_Hz),
    )
    ratio = _contrast_of_thesis(thesis)
    against = (
        f", against {100 * (ratio - 1):.1f} % between A and B in Table 4.1 at 0°"
        if math.isfinite(ratio)
        else ""
    )
    return [
        f"Two electrodes have {measured:g} pF, {deficit_percent:.1f} % less than theory (6.1 says "
        f"{printed['capacitance_deficit_stated']['value']:g} %, App. 5 calls all four close to "
        f"it). For equal charges their voltages are {100 * (open_ - 1):.0f} % higher on an open "
        f"circuit, and {100 * (loaded - 1):.0f} % at {excitation_Hz:g} Hz with the load in "
        f"parallel{against}. The statement that charge or voltage makes no difference (5.3.1) "
        "holds only if each electrode is calibrated."
    ]


def _contrast_of_thesis(thesis: Thesis) -> float:
    """Charge of A over that of B for the centred rectangle at 0°; NaN without these rows."""
    rows = {
        charge.electrode: charge.charge_pC for charge in thesis.charges if charge.case == "t41_r0"
    }
    return rows["A"] / rows["B"] if {"A", "B"} <= rows.keys() else math.nan


def _circuit_table(thesis: Thesis) -> Table:
    circuit, printed = thesis_circuit(thesis), thesis.parameters["circuit"]
    excitation_Hz = thesis.parameters["experiment"]["excitation_frequency"]["value"]
    reactance = printed["reactance_printed"]["value"]
    printed_at_Hz = frequency_of(circuit, 1e6 * reactance)
    equal = 100.0 * (1.0 - abs(circuit.series_load(circuit.corner_frequency)))
    capacitance = printed["capacitance_theory"]["value"]
    printed_factor, at_f = printed["attenuation"]["value"], f"{excitation_Hz:g} Hz"
    loss = printed["drop_if_RL_equals_XC"]["value"]
    rows: list[list[Cell]] = [
        ["capacitance of an electrode (pF)", capacitance, 1e12 * circuit.capacitance],
        [f"reactance at {at_f} (MΩ)", reactance, 1e-6 * circuit.reactance(excitation_Hz)],
        ["frequency of the printed reactance (Hz)", excitation_Hz, printed_at_Hz],
    ]
    for reading, factor in (("load in series", printed_factor), ("load in parallel", None)):
        ratio = READINGS[reading]
        exact = ratio(circuit, excitation_Hz)
        rows += [
            [f"{reading}: factor, printed reactance", factor, abs(ratio(circuit, printed_at_Hz))],
            [f"{reading}: factor at {at_f}", None, abs(exact)],
            [f"{reading}: phase at {at_f} (°)", None, math.degrees(phase(exact))],
        ]
    rows += [
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
    frequencies = np.geomspace(1.0, 200.0, 200)
    inks, ticks = COLOURS[: len(READINGS)], (1, 2, 5, 10, 20, 50, 100, 200)
    with drawing(path, 160, 120) as figure:
        above, below = figure.subplots(2, sharex=True)
        for ax in (above, below):
            for key in ("excitation_frequency", "noise_limit_frequency"):
                ax.axvline(experiment[key]["value"], color=GREY, lw=0.8, ls=LEVEL_DASHES)
        for ax, quantity in ((above, np.abs), (below, lambda z: np.degrees(np.angle(z)))):
            lines = [
                Series(
                    name,
                    frequencies,
                    quantity(np.array([reading(circuit, frequency) for frequency in frequencies])),
                )
                for name, reading in READINGS.items()
            ]
            for line, ink in zip(lines, inks, strict=True):
                ax.plot(line.x, line.y, color=ink)
            ax.set_xscale("log")
            ax.set_xticks(ticks, [str(tick) for tick in ticks])
            ax.set_xlim(1.0, 200.0)
            label_curves(ax, lines, inks)
        excitation_Hz = experiment["excitation_frequency"]["value"]
        printed = thesis.parameters["circuit"]["attenuation"]["value"]
        above.plot(excitation_Hz, printed, "o", mfc="none", mec=inks[1], mew=1.1)
        above.annotate(
            "thesis", (excitation_Hz, printed), (5, 3), textcoords="offset points", size=LABEL_SIZE
        )
        above.set(ylabel="voltage over source voltage", ylim=(0.0, 1.05))
        below.set(ylabel="phase (°)", xlabel="frequency (Hz)", yticks=(-90, -45, 0, 45, 90))


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
    excitation_Hz = thesis.parameters["experiment"]["excitation_frequency"]["value"]
    printed = thesis.parameters["experiment"]["first_natural_frequency"]["value"]
    scene = _rectangle()
    states = (
        ("no force", scene, False, printed),
        ("about 1 N", scene, True, None),
        ("about 1 N, no cooling", scene.with_(**{"film.temperature_change_K": 0.0}), True, None),
    )
    rows: list[list[Cell]] = []
    for name, scene_of_state, loaded, thesis_Hz in states:
        result = modes(scene_of_state.with_(air={"baffle": True}), count=1, loaded=loaded)
        row: list[Cell] = [name, thesis_Hz]
        converged = result.status is Status.CONVERGED
        in_air_Hz = result.frequencies_in_air_Hz if converged else None
        for found in (result.frequencies_Hz if converged else None, in_air_Hz):
            first_Hz = math.nan if found is None else float(found[0])
            row += [
                first_Hz,
                math.nan if found is None else dynamic_factor(excitation_Hz, first_Hz),
            ]
        rows.append([*row, str(result.status)])
    columns = [
        Column("state", "state of the film"),
        Column("thesis_Hz", "thesis (Hz)", None),
        Column("first_mode_Hz", "first mode (Hz)", 1, "vacuum"),
        Column("dynamic_factor", f"dynamic factor at {excitation_Hz:g} Hz", 4, "vacuum"),
        Column("first_mode_in_air_Hz", "first mode (Hz)", 1, "air"),
        Column("dynamic_factor_in_air", f"dynamic factor at {excitation_Hz:g} Hz", 4, "air"),
        Column("status", "status"),
    ]
    caption = "First mode of vibration, the rectangle at the centre, and what it does to a charge."
    return Table("first_mode", caption, columns, rows)


def _mode_texts(thesis: Thesis, table: Table) -> list[str]:
    printed = thesis.parameters["experiment"]["first_natural_frequency"]["value"]
    cells = [cell if isinstance(cell, float) else math.nan for cell in table.rows[0][2:6]]
    first, factor, first_in_air, factor_in_air = cells
    if math.isnan(first):
        return []
    return [
        f"The first natural frequency of {printed:g} Hz (6.1, item 6) is right for a film cooled "
        f"by 1 K in a vacuum: {first:.2f} Hz, which makes the response at 20 Hz "
        f"{100 * (factor - 1):.1f} % larger than a static one. But the air that moves with the "
        "film is heavier than the film itself. In air, in a rigid baffle, it is "
        f"{first_in_air:.1f} Hz and {100 * (factor_in_air - 1):.1f} %. Item 8 says that the "
        "cooling could not be done, so the film tested did not have this tension. But the force "
        "itself stretches it, cooled or not: while the probe presses, the response is static for "
        "another reason than the thesis's. Tapes as heavy as the film (item 9) are not in these "
        "numbers."
    ]


def _static_charges(thesis: Thesis, results: Results) -> dict[str, float]:
    """Charges of A in pC: at 1 N, at rest, and by the pyroelectric effect of 1 K."""
    pressed, at_rest = (results[scene].charge_pC("A") for scene in _charge_scenes(thesis))
    film, geometry = thesis.parameters["film"]["biaxial"], thesis.parameters["geometry"]
    pyro = film["pyro_p3"]["value"] * geometry["electrode_area"]["value"]  # µC/(m² K) · mm² = pC/K
    return {
        "charge of A, rectangle at the centre, 1 N": pressed,
        "of it at rest, from the pretension": at_rest,
        "pyroelectric charge of 1 K": pyro,
    }


def _static_table(thesis: Thesis, results: Results) -> Table:
    charges = _static_charges(thesis, results)
    whole = next(iter(charges.values()))
    rows: list[list[Cell]] = [
        [name, charge, 100.0 * charge / whole] for name, charge in charges.items()
    ]
    columns = [Column("part", "part"), Column("charge_pC", "charge (pC)")]
    columns.append(Column("share_percent", "share of the charge at 1 N (%)"))
    return Table("static_charges", "Parts of a charge that a measurement lacks.", columns, rows)


def _static_texts(thesis: Thesis, results: Results) -> list[str]:
    whole, at_rest, pyro = _static_charges(thesis, results).values()
    limit = thesis.parameters["loading"]["material_linearity_limit"]["value"]
    area = thesis.parameters["geometry"]["electrode_area"]["value"]
    d31 = thesis.parameters["film"]["biaxial"]["d31"]["value"]
    texts = [] if math.isnan(at_rest / whole) else _lacking_texts(whole, at_rest, pyro)
    largest = max(thesis.from_("Table 4.5"), key=lambda charge: charge.charge_pC, default=None)
    if largest is not None:
        mean_MPa = 0.5 * largest.charge_pC / d31 / area  # pC / (pC/N · mm²) = MPa
        largest_MPa = largest_stress_MPa(scene_of(largest))
        texts.append(
            f"Section 2.1.4 takes the film as linear up to a stress of {limit:g} MPa in one "
            f"direction. At {largest.force_N:g} N the charge of {largest.charge_pC:.1f} pC means "
            f"{mean_MPa:.1f} MPa at the electrode, the mean of σx and σy, and the largest "
            f"principal stress of the film is {largest_MPa:.1f} MPa here: "
            f"{100.0 * mean_MPa / limit:.0f} and {100.0 * largest_MPa / limit:.0f} % of the limit."
        )
    return texts


def largest_stress_MPa(scene: Scene, pitch_mm: float = 0.25, reach_mm: float = 15.0) -> float:
    """Largest principal stress on a raster up to `reach_mm` from the centre; NaN if unsolved."""
    solution = solve(scene.with_(numerics=Numerics()))
    if solution.status is not Status.CONVERGED:
        return math.nan
    raster = np.arange(-reach_mm, reach_mm + 1e-9, pitch_mm)
    stress = solution.at(*np.meshgrid(raster, raster)).stress_MPa
    s11, s22, s12 = np.moveaxis(stress, -1, 0)
    return float((0.5 * (s11 + s22) + np.hypot(0.5 * (s11 - s22), s12)).max())


def _lacking_texts(whole: float, at_rest: float, pyro: float) -> list[str]:
    return [
        f"The simulated charges contain {at_rest:.1f} pC of the pretension, "
        f"{100 * at_rest / whole:.0f} % at 1 N, which no measurement at 20 Hz sees. The film can "
        "only be pushed, but the preload of the sine of 1 N is not given, nor whether 1 N is its "
        "peak or its whole swing; and as charges grow with a power of the force of about 2/3, a "
        "sine of force is not a sine of charge.",
        "The pyroelectric effect is ignored in all simulations (6.1, item 15). With the "
        f"coefficient of App. 1 it is {pyro:.0f} pC per kelvin, {100 * pyro / whole:.0f} % of the "
        "charge at 1 N. The cooling by 1 K that makes the pretension would itself give this.",
    ]


MEASURED_POSITIONS_CHAPTER = Chapter(
    "measured-positions",
    "Tables 5.1 and 5.2: measured positions",
    ("Table 5.1", "Table 5.2"),
    lambda thesis: [],
    _measured_positions,
)
CIRCUIT_CHAPTER = Chapter(
    "circuit",
    "Appendix 5: the measuring circuit",
    ("Fig. App5-1", "Fig. App5-2", "Fig. App5-3"),
    lambda thesis: [],
    _circuit,
)
CHARGE_PARTS_CHAPTER = Chapter(
    "charge-parts",
    "Section 6.1: resonance, and what a measurement lacks",
    (),
    _charge_scenes,
    _charge_parts,
)

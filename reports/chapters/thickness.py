"""Chapter of the thesis report: charge against force for films of three thicknesses (3.4.3)."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from pvdf_fem import Scene
from pvdf_fem.output.figures import COLOURS, GREY
from reports.chapters.force_and_angle.force_law import finite, law_through
from reports.common.chapter import Chapter, Content
from reports.common.charge_figures import Dashed, Series, charge_against_force
from reports.common.figures import drawing
from reports.common.page import Cell, Column, Picture, Table, joined
from reports.common.results import THESIS_EDGE, Results
from reports.common.thesis_data import Thesis
from reports.common.thesis_scene import thesis_scene
from reports.thesis_methods.force_law import linearity, local_exponents

Array = NDArray[np.float64]

#: Thickness in µm of the film of each of Figs. 3.23 to 3.25.
THICKNESSES_UM = {"3.23": 25.0, "3.24": 110.0, "3.25": 1000.0}
#: Place of the triangle in mm: 4 mm from A at 60°.
PLACE_MM = (4.0 * math.cos(math.pi / 3), 4.0 * math.sin(math.pi / 3) - 10.0)


def _thickness_forces(thesis: Thesis) -> list[float]:
    """The forces of Table 3.4, since those of the three figures are not printed."""
    return sorted({charge.force_N for charge in thesis.from_("Table 3.4")})


def _film(thickness_um: float, force_N: float) -> Scene:
    x_mm, y_mm = PLACE_MM
    scene = thesis_scene("3", "tri7", x_mm=x_mm, y_mm=y_mm, force_N=force_N)
    return scene.with_(**{"film.thickness_um": thickness_um})


def _thickness_scenes(thesis: Thesis) -> list[Scene]:
    forces = _thickness_forces(thesis)
    films = [
        _film(thickness, force_N) for thickness in THICKNESSES_UM.values() for force_N in forces
    ]
    return films + [as_plate(film) for film in films]


def as_plate(scene: Scene) -> Scene:
    """The scene of a film that also resists bending."""
    return scene.with_(**{"film.bending": True})


def _thickness(thesis: Thesis, results: Results, out: Path) -> Content:
    forces = np.array(_thickness_forces(thesis))
    membranes, plates = (
        {
            thickness: [
                Series(e, forces, _charges(results, thickness, forces, e, bending=bending))
                for e in "ABC"
            ]
            for thickness in THICKNESSES_UM.values()
        }
        for bending in (False, True)
    )
    printed = [
        Series(electrode, forces, thesis.polynomials[f"3.4.3_{electrode}"](forces))
        for electrode in "ABC"
    ]
    _thickness_picture(plates, membranes, printed, out / "figure_3_23.svg")
    return Content(
        [*_thickness_text(plates, membranes, printed), *_bending_text(membranes, plates)],
        [
            Picture(
                "figure_3_23.svg",
                "Figs. 3.23, 3.24 and 3.25: charge against force for films of 25, 110 and "
                "1000 µm, which resist bending, the triangle 4 mm from A at 60°. Rings: the "
                "equations that section 3.4.3 prints for the 1 mm film, drawn over the 25 µm film "
                "too. Dashed: the 1 mm film if it were a membrane, without resistance to bending. "
                "Last: A over force per thickness, on which alone the charge of a membrane "
                "depends.",
            ),
            _thickness_table(plates, printed),
            _bending_table(membranes, plates),
        ],
    )


def _charges(
    results: Results, thickness_um: float, forces: Array, electrode: str, *, bending: bool
) -> Array:
    scenes = [_film(thickness_um, float(force_N)) for force_N in forces]
    records = [results[as_plate(scene) if bending else scene] for scene in scenes]
    return np.array([record.charge_pC(electrode, THESIS_EDGE) for record in records])


def _thickness_picture(
    plates: dict[float, list[Series]],
    membranes: dict[float, list[Series]],
    printed: list[Series],
    path: Path,
) -> None:
    with drawing(path, 180, 165) as figure:
        axes = figure.subplots(2, 2).flat
        for ax, (number, thickness) in zip(axes, THICKNESSES_UM.items(), strict=False):
            shown = [] if number == "3.24" else printed
            dashed = Dashed("as a membrane", membranes[thickness]) if number == "3.25" else None
            charge_against_force(ax, plates[thickness], shown, others="“1 mm” eq.", dashed=dashed)
            ax.set_title(f"Fig. {number}: {thickness:g} µm", pad=17 if shown else None)
        _scaled_by_thickness(axes[3], plates, membranes)


def _scaled_by_thickness(
    ax: Axes, plates: dict[float, list[Series]], membranes: dict[float, list[Series]]
) -> None:
    """Charges of A over F/h in logarithmic scales, with one law through those of all membranes."""
    ax.set(xlabel="force / thickness (N/mm)", ylabel="charge of A (pC)")
    ax.set_title("A, all three films")
    loads = np.concatenate([1e3 * Q[0].x / thickness for thickness, Q in membranes.items()])
    law = law_through(loads, np.concatenate([curves[0].y for curves in membranes.values()]))
    if law is None:
        return
    x = np.geomspace(loads.min() / 2, 1.5 * loads.max(), 100)
    ax.loglog(x, law.charge_pC(x), color=GREY, linewidth=1.0, label="membrane law")
    for (thickness, curves), marker, ink in zip(plates.items(), "so^", COLOURS, strict=False):
        ax.plot(
            1e3 * curves[0].x / thickness, curves[0].y, marker, color=ink, label=f"{thickness:g} µm"
        )
    ax.legend(loc="upper left")


def _thickness_table(ours: dict[float, list[Series]], printed: list[Series]) -> Table:
    forces = printed[0].x
    columns = [Column("thickness_um", "film (µm)", 0), Column("electrode", "electrode")]
    columns += [Column(f"ours_{F:g}_N_pC", f"{F:g} N", 1, "ours (pC)") for F in forces]
    columns += [
        Column(f"printed_over_ours_{F:g}_N", f"{F:g} N", 2, "“1 mm” equation / ours")
        for F in forces
    ]
    columns += [
        Column("exponent_first", "first", 2, "d ln Q / d ln F"),
        Column("exponent_last", "last", 2, "d ln Q / d ln F"),
        Column("deviation_percent", "off a line (%)", 1),
    ]
    rows: list[list[Cell]] = []
    for thickness, curves in ours.items():
        for curve, equation in zip(curves, printed, strict=True):
            row: list[Cell] = [
                thickness,
                curve.label,
                *curve.y.tolist(),
                *(equation.y / curve.y).tolist(),
            ]
            rows.append([*row, *_straightness(curve)])
    return Table(
        "figures_3_23_to_3_25",
        "Figs. 3.23 to 3.25: charges with bending, the equations printed for 1 mm over ours, first "
        "and last local exponent, and the largest distance from the best straight line in percent "
        "of the charges' span.",
        columns,
        rows,
    )


def _bending_table(
    membranes: dict[float, list[Series]], plates: dict[float, list[Series]]
) -> Table:
    forces = next(iter(membranes.values()))[0].x
    columns = [Column("thickness_um", "film (µm)", 0), Column("electrode", "electrode")]
    columns += [Column(f"bent_{F:g}_N_pC", f"{F:g} N", 1, "with bending (pC)") for F in forces]
    columns += [
        Column(f"change_{F:g}_N_percent", f"{F:g} N", 2, "change by bending (%)") for F in forces
    ]
    rows: list[list[Cell]] = [
        [thickness, curve.label, *stiff.y.tolist(), *(100.0 * (stiff.y / curve.y - 1.0)).tolist()]
        for thickness in membranes
        for curve, stiff in zip(membranes[thickness], plates[thickness], strict=True)
    ]
    return Table(
        "bending_by_thickness",
        "The same films as von Kármán plates: charges, and how much bending changes them.",
        columns,
        rows,
    )


def _bending_text(
    membranes: dict[float, list[Series]], plates: dict[float, list[Series]]
) -> list[str]:
    changes = {
        thickness: np.concatenate(
            [
                with_bending.y / without.y - 1.0
                for with_bending, without in zip(
                    plates[thickness], membranes[thickness], strict=True
                )
            ]
        )
        for thickness in membranes
    }
    if not all(np.isfinite(change).all() and change.size for change in changes.values()):
        return []
    ranges = [
        f"between {100.0 * change.min():.2g} and {100.0 * change.max():.2g} % for {thickness:g} µm"
        for thickness, change in changes.items()
    ]
    return [
        "With bending in the model (the last table), the charges change by "
        f"{joined(ranges)}: the 25 µm film is a membrane, the "
        "110 µm film nearly, and the 1 mm film a plate, whose charges hardly leave those of its "
        "pretension."
    ]


def _straightness(curve: Series) -> list[Cell]:
    F, Q = finite(curve)
    if len(F) < 3:
        return [None] * 3
    _, exponents = local_exponents(F, Q)
    return [
        float(exponents[0]),
        float(exponents[-1]),
        100.0 * linearity(F, Q, float(F[-1])).deviation,
    ]


def _thickness_text(
    plates: dict[float, list[Series]], membranes: dict[float, list[Series]], printed: list[Series]
) -> list[str]:
    thin, thick, thick_membrane = (
        np.concatenate(
            [equation.y / curve.y for equation, curve in zip(printed, curves, strict=True)]
        )
        for curves in (plates[25.0], plates[1000.0], membranes[1000.0])
    )
    if not np.isfinite([*thin, *thick, *thick_membrane]).all() or not thin.size:
        return ["Not all charges could be computed."]
    signal = [
        float(np.max([curve.y[-1] for curve in plates[thickness]])) for thickness in (25.0, 1000.0)
    ]
    return [
        "Section 3.4.3 prints three cubics for the 1 mm film and takes them as evidence that "
        "thickness makes the sensor more linear. They are those of the 25 µm film: they give "
        f"{thin.min():.3f} to {thin.max():.3f} times our charges of that film, and "
        f"{thick.min():.0f} to {thick.max():.0f} times those of the 1 mm film. That one is a "
        "plate; if it were a membrane, the factors would still be "
        f"{thick_membrane.min():.1f} to {thick_membrane.max():.1f}.",
        "A thicker film does give a straighter curve, but only because the pretension's constant "
        "charge takes over: the largest charge at "
        f"{printed[0].x[-1]:g} N is {signal[1]:.0f} pC instead of {signal[0]:.0f} pC, and the "
        "local exponents move away from 1, not towards it. The mean stress is even in the "
        "deflection, so the charge begins as a constant plus a multiple of F² whatever carries "
        "the load.",
    ]


THICKNESS_CHAPTER = Chapter(
    "force-thickness",
    "Section 3.4.3: charge against force for three thicknesses",
    ("Fig. 3.23", "Fig. 3.24", "Fig. 3.25"),
    _thickness_scenes,
    _thickness,
)

"""Chapter of the thesis report: the aluminium probe of the experiments instead of a pressure.

The thesis's simulations press with a uniform pressure, its experiments with a flat aluminium probe.
A rigid punch on which the film slides, and one that sticks to it, bound the effect on the charges.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from pvdf_fem import Scene
from reports.common.chapter import Chapter, Content
from reports.common.charge_figures import Series, charge_against_rotation
from reports.common.figures import drawing
from reports.common.page import Cell, Column, Picture, Table
from reports.common.results import MATERIAL, THESIS_EDGE, Results
from reports.common.thesis_data import Thesis
from reports.common.thesis_scene import thesis_scene

#: Rotation in degrees at which a corner of the rectangle points at electrode A.
CORNER_DEG = math.degrees(math.atan2(7.0, 14.0))
#: Ways to press, each with the changes of a scene of the thesis.
CONTACTS: dict[str, dict[str, Any]] = {
    "pressure": {},
    "sliding": {"load.kind": "rigid", "load.contact": "sliding"},
    "stuck": {"load.kind": "rigid", "load.contact": "stuck"},
}


def rotations_deg(thesis: Thesis) -> list[float]:
    """Rotations of Table 4.1 up to 90°, and the two at which a corner points at A or B.

    The latter are left out of a quick report, which has no rotation between 0 and 90°.
    """
    printed = {
        charge.rotation_deg for charge in thesis.from_("Table 4.1") if charge.rotation_deg <= 90.0
    }
    between = any(0.0 < rotation < 90.0 for rotation in printed)
    return sorted(printed | ({CORNER_DEG, 90.0 - CORNER_DEG} if between else set()))


def _every_degree(rotations: list[float]) -> list[float]:
    """Rotations of the curves, which symmetry makes one solve; none in a quick report."""
    return [float(angle) for angle in range(91)] if len(rotations) > 2 else []


def rectangle(rotation_deg: float, contact: str) -> Scene:
    """The rectangle at the centre; under pressure it is the scene of Table 4.1."""
    return pressed(thesis_scene("4", "rect14x7", rotation_deg=rotation_deg), contact)


def triangle(contact: str) -> Scene:
    """The triangle of section 3.1.2, 12 mm from D at 65°."""
    return pressed(thesis_scene("4", "tri7", x_mm=5.0714, y_mm=0.8757), contact)


def pressed(scene: Scene, contact: str) -> Scene:
    """A scene of the thesis with one of the `CONTACTS` instead of its pressure."""
    changes = CONTACTS[contact]
    return scene.with_(**changes, **{"numerics.observable": MATERIAL}) if changes else scene


def _scenes(thesis: Thesis) -> list[Scene]:
    rotations = rotations_deg(thesis)
    shown = [*rotations, *(_every_degree(rotations))]
    turned = [rectangle(rotation, contact) for contact in CONTACTS for rotation in shown]
    return turned + [triangle(contact) for contact in CONTACTS if len(rotations) > 2]


def _compose(thesis: Thesis, results: Results, out: Path) -> Content:
    rotations = rotations_deg(thesis)
    if not rotations:
        return Content([], [])
    curves = {
        (contact, electrode): _curve(rotations, contact, electrode, results)
        for contact in CONTACTS
        for electrode in "AB"
    }
    fine = {
        (contact, electrode): _curve(
            _every_degree(rotations) or rotations, contact, electrode, results
        )
        for contact, electrode in curves
    }
    _picture(thesis, curves, fine, out / "contact.svg")
    caption = (
        "Charge of A and B against rotation of the rectangle at the centre, 1 N (as Fig. 4.3), for "
        "three ways to press; rings: Table 4.1. All charges of this work are the material's."
    )
    blocks: list[Table | Picture] = [Picture("contact.svg", caption), _table(thesis, curves)]
    blocks += [_triangle_table(results)] if len(rotations) > 2 else []
    return Content(_texts(thesis, results, curves), blocks)


def _curve(rotations: list[float], contact: str, electrode: str, results: Results) -> Series:
    charges = [
        results[rectangle(rotation, contact)].charge_pC(electrode, MATERIAL)
        for rotation in rotations
    ]
    label = contact if contact == "pressure" else f"rigid, {contact}"
    return Series(label, np.array(rotations), np.array(charges))


def _picture(
    thesis: Thesis,
    curves: dict[tuple[str, str], Series],
    fine: dict[tuple[str, str], Series],
    path: Path,
) -> None:
    with drawing(path, 160, 140) as figure:
        axes = figure.subplots(2, sharex=True)
        for ax, electrode in zip(axes, "AB", strict=True):
            ours = [curves[contact, electrode] for contact in CONTACTS]
            rows = [charge for charge in thesis.from_("Table 4.1") if charge.electrode == electrode]
            rows = [charge for charge in rows if charge.rotation_deg <= 90.0]
            x, y = (
                np.array([getattr(charge, key) for charge in rows])
                for key in ("rotation_deg", "charge_pC")
            )
            smooth = [fine[contact, electrode] for contact in CONTACTS]
            charge_against_rotation(ax, ours, [Series(ours[0].label, x, y)], between=smooth)
            ax.set_ylabel(f"charge of {electrode} (pC)")
        axes[0].set_xlabel("")


def _table(thesis: Thesis, curves: dict[tuple[str, str], Series]) -> Table:
    columns = [Column("rotation_deg", "rotation (°)", 1)]
    for name in ("thesis", *CONTACTS):
        group = {"thesis": "thesis", "pressure": "pressure"}.get(name, f"rigid probe, {name}")
        columns += [
            Column(f"{name}_{electrode}_pC", f"{electrode} (pC)", 1, group) for electrode in "AB"
        ]
        columns.append(Column(f"{name}_A_over_B", "A/B", 3, group))
    printed = {
        (charge.rotation_deg, charge.electrode): charge.charge_pC
        for charge in thesis.from_("Table 4.1")
    }
    rows: list[list[Cell]] = []
    for index, rotation in enumerate(rotations_deg(thesis)):
        pairs = [[printed.get((rotation, electrode), math.nan) for electrode in "AB"]]
        pairs += [
            [float(curves[contact, electrode].y[index]) for electrode in "AB"]
            for contact in CONTACTS
        ]
        rows.append(
            [rotation, *(cell for of_a, of_b in pairs for cell in (of_a, of_b, of_a / of_b))]
        )
    caption = "Charges of A and B under the rectangle at the centre, 1 N, by the way to press."
    return Table("contact", caption, columns, rows)


def _triangle_table(results: Results) -> Table:
    columns = [Column("contact", "way to press")]
    columns += [Column(f"{electrode}_pC", f"{electrode} (pC)") for electrode in "ABCD"]
    columns.append(Column("status", "status"))
    rows: list[list[Cell]] = []
    for contact in CONTACTS:
        record = results[triangle(contact)]
        charges = [record.charge_pC(electrode, MATERIAL) for electrode in "ABCD"]
        rows.append([contact, *charges, record.status])
    caption = "The same for the triangle at (5.0714, 0.8757) mm (section 3.1.2)."
    return Table("contact_triangle", caption, columns, rows)


def _texts(thesis: Thesis, results: Results, curves: dict[tuple[str, str], Series]) -> list[str]:
    if not all(np.isfinite(curve.y).all() for curve in curves.values()):
        return ["Some of these scenes have no solution, so that nothing is concluded."]
    ratios = {
        contact: _percent(curves[contact, "A"].y[0], curves[contact, "B"].y[0])
        for contact in CONTACTS
    }
    upright = results[rectangle(0.0, "pressure")]
    edges = _percent(*(upright.charge_pC(electrode, THESIS_EDGE) for electrode in "AB"))
    printed = {
        charge.electrode: charge.charge_pC for charge in thesis.charges if charge.case == "t41_r0"
    }
    texts = [
        "The probe of the experiments is of aluminium, and rigid beside a film. At 0°, A has "
        f"{ratios['pressure']:.1f} % more charge than B under a uniform pressure ({edges:.1f} % "
        f"with edge averages; the thesis: {_percent(printed['A'], printed['B']):.1f} %), "
        f"{ratios['sliding']:.0f} % more under a rigid probe on which the film slides, and "
        f"{ratios['stuck']:.0f} % more if it sticks. A calibration with a pressure is therefore "
        "not valid for this probe. Orientation suffers most: it is read from this contrast."
    ]
    if len(curves["stuck", "A"].x) > 2:
        texts.append(_corner_text(thesis, curves))
    return texts


def _corner_text(thesis: Thesis, curves: dict[tuple[str, str], Series]) -> str:
    rows = [
        charge
        for charge in thesis.from_("Table 4.1")
        if charge.electrode == "A" and charge.rotation_deg <= 90.0
    ]
    highest = max(rows, key=lambda charge: charge.charge_pC).rotation_deg
    stuck, sliding = curves["stuck", "A"], curves["sliding", "A"]
    differences = stuck.y - curves["stuck", "B"].y
    steepest = int(np.argmax(differences))
    repeated = np.interp(-differences[0], -differences[steepest:], stuck.x[steepest:])
    return (
        "Section 4.1 says that the charge grows as a sharp corner gets closer to the electrode. A "
        f"corner points at A at {CORNER_DEG:.1f}°; Table 4.1, and a pressure, have the maximum at "
        f"{highest:g}°, where a short side faces A. Under the probe that sticks, A does grow by "
        f"{_percent(np.max(stuck.y), stuck.y[0]):.1f} % towards the corner; under the sliding one "
        f"by {_percent(np.max(sliding.y), sliding.y[0]):.1f} %. For the probe that sticks A − B is "
        f"{differences[0]:.0f} pC at 0°, {differences[steepest]:.0f} pC at "
        f"{stuck.x[steepest]:.3g}° and nothing at 45°: below {repeated:.0f}° even two charges "
        "leave two angles."
    )


def _percent(charge: float, reference: float) -> float:
    return 100.0 * (charge / reference - 1.0)


CONTACT_CHAPTER = Chapter(
    "contact", "Chapter 5: a rigid probe instead of a pressure", (), _scenes, _compose
)

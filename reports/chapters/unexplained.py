"""Chapter of the thesis report: what was tried to explain that our charges differ from its own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pvdf_fem import Scene
from pvdf_fem.arrays import Array
from reports.common.chapter import Chapter, Content
from reports.common.comparison import Comparison, compare
from reports.common.page import Cell, Column, Table, signed
from reports.common.results import MATERIAL, THESIS_EDGE, Results
from reports.common.thesis_data import Charge, Thesis
from reports.common.thesis_scene import PROBES, scene_of, thesis_scene

#: By how much the probe's lengths are enlarged, in mm; the force stays.
LARGER_MM = 0.5
FACTOR, LARGER = "factor_percent", "larger_mm"
#: What is changed about the rectangle at the centre, and the keys that change it.
CHANGES: dict[str, dict[str, Any]] = {
    "nothing": {},
    f"probe {LARGER_MM:g} mm larger": {
        "probe.width_mm": PROBES["rect14x7"]["width_mm"] + LARGER_MM,
        "probe.height_mm": PROBES["rect14x7"]["height_mm"] + LARGER_MM,
    },
    "pressure that stays vertical": {"load.kind": "dead"},
    "modulus 5 % larger": {"film.youngs_modulus_GPa": 2.1},
    "Poisson's ratio 0.40 for 0.34": {"film.poisson_ratio": 0.40},
    "no pretension": {"film.temperature_change_K": 0.0},
    "ten times the pretension": {"film.temperature_change_K": -10.0},
    "film of 40 mm radius for 45 mm": {"film.radius_mm": 40.0},
    "electrodes at 9.5 mm for 10 mm": {"electrodes.ring_radius_mm": 9.5},
}


def larger(charge: Charge) -> Scene:
    """The scene of a charge under a probe that is `LARGER_MM` larger."""
    lengths = {key: length for key, length in PROBES[charge.probe].items() if key != "shape"}
    return scene_of(charge).with_(
        **{f"probe.{key}": length + LARGER_MM for key, length in lengths.items()}
    )


@dataclass(frozen=True)
class Fit:
    """What the charges lack, fitted by what some causes change.

    Attributes
    ----------
    label : str
    values : dict
        Size of each cause, by its name.
    rms_percent : float
        Root mean square of what is left.
    """

    label: str
    values: Mapping[str, float]
    rms_percent: float

    @classmethod
    def of(cls, label: str, causes: Mapping[str, Array], lacking_percent: Array) -> Fit:
        """Least squares; a cause is given by the change in percent that a unit of it makes."""
        columns = np.array([*causes.values()]).reshape(len(causes), len(lacking_percent)).T
        values = np.linalg.lstsq(columns, lacking_percent, rcond=None)[0]
        left = lacking_percent - columns @ values
        return cls(label, dict(zip(causes, values, strict=True)), float(np.sqrt(np.mean(left**2))))


def fits(comparisons: list[Comparison], results: Results) -> list[Fit]:
    """What the charges that count lack, fitted by a common factor, a larger probe, and both."""
    counted = [comparison for comparison in comparisons if comparison.counts]
    changed = np.array(
        [
            results[larger(comparison.charge)].charge_pC(comparison.charge.electrode, THESIS_EDGE)
            / comparison.ours_pC
            for comparison in counted
        ]
    )
    solved = np.isfinite(changed)
    lacking = np.array([1.0 / (1.0 + comparison.difference / 100.0) for comparison in counted])
    lacking = 100.0 * (lacking[solved] - 1.0)
    factor = {FACTOR: np.ones(len(lacking))}
    probe = {LARGER: 100.0 * (changed[solved] - 1.0) / LARGER_MM}
    return [
        Fit.of("nothing", {}, lacking),
        Fit.of("a common factor", factor, lacking),
        Fit.of("a larger probe", probe, lacking),
        Fit.of("a common factor and a larger probe", factor | probe, lacking),
    ]


def _rectangles() -> dict[str, Scene]:
    return {
        name: thesis_scene("4", "rect14x7").with_(**changes) for name, changes in CHANGES.items()
    }


def _scenes(thesis: Thesis) -> list[Scene]:
    charges = thesis.counted
    return [*map(scene_of, charges), *map(larger, charges), *_rectangles().values()]


def _compose(thesis: Thesis, results: Results, out: Path) -> Content:
    comparisons = compare(thesis.counted, results)
    if not any(comparison.counts for comparison in comparisons):
        return Content(["No charge could be compared."], [])
    fitted = fits(comparisons, results)
    swings = _swings(thesis, results)
    return Content(
        [_bias_text(fitted), _swing_text(swings)],
        [_fit_table(fitted, len(comparisons)), _swing_table(swings)],
    )


# --------------------------------------------------------------------------- too small by a factor


def _bias_text(fitted: list[Fit]) -> str:
    nothing, factor, probe, both = fitted
    return (
        f"What the thesis's charges have beyond ours is {nothing.rms_percent:.2f} % root mean "
        f"square. One factor for all, {signed(factor.values[FACTOR], 2)} %, leaves "
        f"{factor.rms_percent:.2f} %; a probe that is {probe.values[LARGER]:.2f} mm larger than "
        f"nominal leaves {probe.rms_percent:.2f} %; both together, "
        f"{signed(both.values[FACTOR], 2)} % and {both.values[LARGER]:.2f} mm, leave "
        f"{both.rms_percent:.2f} %, which is the scatter of the thesis's own charges. Two numbers "
        "thus describe all differences, but they are a description: the thesis states the size of "
        "its probes and its pressure, and no reason for either number has been found."
    )


def _fit_table(fitted: list[Fit], charges: int) -> Table:
    columns = [
        Column("fitted", "fitted"),
        Column(FACTOR, "charges larger by (%)", 2, signed=True),
        Column(LARGER, "probe larger by (mm)", 2, signed=True),
        Column("rms_percent", "left, root mean square (%)", 2),
    ]
    rows: list[list[Cell]] = [
        [fit.label, fit.values.get(FACTOR), fit.values.get(LARGER), fit.rms_percent]
        for fit in fitted
    ]
    caption = f"What would bring our charges to the thesis's, over all {charges} that count."
    return Table("unexplained_fits", caption, columns, rows)


# ----------------------------------------------------------------------- too small by the rotation


def _swings(thesis: Thesis, results: Results) -> dict[str, tuple[float, float]]:
    """Charges of A in pC at 0° and at 90° for each change; turned by 90°, A is what B was."""
    swings = {}
    printed = {
        charge.rotation_deg: charge.charge_pC
        for charge in thesis.from_("Table 4.1")
        if charge.electrode == "A"
    }
    if {0.0, 90.0} <= printed.keys():
        swings["thesis, Table 4.1"] = (printed[0.0], printed[90.0])
    for name, scene in _rectangles().items():
        swings[name] = _charges(results, scene, THESIS_EDGE)
    return swings | {"charge of the area": _charges(results, _rectangles()["nothing"], MATERIAL)}


def _charges(results: Results, scene: Scene, observable: str) -> tuple[float, float]:
    A, B = (results[scene].charge_pC(electrode, observable) for electrode in "AB")
    return A, B


def _swing_text(swings: Mapping[str, tuple[float, float]]) -> str:
    ours = {name: A - B for name, (A, B) in swings.items()}
    theirs, nothing = ours.pop("thesis, Table 4.1", np.nan), ours.pop("nothing")
    strongest = max(ours, key=lambda name: ours[name])
    return (
        "Nor is it known why the rotation of the rectangle at the centre changes A by "
        f"{nothing:.1f} pC here and by {theirs:.1f} pC in the thesis. The table shows what "
        "changes this number, and by how much; A turned by 90° has the charge that B has before. "
        f"Of what was tried, “{strongest}” raises it most, to {ours[strongest]:.1f} pC, and "
        f"changes the charge itself by "
        f"{signed(100.0 * (sum(swings[strongest]) / sum(swings['nothing']) - 1.0))} %."
    )


def _swing_table(swings: Mapping[str, tuple[float, float]]) -> Table:
    columns = [
        Column("changed", "changed"),
        Column("A_0_pC", "A at 0° (pC)", 1),
        Column("A_90_pC", "A at 90° (pC)", 1),
        Column("mean_percent", "mean, from unchanged (%)", 2, signed=True),
        Column("swing_pC", "0° less 90° (pC)", 1),
    ]
    mean = sum(swings["nothing"])
    rows: list[list[Cell]] = [
        [name, A, B, 100.0 * ((A + B) / mean - 1.0), A - B] for name, (A, B) in swings.items()
    ]
    caption = "What changes by how much rotation changes A: rectangle at the centre, 1 N."
    return Table("unexplained_swing", caption, columns, rows)


UNEXPLAINED_CHAPTER = Chapter(
    "unexplained", "What was tried to explain the differences", (), _scenes, _compose
)

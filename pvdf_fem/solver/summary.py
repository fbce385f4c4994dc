"""A solution as tables, in text and HTML: charges, meshes, the end, and earlier tries."""

from __future__ import annotations

from typing import Any

from pvdf_fem.told import Grid, Parts, Told, rounded, told_html


def solution_parts(result: dict[str, Any], uncertainty: Told | None = None) -> Parts:
    """Text about a solution from its JSON, with its uncertainty."""
    _, _, tables, notes = uncertainty.parts() if uncertainty else ("", [], [], [])
    return *_head(result), [*_tables(result), *tables], [*_remarks(result), *notes]


def solution_html(result: dict[str, Any]) -> str:
    """The HTML of a solution, from its JSON."""
    return told_html(*solution_parts(result))


def _head(result: dict[str, Any]) -> tuple[str, list[str]]:
    warnings = [f"warning: {text}" for text in result["warnings"]]
    return result["status"], [result.get("reason", result["stop"]), *warnings]


def _tables(result: dict[str, Any]) -> list[Grid]:
    tables: list[Grid] = []
    if charges := result.get("charges_pC"):
        columns = ["total, pC", "± pC"]
        if result["rest_charges_pC"]:  # not of a film that has no result without a touch
            columns += ["at rest, pC", "± pC", "change by touch, pC", "± pC"]
        rows = tuple((name, *_charge(result, name)) for name in charges)
        tables.append(Grid((f"charges ({result['observable']})", *columns), rows))
    for patch, contact in result.get("contacts", {}).items():
        shown = "depth_mm", "force_N", "area_mm2", "mean_pressure_MPa"
        tables.append(Grid.of({"contact of": [patch], **{k: [contact[k]] for k in shown}}))
    if readings := result.get("readings_V"):
        decays = ["none" if s is None else s for s in result["time_constants_s"].values()]
        channels = {"readings at once": [*readings], "V": [*readings.values()]}
        tables.append(Grid.of({**channels, "decay in s": decays}))
    if history := result["history"]:
        counts = "elements", "unknowns", "iterations"
        meshes = {key: [mesh[key] for mesh in history] for key in counts}
        errors = [mesh["worst_error"] for mesh in history]
        meshes["worst error"] = [None if error is None else f"{error:.1e}" for error in errors]
        meshes["seconds"] = [f"{mesh['seconds']:.3f}" for mesh in history]
        meshes["ended"] = [mesh["status"] for mesh in history]
        tables.append(Grid.of({"mesh": range(1, len(history) + 1), **meshes}))
    return tables


def _charge(result: dict[str, Any], name: str) -> list[str]:
    """The charge of an electrode, at rest, and since, to the same digit, each with its error."""
    cells = [*rounded(result["charges_pC"][name], result["charge_errors_pC"][name])]
    places = len(cells[0].partition(".")[2])
    for kind in ("rest_charge", "charge_change") if result["rest_charges_pC"] else ():
        value, error = (result[f"{kind}{end}"][name] for end in ("s_pC", "_errors_pC"))
        cells += [f"{value + 0.0:.{places}f}", f"{error:.2g}"]
    return cells


def _remarks(result: dict[str, Any]) -> list[str]:
    remarks = [
        f"tried on mesh {number}: {solver['solver']}, {solver['status']} after"
        f" {solver['iterations']} iterations"
        for number, mesh in enumerate(result["history"], 1)
        for solver in mesh["tried"]
    ]
    if deflection := result.get("deflection_max_mm"):
        remarks.append(f"deflection: {deflection:.4g} mm at most")
    for key, word in (("included", "included"), ("left_out", "left out")):
        remarks += [f"{word}: {text}" for text in result[key]]
    return remarks

"""The printed summary of a solution: charges, contacts, readings, meshes and notes."""

from __future__ import annotations

from typing import Any

from pvdf_fem.summary import Result, Summary, TextTable, format_with_error


def summarize_solution(result: dict[str, Any], uncertainty: Result | None = None) -> Summary:
    """Make the printed summary of a solution from its JSON form.

    Parameters
    ----------
    result : dict
        The solution as `Solution.to_json` returns it.
    uncertainty : Result, optional
        Standard deviations of the charges, whose tables and notes are appended.

    Returns
    -------
    Summary
        Status, reason and warnings; tables of charges, contacts, readings and meshes; notes.
    """
    sentences = [result.get("reason", result["stop"])]
    sentences += [f"warning: {text}" for text in result["warnings"]]
    tables = _make_tables(result)
    notes = _make_notes(result)
    if uncertainty is not None:
        added = uncertainty.summary()
        tables += added.tables
        notes += added.notes
    return Summary(result["status"], sentences, tables=tables, notes=notes)


def _make_tables(result: dict[str, Any]) -> list[TextTable]:
    """Make the tables of charges, contacts, readings and meshes; empty ones are left out."""
    tables = []
    if result.get("charges_pC"):
        tables.append(_make_charge_table(result))
    for patch, contact in result.get("contacts", {}).items():
        columns: dict[str, Any] = {"contact of": [patch]}
        for key in ("depth_mm", "force_N", "area_mm2", "mean_pressure_MPa"):
            columns[key] = [contact[key]]
        tables.append(TextTable.from_columns(columns))
    if result.get("readings_V"):
        tables.append(_make_readings_table(result))
    if result["history"]:
        tables.append(_make_mesh_table(result["history"]))
    return tables


def _make_charge_table(result: dict[str, Any]) -> TextTable:
    """Make the table of charges, with columns for the unloaded film if it has a result."""
    heading = [f"charges ({result['observable']})", "total, pC", "± pC"]
    if result["rest_charges_pC"]:  # None if the unloaded film has no result
        heading += ["unloaded, pC", "± pC", "change by load, pC", "± pC"]
    rows = [(name, *_format_charge(result, name)) for name in result["charges_pC"]]
    return TextTable(tuple(heading), tuple(rows))


def _format_charge(result: dict[str, Any], name: str) -> list[str]:
    """Format the charges of an electrode with their errors, with the decimals of the total."""
    total, error = format_with_error(result["charges_pC"][name], result["charge_errors_pC"][name])
    cells = [total, error]
    if result["rest_charges_pC"]:
        decimals = len(total.partition(".")[2])
        for kind in ("rest_charge", "charge_change"):
            value = result[f"{kind}s_pC"][name] + 0.0  # no minus sign before a zero
            cells.append(f"{value:.{decimals}f}")
            cells.append(f"{result[f'{kind}_errors_pC'][name]:.2g}")
    return cells


def _make_readings_table(result: dict[str, Any]) -> TextTable:
    """Make the table of readings in V by channel, with the time constants of their decay."""
    readings = result["readings_V"]
    decays = []
    for time_constant in result["time_constants_s"].values():
        decays.append("none" if time_constant is None else time_constant)
    return TextTable.from_columns(
        {
            "readings at once": list(readings),
            "V": list(readings.values()),
            "decay in s": decays,
        }
    )


def _make_mesh_table(history: list[dict[str, Any]]) -> TextTable:
    """Make the table of meshes, with a row for each solve."""
    columns: dict[str, list[Any]] = {"mesh": list(range(1, len(history) + 1))}
    for key in ("elements", "unknowns", "iterations"):
        columns[key] = [mesh[key] for mesh in history]
    errors = [mesh["worst_error"] for mesh in history]
    columns["worst error"] = [None if error is None else f"{error:.1e}" for error in errors]
    columns["seconds"] = [f"{mesh['seconds']:.3f}" for mesh in history]
    columns["ended"] = [mesh["status"] for mesh in history]
    return TextTable.from_columns(columns)


def _make_notes(result: dict[str, Any]) -> list[str]:
    """Return notes of failed solvers, the deflection, and included and neglected effects."""
    notes = []
    for number, mesh in enumerate(result["history"], start=1):
        for solver in mesh["tried"]:
            outcome = f"{solver['status']} after {solver['iterations']} iterations"
            notes.append(f"tried on mesh {number}: {solver['solver']}, {outcome}")
    if result.get("deflection_max_mm"):
        notes.append(f"deflection: {result['deflection_max_mm']:.4g} mm at most")
    notes += [f"included: {text}" for text in result["included"]]
    notes += [f"neglected: {text}" for text in result["neglected"]]
    return notes

"""A solve's results for the page: bars of charges and readings, or the reason for their absence,
and numbers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pvdf_fem.explore.controls import choose_colour
from pvdf_fem.explore.picture import encode_image, solve_picture
from pvdf_fem.solver.summary import summarize_solution
from pvdf_fem.summary import format_with_error


def collect_results(text: str, quantity: str) -> dict[str, Any]:
    """The results of a scene file; without an image where it has no solution."""
    result, image = solve_picture(text, quantity)
    reason = "" if image is not None else result.get("reason", result["stop"])
    charges, errors = result.get("charges_pC") or {}, result.get("charge_errors_pC") or {}
    readings = result.get("readings_V") or {}
    return {
        "status": result["status"],
        "reason": reason,
        "warnings": result["warnings"],
        "image": None if image is None else encode_image(image, quantity),
        "bars": [
            _bars("charges", "total charge (pC)", charges, errors),
            _bars("readings", "reading at once (V)", readings, {}),
        ],
        "numbers": summarize_solution(result).to_html(),
    }


def _bars(
    name: str, title: str, values: Mapping[str, float], errors: Mapping[str, float]
) -> dict[str, Any]:
    """Bars by electrode: text, and ends in percent of the width."""
    low, high = min([0.0, *values.values()]), max([0.0, *values.values()])
    share = 100.0 / ((high - low) or 1.0)
    rows = []
    for i, (electrode, value) in enumerate(values.items()):
        text = " ± ".join(format_with_error(value, errors[electrode])) if errors else f"{value:.4g}"
        row = {"name": electrode, "colour": choose_colour(i), "value": value, "text": text}
        ends = (min(value, 0.0) - low) * share, abs(value) * share
        rows.append({**row, "from": ends[0], "width": ends[1]})
    return {"name": name, "title": title, "rows": rows}

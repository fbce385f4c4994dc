"""Results of a solve for the page: bars of charges and readings, and a table of numbers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pvdf_fem.explore.controls import choose_colour
from pvdf_fem.explore.picture import encode_image, solve_picture
from pvdf_fem.solver.summary import summarize_solution
from pvdf_fem.summary import format_with_error


def collect_results(text: str, quantity: str) -> dict[str, Any]:
    """Solve a scene file, and collect its results for the page.

    Parameters
    ----------
    text : str
        Text of the scene file.
    quantity : str
        Quantity by which the film is coloured, a key of `QUANTITIES`.

    Returns
    -------
    dict
        `status`; `reason` why the solve did not converge, or empty; `warnings`; `image` as returned
        by `encode_image`, or None if the solve did not converge; `bars`, one group for the charges
        and one for the readings; `numbers`, a summary of the solution in HTML.
    """
    result, image = solve_picture(text, quantity)
    reason = ""
    if image is None:
        reason = result.get("reason", result["stop"])
    charges_pC = result.get("charges_pC") or {}
    errors_pC = result.get("charge_errors_pC") or {}
    readings_V = result.get("readings_V") or {}
    return {
        "status": result["status"],
        "reason": reason,
        "warnings": result["warnings"],
        "image": None if image is None else encode_image(image, quantity),
        "bars": [
            _make_bars("charges", "total charge (pC)", charges_pC, errors_pC),
            _make_bars("readings", "reading at once (V)", readings_V, {}),
        ],
        "numbers": summarize_solution(result).to_html(),
    }


def _make_bars(
    name: str, title: str, values: Mapping[str, float], errors: Mapping[str, float]
) -> dict[str, Any]:
    """Describe a group of horizontal bars, one for each electrode.

    Parameters
    ----------
    name, title : str
        Name of the group in the page, and its heading.
    values, errors : mapping of str to float
        Values and their numerical errors by electrode. `errors` is empty if none is known.

    Returns
    -------
    dict
        `name`, `title` and `rows`. Each row has the `name` and `colour` of an electrode, its
        `value` and `text`, and the left end `from` and the `width` of its bar in percent.
    """
    low = min([0.0, *values.values()])
    high = max([0.0, *values.values()])
    percent_per_unit = 100.0 / ((high - low) or 1.0)
    rows = []
    for i, (electrode, value) in enumerate(values.items()):
        text = f"{value:.4g}"
        if errors:
            text = " ± ".join(format_with_error(value, errors[electrode]))
        row = {
            "name": electrode,
            "colour": choose_colour(i),
            "value": value,
            "text": text,
            "from": (min(value, 0.0) - low) * percent_per_unit,
            "width": abs(value) * percent_per_unit,
        }
        rows.append(row)
    return {"name": name, "title": title, "rows": rows}

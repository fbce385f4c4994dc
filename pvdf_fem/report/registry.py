"""Kinds of figures and tables in report scripts, a line per kind."""

from __future__ import annotations

import traceback
from collections.abc import Mapping
from pathlib import Path
from typing import get_args

from pvdf_fem.report.kind import Kind
from pvdf_fem.report.kinds.charge_vs_distance import ChargeVsDistance
from pvdf_fem.report.kinds.comparison import Comparison
from pvdf_fem.report.kinds.curve import Curve
from pvdf_fem.report.kinds.isocharge import Isocharge
from pvdf_fem.report.kinds.positions import Positions
from pvdf_fem.report.kinds.sensor import Sensor
from pvdf_fem.report.task import run_module
from pvdf_fem.scene.scene_file import SceneError, format_error

#: Kinds of ``[[section.figure]]``.
FIGURES: Mapping[str, type[Kind]] = {
    "sensor": Sensor,
    "charge-vs-distance": ChargeVsDistance,
    "isocharge": Isocharge,
    "curve": Curve,
}
#: Kinds of ``[[section.table]]``.
TABLES: Mapping[str, type[Kind]] = {
    "comparison": Comparison,
    "positions": Positions,
}


def load_kinds(path: Path) -> dict[str, type[Kind]]:
    """Kinds defined in a Python file, by their words for `kind`. The file is run.
    Raises `SceneError` where the file cannot be run, or defines none."""
    try:
        module = run_module(path)
    except Exception as error:
        told = traceback.format_exception_only(error)[-1].strip()[:200]
        reason = f"cannot be run ({told}); mend the file"
        raise SceneError([format_error("kinds", str(path), reason)]) from error
    found: dict[str, type[Kind]] = {}
    for value in vars(module).values():
        is_kind = isinstance(value, type) and issubclass(value, Kind)
        if is_kind and value.__module__ == module.__name__:
            word = value.model_fields.get("kind")
            found |= dict.fromkeys(get_args(word.annotation) if word else (), value)
    if not found:
        reason = "has no kinds; derive a class from Kind, with a field kind: Literal[...]"
        raise SceneError([format_error("kinds", str(path), reason)])
    return found

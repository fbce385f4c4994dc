"""The kinds of figures and tables by their names in report scripts."""

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
    """Run a Python file, and return the kinds of figures and tables that it defines.

    Parameters
    ----------
    path : Path
        A file with classes derived from `Kind`.

    Returns
    -------
    dict of str to Kind classes
        Kinds by the values of their field `kind`.

    Raises
    ------
    SceneError
        If the file cannot be run, or if it does not define a kind.
    """
    try:
        module = run_module(path)
    except Exception as error:
        last_line = traceback.format_exception_only(error)[-1].strip()[:200]
        reason = f"cannot be run ({last_line}); correct the file"
        raise SceneError([format_error("kinds", str(path), reason)]) from error
    kinds: dict[str, type[Kind]] = {}
    for value in vars(module).values():
        is_kind = isinstance(value, type) and issubclass(value, Kind)
        if is_kind and value.__module__ == module.__name__ and "kind" in value.model_fields:
            for name in get_args(value.model_fields["kind"].annotation):
                kinds[name] = value
    if not kinds:
        reason = "defines no kind; derive a class from FigureKind, with a field kind: Literal[...]"
        raise SceneError([format_error("kinds", str(path), reason)])
    return kinds

"""The kinds of figures and tables that a report script may have: a line for each."""

from __future__ import annotations

from collections.abc import Mapping

from pvdf_fem.reporting.kind import Kind
from pvdf_fem.reporting.kinds.charge_vs_distance import ChargeVsDistance
from pvdf_fem.reporting.kinds.comparison import Comparison
from pvdf_fem.reporting.kinds.curve import Curve
from pvdf_fem.reporting.kinds.isocharge import Isocharge
from pvdf_fem.reporting.kinds.positions import Positions
from pvdf_fem.reporting.kinds.sensor import Sensor

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

"""Diagnosis of touches whose readings are in another unit, from the solves of a few touches."""

from __future__ import annotations

import numpy as np

from pvdf_fem.arrays import Mask
from pvdf_fem.inverse.calibration.reading_model import ReadingModel
from pvdf_fem.inverse.calibration.touch_table import TouchTable
from pvdf_fem.inverse.reading_unit import OtherUnit, find_unit_of_known_touches


def diagnose_unit(model: ReadingModel) -> OtherUnit | None:
    """Find the unit of the readings from three touches, if it is clearly not that of the model.

    The touches with the smallest, the median and the largest force are solved at the scene's values
    of the parameters. The model keeps these solves.

    Parameters
    ----------
    model : ReadingModel
        Readings as a function of the parameters.

    Returns
    -------
    OtherUnit or None
        None if the readings of these touches have about the predicted size, if they fit in no unit,
        or if one of the touches cannot be solved.
    """
    which = _select_forces(model.table)
    no_corrections = np.zeros((len(model.table), 2))
    initial = model.parameters.initial
    tolerance = max(model.tolerance, model.options.first_tolerance)
    model.solve_touches(initial, no_corrections, which, tolerance)
    if not model.is_solved[which].all():
        return None
    predicted = model.predict(initial, no_corrections).readings
    return find_unit_of_known_touches(
        model.parameters.scene, model.table.readings[which], predicted[which], model.unit
    )


def _select_forces(table: TouchTable) -> Mask:
    """Mark the touches with the smallest, the median and the largest force; shape (touches,)."""
    order = np.argsort(table.forces_N, kind="stable")
    which = np.zeros(len(table), dtype=bool)
    which[[order[0], order[len(order) // 2], order[-1]]] = True
    return which

"""The quantities of a touch that the tracker does not search for."""

from __future__ import annotations

from collections.abc import Sequence

from pvdf_fem.electrodes.channel import find_unit_errors
from pvdf_fem.inverse.touch.locate import get_scene_quantities
from pvdf_fem.inverse.touch.measurement import get_centre_mm
from pvdf_fem.inverse.touch.validation import find_quantity_errors
from pvdf_fem.surrogate.charge_function import ChargeFunction
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, TouchColumn


def resolve_fixed_quantities(
    response: ChargeFunction, unknown: Sequence[str], unit: str | None
) -> dict[int, float]:
    """Return the values of the quantities of a touch that are not searched for.

    Parameters
    ----------
    response : ChargeFunction
        Charges as a function of the touch.
    unknown : sequence of str
        Quantities to find.
    unit : str or None
        Unit of the readings.

    Returns
    -------
    dict of int to float
        Coordinates relative to the film's centre, by their index.

    Raises
    ------
    ValueError
        If arguments are wrong; the message has a line for each error.
    """
    scene = response.scene
    scene_values = get_scene_quantities(scene)
    origin = (*get_centre_mm(scene), 0.0, 0.0)
    errors = list(
        find_quantity_errors(
            response.domain,
            unknown,
            known={},
            default=scene_values,
            centre_mm=origin[: TouchColumn.ROTATION],
        )
    )
    if "force_N" not in unknown:
        errors.append("unknown: force_N is missing; add it, it is always unknown")
    errors += find_unit_errors(scene, unit)
    if errors:
        raise ValueError("\n".join(errors))
    fixed = {}
    for index, name in enumerate(TOUCH_QUANTITIES):
        if name not in unknown:
            fixed[index] = scene_values[name] - origin[index]
    return fixed

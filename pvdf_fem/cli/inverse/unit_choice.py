"""The choice of the unit of readings, which may not be the one of ``--unit`` or of the scene."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING

from pvdf_fem.cli.program import InputError

if TYPE_CHECKING:
    from pvdf_fem.arrays import Array
    from pvdf_fem.cli.inverse.locate_request import Request
    from pvdf_fem.inverse.reading_unit import OtherUnit
    from pvdf_fem.scene.scene import Scene
    from pvdf_fem.surrogate.charge_function import ChargeFunction


def settle_unit(scene: Scene, given: str | None, other: OtherUnit | None, name: str) -> str:
    """Return the unit of readings after the test whether they can be in it.

    If the unit was not given, and the readings fit in another unit only, this unit is returned, and
    standard error says so.

    Parameters
    ----------
    scene : Scene
        Scene of the sensor.
    given : str or None
        The unit of ``--unit``.
    other : OtherUnit or None
        The unit in which the readings fit, if it is another one.
    name : str
        Name of the readings, for messages.

    Raises
    ------
    InputError
        If the readings are not in the given unit, if they fit in several other units, or if the
        scene has no readout, so that readings in V could not be converted.
    """
    from pvdf_fem.electrodes.channel import get_reading_unit

    if other is None:
        return get_reading_unit(scene) if given is None else given
    if scene.readout is None:
        advice = f"add a [readout] if they are in V, or give {other.options}"
        raise InputError(f"{name}: {other.text}; {advice}")
    if given is not None or other.unit is None:
        raise InputError(f"{name}: {other.text}; give {other.options}")
    print(f"{name}: {other.text}: located with --unit {other.unit}", file=sys.stderr)
    return other.unit


def choose_unit(
    response: ChargeFunction,
    readings: Mapping[str, Array],
    given: str | None,
    name: str,
    *,
    request: Request,
    known: Mapping[str, Array],
) -> str:
    """Choose the unit of readings by a response; see `settle_unit` for messages and exceptions.

    Parameters
    ----------
    response : ChargeFunction
        The response of the sensor.
    readings : mapping of str to ndarray, shape (n,)
        Columns of readings by electrode.
    given : str or None
        The unit of ``--unit``.
    name : str
        Name of the readings, for messages.
    request : Request
        Options with the noise and the meaning of the readings.
    known : mapping of str to ndarray, shape (n,)
        Known quantities, as arguments of `find_other_unit`.
    """
    from pvdf_fem.electrodes.channel import get_reading_unit
    from pvdf_fem.inverse.reading_unit import find_other_unit

    stated = get_reading_unit(response.scene) if given is None else given
    other = find_other_unit(
        response,
        readings,
        stated,
        sigma=request.sigma,
        noise=request.noise,
        reading=request.reading,
        **known,
    )
    return settle_unit(response.scene, given, other, name)

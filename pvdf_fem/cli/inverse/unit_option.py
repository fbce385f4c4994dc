"""The option ``--unit``: the unit of readings, and the test whether they can be in it."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING

from pvdf_fem.cli.options import add_text_option
from pvdf_fem.cli.program import InputError
from pvdf_fem.readings.units import parse_unit

if TYPE_CHECKING:
    from pvdf_fem.arrays import Array
    from pvdf_fem.inverse.reading_unit import OtherUnit
    from pvdf_fem.scene.scene import Scene
    from pvdf_fem.surrogate.charge_function import ChargeFunction


def add_unit_option(parser: argparse.ArgumentParser, *, is_tested: bool) -> None:
    """Add the option ``--unit``, a text or None.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Parser of a subcommand.
    is_tested : bool
        Whether the subcommand chooses another unit if the readings contradict the default.
    """
    about = (
        "unit of the readings, such as V, mV, pC or nC (default: readout.unit, which is V unless "
    )
    about += "the scene says otherwise, or pC without [readout]"
    about += "; pC if they cannot be V, and vice versa, which is then said)" if is_tested else ")"
    add_text_option(parser, "--unit", "UNIT", about=about)


def parse_unit_option(text: str | None) -> str | None:
    """Return the symbol of the unit in ``--unit``, such as ``µV`` for ``uV``.

    An unknown unit is returned unchanged, for `find_unit_errors` to report.
    """
    unit = None if text is None else parse_unit(text)
    return text if unit is None else unit.symbol


def require_valid_unit(scene: Scene, unit: str | None, name: str) -> None:
    """Raise `InputError` if a table has readings in a unit of voltage, but the scene no readout.

    Parameters
    ----------
    scene : Scene
        Scene of the sensor.
    unit : str or None
        Unit that the table states.
    name : str
        Name of the table, for the message.
    """
    from pvdf_fem.electrodes.channel import find_unit_errors

    errors = list(find_unit_errors(scene, unit, f"{name}: readings in"))
    if errors:
        raise InputError(*errors)


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
    sigma: float,
    noise: float | None,
    reading: str | None,
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
    sigma, noise, reading
        As for `find_other_unit`.
    known : mapping of str to ndarray, shape (n,)
        Known quantities, as arguments of `find_other_unit`.
    """
    from pvdf_fem.electrodes.channel import get_reading_unit
    from pvdf_fem.inverse.reading_unit import find_other_unit

    stated = get_reading_unit(response.scene) if given is None else given
    other = find_other_unit(
        response, readings, stated, sigma=sigma, noise=noise, reading=reading, **known
    )
    return settle_unit(response.scene, given, other, name)

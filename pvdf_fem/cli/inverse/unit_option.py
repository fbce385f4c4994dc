"""The option ``--unit``: the unit of readings."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from pvdf_fem.cli.options import add_text_option
from pvdf_fem.cli.program import InputError
from pvdf_fem.readings.units import parse_unit

if TYPE_CHECKING:
    from pvdf_fem.scene.scene import Scene


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

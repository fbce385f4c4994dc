"""The options of ``pvdf-fem locate`` as a validated request."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pvdf_fem.cli.inverse.recording_options import RECORDING_OPTIONS
from pvdf_fem.cli.inverse.unit_option import parse_unit_option
from pvdf_fem.cli.options import parse_noise_options, read_number
from pvdf_fem.cli.output import find_plot_errors
from pvdf_fem.cli.response_choice import ResponseChoice

if TYPE_CHECKING:
    from pvdf_fem.scene.scene import Scene

#: Quantities of a touch that can be located by a response, by their names on the command line.
FOUND_BY_RESPONSES = {"x": "x_mm", "y": "y_mm", "force": "force_N", "rotation": "rotation_deg"}
#: Quantities of a touch that can be located by full solves.
FOUND_BY_SOLVES = {
    **FOUND_BY_RESPONSES,
    "tangential": "tangential_N",
    "temperature": "temperature_K",
}
UNKNOWN_HELP = f"unknown quantities, of {', '.join(FOUND_BY_SOLVES)}"


@dataclass(frozen=True)
class Request:
    """A request to locate touches, as the options describe it.

    Parameters
    ----------
    readings : dict of str to float
        Readings by electrode, in `unit`. Empty if the readings are in a table.
    unit : str or None
        Unit of the readings, also of those in a table, and of `noise`. None: that of
        `get_reading_unit`. Readings in pC are *nominal*: in V times the nominal capacitance of the
        channel, before the correction of gain and offset.
    reading : {"change", "total"} or None
        Whether readings are changes of the charge by the touch, or total charges. None: as in the
        scene's readout.
    sigma : float
        Standard deviation of a reading as a fraction of the charge or change that is read.
    noise : float or None
        Additional standard deviation of every reading in `unit`. None: that of the scene's readout.
    unknown : tuple of str
        Unknown quantities of a touch, such as ``x_mm``.
    touches : int
        Number of probes that touch at once.
    include_calibration : bool
        Whether standard deviations include the errors that the calibration has left.
    response : ResponseChoice
        Options that describe the response.
    errors : tuple of str
        Messages about errors in the options. If there are any, the other fields must not be used.
    """

    readings: dict[str, float]
    unit: str | None
    reading: str | None
    sigma: float
    noise: float | None
    unknown: tuple[str, ...]
    touches: int
    include_calibration: bool
    response: ResponseChoice
    errors: tuple[str, ...]

    @classmethod
    def from_options(cls, options: argparse.Namespace) -> Request:
        """Parse the options of ``pvdf-fem locate``.

        Nothing is raised for invalid options: the field `errors` of the request has the messages.
        """
        errors = _find_misplaced_options(options)
        reading = options.reading
        readings: dict[str, float] = {}
        if options.charges is not None:
            reading = "total"
            readings = _parse_readings("--charges", options.charges, errors)
        elif options.changes is not None:
            reading = "change"
            readings = _parse_readings("--changes", options.changes, errors)
        sigma, noise = parse_noise_options(options, errors)
        unknown = parse_unknowns(options.unknown, errors)
        if needs_solves(options.touches, unknown):
            errors += _find_options_of_responses(options)
        errors += find_plot_errors(options, options.scene)
        if options.plot and not {"x_mm", "y_mm"} <= set(unknown):
            errors.append("--plot: needs an unknown position; add x and y to --unknown")
        response = ResponseChoice.from_options(options, errors)
        if options.model and options.others:
            errors.append("--model: is the response of one scene; remove it, or remove --or")
        return cls(
            readings=readings,
            unit=parse_unit_option(options.unit),
            reading=reading,
            sigma=sigma,
            noise=noise,
            unknown=unknown,
            touches=options.touches,
            include_calibration=not options.without_calibration,
            response=response,
            errors=tuple(errors),
        )

    @property
    def needs_solves(self) -> bool:
        """Whether full solves are needed: for two touches, or unknowns that responses lack."""
        return needs_solves(self.touches, self.unknown)

    def convert_readings_to_pC(self, scene: Scene) -> dict[str, float]:
        """Convert the readings from `unit` to nominal pC, without a correction of gain and offset.

        Nominal pC are V times the nominal capacitance of the channel in pF. Readings of electrodes
        that the scene does not have are not converted.

        Parameters
        ----------
        scene : Scene
            Scene of the sensor.

        Returns
        -------
        dict of str to float
            Readings by electrode.
        """
        from pvdf_fem.electrodes.channel import get_reading_unit
        from pvdf_fem.inverse.touch.measurement import get_units_pC

        units = get_units_pC(scene, self.unit or get_reading_unit(scene))
        return {name: units.get(name, 1.0) * value for name, value in self.readings.items()}

    def convert_noise_to_pC(self, scene: Scene) -> dict[str, float] | None:
        """Convert `noise` from `unit` to nominal pC: to V times the nominal capacitance in pF.

        Parameters
        ----------
        scene : Scene
            Scene of the sensor.

        Returns
        -------
        dict of str to float, or None
            Noise by electrode. None if `noise` is None, so that the scene's readout gives it.
        """
        from pvdf_fem.electrodes.channel import get_reading_unit
        from pvdf_fem.inverse.touch.measurement import get_units_pC

        if self.noise is None:
            return None
        units_pC = get_units_pC(scene, self.unit or get_reading_unit(scene))
        return {name: unit_pC * self.noise for name, unit_pC in units_pC.items()}


def needs_solves(touches: int, unknown: Sequence[str]) -> bool:
    """Return whether full solves are needed to locate touches, since a response cannot.

    Parameters
    ----------
    touches : int
        Number of probes that touch at once; a response is for one.
    unknown : sequence of str
        Unknown quantities, such as ``x_mm``; a response is a function of `FOUND_BY_RESPONSES`.
    """
    return touches > 1 or not set(unknown) <= set(FOUND_BY_RESPONSES.values())


def parse_unknowns(text: str, errors: list[str]) -> tuple[str, ...]:
    """Parse the value of ``--unknown`` to names of quantities.

    Parameters
    ----------
    text : str
        Names separated by commas, in the form ``x`` or ``x_mm``.
    errors : list of str
        Error messages; one is appended for each invalid name.

    Returns
    -------
    tuple of str
        Names of the quantities, such as ``x_mm``, without repetitions.
    """
    quantities = {name: name for name in FOUND_BY_SOLVES.values()}
    quantities |= FOUND_BY_SOLVES
    unknown: list[str] = []
    for item in text.split(","):
        name = item.strip()
        if name not in quantities:
            errors.append(
                f"--unknown {name}: is not a quantity; choose from {', '.join(FOUND_BY_SOLVES)}"
            )
        elif quantities[name] not in unknown:
            unknown.append(quantities[name])
    return tuple(unknown)


def require_locatable(
    scenes: Mapping[str, Scene],
    request: Request,
    readings_pC: Mapping[str, float],
    known: Mapping[str, float],
) -> None:
    """Raise an error if touches cannot be located, before any response is built.

    The quantities of the touch are not tested if ``--model`` names an existing file, whose domain
    is not yet known.

    Parameters
    ----------
    scenes : mapping of str to Scene
        Scenes by file, the sensor's scene first.
    request : Request
        Validated options.
    readings_pC : mapping of str to float
        Readings by electrode in nominal pC, which are V times the nominal capacitance of the
        channel in pF.
    known : mapping of str to float
        Known quantities of the touch, such as ``rotation_deg``.

    Raises
    ------
    ValueError
        If readings, quantities or responses are invalid. The message has a line for each error.
    """
    from pvdf_fem.electrodes.channel import find_unit_errors
    from pvdf_fem.inverse.touch.measurement import get_centre_mm
    from pvdf_fem.inverse.touch.validation import find_quantity_errors, find_reading_errors

    errors: list[str] = []
    for scene in scenes.values():
        errors += find_reading_errors(
            scene, readings_pC, request.sigma, request.convert_noise_to_pC(scene)
        )
        errors += find_unit_errors(scene, request.unit, "--unit")
    for file, scene in scenes.items():
        errors += request.response.find_errors(scene, file)
    file_of_response = request.response.file
    if file_of_response is None or not file_of_response.exists():
        sensor = next(iter(scenes.values()))
        domain, _ = request.response.resolve_settings(sensor)
        centre_mm = get_centre_mm(sensor)
        errors += find_quantity_errors(domain, request.unknown, {}, known, centre_mm)
    if errors:
        raise ValueError("\n".join(dict.fromkeys(errors)))


def _find_misplaced_options(options: argparse.Namespace) -> list[str]:
    """Return error messages about options that require a table or a single touch.

    These are options of single touches if there is ``--csv``, and options of tables if there is
    not.
    """
    if options.csv is not None:
        return [
            f"{option}: is only for single touches; remove it"
            for option in _list_single_touch_options(options)
        ]
    of_tables = {
        "--quick": options.quick,
        "--reading": options.reading is not None,
        "--output": options.output != "-",
    }
    for name, option in RECORDING_OPTIONS.items():
        of_tables[option] = getattr(options, name) is not None
    return [
        f"{option}: is only for tables; remove it, or give --csv FILE"
        for option, is_used in of_tables.items()
        if is_used
    ]


def _find_options_of_responses(options: argparse.Namespace) -> list[str]:
    """Return error messages about options that require a response instead of full solves."""
    # with a table, `_find_misplaced_options` has already reported options of single touches
    used = ["--csv"] if options.csv is not None else _list_single_touch_options(options)
    with_solves = "--touches 2 and --unknown tangential or temperature"
    return [f"{option}: is incompatible with {with_solves}; remove it" for option in used]


def _list_single_touch_options(options: argparse.Namespace) -> list[str]:
    """Return those of the options ``--or`` and ``--plot`` that are used.

    Both are only for a single touch that is located with responses.
    """
    used = []
    if options.others:
        used.append("--or")
    if options.plot:
        used.append("--plot")
    return used


def _parse_readings(option: str, text: str, errors: list[str]) -> dict[str, float]:
    """Parse readings by electrode from a text such as ``A=905.1,B=731.4``.

    For each item that is invalid or repeats a name, a message is appended to `errors` and the item
    is left out.

    Parameters
    ----------
    option : str
        Name of the option, for messages.
    text : str
        Value of the option.
    errors : list of str
        Receives the messages.
    """
    readings: dict[str, float] = {}
    for item in text.split(","):
        name, _, value = (part.strip() for part in item.partition("="))
        number = read_number(value)
        if not name or number is None:
            errors.append(f"{option} {item.strip()}: must be NAME=NUMBER, such as A=905.1")
        elif name in readings:
            errors.append(f"{option} {name}: is given twice; remove one")
        else:
            readings[name] = number
    return readings

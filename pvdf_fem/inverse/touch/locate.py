"""Locate a touch from charges: position, force and rotation with their uncertainty.

`locate` finds all touches that are consistent with some readings, and `locate_many.locate_many` the
most likely touch for each of many rows of readings. Both maximise the likelihood of the charges,
whose errors are assumed to be normal and independent. The result of `locate` also reports why the
best touch may not be the true one: other touches are nearly as likely, the charges do not determine
a direction, no touch explains the charges, or the touch is at the edge of the response's domain.
`rank_probes` computes which of several probes has most probably touched.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.channel import get_reading_unit
from pvdf_fem.inverse.touch.locate_many import find_explanations
from pvdf_fem.inverse.touch.location import Explanation, Location
from pvdf_fem.inverse.touch.measurement import (
    Deviations,
    Measurement,
    get_centre_mm,
    get_units_pC,
)
from pvdf_fem.inverse.touch.search import (
    DEFAULT_OPTIONS,
    LocateOptions,
    evaluate_ends,
    find_distinct_ends,
    make_location,
    search_everywhere,
)
from pvdf_fem.inverse.touch.validation import as_float, find_quantity_errors, find_reading_errors
from pvdf_fem.progress import Progress, SolveCounter, show_progress
from pvdf_fem.scene.arguments import Names, SceneLike, as_scene, coerce
from pvdf_fem.scene.scene import Scene
from pvdf_fem.surrogate.charge_function import ChargeFunction, UnloadedCharges
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, TouchColumn, extract_touch

POSITION_AND_FORCE = ("x_mm", "y_mm", "force_N")


def locate(
    response: ChargeFunction | SceneLike,
    readings: Mapping[str, float],
    sigma: Deviations = 0.01,
    *,
    unknown: Sequence[str] = POSITION_AND_FORCE,
    known: Mapping[str, float] | None = None,
    noise_pC: Deviations | None = None,
    reading: str | None = None,
    unit: str | None = None,
    touches: int = 1,
    include_calibration: bool = True,
    options: LocateOptions = DEFAULT_OPTIONS,
    progress: Progress | bool | None = None,
) -> Location:
    """Find all touches that are consistent with some readings.

    Parameters
    ----------
    response : Response, Scene, or anything that `solve` accepts as a scene
        The response of the sensor to touches. A scene is solved for each touch of the search
        instead, which takes up to a minute. Only a scene admits two `touches` at once, by a list of
        two probes or by one probe at two positions, and the unknowns ``"tangential_N"`` and
        ``"temperature_K"``.
    readings : mapping
        Readings of some or all electrodes by name, in `unit`. Readings in nominal pC equal the
        charges if the channels of the scene's readout have no gain error and no offset.
    sigma, noise_pC : float or mapping
        Standard deviations of the readings, for all electrodes or by electrode: `sigma` as a
        fraction of the charge or change that is read, and `noise_pC` in nominal pC. By default
        `noise_pC` is that of the readout.
    unknown : sequence of str
        Names of the unknown quantities of every probe, of `TOUCH_QUANTITIES`.
    known : mapping, optional
        Values of the other quantities in the frame of the scene's stage. By default those of the
        scene. Not allowed if `response` is a scene.
    reading : {"total", "change"}, optional
        Meaning of the readings: total charges, or changes of the charge due to the touch, as read
        by an amplifier that was zeroed before the touch. By default that of the scene's readout, or
        total charges without a readout.
    unit : str, optional
        Unit of the readings, of `READING_UNITS`. Default: ``readout.unit``, which is V unless the
        scene says otherwise, or pC without a readout. A reading in nominal pC is that in V times
        the channel's capacitance in pF.
    touches : int
        Number of probes that touch at once, 1 or 2; 2 requires a scene.
    include_calibration : bool
        Whether standard deviations include the errors that the calibration of the sensor has left,
        of the scene's ``[calibration]``. They are the same for all touches, so that averaging does
        not reduce them.
    options : LocateOptions
        Numbers and tolerances of the search.
    progress : callable or bool, optional
        Function that is called with the number of finished and of expected solves if a scene is
        solved; or whether to show them, see `pvdf_fem.progress.show_progress`.

    Returns
    -------
    Location
        The touches, the most likely one first, with uncertainties, a status and notes.

    Raises
    ------
    ValueError
        If arguments are invalid; the message has a line for each mistake.

    Notes
    -----
    The error of the response is added to the standard deviations. It is assumed to be uniformly
    distributed within `response.error_bound` times the total charge and independent between
    electrodes.

    Examples
    --------
    >>> response = build_response("sensor.toml", tolerance=3e-2)
    >>> changes = {"A": 350.0, "B": 240.0, "C": 200.0, "D": 230.0}
    >>> print(locate(response, changes, sigma=0.01, reading="change"))
    """
    unknown = coerce("unknown", unknown, Names)
    known = coerce("known", known, dict[str, Any] | None)
    charge_function = response if isinstance(response, ChargeFunction) else None
    scene = as_scene(response) if charge_function is None else charge_function.scene
    if unit is None:
        unit = get_reading_unit(scene)
    request = _Request(
        readings_pC=_convert_readings_to_pC(scene, readings, unit),
        sigma=sigma,
        noise_pC=noise_pC,
        reading=reading,
        unit=unit,
        unknown=unknown,
        touches=touches,
        include_calibration=coerce("include_calibration", include_calibration, bool),
        options=options,
    )
    if charge_function is not None:
        return _locate_by_response(charge_function, request, known or {})
    if known:
        raise ValueError("known: cannot be combined with a scene; set the values in the scene")
    return _locate_by_solves(scene, request, progress)


@dataclass(frozen=True)
class _Request:
    """Arguments of `locate` except for the response and the known quantities."""

    readings_pC: Mapping[str, float]  #: Readings in nominal pC by electrode.
    sigma: Deviations
    noise_pC: Deviations | None
    reading: str | None
    unit: str
    unknown: Sequence[str]
    touches: int
    include_calibration: bool
    options: LocateOptions

    def find_errors(
        self, scene: Scene, unloaded_charges: UnloadedCharges | None = None
    ) -> Iterator[str]:
        """Yield an error message for each mistake in readings, unit and standard deviations."""
        return find_reading_errors(
            scene,
            self.readings_pC,
            sigma=self.sigma,
            noise_pC=self.noise_pC,
            reading=self.reading,
            unloaded_charges=unloaded_charges,
            unit=self.unit,
        )

    def make_measurement(self, response: ChargeFunction) -> Measurement:
        """Make the measurement of the electrodes with readings: channels and noise."""
        return Measurement.from_response(
            response,
            tuple(self.readings_pC),
            sigma=self.sigma,
            noise_pC=self.noise_pC,
            reading=self.reading,
            unit=self.unit,
            include_calibration=self.include_calibration,
        )

    @property
    def row(self) -> Array:
        """Readings in nominal pC as a single row; shape (1, electrodes)."""
        return np.array([list(self.readings_pC.values())], dtype=float)


def _convert_readings_to_pC(
    scene: Scene, readings: Mapping[str, float], unit: str
) -> Mapping[str, float]:
    """Convert readings to nominal pC.

    Parameters
    ----------
    scene : Scene
        Scene with the readout.
    readings : mapping
        Readings by electrode, or anything else.
    unit : str
        Unit of the readings; an unknown unit counts as pC.

    Returns
    -------
    mapping
        Readings in nominal pC by electrode. Values that are not numbers, and readings that are not
        a mapping, are returned as they are, for the validation to report.
    """
    if unit == "pC" or not isinstance(readings, Mapping):
        return readings
    units_pC = get_units_pC(scene, unit)
    converted = {}
    for name, value in readings.items():
        number = as_float(value)
        is_number = not math.isnan(number)
        converted[name] = units_pC.get(name, 1.0) * number if is_number else value
    return converted


def _locate_by_response(
    response: ChargeFunction, request: _Request, known: Mapping[str, float]
) -> Location:
    """Locate one touch from the charges of a response.

    If no touch explains the readings, common mistakes in the readings are tried. A `ValueError` is
    raised if arguments are invalid.

    Parameters
    ----------
    response : ChargeFunction
        The response of one probe.
    request : _Request
        Readings and options.
    known : mapping
        Values of fixed quantities by name; other fixed quantities have the values of the scene.
    """
    scene = response.scene
    errors = [*request.find_errors(scene, response.unloaded_charges_pC)]
    if request.touches != 1:
        reason = "must be 1 with a response, which describes one touch; give its scene instead"
        errors.append(f"touches = {request.touches}: {reason}")
    default = get_scene_quantities(scene)
    centre_mm = get_centre_mm(scene)
    errors += find_quantity_errors(response.domain, request.unknown, known, default, centre_mm)
    if errors:
        raise ValueError("\n".join(errors))
    fixed = _compute_fixed_coordinates({**default, **known}, request.unknown, centre_mm)
    columns = [i for i, name in enumerate(TOUCH_QUANTITIES) if name in request.unknown]
    unknown_columns = np.array(columns)
    measurement = request.make_measurement(response)
    problem = measurement.make_problem(request.row, unknown_columns)
    if not problem.is_determinable:
        return make_location(problem, None, request.options)
    ends = search_everywhere(problem, fixed, request.options)
    location = make_location(problem, ends, request.options)
    if location.explained:
        return location
    fixed_rows = {column: np.array([value]) for column, value in fixed.items()}
    explanations = []
    for found in find_explanations(measurement, request.row, unknown_columns, fixed_rows):
        touch = make_location(found.problem, found.ends, request.options).best
        explanations.append(Explanation(found.text, touch))
    return replace(location, explanations=tuple(explanations))


def _compute_fixed_coordinates(
    values: Mapping[str, float], unknown: Sequence[str], centre_mm: tuple[float, float]
) -> dict[int, float]:
    """Convert the values of the fixed quantities to coordinates, by column.

    Parameters
    ----------
    values : mapping
        Values of the quantities by name, in the frame of the stage.
    unknown : sequence of str
        Names of the free quantities.
    centre_mm : tuple of two floats
        Position x, y of the film's centre in this frame, which is the origin of coordinates.

    Returns
    -------
    dict of int to float
        Coordinates by the column of the quantity: positions in mm, the rotation in degrees and the
        logarithm of the force in N.
    """
    origin = (*centre_mm, 0.0, 0.0)
    fixed = {}
    for column, name in enumerate(TOUCH_QUANTITIES):
        if name not in unknown:
            fixed[column] = values[name] - origin[column]
    if TouchColumn.FORCE in fixed:
        fixed[TouchColumn.FORCE] = math.log(fixed[TouchColumn.FORCE])
    return fixed


def _locate_by_solves(
    scene: Scene, request: _Request, progress: Progress | bool | None
) -> Location:
    """Locate one touch or two simultaneous touches by full solves of a scene.

    A `ValueError` is raised if arguments are invalid.

    Parameters
    ----------
    scene : Scene
        The scene with one probe or a list of two.
    request : _Request
        Readings and options.
    progress : callable or bool, optional
        As for `locate`.
    """
    from pvdf_fem.inverse.touch.solved_charges import SolvedResponse  # imports gmsh
    from pvdf_fem.inverse.touch.superposition import search_touches_by_solves

    errors = list(request.find_errors(scene))
    if errors:
        raise ValueError("\n".join(errors))
    options = request.options
    solves_of_candidates = options.superposed_candidates * (1 + options.preliminary_steps)
    expected = solves_of_candidates + 10 * options.refined_candidates
    with show_progress("solves", progress) as show:
        response = SolvedResponse.from_scene(
            scene,
            request.touches,
            unknown=request.unknown,
            tolerance=options.tolerance,
            before_solve=SolveCounter(show, expected),
        )
        plain = replace(request, include_calibration=False)
        problem = plain.make_measurement(response).make_problem(request.row, response.unknown)
        ends = None
        if problem.is_determinable:
            ends = search_touches_by_solves(problem, response, options)
        if ends is not None and request.include_calibration and scene.calibration is not None:
            # The search takes no account of these errors, whose derivatives need further solves.
            distinct = ends.select(find_distinct_ends(problem, ends, options))
            problem = request.make_measurement(response).make_problem(request.row, response.unknown)
            ends = evaluate_ends(problem, distinct)
        return make_location(problem, ends, options)


def get_scene_quantities(scene: Scene) -> dict[str, float]:
    """Return position, rotation and force of a scene's probe by name, in the frame of its stage.

    Without a stage or a single probe the values of `extract_touch` are returned unchanged.
    """
    quantities = extract_touch(scene)
    if scene.stage is None or scene.single_probe is None:
        return quantities
    position_mm = [quantities["x_mm"], quantities["y_mm"]]
    on_stage_mm, rotation_deg = scene.stage.to_stage(position_mm, quantities["rotation_deg"])
    x_mm, y_mm = on_stage_mm.tolist()
    return {
        "x_mm": x_mm,
        "y_mm": y_mm,
        "rotation_deg": float(rotation_deg),
        "force_N": quantities["force_N"],
    }


@dataclass(frozen=True, eq=False)
class ProbeMatch:
    """One of several probes that may have touched, with its probability."""

    name: str  #: Name of the probe's response.
    #: Posterior probability that this probe touched, if all are equally likely a priori.
    weight: float
    location: Location  #: The likely touches of this probe.


def rank_probes(locations: Mapping[str, Location]) -> tuple[ProbeMatch, ...]:
    """Sort several probes by the posterior probability that each of them has touched.

    Parameters
    ----------
    locations : mapping
        Locations from the same charges, by the name of each probe's response.

    Returns
    -------
    tuple of ProbeMatch
        The probes, the most probable one first. All weights are zero if no probe has a touch.

    Notes
    -----
    By Bayes' rule the probabilities are proportional to the evidence of each probe, which is the
    probability density of the measured charges, averaged over all touches of the probe. The
    evidence is lower for a probe that can produce a wider variety of charges, if it fits equally
    well.
    """
    log_evidences = np.array([location.log_evidence for location in locations.values()])
    total = np.logaddexp.reduce(log_evidences)
    weights = np.zeros(len(log_evidences))
    if np.isfinite(total):
        weights = np.exp(log_evidences - total)
    matches = []
    for (name, location), weight in zip(locations.items(), weights.tolist(), strict=True):
        matches.append(ProbeMatch(name, weight, location))
    return tuple(sorted(matches, key=lambda match: -match.weight))

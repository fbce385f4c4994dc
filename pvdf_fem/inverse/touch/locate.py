"""Locate a touch from charges: position, force and rotation with their uncertainty.

`locate` finds every touch that may have given some readings, and `locate_many.locate_many` the most
likely touch for each of many rows of readings. Both maximise the likelihood of the charges under
independent normal errors. The result of `locate` also says why the best touch may not be the
answer: other touches are as likely, the charges do not determine a direction, no touch explains the
charges, or the touch is at the edge of the response's domain. `rank_probes` says which of several
probes touched.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pvdf_fem.arrays import Array
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
    make_location,
    search_everywhere,
)
from pvdf_fem.inverse.touch.validation import as_float, find_quantity_errors, find_reading_errors
from pvdf_fem.progress import Progress, SolveCounter, show_progress
from pvdf_fem.scene.arguments import Names, SceneLike, as_scene, coerce
from pvdf_fem.scene.scene import Scene
from pvdf_fem.surrogate.charge_function import ChargeFunction, UnloadedCharges
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, TouchColumn, extract_touch

PLACE_AND_FORCE = ("x_mm", "y_mm", "force_N")


def locate(
    response: ChargeFunction | SceneLike,
    readings: Mapping[str, float],
    sigma: Deviations = 0.01,
    *,
    unknown: Sequence[str] = PLACE_AND_FORCE,
    known: Mapping[str, float] | None = None,
    noise_pC: Deviations | None = None,
    reading: str | None = None,
    unit: str = "pC",
    touches: int = 1,
    options: LocateOptions = DEFAULT_OPTIONS,
    progress: Progress | bool | None = None,
) -> Location:
    """Find all touches that may have given some readings.

    Parameters
    ----------
    response : Response, Scene, or anything that `solve` accepts as a scene
        The response of the sensor to touches. A scene is solved again and again instead, which
        takes up to a minute; it also serves two `touches` at once, by its list of probes or by its
        one probe, and the unknowns ``"tangential_N"`` and ``"temperature_K"``.
    readings : mapping
        Readings of some or all electrodes by name. In nominal pC they are charges, if the channels
        of the scene's readout have no gain or offset.
    sigma, noise_pC : float or mapping
        Standard deviations of the readings, for all electrodes or by electrode: `sigma` over the
        charge or the change that is read, and `noise_pC` in pC. By default `noise_pC` is that of
        the readout.
    unknown : sequence of str
        Unknown quantities of every probe, of `TOUCH_QUANTITIES`.
    known : mapping, optional
        Values of the other quantities in the frame of the scene's stage; by default those of the
        scene. If `response` is a scene, they are always those of the scene.
    reading : {"total", "change"}, optional
        What is read: total charges, or their change by the touch, which an amplifier reads that was
        zeroed before the touch. By default that of the scene's readout, or else total charges.
    unit : {"pC", "V"}
        Unit of the readings; nominal pC are readings in V times the channel's capacitance in pF.
    touches : int
        Number of probes that touch at once; two need a scene.
    options : LocateOptions
        Numbers and tolerances of the search.
    progress : callable or bool, optional
        Called with the numbers of finished and of expected solves, if there are any; or whether
        these are shown, see `pvdf_fem.progress.show_progress`.

    Returns
    -------
    Location
        The touches, the most likely one first, with uncertainties, a status and remarks.

    Raises
    ------
    ValueError
        With a line for each mistake in the arguments.

    Notes
    -----
    The response's own error, evenly distributed within `response.error_bound` of the total charge,
    is added to the standard deviations. It is taken as independent between electrodes.

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
    request = _Request(
        readings_pC=_convert_to_pC(scene, readings, unit),
        sigma=sigma,
        noise_pC=noise_pC,
        reading=reading,
        unit=unit,
        unknown=unknown,
        touches=touches,
        options=options,
    )
    if charge_function is not None:
        return _locate_by_response(charge_function, request, known or {})
    if known:
        raise ValueError("known: cannot be combined with a scene; set the values in the scene")
    return _locate_by_solves(scene, request, progress)


@dataclass(frozen=True)
class _Request:
    """The arguments of `locate` except for the response."""

    readings_pC: Mapping[str, float]  #: Readings in nominal pC by electrode.
    sigma: Deviations
    noise_pC: Deviations | None
    reading: str | None
    unit: str
    unknown: Sequence[str]
    touches: int
    options: LocateOptions

    def find_errors(
        self, scene: Scene, unloaded_charges: UnloadedCharges | None = None
    ) -> Iterator[str]:
        """Find validation errors of readings, unit and standard deviations."""
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
        """Describe the readings of a response's electrodes."""
        return Measurement.from_response(
            response,
            tuple(self.readings_pC),
            sigma=self.sigma,
            noise_pC=self.noise_pC,
            reading=self.reading,
            unit=self.unit,
        )

    @property
    def row(self) -> Array:
        """The readings in nominal pC as a single row, (1, electrodes)."""
        return np.array([list(self.readings_pC.values())], dtype=float)


def _convert_to_pC(scene: Scene, readings: Mapping[str, float], unit: str) -> Mapping[str, float]:
    """Convert readings to nominal pC.

    Parameters
    ----------
    scene : Scene
        Scene with the readout.
    readings : mapping
        Readings by electrode. Values that are not numbers stay as they are, for the validation.
    unit : str
        Unit of the readings.
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
    """Locate one touch by a response.

    Parameters
    ----------
    response : ChargeFunction
        The response.
    request : _Request
        Readings and options.
    known : mapping
        Values of fixed quantities; the others have the scene's values.
    """
    scene = response.scene
    errors = [*request.find_errors(scene, response.unloaded_charges_pC)]
    if request.touches != 1:
        reason = "must be 1 with a response, which is of one touch; give its scene instead"
        errors.append(f"touches = {request.touches}: {reason}")
    default = get_scene_quantities(scene)
    centre_mm = get_centre_mm(scene)
    errors += find_quantity_errors(response.domain, request.unknown, known, default, centre_mm)
    if errors:
        raise ValueError("\n".join(errors))
    fixed = _fix_coordinates({**default, **known}, request.unknown, centre_mm)
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


def _fix_coordinates(
    values: Mapping[str, float], unknown: Sequence[str], centre_mm: tuple[float, float]
) -> dict[int, float]:
    """Return the coordinates of the fixed quantities by their column.

    Parameters
    ----------
    values : mapping
        Values of the quantities by name, in the frame of the stage.
    unknown : sequence of str
        Names of the free quantities.
    centre_mm : tuple of two floats
        Place of the film's centre in this frame, where coordinates have their origin.
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
    """Locate one touch or two at once by full solves of a scene.

    Parameters
    ----------
    scene : Scene
        The scene with the probes.
    request : _Request
        Readings and options.
    progress : callable or bool, optional
        As for `locate`.
    """
    from pvdf_fem.inverse.touch.solved_charges import SolvedResponse  # imports gmsh
    from pvdf_fem.inverse.touch.superposition import search_by_solves

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
        problem = request.make_measurement(response).make_problem(request.row, response.unknown)
        ends = None
        if problem.is_determinable:
            ends = search_by_solves(problem, response, options)
        return make_location(problem, ends, options)


def get_scene_quantities(scene: Scene) -> dict[str, float]:
    """Return place, rotation and force of a scene's probe by name, in the frame of its stage.

    A scene without a probe has the force alone.
    """
    quantities = extract_touch(scene)
    if scene.stage is None or scene.single_probe is None:
        return quantities
    place_mm = [quantities["x_mm"], quantities["y_mm"]]
    on_stage_mm, rotation_deg = scene.stage.to_stage(place_mm, quantities["rotation_deg"])
    x_mm, y_mm = on_stage_mm.tolist()
    return {
        "x_mm": x_mm,
        "y_mm": y_mm,
        "rotation_deg": float(rotation_deg),
        "force_N": quantities["force_N"],
    }


@dataclass(frozen=True, eq=False)
class ProbeMatch:
    """One of several probes that may have given the charges."""

    name: str  #: Name of its response.
    #: Probability of this probe given the charges, if all probes were equally likely before.
    weight: float
    location: Location  #: The touches of this probe.


def rank_probes(locations: Mapping[str, Location]) -> tuple[ProbeMatch, ...]:
    """Rank the probes that may have touched by their probability.

    Parameters
    ----------
    locations : mapping
        Locations of the same charges by the name of each probe's response.

    Returns
    -------
    tuple of ProbeMatch
        The most probable probe first.

    Notes
    -----
    By Bayes' rule the probabilities are proportional to the evidence of each probe, which is the
    probability density of the charges over all its touches. A probe that can give many different
    charges must therefore explain the measured ones better than a probe that can give few.
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

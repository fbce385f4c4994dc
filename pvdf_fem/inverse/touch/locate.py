"""From charges to the touch: position, force and rotation with their uncertainty.

`locate` finds every touch that may have given some charges, `locate_many.locate_many` the likeliest
touch for each of many rows of charges. Both maximise the likelihood of the charges under
independent normal errors. The result of `locate` also says what keeps the best touch from being the
answer: other touches as likely, directions that the charges do not determine, charges that no touch
explains, the edge of the model's domain. `rank_probes` tells which of several probes touched.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

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
from pvdf_fem.surrogate.charge_function import ChargeFunction
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, TouchColumn, extract_touch

PLACE_AND_FORCE = ("x_mm", "y_mm", "force_N")


def locate(
    model: ChargeFunction | SceneLike,
    charges_pC: Mapping[str, float],
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
    """All touches that may have given some charges, the likeliest first.

    Parameters
    ----------
    model : Model, Scene, or what `solve` takes for a scene
        A scene is solved again and again, which takes up to a minute, and serves two `touches` at
        once, of its list of probes or of its one probe, and the unknown ``"tangential_N"`` and
        ``"temperature_K"`` too (`solves.Solves`).
    charges_pC : mapping
        Readings in nominal pC of some or all of the model's electrodes: charges, if the channels
        of the scene's readout have no gain or offset. With a `unit` of V, readings in V.
    sigma, noise_pC : float or mapping
        Standard deviations, one for all or one by electrode: over the charge or the change that is
        read, and in pC besides, by default that of the readout.
    unknown : sequence of str
        Unknown quantities of every probe, from `TOUCH_QUANTITIES`.
    known : mapping, optional
        Values of the other quantities in the frame of the scene's stage; by default the scene's.
        With a scene they are the scene's.
    reading : str, optional
        ``"total"`` charges, or their ``"change"`` by the touch, as by an amplifier that was zeroed
        before it. By default that of the scene's readout, or else in total.
    unit : {"pC", "V"}
        Of the readings; nominal pC are readings in V times the channel's capacitance in pF.
    progress : callable or bool, optional
        Called with the numbers of finished and of expected solves, if there are any; or whether
        these are shown, see `pvdf_fem.progress.show_progress`.

    Raises
    ------
    ValueError
        With a line for each mistake in the arguments.

    Notes
    -----
    The model's own error, evenly distributed within `model.error_bound` of the total charge, is
    added to the standard deviations. It is taken as independent between electrodes.

    Examples
    --------
    >>> response = build_response("sensor.toml", tolerance=3e-2)
    >>> changes = {"A": 350.0, "B": 240.0, "C": 200.0, "D": 230.0}
    >>> print(locate(response, changes, sigma=0.01, reading="change"))
    """
    noise, unknown = (sigma, noise_pC, reading), coerce("unknown", unknown, Names)
    known = coerce("known", known, dict[str, Any] | None)
    scene = model.scene if isinstance(model, ChargeFunction) else as_scene(model)
    given = _in_pC(scene, charges_pC, unit)
    if not isinstance(model, ChargeFunction):
        if known:
            raise ValueError("known: a scene has what is known; change the scene")
        return _by_solves(scene, given, unit, noise, unknown, touches, options, progress)
    wrong = [*find_reading_errors(scene, given, *noise, model.unloaded_charges_pC, unit)]
    if touches != 1:
        wrong.append(f"touches = {touches}: a response is of one; give its scene instead")
    default, origin = get_scene_quantities(scene), (*get_centre_mm(scene), 0.0, 0.0)
    wrong += find_quantity_errors(model.domain, unknown, known or {}, default, origin[:2])
    if wrong:
        raise ValueError("\n".join(wrong))
    sought = np.array([i for i, name in enumerate(TOUCH_QUANTITIES) if name in unknown])
    values = {**default, **(known or {})}
    fixed = {i: values[n] - origin[i] for i, n in enumerate(TOUCH_QUANTITIES) if n not in unknown}
    if TouchColumn.FORCE in fixed:
        fixed[TouchColumn.FORCE] = math.log(fixed[TouchColumn.FORCE])
    measurement = Measurement.from_response(model, tuple(given), *noise, unit)
    readings = np.array([[*given.values()]], dtype=float)
    problem = measurement.make_problem(readings, sought)
    if not problem.is_determinable:
        return make_location(problem, None, options)
    found = make_location(problem, search_everywhere(problem, fixed, options), options)
    if found.explained:
        return found
    held = {i: np.array([value]) for i, value in fixed.items()}
    mistakes = find_explanations(measurement, readings, sought, held)
    right = (
        Explanation(text, make_location(of, ends, options).best) for text, of, ends, _ in mistakes
    )
    return replace(found, explanations=tuple(right))


def _in_pC(scene: Scene, readings: Mapping[str, float], unit: str) -> Mapping[str, float]:
    """Readings in nominal pC; what is no number of an electrode is left as it is."""
    units = get_units_pC(scene, unit)
    if unit == "pC" or not isinstance(readings, Mapping):
        return readings
    return {
        name: value if math.isnan(as_float(value)) else units.get(name, 1.0) * as_float(value)
        for name, value in readings.items()
    }


def _by_solves(
    scene: Scene,
    charges_pC: Mapping[str, float],
    unit: str,
    noise: tuple[Deviations, Deviations | None, str | None],
    unknown: Sequence[str],
    touches: int,
    options: LocateOptions,
    progress: Progress | bool | None,
) -> Location:
    """`locate` with a scene; `noise` has its sigma, noise_pC and reading."""
    from pvdf_fem.inverse.touch.solved_charges import SolvedResponse  # with gmsh
    from pvdf_fem.inverse.touch.superposition import search_by_solves

    if wrong := [*find_reading_errors(scene, charges_pC, *noise, unit=unit)]:
        raise ValueError("\n".join(wrong))
    expected = options.starts * (1 + options.first_steps) + 10 * options.followed
    with show_progress("solves", progress) as show:
        solves = SolvedResponse.from_scene(
            scene, touches, unknown, options.tolerance, SolveCounter(show, expected)
        )
        measurement = Measurement.from_response(solves, tuple(charges_pC), *noise, unit)
        readings = np.array([[*charges_pC.values()]], dtype=float)
        problem = measurement.make_problem(readings, solves.unknown)
        ends = search_by_solves(problem, solves, options) if problem.is_determinable else None
        return make_location(problem, ends, options)


def get_scene_quantities(scene: Scene) -> dict[str, float]:
    """The quantities of a scene's touch by name, in the frame of its stage."""
    touch = extract_touch(scene)
    if scene.stage is None or scene.single_probe is None:
        return touch
    x, y, rotation, force = touch.values()
    place, turned = scene.stage.to_stage([x, y], rotation)
    return dict(zip(TOUCH_QUANTITIES, (*place.tolist(), float(turned), force), strict=True))


@dataclass(frozen=True, eq=False)
class ProbeMatch:
    """One probe among several that may have given the charges."""

    name: str  #: Name of its model.
    #: Probability of this probe given the charges, if all probes were equally likely before.
    weight: float
    location: Location  #: The touches of this probe.


def rank_probes(locations: Mapping[str, Location]) -> tuple[ProbeMatch, ...]:
    """The probes that may have touched, the most probable first, from the locations of the charges
    by the name of each probe's model. Bayes' rule is applied to the probability density of the
    charges over all touches of each probe. A probe that can give many different charges must
    explain the measured charges better than a probe that can give few."""
    logs = np.array([location.log_evidence for location in locations.values()])
    total = np.logaddexp.reduce(logs)
    weights = (np.exp(logs - total) if np.isfinite(total) else 0.0 * logs.clip(0.0)).tolist()
    matches = map(ProbeMatch, locations, weights, locations.values())
    return tuple(sorted(matches, key=lambda probe: -probe.weight))

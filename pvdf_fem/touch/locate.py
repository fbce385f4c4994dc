"""From charges to the touch: position, force and rotation with their uncertainty.

`locate` finds every touch that may have given some charges, `locate_many.locate_many` the likeliest
touch for each of many rows of charges. Both maximise the likelihood of the charges under
independent normal errors. The result of `locate` also says what keeps the best touch from being the
answer: other touches as likely, directions that the charges do not determine, charges that no touch
explains, the edge of the model's domain. `weigh` tells which of several probes touched.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.readout.channel import READINGS, channels, units_pC
from pvdf_fem.response.model import FORCE, QUANTITIES, ROTATION, Model, X, Y, period_deg, touch_of
from pvdf_fem.scene.scene import Scene
from pvdf_fem.touch.least_squares import Descent, SearchOptions, descend, joined
from pvdf_fem.touch.location import Location
from pvdf_fem.touch.measurement import Deviations, Measurement, centre_mm
from pvdf_fem.touch.mistakes import charge_mistakes, known_mistakes
from pvdf_fem.touch.problem import Problem
from pvdf_fem.touch.starts import starts
from pvdf_fem.touch.touch import Touch, p_values

if TYPE_CHECKING:
    from pvdf_fem.touch.by_solves import SolveOptions, Touches

PLACE_AND_FORCE = ("x_mm", "y_mm", "force_N")


@dataclass(frozen=True)
class LocateOptions:
    """Which touches are listed, and how they are searched for. At a fold of the charges two touches
    close together have almost the same charges, and a search on one side of the fold does not see
    the touch on the other side. A fold is near where the longest step along some direction changes
    the charges by less than a small share of themselves."""

    #: A touch is listed unless its chi-square exceeds the least by more than this: at 25 it is e^12
    #: times less likely.
    listed: float = 25.0
    #: Two ends of searches are one touch if chi-square, by its slopes at the better end, and the
    #: rotation differ by less than these between them.
    same: float = 0.1
    same_deg: float = 8.0
    fold: float = 0.02  #: Share of the charges by which the longest step changes them near a fold.
    #: Standard deviations that this share must exceed to tell one side of the fold from the other.
    resolved: float = 10.0
    #: Starts about the fold, in longest steps along the direction.
    offsets: tuple[float, ...] = (-0.3, -0.1, -0.03, 0.0, 0.03, 0.1, 0.3)
    #: Of the searches, and of those about a fold, where steps shrink slowly.
    search: SearchOptions = field(default_factory=SearchOptions)
    fold_search: SearchOptions = field(default_factory=lambda: SearchOptions(short=1e-4))


DEFAULTS = LocateOptions()


@overload
def locate(
    model: Scene, charges_pC: Mapping[str, float], sigma: Deviations = ..., **how: Any
) -> tuple[Touches, ...]: ...
@overload
def locate(
    model: Model, charges_pC: Mapping[str, float], sigma: Deviations = ..., **how: Any
) -> Location: ...
def locate(  # type: ignore[misc]  # the overloads leave its keywords out
    model: Model | Scene,
    charges_pC: Mapping[str, float],
    sigma: Deviations = 0.01,
    *,
    unknown: Sequence[str] = PLACE_AND_FORCE,
    known: Mapping[str, float] | None = None,
    noise_pC: Deviations | None = None,
    reading: str | None = None,
    touches: int = 1,
    options: LocateOptions | SolveOptions | None = None,
) -> Location | tuple[Touches, ...]:
    """All touches that may have given some charges, the likeliest first.

    Parameters
    ----------
    model : Model or Scene
        A scene is solved again and again, which takes up to a minute, and serves two `touches` at
        once and the unknown ``"tangential_N"`` and ``"temperature_K"`` too: see
        `by_solves.locate_by_solves`.
    charges_pC : mapping
        Readings in nominal pC of some or all of the model's electrodes: charges, if the channels
        of the scene's readout have no gain or offset.
    sigma, noise_pC : float or mapping
        Standard deviations, one for all or one by electrode: over the charge or the change that is
        read, and in pC besides, by default that of the readout.
    unknown : sequence of str
        What is sought, of `QUANTITIES`.
    known : mapping, optional
        Values of the other quantities in the frame of the scene's stage; by default the scene's.
    reading : str, optional
        ``"total"`` charges, or their ``"change"`` by the touch, as by an amplifier that was zeroed
        before it. By default that of the scene's readout, or else in total.

    Raises
    ------
    ValueError
        With a line for each mistake in the arguments.

    Notes
    -----
    The model's own error, evenly distributed within `model.error_bound` of the total charge, is
    added to the standard deviations. It is taken as independent between electrodes.
    """
    if isinstance(model, Scene):
        from pvdf_fem.touch.by_solves import SolveOptions, locate_by_solves  # with gmsh

        asked: dict[str, Any] = {"touches": touches, "noise_pC": noise_pC, "reading": reading}
        if known:
            raise ValueError("known: a scene has what is known; change the scene")
        asked["options"] = _options(options, SolveOptions, "scene")
        return locate_by_solves(model, charges_pC, sigma, unknown=unknown, **asked)
    how = _options(options, LocateOptions, "response")
    if touches != 1:
        raise ValueError(f"touches = {touches}: a response is of one; give its scene instead")
    default = staged_touch(model.scene)
    mistakes = [*charge_mistakes(model.scene, charges_pC, sigma, noise_pC, reading)]
    origin = *centre_mm(model.scene), 0.0, 0.0
    mistakes += known_mistakes(model.domain, unknown, known or {}, default, origin)
    if mistakes:
        raise ValueError("\n".join(mistakes))
    sought = np.array([i for i, name in enumerate(QUANTITIES) if name in unknown])
    values = {**default, **(known or {})}
    fixed = {i: values[n] - origin[i] for i, n in enumerate(QUANTITIES) if n not in unknown}

    def found(measurement: Measurement, factor: Array | float = 1.0) -> Location:
        readings = factor * np.array([list(charges_pC.values())], dtype=float)
        problem = measurement.problem(readings, sought)
        ends = search(problem, fixed, how)
        return replace(location(problem, ends, how), reading=measurement.reading)

    measurement = Measurement.of(model, tuple(charges_pC), sigma, noise_pC, reading)
    best = found(measurement)
    if best.explained:
        return best
    for words, (meant, factor) in _meant_otherwise(measurement).items():
        other = found(meant, factor)
        if other.explained:
            return replace(best, other_reading=other.best, other_words=words)
    return best


def _options(given: Any, kind: type, what: str) -> Any:
    if not isinstance(given, kind | None):
        raise ValueError(f"options: {type(given).__name__} suits no {what}; give {kind.__name__}")
    return given or kind()


def _meant_otherwise(measurement: Measurement) -> dict[str, tuple[Measurement, Array | float]]:
    """What readings may be instead of what they were taken for, and the factors that undo it."""
    scene, other = measurement.model.scene, measurement.other
    units = units_pC([channels(scene)[i] for i in measurement.electrodes])
    factors: dict[str, Array | float] = {"with the opposite sign": -1.0}
    if scene.readout:
        factors |= {"as V, not pC,": units["V"], "as pC, not V,": 1.0 / units["V"]}
    factors |= {f"as {unit}, not pC,": units[unit] for unit in ("nC", "fC", "µC", "C")}
    by_factor = {words: (measurement, factor) for words, factor in factors.items()}
    as_other = {f"as {READINGS[other.reading]}": (other, 1.0)} if other else {}
    return {**as_other, **by_factor}


def staged_touch(scene: Scene) -> dict[str, float]:
    """The quantities of a scene's touch by name, in the frame of its stage."""
    touch = touch_of(scene)
    if scene.stage is None or scene.single_probe is None:
        return touch
    x, y, rotation, force = touch.values()
    place, turned = scene.stage.to_stage([x, y], rotation)
    return dict(zip(QUANTITIES, (*place.tolist(), float(turned), force), strict=True))


def search(problem: Problem, known: Mapping[int, float], options: LocateOptions) -> Descent:
    """Searches from everywhere for the touch of a problem. `known` are coordinates by their index
    in `QUANTITIES`. A sought rotation is held at first, at many values: a few degrees change
    charges by less than the pitch of the table of starts does."""
    charges, spread = problem.charges_pC[0], problem.deviations_pC[0]
    at = starts(problem.model, charges, spread, problem.electrodes, known)
    without_rotation = problem.unknown[problem.unknown != ROTATION]
    if 0 < len(without_rotation) < len(problem.unknown):
        at = descend(replace(problem, unknown=without_rotation), at, options=options.search).at
    ends = descend(problem, at, hopeless=options.listed, options=options.search)
    # each on its own, as searches that come close to each other would go on as one
    about_fold = _starts_about_fold(problem, ends, options)[:, None]
    return joined([ends, *(descend(problem, at, options=options.fold_search) for at in about_fold)])


def _starts_about_fold(problem: Problem, ends: Descent, options: LocateOptions) -> Array:
    """Starts (n, 4) on both sides of a fold of the charges, if one is near the best end."""
    none, moving = ends.at[:0], problem.moving
    size = float(np.linalg.norm(problem.charges_pC / problem.deviations_pC))
    resolved = options.fold * size >= options.resolved and len(problem.electrodes) > len(moving)
    if not resolved or not ends.arrived.any():
        return none
    best = ends.ranking.argmin()
    longest = problem.longest[moving]
    _, values, vectors = np.linalg.svd(ends.slopes[best][:, moving] * longest)
    if values[-1] > options.fold * size:
        return none
    at = np.tile(ends.at[best], (len(options.offsets), 1))
    at[:, moving] += np.outer(options.offsets, vectors[-1] * longest)
    return at


def location(problem: Problem, ends: Descent, options: LocateOptions = DEFAULTS) -> Location:
    """The location whose touches are the distinct ends of searches for one touch."""
    ends = ends.take(_distinct(problem, ends, options))
    names = tuple(QUANTITIES[i] for i in problem.unknown.tolist())
    freedom = len(problem.electrodes) - len(names)
    if not ends.arrived.size:
        return Location((), names, freedom, -np.inf, problem)
    extent = extents(problem.model)
    # likelihood times a normal prior of the domain's extents, integrated by Laplace's method
    slopes = ends.slopes * extent
    normal = np.matmul(slopes.swapaxes(1, 2), slopes) + np.eye(len(extent))
    logs = -0.5 * (ends.chi_square + np.log(np.linalg.det(normal)))
    total = float(np.logaddexp.reduce(logs))
    values, scale = problem.touches(ends.at), np.ones(ends.at.shape)
    scale[:, FORCE] = values[:, FORCE]
    columns = (
        (ends.slopes / scale[:, None]).take(problem.unknown, axis=2),
        (extent * scale).take(problem.unknown, axis=1),
        ends.chi_square.tolist(),
        p_values(ends.chi_square, freedom).tolist(),
        np.exp(logs - total).tolist(),
        edges(problem, ends.at),
    )
    touches = (
        Touch(names, *attributes, *touch)
        for touch, *attributes in zip(values.tolist(), *columns, strict=True)
    )
    spread = math.log(2.0 * math.pi) / 2.0 + np.log(problem.deviations_pC[0])
    return Location(tuple(touches), names, freedom, total - float(spread.sum()), problem)


def _distinct(problem: Problem, ends: Descent, options: LocateOptions) -> Indices:
    """The likely ends of searches that do not repeat a better one, the best first."""
    ranking = ends.ranking
    order = ranking.argsort(kind="stable")
    rows = order[ranking[order] <= ranking.min() + options.listed]
    rows = rows[ends.arrived[rows]]
    period, distinct = period_deg(problem.model), rows[:0]
    while len(rows) > 1:
        apart = ends.at[rows] - ends.at[rows[0]]
        apart[:, ROTATION] -= period * np.rint(apart[:, ROTATION] / period)
        same = np.square(apart @ ends.slopes[rows[0]].T).sum(axis=1) < options.same
        same &= np.abs(apart[:, ROTATION]) < options.same_deg
        distinct, rows = np.append(distinct, rows[0]), rows[~same]
    return np.append(distinct, rows)


@lru_cache(maxsize=8)
def extents(model: Model) -> Array:
    """Size of a model's domain in each coordinate, (4,)."""
    lowest, highest = model.domain.log_force
    reach_mm = model.domain.reach_mm
    return np.array([reach_mm, reach_mm, 0.5 * period_deg(model), highest - lowest])


def edges(problem: Problem, at: Array) -> list[tuple[str, ...]]:
    """Which limits of the domain each of the touches `at` (n, 4) is at, or beyond."""
    reach_mm, (lowest, highest) = problem.model.domain.reach_mm, problem.model.domain.log_force
    sought = problem.unknown.tolist()
    placed, pressed = X in sought or Y in sought, FORCE in sought
    limits = []
    for x, y, _, force in at.tolist():
        far = placed and math.hypot(x, y) >= reach_mm
        extreme = pressed and not lowest < force < highest
        limits.append(("reach_mm",) * far + ("force_N",) * extreme)
    return limits


@dataclass(frozen=True, eq=False)
class ProbeMatch:
    """One probe among several that may have given the charges."""

    name: str  #: Name of its model.
    #: Probability of this probe given the charges, if all probes were equally likely before.
    weight: float
    location: Location  #: The touches of this probe.


def weigh(
    models: Mapping[str, Model],
    charges_pC: Mapping[str, float],
    sigma: Deviations = 0.01,
    *,
    unknown: Sequence[str] = QUANTITIES,
    **options: Any,
) -> tuple[ProbeMatch, ...]:
    """The probes that may have touched, the most probable first, from their models by name. Bayes'
    rule is applied to the probability density of the charges over all touches of each probe. A
    probe that can give many different charges must explain the measured ones better than a probe
    that can give few. The other arguments are those of `locate`."""
    if not models:
        raise ValueError("models: none given; give one for each probe in question")
    options |= {"sigma": sigma, "unknown": unknown}
    return match({name: locate(model, charges_pC, **options) for name, model in models.items()})


def match(locations: Mapping[str, Location]) -> tuple[ProbeMatch, ...]:
    """Locations of the same charges with different probes, the most probable first."""
    logs = np.array([location.log_evidence for location in locations.values()])
    total = np.logaddexp.reduce(logs)
    weights = (np.exp(logs - total) if np.isfinite(total) else 0.0 * logs.clip(0.0)).tolist()
    matches = map(ProbeMatch, locations, weights, locations.values())
    return tuple(sorted(matches, key=lambda probe: -probe.weight))

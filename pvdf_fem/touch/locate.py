"""From charges to the touch: position, force and rotation with their uncertainty.

`locate` finds every touch that may have given some charges (`pvdf_fem.touch.locate_many` the
likeliest one of each of many): it maximises the likelihood of the charges under independent normal
errors. Whatever keeps the result from being an answer is in it: other touches as likely, directions
that the charges do not determine, charges that no touch explains, the edge of the model's domain.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincc

from pvdf_fem.touch.descent import LONGEST, Descent, Problem, descend, joined
from pvdf_fem.touch.few_searches import FEW, descend_few
from pvdf_fem.touch.location import Location
from pvdf_fem.touch.starts import starts
from pvdf_fem.touch.touch import (
    FORCE,
    QUANTITIES,
    ROTATION,
    Domain,
    Model,
    Touch,
    X,
    Y,
    period_deg,
)

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

PLACE_AND_FORCE = ("x_mm", "y_mm", "force_N")

# A touch is listed unless chi-square exceeds the least by this: then it is e^12 times less likely.
_LISTED = 25.0
# Charges may fold where the longest step along some direction changes them by less than this share
# of themselves. If that is less than so many standard deviations noise hides which side is right.
# The other side is sought so far along the direction, in longest steps.
_FOLD, _HIDDEN = 0.02, 10.0
_ALONG = np.array([-0.3, -0.1, -0.03, 0.0, 0.03, 0.1, 0.3])
# Near a fold steps shrink slowly: the last one is shorter than this share of the longest.
_EXACT = 1e-4
# Two ends of searches are one touch if they are this close (mm, mm, degrees, logarithm of the
# force), and by the curvature of chi-square too.
_SAME = np.array([0.5, 0.5, 8.0, 0.3])
_SAME_CHI_SQUARE = 0.1


def locate(
    model: Model,
    charges_pC: Mapping[str, float],
    sigma: float | Mapping[str, float] = 0.01,
    *,
    unknown: Sequence[str] = PLACE_AND_FORCE,
    known: Mapping[str, float] | None = None,
    noise_pC: float = 0.0,
) -> Location:
    """All touches that may have given some charges, the likeliest first.

    Parameters
    ----------
    model : Model
    charges_pC : mapping
        Measured charges of some or all of the model's electrodes.
    sigma : float or mapping
        Relative standard deviation of the charges, of all or by electrode.
    unknown : sequence of str
        What is sought, of `QUANTITIES`.
    known : mapping, optional
        Values of the other quantities; by default those of the model's scene.
    noise_pC : float
        A standard deviation in pC that every charge has besides.

    Returns
    -------
    Location

    Raises
    ------
    ValueError
        Listing all mistakes, a line each: charges of electrodes that the model has not, numbers
        that are not finite, quantities that are both sought and known, known ones out of the
        model's domain, no standard deviation at all.

    Notes
    -----
    The model's own error, evenly distributed within `model.error_bound`, is added to the standard
    deviations. It is taken as independent between electrodes.
    """
    mistakes = [*charge_mistakes(model.names, charges_pC, sigma, noise_pC)]
    default = _of_scene(model)
    mistakes += known_mistakes(model.domain, unknown, known or {}, default)
    if not (mistakes or model.error_bound or noise_pC or np.min(_relative(sigma, charges_pC))):
        mistakes.append("sigma = 0: the model has no error of its own; give a positive one")
    if mistakes:
        raise ValueError("\n".join(mistakes))
    electrodes = np.array([model.names.index(name) for name in charges_pC])
    charges = np.array(list(charges_pC.values()), dtype=float)
    spread = deviations(model, charges, _relative(sigma, charges_pC), noise_pC)
    sought = np.array([i for i, name in enumerate(QUANTITIES) if name in unknown], dtype=np.intp)
    values = {**default, **(known or {})}
    rest = {i: float(values[n]) for i, n in enumerate(QUANTITIES) if n not in unknown}
    problem = Problem(model, electrodes, charges[None], spread[None], sought)
    return location(problem, search(problem, 0, rest))


def search(problem: Problem, touch: int, known: dict[int, float]) -> Descent:
    """Searches from everywhere for one of a problem's touches.

    A sought rotation is held at first, at many values: a few degrees change charges by less than
    the table's pitch of places does.
    """
    if len(problem.charges_pC) > 1:
        charges, spread = problem.charges_pC[[touch]], problem.deviations_pC[[touch]]
        problem = replace(problem, charges_pC=charges, deviations_pC=spread)
    charges, spread = problem.charges_pC[0], problem.deviations_pC[0]
    at = starts(problem.model, charges, spread, problem.electrodes, known)
    others = problem.unknown[problem.unknown != ROTATION]
    if 0 < len(others) < len(problem.unknown):
        at = _descended(replace(problem, unknown=others), at, np.inf).at
    ends = _descended(problem, at, _LISTED)
    # one by one: together those that come close go on as one
    about = _about_fold(problem, ends)
    across = [descend_few(problem, start[None], short=_EXACT) for start in about]
    return joined([ends, *across]) if across else ends


def _about_fold(problem: Problem, ends: Descent) -> Array:
    """Starts (n, 4) on both sides of a fold at the best end of searches, if one is near.

    Where charges turn along a direction two touches close together have almost the same ones, and a
    search on one side of the fold between them does not see the other. Charges tell which it is if
    they are as exact as that, and more than the unknown.
    """
    none, moving = np.empty((0, 4)), problem.moving
    size = float(np.linalg.norm(problem.charges_pC / problem.deviations_pC))
    few = len(problem.electrodes) <= len(moving)
    if few or _FOLD * size < _HIDDEN or not ends.arrived.any():
        return none
    best = np.where(ends.arrived, ends.chi_square, np.inf).argmin()
    longest = LONGEST * problem.scale
    _, values, vectors = np.linalg.svd(ends.slopes[best][:, moving] * longest[moving])
    if values[-1] > _FOLD * size:
        return none
    at = np.tile(ends.at[best], (len(_ALONG), 1))
    at[:, moving] += _ALONG[:, None] * vectors[-1] * longest[moving]
    return at


def _descended(problem: Problem, at: Array, hopeless: float) -> Descent:
    if len(at) <= FEW:
        return descend_few(problem, at, hopeless)
    return descend(problem, at, np.zeros(len(at), dtype=np.intp), hopeless)


def _relative(sigma: float | Mapping[str, float], charges_pC: Mapping[str, float]) -> Array:
    return np.array([sigma[n] for n in charges_pC] if isinstance(sigma, Mapping) else sigma)


def deviations(model: Model, charges: Array, relative: Array, noise_pC: float) -> Array:
    """Standard deviations in pC of charges: measured, the amplifier's, and the model's own."""
    own = model.error_bound / math.sqrt(3.0)
    return np.sqrt((relative**2 + own**2) * charges**2 + noise_pC**2)


@lru_cache(maxsize=8)
def _of_scene(model: Model) -> Mapping[str, float]:
    probe, force_N = model.scene.probe, model.scene.load.force_N
    if probe is None:
        return {"force_N": force_N}
    place = {"x_mm": probe.x_mm, "y_mm": probe.y_mm, "rotation_deg": probe.rotation_deg}
    return {**place, "force_N": force_N}


# -------------------------------------------------------------------------------------- mistakes


def charge_mistakes(
    names: Sequence[str],
    charges_pC: Mapping[str, float],
    sigma: float | Mapping[str, float],
    noise_pC: float,
) -> Iterator[str]:
    """What is wrong with measured charges and their deviations."""
    if not charges_pC:
        yield f"charges: none given; give some of {', '.join(names)}"
    for name, charge in charges_pC.items():
        if name not in names:
            yield f"charges.{name}: no such electrode; choose from {', '.join(names)}"
        elif not abs(charge) <= 1e12:
            yield f"charges.{name} = {charge}: give a charge in pC"
    each = sigma if isinstance(sigma, Mapping) else {"": sigma}
    for name in charges_pC if isinstance(sigma, Mapping) else ():
        if name not in each:
            yield f"sigma.{name}: missing; give one for each charge, or one number for all"
    for name, value in each.items():
        if not 0.0 <= value <= 1.0:
            yield f"sigma{'.' * bool(name)}{name} = {value}: give a share of the charge, 0 to 1"
    if not 0.0 <= noise_pC < math.inf:
        yield f"noise_pC = {noise_pC}: give a standard deviation in pC, not negative"
    elif not noise_pC and any(charge == 0.0 for charge in charges_pC.values()):
        yield "noise_pC = 0: a charge of 0 has no deviation then; give that of the amplifier"


def known_mistakes(
    domain: Domain,
    unknown: Sequence[str],
    known: Mapping[str, float],
    default: Mapping[str, float],
) -> Iterator[str]:
    """What is wrong with the quantities sought and known; `default` has those of the scene."""
    names = ", ".join(QUANTITIES)
    if not unknown:
        yield f"unknown: nothing is sought; choose from {names}"
    for name in dict.fromkeys([*unknown, *known]):
        if name not in QUANTITIES:
            yield f"{name}: no quantity of a touch; choose from {names}"
        elif name in unknown and name in known:
            yield f"{name}: both sought and known; remove one"
        elif name in known and not math.isfinite(known[name]):
            yield f"known.{name} = {known[name]}: give a finite number"
    fixed = {n: v for n, v in {**default, **known}.items() if n not in unknown}
    reach, (lowest, highest) = domain.reach_mm, domain.force_N
    distance = math.hypot(fixed.get("x_mm", 0.0), fixed.get("y_mm", 0.0))
    if distance > reach:
        place = ", ".join(f"{n} = {fixed[n]:g}" for n in ("x_mm", "y_mm") if n in fixed)
        yield f"known {place}: beyond the {reach:g} mm that the model reaches; build a larger one"
    if not lowest <= fixed.get("force_N", lowest) <= highest:
        yield (
            f"known force_N = {fixed['force_N']:g}: out of the model's {lowest:g} to {highest:g} "
            "N; build one for it"
        )


# --------------------------------------------------------------------------------------- results


def location(problem: Problem, ends: Descent) -> Location:
    """The distinct touches among the ends of searches for one touch."""
    keep = _distinct(problem, ends)
    names = tuple(QUANTITIES[i] for i in problem.unknown.tolist())
    freedom = len(problem.electrodes) - len(names)
    if not keep.size:
        return Location((), names, freedom, -np.inf, problem)
    at, slopes, chi_square = ends.at[keep], ends.slopes[keep], ends.chi_square[keep]
    extent = extents(problem.model)
    logs = _log_masses(slopes * extent, chi_square)
    total = float(np.logaddexp.reduce(logs))
    values, scale = at.copy(), np.ones(at.shape)
    values[:, FORCE] = scale[:, FORCE] = np.exp(at[:, FORCE])
    if QUANTITIES[ROTATION] in names:
        values[:, ROTATION] %= period_deg(problem.model)
    columns = (
        (slopes / scale[:, None]).take(problem.unknown, axis=2),
        (extent * scale).take(problem.unknown, axis=1),
        chi_square.tolist(),
        p_values(chi_square, freedom).tolist(),
        np.exp(logs - total).tolist(),
        edges(problem, at),
    )
    touches = (
        Touch(x, y, rotation, force, names, *row)
        for (x, y, rotation, force), *row in zip(values.tolist(), *columns, strict=True)
    )
    spread = math.log(2.0 * math.pi) / 2.0 + np.log(problem.deviations_pC[0])
    return Location(tuple(touches), names, freedom, total - float(spread.sum()), problem)


def _distinct(problem: Problem, ends: Descent) -> Indices:
    """The likely ends of searches that are no repetition of a better one, the best first."""
    rows = zip(ends.chi_square.tolist(), ends.arrived.tolist(), strict=True)
    best_first = sorted((value, row) for row, (value, arrived) in enumerate(rows) if arrived)
    likely = [row for value, row in best_first if value <= best_first[0][0] + _LISTED]
    keep = np.array(likely, dtype=np.intp)
    period = period_deg(problem.model)
    k = 1
    while k < len(keep):
        best, others = keep[k - 1], keep[k:]
        apart = ends.at[others] - ends.at[best]
        apart[:, ROTATION] -= period * np.rint(apart[:, ROTATION] / period)
        # by the slopes of the better one
        same = np.square(apart @ ends.slopes[best].T).sum(axis=1) < _SAME_CHI_SQUARE
        same &= (np.abs(apart) < _SAME).all(axis=1)
        keep = np.concatenate([keep[:k], others[~same]])
        k += 1
    return keep


@lru_cache(maxsize=8)
def extents(model: Model) -> Array:
    """Size of a model's domain in each coordinate, (4,)."""
    reach_mm, (lowest, highest) = model.domain.reach_mm, model.domain.force_N
    return np.array([reach_mm, reach_mm, 0.5 * period_deg(model), math.log(highest / lowest)])


def _log_masses(slopes: Array, chi_square: Array) -> Array:
    """Logarithm of likelihood times prior integrated about each touch (Laplace), (n,).

    The prior is normal with the domain's extents about the touch, so that a direction which the
    charges do not determine counts with the domain's size and not with infinity. `slopes`
    (n, electrodes, 4) are by coordinates over these.
    """
    normal = np.matmul(slopes.swapaxes(1, 2), slopes) + np.eye(slopes.shape[2])
    return -0.5 * (chi_square + np.log(np.linalg.det(normal)))


def p_values(chi_square: Array, freedom: int) -> Array:
    """Probabilities of a larger chi-square if the model is right; NaN without freedom."""
    if freedom <= 0:
        return np.full(len(chi_square), np.nan)
    return gammaincc(0.5 * freedom, 0.5 * chi_square)


def edges(problem: Problem, at: Array) -> list[tuple[str, ...]]:
    """Which limits of the domain touches (n, 4) are at, or beyond."""
    domain, held = problem.model.domain, []
    lowest, highest = map(math.log, domain.force_N)
    sought = problem.unknown.tolist()
    placed, pressed = X in sought or Y in sought, FORCE in sought
    for x, y, _, force in at.tolist():
        far = placed and math.hypot(x, y) >= domain.reach_mm
        limits = (("reach_mm", far), ("force_N", pressed and not lowest < force < highest))
        held.append(tuple(name for name, is_held in limits if is_held))
    return held


# ---------------------------------------------------------------------------------------- shapes


@dataclass(frozen=True, eq=False)
class Choice:
    """A model of one probe among several, and what it makes of the charges.

    Attributes
    ----------
    name : str
    weight : float
        Probability that the charges are of this probe, if each was as likely before.
    location : Location
    """

    name: str
    weight: float
    location: Location


def weigh(
    models: Mapping[str, Model],
    charges_pC: Mapping[str, float],
    sigma: float | Mapping[str, float] = 0.01,
    *,
    unknown: Sequence[str] = QUANTITIES,
    known: Mapping[str, float] | None = None,
    noise_pC: float = 0.0,
) -> tuple[Choice, ...]:
    """Which probe touched: models by the probability that they gave the charges.

    Bayes' rule with each model's probability of the charges over all its touches: a probe that can
    give many charges must explain these better than one that can give few.

    Parameters
    ----------
    models : mapping
        Models of different probes on the same sensor, by name.
    charges_pC, sigma, unknown, known, noise_pC
        As for `locate`.

    Raises
    ------
    ValueError
        Without models, and as `locate`.
    """
    if not models:
        raise ValueError("models: none given; give one for each probe in question")
    found = {
        name: locate(model, charges_pC, sigma, unknown=unknown, known=known, noise_pC=noise_pC)
        for name, model in models.items()
    }
    return choose(found)


def choose(found: Mapping[str, Location]) -> tuple[Choice, ...]:
    """Locations of the same charges with different probes, by their probability."""
    logs = np.array([one.log_evidence for one in found.values()])
    shares = np.zeros(len(logs))
    if np.isfinite(logs).any():
        shares = np.exp(logs - np.logaddexp.reduce(logs))
    weighed = zip(found.items(), shares.tolist(), strict=True)
    choices = [Choice(name, weight, location) for (name, location), weight in weighed]
    return tuple(sorted(choices, key=lambda choice: -choice.weight))

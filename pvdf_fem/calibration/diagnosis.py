"""What is wrong with touches that no sensor like the scene's explains.

Each mistake that people make with such files is a change of the touches that undoes it. Changes are
ranked by fits to a few touches, and the best are fitted in full, with solves.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import combinations, permutations
from typing import Any

import numpy as np
from scipy.constants import g
from scipy.stats import chi2

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.calibration.fit import FALSE_OUTLIERS, Fit, Noise, fitted
from pvdf_fem.calibration.model import TouchModel
from pvdf_fem.calibration.touches import Touches

#: Touches by which changes are ranked, and changes that are then fitted in full.
FEW_TOUCHES, MOST_FITS = 10, 3
#: Probability of a chi-square that is no chance, and the scatter that is then still explained.
UNLIKELY, SCATTER = 1e-4, 1.5
#: Deviations of a prior that a parameter may be away from the scene's value.
FAR = 4.0
#: Scatter over the noise after the first steps, with which changes are tried at once.
FAR_OFF = 10.0
#: Changes are fitted if their score is not far from the best one, and told if their chi-square is
#: this near to the best one and that of the touches as they are is larger by this factor.
CLOSE_SCORE, CLOSE, CLEARLY = 5.0, 20.0, 2.0
#: All orders of this number of channels are tried; of more, only two are exchanged.
MOST_PERMUTED = 4
#: Scatter over the noise beyond which parameters are of no use.
MOST_SCATTER = 4.0
#: Largest error of places in mm that is proposed instead of a mistake.
MOST_PLACE_MM = 1.0


class CalibrationStatus(StrEnum):
    """How a calibration ended."""

    CALIBRATED = "calibrated"
    TOO_FEW = "too_few_touches"
    SWAPPED = "swapped_channels"
    FRAME = "wrong_frame"
    UNIT = "wrong_unit"
    SIGN = "wrong_sign"
    FORCE = "wrong_force"
    READING = "wrong_reading"
    CHANNEL = "wrong_channel"
    NOT_EXPLAINED = "not_explained"
    NOT_CONVERGED = "not_converged"


@dataclass(frozen=True, eq=False)
class Change:
    """A mistake and what undoes it."""

    status: CalibrationStatus
    text: str
    touches: Touches
    reading: str
    noise: Noise

    def model(self, like: TouchModel) -> TouchModel:
        """Another model with the changed touches."""
        return replace(like, touches=self.touches, reading=self.reading, failures={}, solves=0)


def suspect(fit: Fit) -> bool:
    """Whether the readings, or the parameters they lead to, are not those of such a sensor."""
    return not fit.converged or fit.p_value < UNLIKELY or _pulled(fit)


def _pulled(fit: Fit) -> bool:
    """Whether a parameter is far from what the scene and its prior say."""
    pulls = np.abs(fit.values - fit.model.unknowns.start) / fit.model.unknowns.priors
    return bool((pulls > FAR).any())


def explained(model: TouchModel, noise: Noise) -> tuple[Fit, list[tuple[Change, Fit]]]:
    """The fit, and where it is suspect the changes with which the touches fit a sensor better.

    Touches that are far off at first are fitted to the end only if no change explains them.
    """
    enough = len(model.touches) >= len(model.unknowns.names)
    fit = fitted(model, noise, FAR_OFF if enough else np.inf)
    found = mistakes_of(fit) if enough and suspect(fit) else []
    if not found and fit.scale > FAR_OFF and not fit.converged:
        fit = fitted(model, noise)
    return fit, found


def mistakes_of(fit: Fit) -> list[tuple[Change, Fit]]:
    """The changes with which a sensor like the scene's explains the touches, with their fits."""
    ranked = _ranked(fit.model, fit.noise)
    limit = CLOSE_SCORE + 1.5 * ranked[0][0]
    found = []
    for change in [change for score, change in ranked[:MOST_FITS] if score < limit]:
        better = fitted(change.model(fit.model), change.noise, FAR_OFF)
        likely = better.p_value > UNLIKELY or better.scale < SCATTER
        gain = fit.chi_square > CLEARLY * better.chi_square or fit.p_value > UNLIKELY
        if better.converged and likely and gain and not _pulled(better):
            found.append((change, better))
    if any(change.status is not CalibrationStatus.CHANNEL for change, _ in found):
        found = [pair for pair in found if pair[0].status is not CalibrationStatus.CHANNEL]
    best = min((better.chi_square for _, better in found), default=0.0)
    return [pair for pair in found if pair[1].chi_square < best + CLOSE]


def _ranked(model: TouchModel, noise: Noise) -> list[tuple[float, Change]]:
    """The changes with their scores, the one first with which few touches are explained best."""
    few = np.linspace(0, len(model.touches) - 1, min(FEW_TOUCHES, len(model.touches))).astype(int)
    chosen = _rows(model.touches, np.unique(few))
    start, none = model.unknowns.start, np.zeros((len(chosen), 2))
    solved: dict[bytes, TouchModel] = {}
    scores = []
    everything, of_few = (_changes(t, model, noise) for t in (model.touches, chosen))
    for number, (whole, change) in enumerate(zip(everything, of_few, strict=True)):
        trial = change.model(model)
        key = change.touches.touches.tobytes()
        if key not in solved:
            trial.solve(start, none, np.ones(len(chosen), dtype=bool))
            solved[key] = trial
        for name in ("at", "forces", "rates", "rest", "errors"):
            setattr(trial, name, getattr(solved[key], name))
        fit = Fit(trial, change.noise, start, none, trial.solved).settled(soft=True)
        misfit = np.log1p(fit.distances / np.maximum(fit.counts, 1))[fit.kept]
        pulls = (fit.values - start) / model.unknowns.priors
        score = misfit.sum() + np.log1p(pulls**2).sum() if len(misfit) else np.inf
        scores.append((float(score), number, whole))
    ordered = sorted(scores, key=lambda item: item[:2])
    return [(score, change) for score, _, change in ordered]


def _rows(touches: Touches, which: Indices) -> Touches:
    return replace(
        touches,
        rows=touches.rows[which],
        touches=touches.touches[which],
        readings=touches.readings[which],
    )


def _changes(touches: Touches, model: TouchModel, noise: Noise) -> Iterator[Change]:
    def change(status: CalibrationStatus, text: str, **of: Any) -> Change:
        return Change(status, text, replace(touches, **of), model.reading, noise)

    names, readings = [channel.name for channel in model.channels], touches.readings
    for order in _orders(len(names)):
        yield change(
            CalibrationStatus.SWAPPED, _told_order(names, order), readings=readings[:, order]
        )
    for text, frame in _frames(touches.touches):
        yield change(CalibrationStatus.FRAME, text, touches=frame)
    for power in (-9, -6, -3, 3, 6, 9):
        text = f"readings are in another unit: 1e{power:+d} of what was said"
        yield change(CalibrationStatus.UNIT, text, readings=readings * 10.0**power)
    yield change(CalibrationStatus.SIGN, "readings have the wrong sign", readings=-readings)
    for unit, newton in (("gram-force (grams)", 1e-3 * g), ("kgf", g), ("mN", 1e-3), ("kN", 1e3)):
        scaled = touches.touches * np.array([1.0, 1.0, 1.0, newton])
        yield change(CalibrationStatus.FORCE, f"force_N is in {unit}", touches=scaled)
    if np.ptp(touches.touches[:, 3]) == 0.0:
        text = f"force_N is {touches.touches[0, 3]:g} in every row, and the readings ask for others"
        yield replace(change(CalibrationStatus.FORCE, text), noise=replace(noise, force=1.0))
    other = "total" if model.reading == "change" else "change"
    text = f"readings are of the {other} charge, not its {model.reading}; give reading = {other}"
    text = text.replace("not its total", "not the total")
    yield replace(change(CalibrationStatus.READING, text), reading=other)
    for j, name in enumerate(names if len(names) > 2 else ()):
        without = readings.copy()
        without[:, j] = np.nan
        text = f"channel {name} does not fit, and the others do; it is dead or not connected"
        yield change(CalibrationStatus.CHANNEL, text, readings=without)


def _orders(count: int) -> Iterator[list[int]]:
    if count <= MOST_PERMUTED:
        yield from (list(order) for order in list(permutations(range(count)))[1:])
        return
    for a, b in combinations(range(count), 2):
        order = list(range(count))
        order[a], order[b] = b, a
        yield order


def _told_order(names: Sequence[str], order: Sequence[int]) -> str:
    moved = [(names[i], names[j]) for i, j in enumerate(order) if i != j]
    if len(moved) == 2:
        return f"channels {moved[0][0]} and {moved[0][1]} are swapped"
    places = ", ".join(f"{wanted} is in column {given}" for wanted, given in moved)
    return f"channels are permuted: {places}"


def _frames(touches: Array) -> Iterator[tuple[str, Array]]:
    """Other frames in which places and rotations may have been written."""
    x, y, turn, force = touches.T
    frames = {
        "x_mm has the wrong sign (a mirrored axis)": (-x, y, turn),
        "y_mm has the wrong sign (a mirrored axis)": (x, -y, turn),
        "x_mm and rotation_deg have the wrong sign (a mirrored frame)": (-x, y, -turn),
        "y_mm and rotation_deg have the wrong sign (a mirrored frame)": (x, -y, -turn),
        "y_mm points the other way (a mirrored frame)": (x, -y, 180.0 - turn),
        "x_mm and y_mm are swapped": (y, x, turn),
        "x and y are swapped (a mirrored frame)": (y, x, 90.0 - turn),
        "rotation_deg is clockwise": (x, y, -turn),
        "the frame is turned by 180°": (-x, -y, turn + 180.0),
        "the frame is turned by 90°": (-y, x, turn + 90.0),
        "the frame is turned by -90°": (y, -x, turn - 90.0),
    }
    for text, columns in frames.items():
        yield text, np.column_stack([*columns, force])


def place_error(fit: Fit) -> float | None:
    """The error of places in mm that would explain the readings, if it is a small one."""
    low, high = 0.0, MOST_PLACE_MM

    def scatter(place_mm: float) -> float:
        noise = replace(fit.noise, place_mm=place_mm)
        other = replace(fit, noise=noise).without_bad()
        return other.chi_square / max(other.degrees_of_freedom, 1)

    if scatter(high) > 1.0:
        return None
    for _ in range(12):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if scatter(middle) > 1.0 else (low, middle)
    return high


def what_is_wrong(fit: Fit, i: int, steps: int = 8, longest_mm: float = 3.0) -> str:
    """Why a touch does not fit, by the place where its readings do."""
    model = replace(
        fit.model, touches=_rows(fit.model.touches, np.array([i])), failures={}, solves=0
    )
    moves, limit = np.zeros((1, 2)), chi2.isf(FALSE_OUTLIERS, max(fit.counts[i] - 2, 1))
    for _ in range(steps):
        model.solve(fit.values, moves, np.ones(1, dtype=bool))
        if model.failures:
            break
        one = Fit(model, fit.noise, fit.values, moves, model.solved)
        weights = 1.0 / one.deviations[0]
        residual = weights * np.nan_to_num(model.touches.readings - one.prediction.readings)[0]
        if residual @ residual < limit:
            (x, y), off = model.touches.touches[0, :2] + moves[0], float(np.hypot(*moves[0]))
            place = f"x_mm, y_mm = {x:.2f}, {y:.2f}"
            return f"its readings are those of {place}, {off:.1f} mm away: misplaced?"
        step = np.linalg.lstsq(weights[:, None] * one.prediction.by_touch[0, :, :2], residual)[0]
        moves = moves + step * min(1.0, longest_mm / max(float(np.hypot(*step)), 1e-12))
    return "no place near it explains its readings; force, rotation or readings are wrong"

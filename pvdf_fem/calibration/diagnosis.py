"""What is wrong with touches that no sensor like the scene's explains.

A common mistake in files of touches is undone by a change of the touches. Changes of readings are
ranked by the solves at hand. Changes of places and forces, tried where no change of readings
explains the touches for sure, are ranked by solves of a few touches. The best are fitted in full.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from scipy.constants import g
from scipy.stats import chi2

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.calibration.fit import FALSE_OUTLIERS, Fit, Noise, fitted
from pvdf_fem.calibration.model import TouchModel
from pvdf_fem.calibration.touches import Touches
from pvdf_fem.readout.misread import misreadings
from pvdf_fem.touch.least_squares import LeastSquares, SearchOptions, descend

FEW_TOUCHES = 8  #: Number of touches by which changes of places and forces are ranked.
COARSE = 2e-3  #: Tolerance of their solves.
MOST_FITS = 3  #: Changes that are then fitted in full.
UNLIKELY = 1e-4  #: Probability of a chi-square that is no chance.
SCATTER = 1.5  #: Scatter that is still explained.
FAR = 4.0  #: Deviations of a prior that a parameter may be away from the scene's value.
#: Scatter over the noise after the first steps, with which changes are tried at once.
FAR_OFF = 10.0
CLOSE_SCORE = 5.0  #: Changes are fitted if their score is no farther than this from the best one.
CLOSE = 20.0  #: They are told if their chi-square is no farther than this from the best one ...
CLEARLY = 2.0  #: ... and that of the touches as they are is larger by this factor.
MOST_SCATTER = 4.0  #: Scatter over the noise beyond which parameters are of no use.
LONGEST_MM = 3.0  #: Longest step in the search for the place of a touch that does not fit.
UNSOLVED = 1e6  #: Residuals over their deviations of a place without a solution.
OTHER_SIZE = 3.0  #: Readings this factor above or below the scene's are not due to a wrong frame.


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
    """A mistake, and touches and reading without it."""

    status: CalibrationStatus
    text: str
    touches: Touches
    reading: str


def explained(model: TouchModel, noise: Noise) -> tuple[Fit, list[tuple[Change, Fit]]]:
    """The fit, and where it is suspect the changes with which the touches fit a sensor better.
    Touches that are far off at first are fitted to the end only if no change explains them."""
    enough = len(model.touches) >= len(model.unknowns.names)
    fit = fitted(model, noise, FAR_OFF if enough else np.inf)
    # the readings, or the parameters they lead to, are not those of such a sensor
    suspect = not fit.converged or fit.p_value < UNLIKELY or bool((fit.pulls > FAR).any())
    found = mistakes_of(fit) if enough and suspect else []
    if not found and fit.scale > FAR_OFF and not fit.converged:
        fit = fitted(model, noise)
    return fit, found


def mistakes_of(fit: Fit) -> list[tuple[Change, Fit]]:
    """The changes with which a sensor like the scene's explains the touches, with their fits."""
    found = _better(fit, _of_readings(fit.model)) if fit.model.solved.any() else []
    # these may look like a wrong frame; other mistakes in readings do not
    doubtful = {CalibrationStatus.SWAPPED, CalibrationStatus.CHANNEL}
    if {change.status for change, _ in found} <= doubtful:
        found += _better(fit, _of_touches(fit))
    others = [pair for pair in found if pair[0].status is not CalibrationStatus.CHANNEL]
    best = min((better.chi_square for _, better in others or found), default=0.0)
    return [pair for pair in others or found if pair[1].chi_square < best + CLOSE]


def _better(fit: Fit, changes: Iterable[Change]) -> list[tuple[Change, Fit]]:
    """Those of the changes that explain the touches: the best ones are fitted in full."""
    scored = sorted(((_score(fit, change), change) for change in changes), key=lambda pair: pair[0])
    found = []
    for score, change in scored[:MOST_FITS]:
        if not score < CLOSE_SCORE + 1.5 * scored[0][0]:
            break
        better = fitted(fit.model.changed(change.touches, change.reading), fit.noise, FAR_OFF)
        likely = better.p_value > UNLIKELY or better.scale < SCATTER
        gain = fit.chi_square > CLEARLY * better.chi_square or fit.p_value > UNLIKELY
        if better.converged and likely and gain and (better.pulls < FAR).all():
            found.append((change, better))
    return found


def _score(fit: Fit, change: Change) -> float:
    """How badly the changed touches fit a sensor, by solves at hand or those of a few touches."""
    model, start = fit.model.changed(change.touches, change.reading), fit.model.unknowns.start
    if not model.solved.any():
        few = np.linspace(0, len(change.touches) - 1, FEW_TOUCHES).astype(int)
        chosen = change.touches.some(np.unique(few).tolist())
        model = replace(model.changed(chosen, change.reading), tolerance=COARSE)
        model.solve(start, np.zeros((len(chosen), 2)), np.ones(len(chosen), dtype=bool))
    none = np.zeros((len(model.touches), 2))
    tried = Fit(model, fit.noise, start, none, model.solved).settled(soft=True)
    misfit = np.log1p(tried.distances / np.maximum(tried.counts, 1))[tried.kept]
    return float(misfit.sum() + np.log1p(tried.pulls**2).sum()) if len(misfit) else np.inf


def _of_readings(model: TouchModel) -> Iterator[Change]:
    """Changes that need no solve."""
    touches, names = model.touches, [channel.name for channel in model.channels]
    read = touches.readings
    for mistake in misreadings(model.channels, model.unit):
        status = CalibrationStatus(mistake.kind)
        changed = replace(touches, readings=mistake.undone(read))
        yield Change(status, mistake.text, changed, model.reading)
    other = "total" if model.reading == "change" else "change"
    text = f"readings are of the {other} of the charge, not of the {model.reading};"
    if np.isfinite(model.rest[1]).all():
        yield Change(CalibrationStatus.READING, f"{text} give reading = {other}", touches, other)
    for j, name in enumerate(names if len(names) > 2 else ()):
        without = read.copy()
        without[:, j] = np.nan
        text = f"channel {name} does not fit, and the others do; it is dead or not connected"
        changed = replace(touches, readings=without)
        yield Change(CalibrationStatus.CHANNEL, text, changed, model.reading)


def _of_touches(fit: Fit) -> Iterator[Change]:
    """Changes that need solves: of frames, or of forces where the readings have another size."""
    touches, reading = fit.model.touches, fit.model.reading
    start = fit.model.predict(fit.model.unknowns.start, np.zeros((len(touches), 2))).readings
    solved = fit.model.solved
    size = np.nanmedian(np.abs(touches.readings[solved] / start[solved])) if solved.any() else 0.0
    if 1.0 / OTHER_SIZE < size < OTHER_SIZE:
        seen = {touches.touches.tobytes()}
        probe = fit.model.unknowns.scene.single_probe
        for text, frame in _frames(touches.touches, probe is None or bool(probe.period_deg)):
            if frame.tobytes() not in seen:
                seen.add(frame.tobytes())
                changed = replace(touches, touches=frame)
                yield Change(CalibrationStatus.FRAME, text, changed, reading)
        return
    for unit, newton in (("gram-force (grams)", 1e-3 * g), ("kgf", g), ("mN", 1e-3), ("kN", 1e3)):
        if (newton < 1.0) == (size < 1.0):
            changed = replace(touches, touches=touches.touches * [1.0, 1.0, 1.0, newton])
            yield Change(CalibrationStatus.FORCE, f"force_N is in {unit}", changed, reading)


def _frames(touches: Array, turns: bool) -> Iterator[tuple[str, Array]]:
    """Other frames in which places, and rotations where they count, may have been written."""
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
    for text, (u, v, angle) in frames.items():
        yield text, np.column_stack([u, v, angle if turns else turn, force])


def what_is_wrong(fit: Fit, i: int) -> str:
    """Why a touch does not fit, by the place where its readings do."""
    end = descend(_Elsewhere(fit, i), np.zeros((1, 2)), options=SearchOptions(max_steps=8))
    if end.chi_square[0] < chi2.isf(FALSE_OUTLIERS, max(fit.counts[i] - 2, 1)):
        (x, y), off = fit.model.touches.touches[i, :2] + end.at[0], float(np.hypot(*end.at[0]))
        place = f"x_mm, y_mm = {x:.2f}, {y:.2f}"
        return f"its readings are those of {place}, {off:.1f} mm away: misplaced?"
    return "no place near it explains its readings; force, rotation or readings are wrong"


@dataclass(frozen=True, eq=False)
class _Elsewhere(LeastSquares):
    """The least-squares problem of a touch's place by its readings: moves x, y in mm."""

    fit: Fit
    number: int  #: Of the touch.

    @property
    def longest(self) -> Array:
        """Longest steps, (2,)."""
        return np.array([LONGEST_MM, LONGEST_MM])

    def linearised(self, at: Array, rows: Indices | None = None) -> Array:
        """Whitened differences of readings, then slopes, (1, electrodes, 1 + 2)."""
        one = self.fit.model.touches.some([self.number])
        model = self.fit.model.changed(one, self.fit.model.reading)
        model.solve(self.fit.values, at, np.ones(1, dtype=bool))
        if model.failures:
            return np.broadcast_to([UNSOLVED, 0.0, 0.0], (1, len(model.channels), 3)).copy()
        there = Fit(model, self.fit.noise, self.fit.values, at, model.solved)
        residuals = np.nan_to_num(there.prediction.readings - one.readings)
        system = np.concatenate([residuals[..., None], there.prediction.by_touch[..., :2]], axis=2)
        return np.asarray(system / there.deviations[..., None])

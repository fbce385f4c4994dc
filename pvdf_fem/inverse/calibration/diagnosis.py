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

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.misreadings import list_misreadings
from pvdf_fem.inverse.calibration.fit import CalibrationFit, ReadingNoise, fit_parameters
from pvdf_fem.inverse.calibration.reading_model import ReadingModel
from pvdf_fem.inverse.calibration.touch_table import TouchTable


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
class Correction:
    """A mistake, and touches and reading without it."""

    status: CalibrationStatus
    text: str
    touches: TouchTable
    reading: str


def fit_and_diagnose(
    model: ReadingModel, noise: ReadingNoise
) -> tuple[CalibrationFit, list[tuple[Correction, CalibrationFit]]]:
    """The fit, and where it is suspect the changes with which the touches fit a sensor better.
    Touches that are far off at first are fitted to the end only if no change explains them."""
    enough, options = len(model.touches) >= len(model.unknowns.names), model.options
    fit = fit_parameters(model, noise, options.far_off if enough else np.inf)
    # the readings, or the parameters they lead to, are not those of such a sensor
    suspect = not fit.converged or fit.p_value < options.unlikely
    suspect |= bool((fit.pulls > options.far).any())
    found = _find_corrections(fit) if enough and suspect else []
    if not found and fit.scale > options.far_off and not fit.converged:
        fit = fit_parameters(model, noise)
    return fit, found


def _find_corrections(fit: CalibrationFit) -> list[tuple[Correction, CalibrationFit]]:
    """The changes with which a sensor like the scene's explains the touches, with their fits."""
    found = (
        _fit_corrections(fit, _propose_reading_corrections(fit.model))
        if fit.model.solved.any()
        else []
    )
    # these may look like a wrong frame; other mistakes in readings do not
    doubtful = {CalibrationStatus.SWAPPED, CalibrationStatus.CHANNEL}
    if {change.status for change, _ in found} <= doubtful:
        found += _fit_corrections(fit, _propose_touch_corrections(fit))
    # a channel that is left out always leaves a better fit
    found = [pair for pair in found if pair[0].status is not CalibrationStatus.CHANNEL] or found
    best = min((better.chi_square for _, better in found), default=0.0)
    return [pair for pair in found if pair[1].chi_square < best + fit.model.options.close]


def _fit_corrections(
    fit: CalibrationFit, changes: Iterable[Correction]
) -> list[tuple[Correction, CalibrationFit]]:
    """Those of the changes that explain the touches: the best ones are fitted in full."""
    scored = sorted(
        ((_score_correction(fit, change), change) for change in changes), key=lambda pair: pair[0]
    )
    found, options = [], fit.model.options
    for score, change in scored[: options.most_fits]:
        if not score < options.close_score + 1.5 * scored[0][0]:
            break
        changed = fit.model.changed(change.touches, change.reading)
        better = fit_parameters(changed, fit.noise, options.far_off)
        likely = better.p_value > options.unlikely or better.scale < options.scatter
        gain = fit.chi_square > options.clearly * better.chi_square
        gain |= fit.p_value > options.unlikely
        if better.converged and likely and gain and (better.pulls < options.far).all():
            found.append((change, better))
    return found


def _score_correction(fit: CalibrationFit, change: Correction) -> float:
    """How badly the changed touches fit a sensor, by solves at hand or those of a few touches."""
    model, start = fit.model.changed(change.touches, change.reading), fit.model.unknowns.start
    if not model.solved.any():
        few = np.linspace(0, len(change.touches) - 1, model.options.few_touches).astype(int)
        model = model.changed(change.touches.some(np.unique(few).tolist()), change.reading)
        every = np.ones(len(model.touches), dtype=bool)
        model.solve(start, np.zeros((len(every), 2)), every, model.options.first_tolerance)
    none = np.zeros((len(model.touches), 2))
    tried = CalibrationFit(model, fit.noise, start, none, model.solved).settled(
        model.solved, soft=True
    )
    misfit = np.log1p(tried.distances / np.maximum(tried.counts, 1))[tried.kept]
    return float(misfit.sum() + np.log1p(tried.pulls**2).sum()) if len(misfit) else np.inf


def _propose_reading_corrections(model: ReadingModel) -> Iterator[Correction]:
    """Changes that need no solve."""
    touches, names = model.touches, [channel.name for channel in model.channels]
    read = touches.readings
    for mistake in list_misreadings(model.channels, model.unit):
        status = CalibrationStatus(mistake.kind)
        changed = replace(touches, readings=mistake.undone(read))
        yield Correction(status, mistake.text, changed, model.reading)
    other = "total" if model.reading == "change" else "change"
    text = f"readings are of the {other} of the charge, not of the {model.reading};"
    if np.isfinite(model.at_rest).all():
        yield Correction(
            CalibrationStatus.READING, f"{text} give reading = {other}", touches, other
        )
    for j, name in enumerate(names if len(names) > 2 else ()):
        without = read.copy()
        without[:, j] = np.nan
        text = f"channel {name} does not fit, and the others do; it is dead or not connected"
        changed = replace(touches, readings=without)
        yield Correction(CalibrationStatus.CHANNEL, text, changed, model.reading)


def _propose_touch_corrections(fit: CalibrationFit) -> Iterator[Correction]:
    """Changes that need solves: of frames, or of forces where the readings have another size."""
    touches, reading = fit.model.touches, fit.model.reading
    start = fit.model.predict(fit.model.unknowns.start, np.zeros((len(touches), 2))).readings
    solved = fit.model.solved
    size = np.nanmedian(np.abs(touches.readings[solved] / start[solved])) if solved.any() else 0.0
    if abs(np.log(max(size, 1e-300))) < np.log(fit.model.options.other_size):
        seen = {touches.touches.tobytes()}
        probe = fit.model.unknowns.scene.single_probe
        for text, frame in _propose_frames(
            touches.touches, probe is None or bool(probe.period_deg)
        ):
            if frame.tobytes() not in seen:
                seen.add(frame.tobytes())
                changed = replace(touches, touches=frame)
                yield Correction(CalibrationStatus.FRAME, text, changed, reading)
        return
    for unit, newton in (("gram-force (grams)", 1e-3 * g), ("kgf", g), ("mN", 1e-3), ("kN", 1e3)):
        if (newton < 1.0) == (size < 1.0):
            changed = replace(touches, touches=touches.touches * [1.0, 1.0, 1.0, newton])
            yield Correction(CalibrationStatus.FORCE, f"force_N is in {unit}", changed, reading)


def _propose_frames(touches: Array, turns: bool) -> Iterator[tuple[str, Array]]:
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


def describe_outlier(fit: CalibrationFit, i: int) -> str:
    """Why a touch does not fit: by the linear step of its place, or of its force, that would make
    it fit best."""
    roots, residuals, _ = fit.whitened
    slopes = np.linalg.solve(roots[i], fit.prediction.by_touch[i])
    left = []
    for columns in (slopes[:, :2], slopes[:, 2:]):
        step = np.linalg.lstsq(columns, residuals[i])[0]
        left.append(float(np.sum((residuals[i] - columns @ step) ** 2)))
    if left[0] < left[1]:
        return "its readings are rather those of another place: misplaced?"
    return "its readings are rather those of another force; force_N or the readings are wrong"

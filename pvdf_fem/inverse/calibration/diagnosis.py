"""Diagnosis of touches that no sensor similar to the scene's explains.

For each common mistake in a file of touches there is a correction that undoes it. Corrections of
readings are ranked first, with the existing solves. Unless one of them clearly explains the
touches, corrections of positions and forces are ranked with new solves of a few touches. Finally
the parameters are fitted to the touches of the best corrections.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from enum import StrEnum
from operator import attrgetter
from typing import NamedTuple

import numpy as np
from scipy.constants import g

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.misreadings import list_misreadings
from pvdf_fem.inverse.calibration.fit import CalibrationFit, ReadingNoise, fit_parameters
from pvdf_fem.inverse.calibration.reading_model import ReadingModel
from pvdf_fem.inverse.calibration.touch_table import TouchTable

#: Units of force in newtons.
FORCE_UNITS_N = {"gram-force (grams)": 1e-3 * g, "kgf": g, "mN": 1e-3, "kN": 1e3}
#: Corrections are fitted up to this factor of the best score, plus `CalibrateOptions.score_margin`.
SCORE_FACTOR = 1.5


class CalibrationStatus(StrEnum):
    """Outcome of a calibration."""

    CALIBRATED = "calibrated"  #: The parameters explain the touches.
    TOO_FEW = "too_few_touches"  #: There are fewer usable touches than parameters.
    CLIPPED = "clipped"  #: There are too few touches, since readings are clipped.
    SWAPPED = "swapped_channels"  #: Channels are swapped.
    FRAME = "wrong_frame"  #: Positions or rotations are in another frame.
    UNIT = "wrong_unit"  #: Readings are in another unit.
    SIGN = "wrong_sign"  #: Readings have the wrong sign.
    FORCE = "wrong_force"  #: Forces are in another unit, or wrong.
    READING = "wrong_reading"  #: Readings are totals instead of changes, or vice versa.
    CHANNEL = "wrong_channel"  #: One channel does not fit.
    NOT_EXPLAINED = "not_explained"  #: No parameters and no correction explain the touches.
    NOT_CONVERGED = "not_converged"  #: The fit did not converge.


@dataclass(frozen=True, eq=False)
class Correction:
    """Touches from which a mistake that the file may contain is removed."""

    status: CalibrationStatus  #: Status of the calibration if this is the mistake.
    text: str  #: Description of the mistake.
    table: TouchTable  #: Corrected touches.
    reading: str  #: Corrected meaning of the readings.


class ScoredCorrection(NamedTuple):
    """Correction with its score; a lower score is a better fit."""

    score: float
    correction: Correction


class FittedCorrection(NamedTuple):
    """Correction with the fit to its touches."""

    correction: Correction
    fit: CalibrationFit


class Diagnosis(NamedTuple):
    """Fit of the touches as given, and the corrections that explain them better."""

    fit: CalibrationFit
    corrections: list[FittedCorrection]


def fit_and_diagnose(model: ReadingModel, noise: ReadingNoise) -> Diagnosis:
    """Fit the parameters, and look for mistakes in the touches if the fit is suspect.

    If the first solves leave a very large scatter, the fit is abandoned, since the cause is
    probably a mistake in the file. It is completed only if no correction explains the touches. With
    fewer touches than parameters, the fit is not abandoned and no mistakes are looked for.

    Parameters
    ----------
    model : ReadingModel
        Readings as a function of the parameters. Its solves are updated in place.
    noise : ReadingNoise
        Standard deviations of readings and positions.
    """
    options = model.options
    has_enough = len(model.table) >= len(model.parameters)
    max_scatter = options.hopeless_scatter if has_enough else np.inf
    fit = fit_parameters(model, noise, max_scatter)
    # A fit is suspect if the residuals or the parameters are implausible for such a sensor.
    is_suspect = not fit.is_converged or fit.p_value < options.min_p_value
    is_suspect |= bool((fit.pulls > options.max_pull).any())
    corrections = _find_corrections(fit) if has_enough and is_suspect else []
    if not corrections and fit.scatter > options.hopeless_scatter and not fit.is_converged:
        fit = fit_parameters(model, noise)
    return Diagnosis(fit, corrections)


def _find_corrections(fit: CalibrationFit) -> list[FittedCorrection]:
    """Find the corrections with which a sensor similar to the scene's explains the touches.

    Returns
    -------
    list of FittedCorrection
        Corrections whose chi-square exceeds the lowest one by less than
        `CalibrateOptions.chi_square_margin`; empty if no correction explains the touches.
    """
    fitted = []
    if fit.model.is_solved.any():
        fitted = _fit_corrections(fit, _propose_reading_corrections(fit.model))
    # A wrong frame may look like swapped or dead channels, but not like other wrong readings.
    # Therefore touches are corrected only if no other mistake in the readings was found.
    ambiguous = {CalibrationStatus.SWAPPED, CalibrationStatus.CHANNEL}
    if {each.correction.status for each in fitted} <= ambiguous:
        fitted += _fit_corrections(fit, _propose_touch_corrections(fit))
    # Leaving out a channel always improves the fit, so that other corrections are preferred.
    others = [each for each in fitted if each.correction.status is not CalibrationStatus.CHANNEL]
    if others:
        fitted = others
    if not fitted:
        return []
    min_chi_square = min(each.fit.chi_square for each in fitted)
    limit = min_chi_square + fit.model.options.chi_square_margin
    return [each for each in fitted if each.fit.chi_square < limit]


def _fit_corrections(
    fit: CalibrationFit, corrections: Iterable[Correction]
) -> list[FittedCorrection]:
    """Fit the corrections with the lowest scores, and return those that explain the touches.

    Parameters
    ----------
    fit : CalibrationFit
        Fit of the touches without correction.
    corrections : iterable of Correction
        Corrections to rank.
    """
    options = fit.model.options
    scored = []
    for correction in corrections:
        scored.append(ScoredCorrection(_score_correction(fit, correction), correction))
    scored.sort(key=attrgetter("score"))
    fitted = []
    for score, correction in scored[: options.max_fits]:
        # If no touch is solved, all scores are infinite, and this comparison is false.
        if not score < options.score_margin + SCORE_FACTOR * scored[0].score:
            break
        corrected = fit.model.with_table(correction.table, correction.reading)
        better = fit_parameters(corrected, fit.noise, options.hopeless_scatter)
        if better.is_converged and _is_explanation(fit, better):
            fitted.append(FittedCorrection(correction, better))
    return fitted


def _is_explanation(fit: CalibrationFit, corrected: CalibrationFit) -> bool:
    """Return whether the fit of corrected touches is plausible and clearly better."""
    options = fit.model.options
    is_likely = corrected.p_value > options.min_p_value
    is_plausible = is_likely or corrected.scatter < options.plausible_scatter
    is_better = fit.chi_square > options.min_improvement * corrected.chi_square
    # If the residuals of the uncorrected fit are fine, it was suspect only for its parameters.
    is_better |= fit.p_value > options.min_p_value
    return is_plausible and is_better and bool((corrected.pulls < options.max_pull).all())


def _score_correction(fit: CalibrationFit, correction: Correction) -> float:
    """Compute the score of a correction from a robust fit; a lower score is better.

    Corrections of readings use the solves of `fit`. For corrections of positions or forces, a few
    touches are solved. The score is infinite if no touch is solved.

    Notes
    -----
    The score is the sum of log(1 + χ²/n) over the touches with n readings and squared residuals χ²,
    plus the sum of log(1 + p²) over the parameters, whose pull p is the distance from the scene's
    value in standard deviations of the prior. The logarithm limits the influence of outliers.
    """
    initial = fit.model.parameters.initial
    model = fit.model.with_table(correction.table, correction.reading)
    if not model.is_solved.any():
        count = model.options.ranking_touches
        indices = np.linspace(0, len(correction.table) - 1, count).astype(int)
        table = correction.table.select(np.unique(indices).tolist())
        model = model.with_table(table, correction.reading)
        model.solve_touches(
            initial,
            np.zeros((len(table), 2)),
            which=np.ones(len(table), dtype=bool),
            tolerance=model.options.first_tolerance,
        )
    start = CalibrationFit(
        model,
        fit.noise,
        values=initial,
        place_corrections_mm=np.zeros((len(model.table), 2)),
        is_used=model.is_solved,
    )
    robust_fit = start.refit(model.is_solved, is_robust=True)
    if not robust_fit.is_used.any():
        return np.inf
    mean_squares = robust_fit.squared_residuals / np.maximum(robust_fit.reading_counts, 1)
    misfit = np.log1p(mean_squares[robust_fit.is_used]).sum()
    return float(misfit + np.log1p(robust_fit.pulls**2).sum())


def _propose_reading_corrections(model: ReadingModel) -> Iterator[Correction]:
    """Propose corrections of the readings: units, signs, channels, and change or total.

    These corrections need no further solves. Change and total are exchanged only if the unloaded
    film has an equilibrium, and a channel is left out only if there are at least three.
    """
    table = model.table
    for misreading in list_misreadings(model.channels, model.unit):
        status = CalibrationStatus(misreading.kind)
        corrected = replace(table, readings=misreading.correct(table.readings))
        yield Correction(status, misreading.text, corrected, model.reading)
    if np.isfinite(model.unloaded_integrals).all():
        other = "total" if model.reading == "change" else "change"
        meanings = {"change": "changes of the charge", "total": "total charges"}
        text = f"readings are {meanings[other]}, not {meanings[model.reading]};"
        yield Correction(
            CalibrationStatus.READING, f"{text} give reading = {other}", table, reading=other
        )
    if len(model.channels) <= 2:
        return
    for index, channel in enumerate(model.channels):
        without = table.readings.copy()
        without[:, index] = np.nan
        name = channel.name
        text = f"channel {name} does not fit, and the others do; it is dead or not connected"
        corrected = replace(table, readings=without)
        yield Correction(CalibrationStatus.CHANNEL, text, corrected, model.reading)


def _propose_touch_corrections(fit: CalibrationFit) -> Iterator[Correction]:
    """Propose corrections of positions, rotations and forces, which need further solves.

    If the readings have about the predicted size, other frames are proposed; otherwise other units
    of the force.
    """
    table = fit.model.table
    size = _compute_median_reading_ratio(fit)
    has_predicted_size = abs(np.log(max(size, 1e-300))) < np.log(fit.model.options.max_size_ratio)
    if has_predicted_size:
        yield from _propose_frame_corrections(fit.model)
        return
    # Readings that are too small come from forces in a smaller unit than newton.
    for unit, newtons in FORCE_UNITS_N.items():
        if (newtons < 1.0) == (size < 1.0):
            probe_loads = table.probe_loads * [1.0, 1.0, 1.0, newtons]
            text = f"force_N is in {unit}"
            corrected = replace(table, probe_loads=probe_loads)
            yield Correction(CalibrationStatus.FORCE, text, corrected, fit.model.reading)


def _compute_median_reading_ratio(fit: CalibrationFit) -> float:
    """Compute the median ratio of measured readings to those predicted for the scene.

    Ratios are taken without their signs, for solved touches only; 0 if there are none.
    """
    model = fit.model
    is_solved = model.is_solved
    if not is_solved.any():
        return 0.0
    predicted = model.predict(model.parameters.initial, np.zeros((len(model.table), 2))).readings
    ratios = np.abs(model.table.readings[is_solved] / predicted[is_solved])
    return float(np.nanmedian(ratios))


def _propose_frame_corrections(model: ReadingModel) -> Iterator[Correction]:
    """Propose corrections of the frame.

    A correction is left out if its probe loads are those of the file or of an earlier correction.
    """
    table = model.table
    probe = model.parameters.scene.single_probe
    has_rotation = probe is None or bool(probe.period_deg)
    seen = {table.probe_loads.tobytes()}
    for text, probe_loads in _list_frames(table.probe_loads, has_rotation):
        if probe_loads.tobytes() not in seen:
            seen.add(probe_loads.tobytes())
            corrected = replace(table, probe_loads=probe_loads)
            yield Correction(CalibrationStatus.FRAME, text, corrected, model.reading)


def _list_frames(probe_loads: Array, has_rotation: bool) -> Iterator[tuple[str, Array]]:
    """Convert probe loads from frames in which they may have been written by mistake.

    Parameters
    ----------
    probe_loads : ndarray, shape (touches, 4)
        Positions x, y in mm, rotations in degrees and forces in N, as in the file.
    has_rotation : bool
        Whether the probe has a rotation; if not, rotations are not changed.

    Yields
    ------
    text : str
        Description of the mistake.
    probe_loads : ndarray, shape (touches, 4)
        Corrected probe loads.
    """
    x, y, rotation, force = probe_loads.T
    frames = {
        "x_mm has the wrong sign (a mirrored axis)": (-x, y, rotation),
        "y_mm has the wrong sign (a mirrored axis)": (x, -y, rotation),
        "x_mm and rotation_deg have the wrong sign (a mirrored frame)": (-x, y, -rotation),
        "y_mm and rotation_deg have the wrong sign (a mirrored frame)": (x, -y, -rotation),
        "y_mm points the other way (a mirrored frame)": (x, -y, 180.0 - rotation),
        "x_mm and y_mm are swapped": (y, x, rotation),
        "x and y are swapped (a mirrored frame)": (y, x, 90.0 - rotation),
        "rotation_deg is clockwise": (x, y, -rotation),
        "the frame is rotated by 180°": (-x, -y, rotation + 180.0),
        "the frame is rotated by 90°": (-y, x, rotation + 90.0),
        "the frame is rotated by -90°": (y, -x, rotation - 90.0),
    }
    for text, (new_x, new_y, new_rotation) in frames.items():
        if not has_rotation:
            new_rotation = rotation
        yield text, np.column_stack([new_x, new_y, new_rotation, force])


def describe_outlier(fit: CalibrationFit, index: int) -> str:
    """Describe whether the position of a rejected touch may be wrong, or its force or readings.

    The best change of the position and the best change of the force are compared by linear least
    squares; the text names the one with the smaller remaining residuals.

    Parameters
    ----------
    fit : CalibrationFit
        Fit that rejects the touch.
    index : int
        Index of the touch in the table.
    """
    system = fit.whitened
    slopes = np.linalg.solve(system.roots[index], fit.prediction.by_touch[index])
    residuals = system.residuals[index]
    by_place = _compute_misfit(slopes[:, :2], residuals)
    by_force = _compute_misfit(slopes[:, 2:], residuals)
    if by_place < by_force:
        return "its readings match another position; x_mm, y_mm may be wrong"
    return "its readings match another force; force_N or the readings may be wrong"


def _compute_misfit(slopes: Array, residuals: Array) -> float:
    """Compute the sum of squared residuals that remains after a linear least-squares step."""
    step = np.linalg.lstsq(slopes, residuals)[0]
    return float(np.sum((residuals - slopes @ step) ** 2))

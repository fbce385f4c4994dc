"""Diagnosis of touches that no sensor like the scene's explains.

A common mistake in a file of touches is undone by a correction of the touches. Corrections of
readings are ranked by the solves at hand. Corrections of places and forces are tried where no
correction of readings explains the touches for sure; they are ranked by solves of a few touches.
The best corrections are fitted in full.
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

#: Newtons in other units of the force.
FORCE_UNITS_N = {"gram-force (grams)": 1e-3 * g, "kgf": g, "mN": 1e-3, "kN": 1e3}
#: Factor of the best score up to which other corrections are fitted, beside the margin.
SCORE_FACTOR = 1.5


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
    """Touches as they would be without a mistake that may be in the file."""

    status: CalibrationStatus
    text: str  #: The mistake in words.
    table: TouchTable
    reading: str


class ScoredCorrection(NamedTuple):
    """A correction with its score, which is lower for a better fit."""

    score: float
    correction: Correction


class FittedCorrection(NamedTuple):
    """A correction with which a sensor like the scene's explains the touches."""

    correction: Correction
    fit: CalibrationFit


class Diagnosis(NamedTuple):
    """The fit of the touches, and corrections with which a sensor fits them better."""

    fit: CalibrationFit
    corrections: list[FittedCorrection]


def fit_and_diagnose(model: ReadingModel, noise: ReadingNoise) -> Diagnosis:
    """Fit the parameters, and find corrections where the fit is suspect.

    A fit whose first solves leave a hopeless scatter is given up, since the cause is likely a
    mistake in the file. It is made to the end only if no correction explains the touches.

    Parameters
    ----------
    model : ReadingModel
        Readings as a function of the parameters.
    noise : ReadingNoise
        Standard deviations of readings and places.
    """
    options = model.options
    has_enough = len(model.table) >= len(model.parameters)
    max_scatter = options.hopeless_scatter if has_enough else np.inf
    fit = fit_parameters(model, noise, max_scatter)
    # The readings, or the parameters they lead to, are not those of such a sensor.
    is_suspect = not fit.is_converged or fit.p_value < options.min_p_value
    is_suspect |= bool((fit.pulls > options.max_pull).any())
    corrections = _find_corrections(fit) if has_enough and is_suspect else []
    if not corrections and fit.scatter > options.hopeless_scatter and not fit.is_converged:
        fit = fit_parameters(model, noise)
    return Diagnosis(fit, corrections)


def _find_corrections(fit: CalibrationFit) -> list[FittedCorrection]:
    """Find the corrections with which a sensor like the scene's explains the touches."""
    fitted = []
    if fit.model.is_solved.any():
        fitted = _fit_corrections(fit, _propose_reading_corrections(fit.model))
    # Swapped or dead channels may look like a wrong frame; other wrong readings do not.
    ambiguous = {CalibrationStatus.SWAPPED, CalibrationStatus.CHANNEL}
    if {each.correction.status for each in fitted} <= ambiguous:
        fitted += _fit_corrections(fit, _propose_touch_corrections(fit))
    # Without one of the channels the fit is always better, so that others come first.
    others = [each for each in fitted if each.correction.status is not CalibrationStatus.CHANNEL]
    if others:
        fitted = others
    if not fitted:
        return []
    least_chi_square = min(each.fit.chi_square for each in fitted)
    limit = least_chi_square + fit.model.options.chi_square_margin
    return [each for each in fitted if each.fit.chi_square < limit]


def _fit_corrections(
    fit: CalibrationFit, corrections: Iterable[Correction]
) -> list[FittedCorrection]:
    """Fit the best of some corrections in full, and return those that explain the touches."""
    options = fit.model.options
    scored = []
    for correction in corrections:
        scored.append(ScoredCorrection(_score_correction(fit, correction), correction))
    scored.sort(key=attrgetter("score"))
    fitted = []
    for score, correction in scored[: options.max_fits]:
        # The score is infinite where no touch is solved.
        if not score < options.score_margin + SCORE_FACTOR * scored[0].score:
            break
        corrected = fit.model.with_table(correction.table, correction.reading)
        better = fit_parameters(corrected, fit.noise, options.hopeless_scatter)
        if better.is_converged and _is_explanation(fit, better):
            fitted.append(FittedCorrection(correction, better))
    return fitted


def _is_explanation(fit: CalibrationFit, corrected: CalibrationFit) -> bool:
    """Whether the fit of corrected touches is plausible, and better than that of the touches."""
    options = fit.model.options
    is_likely = corrected.p_value > options.min_p_value
    is_plausible = is_likely or corrected.scatter < options.plausible_scatter
    is_better = fit.chi_square > options.min_improvement * corrected.chi_square
    # A likely fit is suspect only for its parameters.
    is_better |= fit.p_value > options.min_p_value
    return is_plausible and is_better and bool((corrected.pulls < options.max_pull).all())


def _score_correction(fit: CalibrationFit, correction: Correction) -> float:
    """Score how badly corrected touches fit a sensor; infinite if none is solved.

    The score is by the solves at hand, or by solves of a few touches where places or forces are
    corrected.

    Notes
    -----
    The score is the sum of log(1 + χ²/n) over touches with n readings, and of log(1 + p²) over
    parameters with the pull p. By the logarithm a few outliers hardly count.
    """
    initial = fit.model.parameters.initial
    model = fit.model.with_table(correction.table, correction.reading)
    if not model.is_solved.any():
        count = model.options.ranking_touches
        few = np.linspace(0, len(correction.table) - 1, count).astype(int)
        table = correction.table.select(np.unique(few).tolist())
        model = model.with_table(table, correction.reading)
        uncorrected_places = np.zeros((len(table), 2))
        every = np.ones(len(table), dtype=bool)
        model.solve_touches(initial, uncorrected_places, every, model.options.first_tolerance)
    uncorrected_places = np.zeros((len(model.table), 2))
    start = CalibrationFit(model, fit.noise, initial, uncorrected_places, model.is_solved)
    robust_fit = start.refit(model.is_solved, is_robust=True)
    if not robust_fit.is_used.any():
        return np.inf
    mean_squares = robust_fit.squared_residuals / np.maximum(robust_fit.reading_counts, 1)
    misfit = np.log1p(mean_squares[robust_fit.is_used]).sum()
    return float(misfit + np.log1p(robust_fit.pulls**2).sum())


def _propose_reading_corrections(model: ReadingModel) -> Iterator[Correction]:
    """Propose corrections of readings, which need no solve."""
    table = model.table
    for misreading in list_misreadings(model.channels, model.unit):
        status = CalibrationStatus(misreading.kind)
        corrected = replace(table, readings=misreading.correct(table.readings))
        yield Correction(status, misreading.text, corrected, model.reading)
    if np.isfinite(model.unloaded_integrals).all():
        other = "total" if model.reading == "change" else "change"
        text = f"readings are of the {other} of the charge, not of the {model.reading};"
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
    """Propose corrections that need solves.

    Frames are corrected where the readings have about the size of the scene's, forces where they
    have another size.
    """
    table = fit.model.table
    size = _compute_size_ratio(fit)
    is_of_size = abs(np.log(max(size, 1e-300))) < np.log(fit.model.options.max_size_ratio)
    if is_of_size:
        yield from _propose_frame_corrections(fit.model)
        return
    # Readings that are too small come from forces in a smaller unit than newton.
    for unit, newtons in FORCE_UNITS_N.items():
        if (newtons < 1.0) == (size < 1.0):
            probe_loads = table.probe_loads * [1.0, 1.0, 1.0, newtons]
            text = f"force_N is in {unit}"
            corrected = replace(table, probe_loads=probe_loads)
            yield Correction(CalibrationStatus.FORCE, text, corrected, fit.model.reading)


def _compute_size_ratio(fit: CalibrationFit) -> float:
    """Compute the median ratio of the readings to the scene's; 0 if no touch is solved."""
    model = fit.model
    is_solved = model.is_solved
    if not is_solved.any():
        return 0.0
    predicted = model.predict(model.parameters.initial, np.zeros((len(model.table), 2))).readings
    ratios = np.abs(model.table.readings[is_solved] / predicted[is_solved])
    return float(np.nanmedian(ratios))


def _propose_frame_corrections(model: ReadingModel) -> Iterator[Correction]:
    """Propose other frames, but for those that leave all touches where they are."""
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
    """List the probe loads in other frames in which they may have been written.

    Parameters
    ----------
    probe_loads : array, (touches, 4)
        Place x, y in mm, rotation in degrees and force in N, as written.
    has_rotation : bool
        Whether the rotation of the probe counts.
    """
    x, y, turn, force = probe_loads.T
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
    for text, (new_x, new_y, new_turn) in frames.items():
        rotation = new_turn if has_rotation else turn
        yield text, np.column_stack([new_x, new_y, rotation, force])


def describe_outlier(fit: CalibrationFit, index: int) -> str:
    """Describe why a touch does not fit.

    A linear step of its place is compared with a linear step of its force: the text names the one
    that leaves the smaller residuals.
    """
    system = fit.whitened
    slopes = np.linalg.solve(system.roots[index], fit.prediction.by_touch[index])
    residuals = system.residuals[index]
    by_place = _compute_misfit(slopes[:, :2], residuals)
    by_force = _compute_misfit(slopes[:, 2:], residuals)
    if by_place < by_force:
        return "its readings are rather those of another place: misplaced?"
    return "its readings are rather those of another force; force_N or the readings are wrong"


def _compute_misfit(slopes: Array, residuals: Array) -> float:
    """Compute the sum of squares that the best linear step leaves of residuals."""
    step = np.linalg.lstsq(slopes, residuals)[0]
    return float(np.sum((residuals - slopes @ step) ** 2))

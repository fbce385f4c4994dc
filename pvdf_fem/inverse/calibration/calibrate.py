"""Calibration of a sensor by touches with known place, rotation and force."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.channel import READINGS, list_units_pC, make_channels
from pvdf_fem.film.loads.load_classes import PROBE_LOADS
from pvdf_fem.inverse.calibration.calibration import Calibration
from pvdf_fem.inverse.calibration.diagnosis import (
    CalibrationStatus,
    Diagnosis,
    describe_outlier,
    fit_and_diagnose,
)
from pvdf_fem.inverse.calibration.fit import CalibrationFit, ReadingNoise
from pvdf_fem.inverse.calibration.options import DEFAULTS, CalibrateOptions
from pvdf_fem.inverse.calibration.parameters import select_parameters
from pvdf_fem.inverse.calibration.reading_model import ReadingModel
from pvdf_fem.inverse.calibration.touch_table import read_touches
from pvdf_fem.progress import Progress, SolveCounter, show_progress
from pvdf_fem.scene.arguments import Names, SceneLike, as_scene, coerce
from pvdf_fem.scene.scene import Scene

DEFAULT_UNKNOWN = ("film.pretension_N_m", "gains")
UNITS = ("pC", "V")  #: Units of readings.


def calibrate(
    scene: SceneLike,
    touches: Any,
    unknown: Sequence[str] = DEFAULT_UNKNOWN,
    *,
    reading: str | None = None,
    unit: str = "pC",
    sigma: float = 0.01,
    noise_pC: float | Mapping[str, float] | None = None,
    place_sd: float = 0.0,
    priors: Mapping[str, float] | None = None,
    progress: Progress | bool | None = None,
    options: CalibrateOptions = DEFAULTS,
) -> Calibration:
    """Fit the parameters of a sensor to touches with known place, rotation and force.

    Parameters
    ----------
    scene : Scene, or anything that `solve` accepts as a scene
        The sensor as it is thought to be, with the probe.
    touches : path, mapping of columns, or table with `columns`
        ``x_mm``, ``y_mm`` and ``rotation_deg`` of the probe on the stage, ``force_N``, and a column
        for each electrode with the readings of its channel. A cell that is empty or NaN is left
        out.
    unknown : sequence of str
        Parameters to fit: keys of the film by which `gradients` differentiates; ``gain.A``,
        ``offset.A`` (V), ``stage.x_mm``, ``stage.y_mm``, ``stage.rotation_deg``; ``gains``,
        ``offsets``, ``shift`` and ``turn`` for groups of these.
    reading : {"change", "total"}, optional
        Whether readings are changes of the charge by the touch or total charges; by default as the
        scene's ``[readout]`` says, else ``change``.
    unit : {"pC", "V"}
        Unit of the readings. Readings in nominal pC are readings in V times the capacitance of
        their channel.
    sigma : float
        Standard deviation of a reading, relative to it.
    noise_pC : float or mapping of str to float, optional
        Absolute standard deviation of a reading in nominal pC, one for all electrodes or one for
        each; by default the ``noise_V`` of the scene's ``[readout]``.
    place_sd : float
        Standard deviation in mm of each coordinate of the touches' places.
    priors : mapping of str to float, optional
        Standard deviations of the priors by parameter or group, relative but for shift, turn (mm,
        degrees) and offsets (V). By default gains 10 %, d31 and d32 20 %, pretension 30 %, other
        film parameters 20 %, shift 1 mm, turn 3°, offsets 0.1 V.
    progress : callable or bool, optional
        Called with the numbers of finished and of expected solves; or whether these are shown, see
        `pvdf_fem.progress.show_progress`.
    options : CalibrateOptions
        When the fit has converged, and when touches do not fit.

    Returns
    -------
    Calibration
        The parameters with their uncertainties, or a status that names the mistake in the touches.

    Raises
    ------
    ValueError
        If arguments are wrong, with a line for each error (`TouchesError`: in the touches).

    Notes
    -----
    Parameters p and errors e of the places minimise the squares of the whitened residuals of
    readings, places and priors; see `pvdf_fem.inverse.calibration.fit`. Touches that are far from a
    fit to the other touches are rejected.

    Examples
    --------
    >>> calibration = calibrate("sensor.toml", "touches.csv", ["film.pretension_N_m", "gains"])
    >>> print(calibration)
    >>> sensor = calibration.scene
    """
    scene = as_scene(scene)
    unknown = coerce("unknown", unknown, Names)
    scene.require_plain_charges("a calibration")
    if reading is None:
        reading = scene.readout.reading if scene.readout else "change"
    sigma = coerce("sigma", sigma, float)
    place_sd = coerce("place_sd", place_sd, float)
    absolute_pC = _list_noise_pC(scene, noise_pC)
    errors = [
        *_find_scene_errors(scene),
        *_find_choice_errors("reading", reading, tuple(READINGS)),
        *_find_choice_errors("unit", unit, UNITS),
        *_find_deviation_errors("sigma", sigma),
        *_find_deviation_errors("noise_pC", *absolute_pC),
        *_find_deviation_errors("place_sd", place_sd),
    ]
    if not sigma and not all(absolute_pC):
        errors.append("sigma = 0: readings have errors; give sigma or noise_pC")
    if errors:
        raise ValueError("\n".join(errors))
    units_pC = list_units_pC(make_channels(scene))[unit]
    noise = ReadingNoise(sigma, absolute=np.array(absolute_pC) / units_pC, place_mm=place_sd)
    parameters = select_parameters(scene, unknown, coerce("priors", priors or {}, dict[str, Any]))
    table = read_touches(touches, scene)
    wanted = options.tolerance_share * sigma
    tolerance = min(max(wanted, options.min_tolerance), options.max_tolerance)
    with show_progress("solves", progress) as show:
        count_solve = SolveCounter(show, options.expected_rounds * len(table))
        model = ReadingModel(
            parameters, table, reading, unit, tolerance, options, count_solve=count_solve
        )
        diagnosis = fit_and_diagnose(model, noise)
    status, reason = _judge(diagnosis)
    return Calibration(
        status,
        reason,
        notes=(*table.notes, *_list_notes(diagnosis)),
        outliers=_list_outliers(diagnosis.fit, status),
        fit=diagnosis.fit,
    )


def _list_noise_pC(scene: Scene, noise_pC: float | Mapping[str, float] | None) -> list[float]:
    """Return the absolute noise of each channel in nominal pC, by default that of the readout."""
    channels = make_channels(scene)
    if noise_pC is None:
        return [1e12 * channel.capacitance * channel.noise for channel in channels]
    if not isinstance(noise_pC, Mapping):
        return [coerce("noise_pC", noise_pC, float)] * len(channels)
    names = [channel.name for channel in channels]
    missing = [name for name in names if name not in noise_pC]
    if missing:
        raise ValueError(f"noise_pC.{missing[0]}: is required; give one for each electrode")
    return [coerce(f"noise_pC.{name}", noise_pC[name], float) for name in names]


def _find_scene_errors(scene: Scene) -> Iterator[str]:
    """Find out whether the scene has a probe that touches can be calibrated with."""
    if scene.single_probe is None:
        yield "probe: is required; add the [probe] that touched the film"
    elif PROBE_LOADS[scene.load.kind].is_rigid:
        reason = "has no derivatives by the place; choose dead or follower"
        yield f'load.kind = "{scene.load.kind}": {reason}'


def _find_choice_errors(name: str, value: str, allowed: Sequence[str]) -> Iterator[str]:
    """Find a value that is not allowed.

    Parameters
    ----------
    name : str
        Name of the argument.
    value : str
        Its value.
    allowed : sequence of str
        All allowed values.
    """
    if value not in allowed:
        yield f"{name} = {value!r}: choose from {', '.join(allowed)}"


def _find_deviation_errors(name: str, *values: float) -> Iterator[str]:
    """Find the first standard deviation that is negative or not finite."""
    for value in values:
        if not 0.0 <= value < np.inf:
            yield f"{name} = {value:g}: give a standard deviation that is not negative"
            return


def _judge(diagnosis: Diagnosis) -> tuple[CalibrationStatus, str]:
    """Return the status of a diagnosed fit, with its reason."""
    fit, corrections = diagnosis
    options = fit.model.options
    count = int(fit.is_used.sum())
    parameters = len(fit.model.parameters)
    is_scattered = fit.scatter > options.max_scatter
    if count < parameters:
        readings = f"{count} touches ({fit.reading_counts[fit.is_used].sum()} readings)"
        text = f"{readings} for {parameters} parameters; give more touches or fit fewer parameters"
        return CalibrationStatus.TOO_FEW, text
    if corrections:
        texts = [each.correction.text for each in corrections]
        return corrections[0].correction.status, "; or ".join(texts)
    if not fit.is_converged:
        text = "solves of the touches fail, or do not converge; correct scene and touches"
        return CalibrationStatus.NOT_CONVERGED, text
    if is_scattered and np.ptp(fit.model.table.forces_N) == 0.0:
        text = "force_N is the same in every row, and other forces would explain the readings"
        return CalibrationStatus.FORCE, text
    if is_scattered:
        text = f"readings scatter {fit.scatter:.2g} times as much as their noise about any sensor"
        return CalibrationStatus.NOT_EXPLAINED, f"{text} like the scene's"
    return CalibrationStatus.CALIBRATED, f"{parameters} parameters from {count} touches"


def _list_outliers(fit: CalibrationFit, status: CalibrationStatus) -> dict[int, str]:
    """Return the reasons why touches did not count, by their rows."""
    model = fit.model
    rows = model.table.rows.tolist()
    outliers = {rows[index]: reason for index, reason in model.failures.items()}
    if status is CalibrationStatus.CALIBRATED:
        for index in np.flatnonzero(model.is_solved & ~fit.is_used).tolist():
            outliers[rows[index]] = describe_outlier(fit, index)
    return outliers


def _list_notes(diagnosis: Diagnosis) -> Iterator[str]:
    """List notes about forces, parameters far from the scene's, scatter and corrections."""
    fit = diagnosis.fit
    options = fit.model.options
    forces_N: Array = fit.model.table.forces_N
    if np.ptp(forces_N) == 0.0:
        yield f"force_N is {forces_N[0]:g} in every row; touches with several forces determine more"
    for index in np.flatnonzero(fit.pulls > options.max_pull):
        name = fit.model.parameters.names[index]
        yield f"{name}: is {fit.pulls[index]:.2g} deviations of its prior from the scene's value"
    if fit.p_value < options.min_p_value:
        text = f"readings scatter {fit.scatter:.2g} times as much as their noise, so do the ±"
        advice = "" if fit.noise.place_mm else "; if the places are uncertain, give place_sd"
        yield text + advice
    for correction, better in diagnosis.corrections:
        values = f"{fit.chi_square:.3g} to {better.chi_square:.3g}"
        yield f"{correction.text}: chi-square falls from {values}"

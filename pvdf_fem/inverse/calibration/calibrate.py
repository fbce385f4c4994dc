"""Calibration of a sensor from touches at known positions, rotations and forces."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.channel import (
    READINGS,
    find_unit_errors,
    get_reading_unit,
    list_units_pC,
    make_channels,
)
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
from pvdf_fem.inverse.calibration.touch_columns import TouchesError
from pvdf_fem.inverse.calibration.touch_table import read_touches
from pvdf_fem.inverse.calibration.unit_diagnosis import diagnose_unit
from pvdf_fem.inverse.clipping import CLIPPED_ADVICE
from pvdf_fem.inverse.reading_unit import OtherUnit
from pvdf_fem.progress import Progress, SolveCounter, show_progress
from pvdf_fem.scene.arguments import Names, SceneLike, as_scene, coerce
from pvdf_fem.scene.scene import Scene

DEFAULT_UNKNOWN = ("film.pretension_N_m", "gains")


def calibrate(
    scene: SceneLike,
    touches: Any,
    unknown: Sequence[str] = DEFAULT_UNKNOWN,
    *,
    reading: str | None = None,
    unit: str | None = None,
    sigma: float = 0.01,
    noise_pC: float | Mapping[str, float] | None = None,
    place_sd: float = 0.0,
    priors: Mapping[str, float] | None = None,
    progress: Progress | bool | None = None,
    options: CalibrateOptions = DEFAULTS,
) -> Calibration:
    """Fit the parameters of a sensor to touches at known positions, rotations and forces.

    Parameters
    ----------
    scene : Scene, or anything that `solve` accepts as a scene
        Nominal sensor with the probe; its values are the initial guess and the means of the priors.
    touches : path, mapping of columns, or table with `columns`
        ``x_mm``, ``y_mm`` and ``rotation_deg`` of the probe on the stage, ``force_N``, and a column
        for each electrode with the readings of its channel. Cells that are empty or NaN are
        missing; touches without a position, a force or any reading are left out.
    unknown : sequence of str
        Parameters to fit: the keys of the film that `gradients` differentiates with respect to,
        ``gain.A``, ``offset.A`` (V), ``stage.x_mm``, ``stage.y_mm`` and ``stage.rotation_deg``. The
        words ``gains``, ``offsets``, ``shift`` and ``turn`` stand for groups of these.
    reading : {"change", "total"}, optional
        Whether the readings are the changes of the charges due to the touch, or total charges.
        Default: the value of the scene's ``[readout]``, ``change`` without one.
    unit : str, optional
        Unit of the readings, of `READING_UNITS`. Default: ``readout.unit``, which is V unless the
        scene says otherwise, or pC without a readout; if the readings contradict this default, the
        unit in which they fit, which `Calibration.notes` then says. Readings in nominal pC are
        readings in V times the capacitance of their channel.
    sigma : float
        Relative standard deviation of the readings.
    noise_pC : float or mapping of str to float, optional
        Absolute standard deviation of the readings in nominal pC, for all electrodes or by name.
        Default: the ``noise_V`` of the scene's ``[readout]``.
    place_sd : float
        Standard deviation in mm of the coordinates x and y of the touches.
    priors : mapping of str to float, optional
        Standard deviations of the priors by parameter or group. They are relative, except those of
        shift (mm), turn (degrees) and offsets (V). Default: gains 10 %, pretension 30 %, other film
        parameters 20 %, shift 1 mm, turn 3°, offsets 0.1 V.
    progress : callable or bool, optional
        Function that is called with the numbers of finished and expected solves, or whether to
        show these; see `pvdf_fem.progress.show_progress`.
    options : CalibrateOptions
        Criteria of convergence, of outliers and of the diagnosis.

    Returns
    -------
    Calibration
        Parameters with their uncertainties, or a status and a reason why they cannot be used, such
        as a mistake in the touches.

    Raises
    ------
    ValueError
        If arguments are wrong; the message has a line for each error. It is a `TouchesError` if
        the error is in the touches.

    Notes
    -----
    The parameters p and the position errors e minimise the sum of squares of the whitened residuals
    of readings, positions and priors; see `pvdf_fem.inverse.calibration.fit`. Outliers, touches
    that are far from a fit to the other touches, are rejected.

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
        *_find_calibration_probe_errors(scene),
        *_find_choice_errors("reading", reading, tuple(READINGS)),
        *find_unit_errors(scene, unit),
        *_find_invalid_deviation_errors("sigma", sigma),
        *_find_invalid_deviation_errors("noise_pC", *absolute_pC),
        *_find_invalid_deviation_errors("place_sd", place_sd),
    ]
    if not sigma and not all(absolute_pC):
        errors.append(
            "sigma = 0: must be positive, since readings have noise; give sigma or noise_pC"
        )
    if errors:
        raise ValueError("\n".join(errors))
    parameters = select_parameters(scene, unknown, coerce("priors", priors or {}, dict[str, Any]))
    table = read_touches(touches, scene, unit)
    unit = table.unit
    errors += find_unit_errors(scene, unit, "touches: readings in")
    if errors:
        raise TouchesError(*errors)
    stated_unit = get_reading_unit(scene) if unit is None else unit
    tolerance = max(options.tolerance_fraction * sigma, options.min_tolerance)
    tolerance = min(tolerance, options.max_tolerance)
    with show_progress("solves", progress) as show:
        count_solve = SolveCounter(show, options.expected_rounds * len(table))
        model = ReadingModel(
            parameters, table, reading, stated_unit, tolerance, options, count_solve=count_solve
        )
        other = diagnose_unit(model)
        unit_notes = []
        if other is not None:
            if unit is not None or other.unit is None or scene.readout is None:
                return _refuse_unit(model, other, _make_noise(model, sigma, absolute_pC, place_sd))
            unit_notes.append(f"unit: {other.unit}; {other.text}")
            model = model.with_unit(other.unit)
        model = model.leave_out_clipped()
        diagnosis = fit_and_diagnose(model, _make_noise(model, sigma, absolute_pC, place_sd))
    status, reason = _determine_status(diagnosis)
    return Calibration(
        status,
        reason,
        notes=(*unit_notes, *model.table.notes, *_list_notes(diagnosis)),
        outliers=_list_rejection_reasons(diagnosis.fit, status),
        fit=diagnosis.fit,
    )


def _make_noise(
    model: ReadingModel, sigma: float, absolute_pC: Sequence[float], place_sd: float
) -> ReadingNoise:
    """Make the noise of readings in the unit of a model.

    Parameters
    ----------
    model : ReadingModel
        Model with the unit and the channels.
    sigma : float
        Relative standard deviation of the readings.
    absolute_pC : sequence of float
        Absolute standard deviation of the readings of each channel in nominal pC.
    place_sd : float
        Standard deviation of the coordinates of a touch in mm.
    """
    units_pC = list_units_pC(model.channels)[model.unit]
    return ReadingNoise(sigma, absolute=np.array(absolute_pC) / units_pC, place_mm=place_sd)


def _refuse_unit(model: ReadingModel, other: OtherUnit, noise: ReadingNoise) -> Calibration:
    """Return a calibration without a fit, since the readings are in another unit.

    Parameters
    ----------
    model : ReadingModel
        Model in which a few touches are solved.
    other : OtherUnit
        The unit in which the readings fit.
    noise : ReadingNoise
        Standard deviations of the readings.
    """
    no_corrections = np.zeros((len(model.table), 2))
    fit = CalibrationFit(
        model,
        noise,
        model.parameters.initial,
        no_corrections,
        is_used=model.is_solved,
        is_converged=False,
    )
    reason = f"{other.text}; give {other.options}"
    if model.parameters.scene.readout is None:
        reason += ", or add a [readout] if they are in V"
    return Calibration(
        CalibrationStatus.UNIT, reason, notes=model.table.notes, outliers={}, fit=fit
    )


def _list_noise_pC(scene: Scene, noise_pC: float | Mapping[str, float] | None) -> list[float]:
    """Return the absolute noise of each channel in nominal pC (V times its capacitance).

    Parameters
    ----------
    scene : Scene
        Scene with the electrodes and the readout.
    noise_pC : float or mapping of str to float, optional
        Noise of all electrodes or by name. Default: the noise of the scene's readout.

    Raises
    ------
    ValueError
        If an electrode is missing in a mapping, or a value is not a number.
    """
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


def _find_calibration_probe_errors(scene: Scene) -> Iterator[str]:
    """Yield a message if the scene does not have a single probe, or if the probe is rigid."""
    if scene.single_probe is None:
        yield "probe: is required; add the [probe] that touched the film"
    elif PROBE_LOADS[scene.load.kind].is_rigid:
        reason = "has no derivatives with respect to the position; choose dead or follower"
        yield f'load.kind = "{scene.load.kind}": {reason}'


def _find_choice_errors(name: str, value: str, allowed: Sequence[str]) -> Iterator[str]:
    """Yield a message if the value of an argument is not one of the allowed values.

    Parameters
    ----------
    name : str
        Name of the argument, for the message.
    value : str
        Value to check.
    allowed : sequence of str
        Allowed values.
    """
    if value not in allowed:
        yield f"{name} = {value!r}: choose from {', '.join(allowed)}"


def _find_invalid_deviation_errors(name: str, *values: float) -> Iterator[str]:
    """Yield a message for the first standard deviation that is negative or not finite, if any."""
    for value in values:
        if not 0.0 <= value < np.inf:
            yield f"{name} = {value:g}: is not a standard deviation; give a number of at least 0"
            return


def _determine_status(diagnosis: Diagnosis) -> tuple[CalibrationStatus, str]:
    """Determine the status of a diagnosed fit, and the reason in words.

    If several statuses apply, too few touches come first, then the mistakes that were found, a
    search that has not converged, and residuals that are too large.
    """
    fit, corrections = diagnosis
    options = fit.model.options
    count = int(fit.is_used.sum())
    parameters = len(fit.model.parameters)
    is_scattered = fit.scatter > options.max_scatter
    if count < parameters:
        readings = f"{count} touches ({fit.reading_counts[fit.is_used].sum()} readings)"
        text = f"{readings} for {parameters} parameters"
        clipped = fit.model.table.clipped
        if clipped:
            text = f"{len(clipped)} readings are clipped, which leaves {text}; {CLIPPED_ADVICE}"
            return CalibrationStatus.CLIPPED, text
        return CalibrationStatus.TOO_FEW, f"{text}; give more touches or fit fewer parameters"
    if corrections:
        texts = [each.correction.text for each in corrections]
        return corrections[0].correction.status, "; or ".join(texts)
    if not fit.is_converged:
        text = (
            "the touches cannot be solved, or the fit does not converge; correct scene and touches"
        )
        return CalibrationStatus.NOT_CONVERGED, text
    if is_scattered and np.ptp(fit.model.table.forces_N) == 0.0:
        text = "force_N is the same in every row, and other forces would explain the readings"
        return CalibrationStatus.FORCE, text
    if is_scattered:
        text = f"residuals are {fit.scatter:.2g} times as large as the noise for any sensor"
        return CalibrationStatus.NOT_EXPLAINED, f"{text} like the scene's"
    return CalibrationStatus.CALIBRATED, f"{parameters} parameters from {count} touches"


def _list_rejection_reasons(fit: CalibrationFit, status: CalibrationStatus) -> dict[int, str]:
    """Return the reasons why touches were not used, by their rows.

    Touches that could not be solved are always listed; touches that the fit rejects as outliers
    are listed only if the status is ``calibrated``.
    """
    model = fit.model
    rows = model.table.rows.tolist()
    outliers = {rows[index]: reason for index, reason in model.failures.items()}
    if status is CalibrationStatus.CALIBRATED:
        for index in np.flatnonzero(model.is_solved & ~fit.is_used).tolist():
            outliers[rows[index]] = describe_outlier(fit, index)
    return outliers


def _list_notes(diagnosis: Diagnosis) -> Iterator[str]:
    """Yield notes on equal forces, parameters far from the scene's values and large residuals.

    They are followed by notes on clipped readings that the fit contradicts. The last notes are the
    corrections that explain the touches better.
    """
    fit = diagnosis.fit
    options = fit.model.options
    forces_N: Array = fit.model.table.forces_N
    if np.ptp(forces_N) == 0.0:
        constant = f"force_N is {forces_N[0]:g} in every row"
        yield f"{constant}; touches with different forces determine more parameters"
    for index in np.flatnonzero(fit.pulls > options.max_pull):
        name = fit.model.parameters.names[index]
        distance = f"{fit.pulls[index]:.2g} standard deviations of its prior"
        yield f"{name}: is {distance} away from the scene's value"
    if fit.p_value < options.min_p_value:
        text = (
            f"residuals are {fit.scatter:.2g} times as large as the noise; ± is enlarged likewise"
        )
        advice = "" if fit.noise.place_mm else "; if the positions are uncertain, give place_sd"
        yield text + advice
    yield from _list_contradicted_limits(fit)
    for correction, better in diagnosis.corrections:
        values = f"{fit.chi_square:.3g} to {better.chi_square:.3g}"
        yield f"{correction.text}: with this correction chi-square falls from {values}"


def _list_contradicted_limits(fit: CalibrationFit) -> Iterator[str]:
    """Yield a note for each clipped reading whose prediction is clearly within its limit.

    Nothing is yielded unless the fit has converged.
    """
    model = fit.model
    rows = model.table.rows.tolist()
    names = [channel.name for channel in model.channels]
    for row, electrode, limit, side in model.table.clipped if fit.is_converged else ():
        if row not in rows or not fit.is_used[rows.index(row)]:
            continue
        at = (rows.index(row), names.index(electrode))
        predicted = float(fit.prediction.readings[at])
        by_place = fit.noise.place_mm * np.linalg.norm(fit.prediction.by_touch[at][:2])
        deviation = np.hypot(fit.noise.sigma * limit, fit.noise.absolute[at[1]])
        deviation = fit.scatter * np.hypot(deviation, by_place)
        if side * (limit - predicted) > fit.model.options.max_limit_pull * deviation:
            values = f"{limit:.6g} {model.unit}, but {predicted:.6g} ± {deviation:.2g} is predicted"
            yield f"row {row}: {electrode} looks clipped at {values}; check the channel"

"""From known touches and what the channels read to the sensor."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from pvdf_fem.electrodes.channel import READINGS, list_units_pC, make_channels
from pvdf_fem.film.loads.load_classes import PROBE_LOADS
from pvdf_fem.inverse.calibration.calibration import Calibration
from pvdf_fem.inverse.calibration.diagnosis import (
    CalibrationStatus,
    Correction,
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
CHOICES = {"reading": tuple(READINGS), "unit": ("pC", "V")}


def calibrate(
    scene: SceneLike,
    touches: Any,
    unknown: Sequence[str] = DEFAULT_UNKNOWN,
    *,
    reading: str | None = None,
    unit: str = "pC",
    sigma: float = 0.01,
    noise: float | None = None,
    place_sd: float = 0.0,
    priors: Mapping[str, float] | None = None,
    progress: Progress | bool | None = None,
    options: CalibrateOptions = DEFAULTS,
) -> Calibration:
    """Parameters of a sensor from touches with known place, rotation and force.

    Parameters
    ----------
    scene : Scene, or what `solve` takes for a scene
        The sensor as it is thought to be, with the probe.
    touches : path, mapping of columns, or table with `columns`
        ``x_mm``, ``y_mm`` and ``rotation_deg`` on the stage, ``force_N``, and a column for each
        electrode with what its channel read. A cell that is empty or NaN is left out.
    unknown : sequence of str
        What is sought: keys of the film by which `gradients` differentiates; ``gain.A``,
        ``offset.A`` (V), ``stage.x_mm``, ``stage.y_mm``, ``stage.rotation_deg``; ``gains``,
        ``offsets``, ``shift`` and ``turn`` for groups of these.
    reading : {"change", "total"}, optional
        Of what readings are; by default what the scene's ``[readout]`` says, else ``change``.
    unit : {"pC", "V"}
        Of the readings; those in pC are readings in V times the channel's capacitance.
    sigma, noise : float
        Standard deviations of a reading: relative to it, and in its unit, by default the readout's
        ``noise_V``.
    place_sd : float
        Standard deviation in mm of each coordinate of the touches' places.
    priors : mapping, optional
        Standard deviations by parameter or group, relative but for shift, turn (mm, degrees) and
        offsets (V). By default gains 10 %, d31 and d32 20 %, pretension 30 %, other film
        parameters 20 %, shift 1 mm, turn 3°, offsets 0.1 V.
    progress : callable or bool, optional
        Called with the numbers of finished and of expected solves; or whether these are shown, see
        `pvdf_fem.progress.show_progress`.
    options : CalibrateOptions
        When the fit has ended, and what is taken for a mistake.

    Raises
    ------
    ValueError
        A line for each mistake in the arguments (`TouchesError`: in the touches).

    Examples
    --------
    >>> found = calibrate("sensor.toml", "touches.csv", ["film.pretension_N_m", "gains"])
    >>> print(found)
    >>> sensor = found.scene
    """
    scene, unknown = as_scene(scene), coerce("unknown", unknown, Names)
    scene.require_plain_charges("a calibration")
    if reading is None:
        reading = scene.readout.reading if scene.readout else "change"
    deviations = {"sigma": sigma, "place_sd": place_sd}
    deviations |= {} if noise is None else {"noise": noise}
    deviations = {name: coerce(name, value, float) for name, value in deviations.items()}
    if mistakes := _mistakes(scene, {"reading": reading, "unit": unit}, deviations):
        raise ValueError("\n".join(mistakes))
    wired = make_channels(scene)
    in_unit = (
        list_units_pC(wired)["V"]
        / list_units_pC(wired)[unit]
        * [channel.noise for channel in wired]
    )
    uncertain = ReadingNoise(
        deviations["sigma"],
        np.broadcast_to(deviations.get("noise", in_unit), len(wired)),
        deviations["place_sd"],
    )
    unknowns = select_parameters(scene, unknown, coerce("priors", priors or {}, dict[str, Any]))
    given = read_touches(touches, scene)
    tolerance = min(max(options.tolerance_share * sigma, options.finest), options.coarsest)
    expected = options.expected_rounds * len(given)
    with show_progress("solves", progress) as show:
        count = SolveCounter(show, expected)
        model = ReadingModel(unknowns, given, reading, unit, tolerance, options, count=count)
        fit, found = fit_and_diagnose(model, uncertain)
    status, reason = _judged(fit, found)
    rows, bad = given.rows.tolist(), np.flatnonzero(model.solved & ~fit.kept).tolist()
    outliers = {rows[i]: why for i, why in model.failures.items()}
    if status is CalibrationStatus.CALIBRATED:
        outliers |= {rows[i]: describe_outlier(fit, i) for i in bad}
    remarks = (*given.remarks, *_remarks(fit, found))
    return Calibration(status, reason, remarks, outliers, fit)


def _mistakes(scene: Scene, words: Mapping[str, str], deviations: Mapping[str, float]) -> list[str]:
    mistakes = []
    if scene.single_probe is None:
        mistakes.append("probe: the scene has none; add the [probe] that touched the film")
    elif PROBE_LOADS[scene.load.kind].is_rigid:
        reason = "has no derivatives by the place; take dead or follower"
        mistakes.append(f'load.kind = "{scene.load.kind}": {reason}')
    for name, word in words.items():
        if word not in CHOICES[name]:
            mistakes.append(f"{name} = {word!r}: choose from {', '.join(CHOICES[name])}")
    for name, value in deviations.items():
        if not 0.0 <= value < np.inf:
            mistakes.append(f"{name} = {value:g}: give a standard deviation, not negative")
    quietest = min(channel.noise for channel in make_channels(scene))
    if not (deviations["sigma"] or deviations.get("noise", quietest)):
        mistakes.append("sigma = 0: readings have errors; give sigma or noise")
    return mistakes


def _judged(
    fit: CalibrationFit, found: Sequence[tuple[Correction, CalibrationFit]]
) -> tuple[CalibrationStatus, str]:
    """Status and reason of a fit, and of the changes that explain the touches better."""
    unknowns, count = len(fit.model.unknowns.names), int(fit.kept.sum())
    is_scattered = fit.scale > fit.model.options.most_scatter
    if count < unknowns:
        readings = f"{count} touches ({fit.counts[fit.kept].sum()} readings)"
        text = f"{readings} for {unknowns} unknowns; give more touches or seek less"
        return CalibrationStatus.TOO_FEW, text
    if found:
        return found[0][0].status, "; or ".join(change.text for change, _ in found)
    if not fit.converged:
        text = "solves of the touches do not settle, or fail; correct scene and touches"
        return CalibrationStatus.NOT_CONVERGED, text
    if is_scattered and np.ptp(fit.model.touches.touches[:, 3]) == 0.0:
        text = "force_N is the same in every row, and the readings ask for others"
        return CalibrationStatus.FORCE, text
    if is_scattered:
        text = f"readings scatter {fit.scale:.2g} times as much as their noise about any sensor"
        return CalibrationStatus.NOT_EXPLAINED, f"{text} like the scene's"
    return CalibrationStatus.CALIBRATED, f"{unknowns} parameters from {count} touches"


def _remarks(
    fit: CalibrationFit, found: Sequence[tuple[Correction, CalibrationFit]]
) -> Iterator[str]:
    """What is remarkable in touches and in what they tell."""
    force, names = fit.model.touches.touches[:, 3], fit.model.unknowns.names
    if np.ptp(force) == 0.0:
        yield f"force_N is {force[0]:g} in every row; touches with several forces tell more"
    for i in np.flatnonzero(fit.pulls > fit.model.options.far):
        far = f"{fit.pulls[i]:.2g} deviations of its prior from the scene's value"
        yield f"{names[i]}: is {far}"
    if fit.p_value < fit.model.options.unlikely:
        text = f"readings scatter {fit.scale:.2g} times as much as their noise, so do the ±"
        yield text + "; if the places are uncertain, give place_sd" * (not fit.noise.place_mm)
    for change, better in found:
        values = f"{fit.chi_square:.3g} to {better.chi_square:.3g}"
        yield f"{change.text}: chi-square falls from {values}"

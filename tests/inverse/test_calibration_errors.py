"""Errors that a calibration has left: their effect on residuals, and on located touches."""

from __future__ import annotations

import numpy as np
import pytest

from pvdf_fem import calibrate, locate
from pvdf_fem.inverse.calibration.parameters import find_scene_key, get_parameter
from pvdf_fem.inverse.calibration_errors import whiten
from pvdf_fem.inverse.touch.locate_many import locate_many
from pvdf_fem.inverse.touch.measurement import Measurement
from pvdf_fem.inverse.tracking.charges.charge_sample import ChargeSample
from pvdf_fem.inverse.tracking.options import DEFAULTS
from pvdf_fem.inverse.tracking.problem.contact_problem import ContactProblem
from pvdf_fem.surrogate.touch_domain import TouchColumn
from tests.helpers.touched_sensor import (
    NAMES,
    SCENE,
    UNKNOWN,
    TouchedResponse,
    make_columns,
    patch_solver,
)

GAINS = {"A": 1.07, "B": 0.94, "C": -1.03, "D": 0.98}
OFFSETS_V = {"A": 0.02, "B": -0.01, "C": 0.0, "D": 0.03}
SENSOR = SCENE.with_(
    readout={"gain": GAINS, "offset_V": OFFSETS_V, "feedback_capacitance_pF": 500.0},
    stage={"x_mm": 30.0, "y_mm": -5.0, "rotation_deg": 40.0},
)
#: Position on the stage, rotation and force of a touch.
TOUCH = np.array([33.0, -7.0, 65.0, 0.8])
KEYS = {
    "film.pretension_N_m": 1e-3,
    "readout.gain.B": 1e-5,
    "readout.gain.C": 1e-5,
    "readout.offset_V.D": 1e-5,
    "stage.x_mm": 1e-4,
    "stage.y_mm": 1e-4,
    "stage.rotation_deg": 1e-3,
}


def find_name(key):
    """Return the name of a parameter of calibrations by its key in the scene."""
    return key.removeprefix("readout.").replace("offset_V", "offset")


def make_problem(scene, readings_pC, reading, include_calibration=False):
    """Make the problem of one row of readings in pC."""
    measurement = Measurement.from_response(
        TouchedResponse(scene),
        NAMES,
        sigma=0.01,
        noise_pC=1.0,
        reading=reading,
        include_calibration=include_calibration,
    )
    return measurement.make_problem(readings_pC[None], np.arange(4))


def compute_residuals(problem):
    """Compute the residuals in pC of the touch at its place on the stage; shape (electrodes,)."""
    coordinates = problem.to_coordinates(TOUCH[None])
    return problem.compute_residuals(coordinates, slice(1)).system[0, :, 0]


@pytest.mark.parametrize("reading", ["change", "total"])
def test_effects_are_those_of_changed_parameters_on_residuals(reading):
    """With one uncertain parameter, the effect is its deviation times a difference quotient."""
    readings_pC = np.array([700.0, 500.0, -400.0, 300.0])
    for key, step in KEYS.items():
        assert find_scene_key(find_name(key)) == key
        table = {"keys": [key], "deviations": [2.0]}
        problem = make_problem(
            SENSOR.with_(calibration=table), readings_pC, reading, include_calibration=True
        )
        coordinates = problem.to_coordinates(TOUCH[None])
        found = problem.compute_residuals(coordinates, slice(1))
        effects = problem.calibration.compute_effects(
            coordinates, found.system[:, :, 1:], found.film_effects, slice(1)
        )
        value = get_parameter(SENSOR, find_name(key))
        ends = []
        for changed in (value + step, value - step):
            scene = SENSOR.with_(**{key: changed})
            ends.append(compute_residuals(make_problem(scene, readings_pC, reading)))
        expected = 2.0 * (ends[0] - ends[1]) / (2.0 * step)
        sign = np.sign(effects[0, :, 0] @ expected)  # that of a square root is arbitrary
        np.testing.assert_allclose(sign * effects[0, :, 0], expected, rtol=1e-4, atol=1e-4)


def test_whitened_residuals_have_the_inverse_covariance():
    """A limit keeps its own variance, and one at infinity reaches no other residual."""
    random = np.random.default_rng(3)
    system = random.standard_normal((5, 4, 3))
    deviations = random.uniform(0.5, 2.0, (1, 4))
    effects = random.standard_normal((5, 4, 2))
    is_limit = np.zeros((1, 4), dtype=bool)
    whitened = whiten(system, deviations, effects, is_limit)
    covariances = effects @ effects.swapaxes(1, 2) + np.diag(deviations[0] ** 2)
    expected = system.swapaxes(1, 2) @ np.linalg.solve(covariances, system)
    np.testing.assert_allclose(whitened.swapaxes(1, 2) @ whitened, expected, rtol=1e-10)

    is_limit[0, 1] = True
    others = [0, 2, 3]
    system[:, 1, 0] = np.inf
    limited = whiten(system, deviations, effects, is_limit)
    alone = whiten(
        system[:, others], deviations[:, others], effects[:, others], is_limit[:, others]
    )
    np.testing.assert_allclose(
        np.square(limited[:, others]).sum(axis=1), np.square(alone).sum(axis=1), rtol=1e-10
    )
    variance = deviations[0, 1] ** 2 + np.square(effects[:, 1]).sum(axis=1)
    np.testing.assert_allclose(limited[:, 1, 1], system[:, 1, 1] / np.sqrt(variance))


def test_an_uncertain_stage_is_an_uncertain_place():
    """Its variance is added to that of the place, and changes neither touch nor chi-square."""
    table = {"keys": ["stage.x_mm", "stage.y_mm"], "deviations": [0.1, 0.05]}
    scene = SCENE.with_(calibration=table)
    response = TouchedResponse(scene)
    columns = make_columns(5, sigma=0.003, true={"film.pretension_N_m": 8.0})
    rows = np.column_stack([columns[name] for name in NAMES])
    known = {"rotations_deg": columns["rotation_deg"], "reading": "change", "unit": "pC"}
    found = locate_many(response, rows, 0.003, **known)
    without = locate_many(response, rows, 0.003, include_calibration=False, **known)
    assert found.values == pytest.approx(without.values, abs=1e-3)
    assert found.chi_square == pytest.approx(without.chi_square, abs=1e-2)
    added = found.covariances - without.covariances
    for covariance in added:
        assert covariance == pytest.approx(np.diag([0.01, 0.0025, 0.0]), abs=2e-4)
    readings = dict(zip(NAMES, rows[0].tolist(), strict=True))
    location = locate(
        response,
        readings,
        0.003,
        known={"rotation_deg": columns["rotation_deg"][0]},
        reading="change",
    )
    expected = found.covariances[0][0, 0] ** 0.5
    assert location.deviations["x_mm"] == pytest.approx(expected, rel=0.05)


def draw_parameters(random):
    """Draw true parameters of a sensor from the priors of its calibration."""
    true = {"film.pretension_N_m": 8.0 * (1.0 + 0.2 * random.standard_normal())}
    for name in NAMES:
        true[f"gain.{name}"] = 1.0 + 0.05 * random.standard_normal()
    for name, deviation in {"x_mm": 0.7, "y_mm": 0.7, "rotation_deg": 2.0}.items():
        true[f"stage.{name}"] = deviation * random.standard_normal()
    return true


PRIORS = {"film.pretension_N_m": 0.2, "gains": 0.05, "shift": 0.7, "turn": 2.0}


def measure_pulls(calibrations):
    """Calibrate sensors by eight touches, and locate six others of each with the fitted sensor.

    Return errors over deviations (touches, 3) of x, y and force, and the chi-square of each touch,
    with the errors of the calibration and without.
    """
    pulls = {True: [], False: []}
    chi_square = {True: [], False: []}
    for seed in range(calibrations):
        true = draw_parameters(np.random.default_rng(1000 + seed))
        touches = make_columns(8, sigma=0.01, place_sd=0.3, seed=seed, true=true)
        calibration = calibrate(SCENE, touches, UNKNOWN, place_sd=0.3, priors=PRIORS)
        response = TouchedResponse(calibration.scene)
        columns = make_columns(6, sigma=0.002, seed=5000 + seed, true=true)
        rows = np.column_stack([columns[name] for name in NAMES])
        truth = np.column_stack([columns[name] for name in ("x_mm", "y_mm", "force_N")])
        for included in pulls:
            found = locate_many(
                response,
                rows,
                0.002,
                rotations_deg=columns["rotation_deg"],
                reading="change",
                include_calibration=included,
            )
            errors = found.values[:, [0, 1, TouchColumn.FORCE]] - truth
            pulls[included].append(errors / found.deviations)
            chi_square[included].append(found.chi_square)
    result = {}
    for included in pulls:
        result[included] = np.concatenate(pulls[included]), np.concatenate(chi_square[included])
    return result


@pytest.mark.parametrize(
    ("calibrations", "low", "high"),
    [(8, 0.5, 1.6), pytest.param(80, 0.8, 1.2, marks=pytest.mark.slow)],
)
def test_deviations_hold_over_calibrations_with_few_touches(monkeypatch, calibrations, low, high):
    """Their rms pull is 1, and chi-square is that of one degree of freedom.

    Without the errors of the calibration, touches are 4 to 9 deviations off, and a fifth of them is
    not explained. The touches of one calibration share its errors: with 8 of them a rms pull has an
    error of a quarter.
    """
    patch_solver(monkeypatch)
    found = measure_pulls(calibrations)
    pulls, chi_square = found[True]
    rms = np.sqrt(np.square(pulls).mean(axis=0))
    assert ((low < rms) & (rms < high)).all(), rms
    assert np.mean(chi_square) == pytest.approx(1.0, abs=0.5)
    pulls, chi_square = found[False]
    assert (np.sqrt(np.square(pulls).mean(axis=0)) > 3.0).all()
    assert np.mean(chi_square) > 3.0


@pytest.mark.parametrize("noise_pC", [1.0, 0.1, 0.01])
def test_the_mean_of_many_samples_keeps_the_errors_of_the_calibration(noise_pC):
    """The noise of a contact's peak falls with the number of its samples; gains do not."""
    table = {"keys": [f"readout.gain.{name}" for name in NAMES], "deviations": [0.02] * 4}
    response = TouchedResponse(SCENE.with_(calibration=table))
    touch = np.array([[3.0, -2.0, 0.0, 0.8]])
    unloaded_pC = np.array(response.unloaded_charges_pC[0])
    changes_pC = response.evaluate(touch)[0][0] - unloaded_pC
    zeros = np.zeros(4)
    factors = np.array([1.01, 0.99, 1.02, 0.98])  # wrong gains, of about a deviation
    sample = ChargeSample(
        0.0,
        factors * changes_pC,
        noise_variance=zeros + noise_pC**2,
        walk_variance=zeros,
        drift_pC=zeros,
        sampling_variance=0.0,
        is_clipped=np.zeros(4, dtype=bool),
    )
    fixed = {TouchColumn.ROTATION: 0.0}
    candidates = ContactProblem.from_response(response, fixed, DEFAULTS).locate(sample)
    assert candidates.is_explained
    errors = candidates.likeliest[[0, 1]] - touch[0, :2]
    assert (np.abs(errors) < 3.0 * candidates.deviations[[0, 1]]).all()
    exact = ContactProblem.from_response(response, fixed, DEFAULTS, include_calibration=False)
    without = exact.locate(sample)
    assert not without.is_explained
    assert without.deviations[0] < candidates.deviations[0]
    assert candidates.deviations[0] > 0.05

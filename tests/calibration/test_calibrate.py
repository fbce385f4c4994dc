"""Calibrations of a made-up sensor: what is found, what is left out, and what is wrong."""

import re
from functools import cache

import numpy as np
import pytest

from pvdf_fem import Scene, calibrate
from pvdf_fem.calibration import diagnosis, model
from pvdf_fem.calibration.model import TouchModel
from pvdf_fem.calibration.touches import read_touches
from pvdf_fem.calibration.unknowns import unknowns_of
from pvdf_fem.charges.goals import goals_of
from pvdf_fem.solution.solve import solve_goals
from tests.helpers.touched_sensor import NAMES, SCENE, TRUE, UNKNOWN, made


@pytest.fixture(scope="module", autouse=True)
def solved_once():
    """Fits of the same touches begin with the same scenes."""
    with pytest.MonkeyPatch.context() as patched:
        solved = cache(lambda scene: solve_goals(scene, goals_of(scene)))
        patched.setattr(model, "solve_goals", lambda scene, goals: solved(scene))
        yield


@pytest.fixture(scope="module")
def found():
    return calibrate(SCENE, made(sigma=0.01, place_sd=0.3), UNKNOWN, place_sd=0.3)


def test_exact_readings_give_the_true_parameters():
    told = []
    calibration = calibrate(SCENE, made(), UNKNOWN, sigma=4e-3, progress=lambda *n: told.append(n))
    assert [done for done, _ in told] == [*range(1, len(told) + 1)]
    assert all(done <= total for done, total in told)
    assert (calibration.status, calibration.outliers) == ("calibrated", {})
    for name, true in TRUE.items():
        of = calibration.parameters[name]
        assert abs(of["value"] - true) < 1.5 * of["deviation"], name
        unit = 1.0 if name.startswith("stage.") else true
        assert abs(of["value"] - true) < 0.02 * unit, name


def test_noise_and_places_are_within_the_deviations(found):
    assert found.status == "calibrated"
    assert found.fit.p_value > 0.01
    errors = [(of["value"] - TRUE[name]) / of["deviation"] for name, of in found.parameters.items()]
    assert np.abs(errors).max() < 3.0
    assert 0.3 < np.sqrt(np.mean(np.square(errors))) < 1.8
    moved = np.linalg.norm(found.fit.moves, axis=1)
    assert 0.1 < np.median(moved) < 0.6
    assert 0.01 < found.leave_one_out["charge"] < 0.15
    assert 0.1 < found.leave_one_out["place_mm"] < 1.5


def test_the_calibrated_scene_reads_as_the_sensor_does(found):
    scene = Scene.parse(found.scene.to_toml())
    assert scene == found.scene
    assert scene.film.pretension_N_m == found.parameters["film.pretension_N_m"]["value"]
    assert scene.readout.gain == {n: found.parameters[f"gain.{n}"]["value"] for n in NAMES}
    assert scene.readout.reading == "change"
    assert scene.stage.x_mm == found.parameters["stage.x_mm"]["value"]


def test_derivatives_are_those_of_solves():
    """By parameters of film and stage, place and force, against differences of solves."""
    unknowns = unknowns_of(SCENE, ("film.pretension_N_m", "gain.B", "turn"), {})
    columns = {name: column[:2] for name, column in made().items()}
    values, moves = unknowns.start + 0.01, np.array([[0.1, -0.2], [0.0, 0.0]])

    def readings(step=(0.0, 0.0, 0.0), at=values):
        changed = zip(("x_mm", "y_mm", "force_N"), step, strict=True)
        touches = read_touches({**columns, **{n: columns[n] + h for n, h in changed}}, SCENE)
        of_touches = TouchModel(unknowns, touches, "change", "V", 1e-5)
        of_touches.solve(at, moves, np.array([True, False]))
        return of_touches.predict(at, moves)

    prediction = readings()
    scale = np.abs(prediction.readings[0]).max()
    for i, name in ((0, "film.pretension_N_m"), (2, "stage.rotation_deg")):
        step = np.eye(len(values))[i] * 0.1 * unknowns.priors[i]
        ends = [readings(at=values + sign * step).readings[0] for sign in (1.0, -1.0)]
        slope = prediction.by_parameter[0, :, i] * step[i]
        assert unknowns.names[i] == name
        np.testing.assert_allclose(slope, (ends[0] - ends[1]) / 2.0, atol=1e-4 * scale)
    for i in (0, 2):
        step = 0.02 * np.eye(3)[i]
        ends = [readings(step=sign * step).readings[0] for sign in (1.0, -1.0)]
        slope = (ends[0] - ends[1]) / 0.04
        np.testing.assert_allclose(prediction.by_touch[0, :, i], slope, atol=1e-3 * scale)


@pytest.mark.slow
def test_one_misplaced_touch_is_named_and_does_not_bias(found):
    columns = made(sigma=0.01, place_sd=0.3)
    x_mm = columns["x_mm"].copy()
    x_mm[4] -= 5.0 * np.sign(x_mm[4])
    wrong = calibrate(SCENE, {**columns, "x_mm": x_mm}, UNKNOWN, place_sd=0.3)
    assert wrong.status == "calibrated"
    assert list(wrong.outliers) == [5]
    assert "misplaced" in wrong.outliers[5]
    for name, of in found.parameters.items():
        assert abs(wrong.parameters[name]["value"] - of["value"]) < 2.0 * of["deviation"]


def test_what_cannot_be_told_apart_is_decided_by_the_priors():
    words = ("film.d31_pC_N", "film.d32_pC_N", "gains")
    truth = SCENE.with_(**{"film.pretension_N_m": 9.5, "stage.x_mm": 0.6, "stage.y_mm": -0.4})
    truth = truth.with_(**{"stage.rotation_deg": 2.0})
    columns = {name: column[:8] for name, column in made(sigma=0.01).items()}
    calibration = calibrate(truth, columns, words)
    (text,) = calibration.not_told_apart
    assert all(name in text for name in calibration.parameters)
    assert "gain.A 1 ± 0.1" in text
    assert "film.d31_pC_N 8 ± 1.6" in text
    # the product is told to the noise, the factors to their priors
    gain, d31 = calibration.parameters["gain.A"], calibration.parameters["film.d31_pC_N"]
    assert gain["value"] * d31["value"] == pytest.approx(8.0 * 1.07, rel=0.02)
    assert gain["deviation"] > 0.03
    # with gains that are known, the coefficients are told
    louder = {n: 1.1 * column / TRUE[f"gain.{n}"] for n, column in columns.items() if n in NAMES}
    narrow = calibrate(truth, {**columns, **louder}, words, priors={"gains": 1e-3})
    assert narrow.parameters["gain.A"]["value"] == pytest.approx(1.0, abs=0.005)
    assert narrow.parameters["film.d31_pC_N"]["value"] == pytest.approx(8.8, rel=0.02)
    assert narrow.parameters["film.d31_pC_N"]["deviation"] < 0.2 * d31["deviation"]


@pytest.mark.parametrize(
    ("change", "status", "said"),
    [
        (lambda c: {n: 1e-3 * c[n] for n in NAMES}, "wrong_unit", "in nC, not in pC"),
        (lambda c: {n: -c[n] for n in NAMES}, "wrong_sign", "the wrong sign"),
        pytest.param(
            lambda c: {"force_N": c["force_N"] / 9.81},
            "wrong_force",
            "force_N is in kgf",
            marks=pytest.mark.slow,
        ),
        (lambda c: {"y_mm": -c["y_mm"]}, "swapped_channels", "B and D are swapped; or y_mm has"),
    ],
)
def test_mistakes_are_named(change, status, said, monkeypatch):
    monkeypatch.setattr(diagnosis, "FEW_TOUCHES", 5)
    columns = {name: column[:8] for name, column in made(sigma=0.01, place_sd=0.3).items()}
    calibration = calibrate(SCENE, {**columns, **change(columns)}, UNKNOWN, place_sd=0.3)
    assert calibration.status == status
    assert re.search(said, calibration.reason)
    assert "parameters" not in calibration.to_json()
    with pytest.raises(ValueError, match=status):
        calibration.scene  # noqa: B018


def test_too_few_touches_are_named():
    columns = {name: column[:6] for name, column in made(sigma=0.01, place_sd=0.3).items()}
    calibration = calibrate(SCENE, columns, UNKNOWN, place_sd=0.3)
    assert calibration.status == "too_few_touches"
    assert calibration.reason.startswith("6 touches (24 readings) for 8 unknowns")


@pytest.mark.slow
def test_volts_are_read_through_the_channels():
    scene = SCENE.with_(**{"readout.feedback_capacitance_pF": 220.0})
    columns = made(sigma=0.01, place_sd=0.3)
    volts = {n: columns[n] / 220.0 + 0.02 for n in NAMES}
    words = (*UNKNOWN, "offsets")
    calibration = calibrate(scene, {**columns, **volts}, words, unit="V", place_sd=0.3)
    assert calibration.status == "calibrated"
    for name in NAMES:
        offset = calibration.parameters[f"offset.{name}"]
        assert abs(offset["value"] - 0.02) < 3.0 * offset["deviation"]
        assert offset["deviation"] < 0.05  # half of the prior's


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"unknown": ["gain"]}, "unknown gain: did you mean gains"),
        ({"unknown": []}, "nothing is sought"),
        ({"reading": "changes"}, "reading = 'changes'"),
        ({"unit": "mV"}, "unit = 'mV'"),
        ({"sigma": -1.0}, "sigma = -1"),
        ({"sigma": 0.0}, "sigma = 0: readings have errors"),
        ({"place_sd": float("nan")}, "place_sd = nan"),
        ({"priors": {"gains": 0.0}}, "prior gains = 0"),
        ({"priors": {"turn": 1.0}}, "prior turn: is not sought"),
    ],
)
def test_arguments_are_refused_before_any_solve(arguments, said):
    with pytest.raises(ValueError, match=said):
        calibrate(SCENE, {}, **arguments)


def test_scenes_without_a_probe_or_with_a_rigid_one_are_refused():
    with pytest.raises(ValueError, match="probe: the scene has none"):
        calibrate(SCENE.with_(probe=None), {})
    with pytest.raises(ValueError, match="rigid"):
        calibrate(SCENE.with_(**{"load.kind": "rigid"}), {})


def test_a_thickness_is_not_sought_through_the_capacitance_of_the_film():
    scene = SCENE.with_(**{"readout.kind": "voltage"})
    with pytest.raises(ValueError, match="thickness_um: changes the capacitance"):
        unknowns_of(scene, ["film.thickness_um"], {})


def test_a_cooled_film_starts_at_its_tension():
    cooled = Scene.parse('[probe]\nshape = "triangle"\n')
    unknowns = unknowns_of(cooled, ["film.pretension_N_m"], {})
    assert unknowns.start[0] == pytest.approx(25e-6 * 2e9 / 0.66 * 110e-6)

"""Calibrations of a made-up sensor: what is found, what is left out, and what is wrong."""

import numpy as np
import pytest

from pvdf_fem import Scene, calibrate
from pvdf_fem.inverse.calibration.parameters import get_parameter, select_parameters
from pvdf_fem.inverse.calibration.reading_model import ReadingModel
from pvdf_fem.inverse.calibration.touch_table import read_touches
from pvdf_fem.inverse.least_squares import apply_robust_loss
from tests.helpers.touched_sensor import NAMES, SCENE, TRUE, UNKNOWN, drawn, made, made_up

PRETENSION = "film.pretension_N_m"
UNCERTAIN = {PRETENSION: "30 %", "film.thickness_um": "5 %"}


@pytest.fixture(scope="module", autouse=True)
def made_up_sensor():
    with pytest.MonkeyPatch.context() as patched:
        made_up(patched)
        yield


@pytest.fixture(scope="module")
def found():
    scene = SCENE.with_(uncertain=UNCERTAIN)
    return calibrate(scene, made(sigma=0.01, place_sd=0.3), UNKNOWN, place_sd=0.3)


@pytest.mark.parametrize(("true", "is_like"), [(TRUE, False), ({PRETENSION: 8.0}, True)])
def test_exact_readings_give_the_true_parameters(true, is_like):
    """The first solves are coarse, and never the last; at a sensor that is like the scene no
    further ones are needed."""
    told, how = [], {"sigma": 4e-3, "progress": lambda *n: told.append(n)}
    calibration = calibrate(SCENE, made(true=true), UNKNOWN, **how)
    assert (len(told) == 2 * 24) == is_like
    assert (calibration.status, calibration.outliers) == ("calibrated", {})
    for name in TRUE:
        of, value = calibration.parameters[name], true.get(name, get_parameter(SCENE, name))
        assert abs(of["value"] - value) < 1.5 * of["deviation"], name
        assert of["value"] == pytest.approx(value, rel=1e-3, abs=1e-3), name


def test_derivatives_are_those_of_solves():
    """By parameters of film and stage, place and force, against differences of solves."""
    parameters = select_parameters(SCENE, (PRETENSION, "gain.B", "shift", "turn"), {})
    columns = {name: column[:2] for name, column in made().items()}
    moves, start, count = np.array([[0.1, -0.2], [0.0, 0.0]]), parameters.initial + 0.1, 5

    def predicted(step):
        moved = dict(zip(("x_mm", "y_mm", "force_N"), step[count:], strict=True))
        touches = read_touches({**columns, **{n: columns[n] + h for n, h in moved.items()}}, SCENE)
        of_touches = ReadingModel(parameters, touches, "change", "V", 1e-5)
        of_touches.solve_touches(start + step[:count], moves, np.array([True, True]))
        return of_touches.predict(start + step[:count], moves)

    at, h = predicted(np.zeros(count + 3)), 1e-4
    rates = np.concatenate([at.by_parameter, at.by_touch], axis=-1)
    for i, step in enumerate(h * np.eye(count + 3)):
        slope = (predicted(step).readings - predicted(-step).readings) / (2.0 * h)
        scale = np.abs(at.readings).max()
        np.testing.assert_allclose(rates[:, :, i], slope, atol=1e-5 * scale)


def test_places_are_corrected(found):
    assert found.status == "calibrated"
    assert found.fit.p_value > 0.01
    _, true, *_ = drawn(24, 0.3, 1)
    given = found.fit.model.table.probe_loads[:, :2]
    before, after = (np.linalg.norm(true - at, axis=1) for at in (given, found.places_mm))
    assert np.median(after) < 0.7 * np.median(before)


def test_the_calibrated_scene_reads_as_the_sensor_does(found):
    """What was uncertain in the scene has the deviations that were found."""
    scene, of = Scene.parse(found.scene.to_toml()), found.parameters
    assert scene == found.scene
    assert scene.film.pretension_N_m == of[PRETENSION]["value"]
    assert scene.readout.gain == {n: of[f"gain.{n}"]["value"] for n in NAMES}
    assert scene.readout.reading == "change"
    assert scene.stage.x_mm == of["stage.x_mm"]["value"]
    assert scene.uncertain == {**UNCERTAIN, PRETENSION: of[PRETENSION]["deviation"]}


@pytest.mark.parametrize("unit", ["pC", "V"])
def test_readings_are_those_of_the_channels_and_have_their_noise(unit):
    noise_V = {"A": 0.03, "B": 0.01}
    scene = SCENE.with_(readout={"feedback_capacitance_pF": 220.0, "noise_V": noise_V})
    columns, in_unit = made(sigma=0.01, place_sd=0.3), 1.0 if unit == "V" else 220.0
    columns |= {n: in_unit * (columns[n] / 220.0 + 0.02) for n in NAMES}
    found = calibrate(scene, columns, (*UNKNOWN, "offsets"), unit=unit, place_sd=0.3)
    assert found.status == "calibrated"
    for name in NAMES:
        offset = found.parameters[f"offset.{name}"]
        assert abs(offset["value"] - 0.02) < 3.0 * offset["deviation"]
        assert offset["deviation"] < 0.05  # half of the prior's
    read = np.stack([columns[n] for n in NAMES], axis=1)
    size = np.maximum(np.abs(read), np.abs(found.fit.prediction.readings))
    noise = in_unit * np.array([noise_V.get(name, 0.0) for name in NAMES])
    np.testing.assert_allclose(found.fit.deviations, np.hypot(0.01 * size, noise), rtol=1e-6)


def test_what_cannot_be_told_apart_is_decided_by_the_priors():
    """The product of gain and coefficient is told to the noise, the factors to their priors."""
    truth = SCENE.with_(**{key: of for key, of in TRUE.items() if not key.startswith("gain.")})
    words = ("film.d31_pC_N", "film.d32_pC_N", "gains")
    calibration = calibrate(truth, made(sigma=0.01), words)
    (text,) = calibration.undetermined
    assert all(name in text for name in calibration.parameters)
    assert calibration.fit.degrees_of_freedom == 24 * 4 - (6 - 1)
    gain, d31 = calibration.parameters["gain.A"], calibration.parameters["film.d31_pC_N"]
    assert gain["value"] * d31["value"] == pytest.approx(8.0 * 1.07, rel=0.02)
    assert gain["deviation"] > 0.03


def test_a_cooled_film_starts_at_its_tension():
    cooled = Scene.parse('[probe]\nshape = "triangle"\n')
    parameters = select_parameters(cooled, [PRETENSION], {})
    assert parameters.initial[0] == pytest.approx(25e-6 * 2e9 / 0.66 * 110e-6)


def test_deviations_and_chi_square_are_those_of_many_sensors():
    """25 sensors, 10 touches each: 68 % are within a deviation, and chi-square is what it is."""
    pulls, excess = [], []
    for seed in range(25):
        of = calibrate(SCENE, made(10, sigma=0.01, seed=seed), UNKNOWN)
        pulls.append([(p["value"] - TRUE[n]) / p["deviation"] for n, p in of.parameters.items()])
        excess.append(of.fit.chi_square - of.fit.degrees_of_freedom)
        assert (of.fit.degrees_of_freedom, of.fit.scatter >= 1.0) == (40 - 8, True)
    sizes = np.abs(pulls)
    assert 0.58 < np.mean(sizes < 1.0) < 0.78
    assert np.mean(sizes < 3.0) > 0.985
    assert abs(np.mean(excess)) < 3.0 * np.sqrt(2.0 * 32 / 25)


def test_readings_that_scatter_more_than_said_widen_the_deviations():
    columns = made(sigma=0.02)
    said, less = (calibrate(SCENE, columns, UNKNOWN, sigma=of) for of in (0.02, 0.01))
    assert less.status == "calibrated"
    assert less.fit.scatter == pytest.approx(2.0, rel=0.4)  # a robust scale of 96 residuals: 1.62
    for name, of in said.parameters.items():
        assert less.parameters[name]["deviation"] == pytest.approx(of["deviation"], rel=0.25)


def test_residuals_from_a_fit_to_the_others_have_its_errors():
    """Closed form: less those of the fit in which a touch has part, plus those of another fit."""
    columns = made(10, sigma=0.01)
    columns["force_N"][4] *= 1.5
    found = calibrate(SCENE, columns, UNKNOWN)
    assert list(found.outliers) == [5]
    fit, (others, lengths) = found.fit, found.fit.compute_deleted_residuals()
    for i, sign in ((0, -1.0), (4, 1.0)):
        root, slopes = fit.whitened.roots[i], fit.prediction.by_parameter[i]
        of_noise, residual = root @ root.T, root @ fit.whitened.residuals[i]
        solved = np.linalg.solve(of_noise + sign * slopes @ fit.covariance @ slopes.T, residual)
        assert lengths[i] == pytest.approx(residual @ solved, rel=1e-6)
        expected = of_noise @ solved if sign < 0.0 else residual
        np.testing.assert_allclose(root @ others[i], expected, rtol=1e-6)


@pytest.mark.parametrize(
    ("column", "told", "size"),
    [("y_mm", "place_mm", 0.5), ("x_mm", "place_mm", 0.5), ("force_N", "force", 0.05)],
)
def test_what_a_left_out_touch_is_off_its_place_and_force(column, told, size):
    columns, signs = made(), np.where(np.arange(24) % 2, 1.0, -1.0)
    factor = columns["force_N"] if column == "force_N" else 1.0
    columns[column] = columns[column] + signs * size * factor
    left = calibrate(SCENE, columns, UNKNOWN, sigma=0.05).leave_one_out
    assert left[told] == pytest.approx(size, rel=0.35)


@pytest.mark.parametrize(
    ("limit", "loss"), [(12.5, 12.5 * (1.0 + np.log(2.0))), (50.0, 25.0), (np.inf, 25.0)]
)
def test_a_robust_loss_grows_as_the_logarithm_beyond_its_limit(limit, loss):
    """Groups with a squared length of 25: of twice the limit, of half of it, and without one."""
    system = np.zeros((3, 2, 2))
    system[:, :, 0] = [3.0, 4.0]
    residuals = apply_robust_loss(system, np.full(3, limit))[0, :, 0]
    assert np.square(residuals).sum() == pytest.approx(3.0 * loss)


@pytest.mark.parametrize(("column", "said"), [("x_mm", "misplaced"), ("force_N", "force_N")])
def test_one_wrong_touch_is_named_and_does_not_bias(found, column, said):
    columns = made(sigma=0.01, place_sd=0.3)
    columns[column][4] = 1.5 * columns[column][4] + 4.0 * (column == "x_mm")
    wrong = calibrate(SCENE, columns, UNKNOWN, place_sd=0.3)
    assert wrong.status == "calibrated"
    assert list(wrong.outliers) == [5]
    assert said in wrong.outliers[5]
    for name, of in found.parameters.items():
        assert abs(wrong.parameters[name]["value"] - of["value"]) < 2.0 * of["deviation"]


MISTAKES = {
    "in nC": ("wrong_unit", lambda c: {n: 1e-3 * c[n] for n in NAMES}),
    "wrong sign": ("wrong_sign", lambda c: {n: -c[n] for n in NAMES}),
    "channel C": ("wrong_sign", lambda c: {"C": -c["C"]}),
    "channel D": ("wrong_channel", lambda c: {"D": 50.0 * np.cos(np.arange(24.0))}),
    "A and B": ("swapped_channels", lambda c: {"A": c["B"], "B": c["A"]}),
    "total": ("wrong_reading", lambda c: {n: c[n] + 8.0 * 9.5 for n in NAMES}),
    "kgf": ("wrong_force", lambda c: {"force_N": c["force_N"] / 9.81}),
    "grams": ("wrong_force", lambda c: {"force_N": c["force_N"] / 9.81e-3}),
    "clockwise": ("wrong_frame", lambda c: {"rotation_deg": -c["rotation_deg"]}),
    "mirrored": ("wrong_frame", lambda c: {"y_mm": -c["y_mm"]}),
}


@pytest.mark.parametrize("said", MISTAKES)
def test_mistakes_are_named(said):
    columns, (status, change) = made(sigma=0.01, place_sd=0.3), MISTAKES[said]
    calibration = calibrate(SCENE, {**columns, **change(columns)}, UNKNOWN, place_sd=0.3)
    assert calibration.status == status
    assert said in calibration.reason
    assert "parameters" not in calibration.to_json()
    with pytest.raises(ValueError, match=status):
        calibration.scene  # noqa: B018


def test_too_few_touches_and_touches_of_another_sensor_have_a_status():
    columns = made(10, sigma=0.01)
    shuffled = {n: np.roll(columns[n], i) for i, n in enumerate(NAMES)}
    assert calibrate(SCENE, {**columns, **shuffled}, UNKNOWN).status == "not_explained"
    same = {"force_N": np.ones(10)}
    assert calibrate(SCENE, {**columns, **same}, UNKNOWN).status == "wrong_force"
    for count in (2, 6):
        some = {name: column[:count] for name, column in columns.items()}
        few = calibrate(SCENE, some, UNKNOWN, sigma=1e-4)  # two have no degree of freedom
        assert (few.status, 0.0 <= few.fit.p_value <= 1.0) == ("too_few_touches", True)


@pytest.mark.parametrize(
    ("changes", "arguments", "key"),
    [
        ({}, {"unknown": ["gain"]}, "unknown gain"),
        ({}, {"sigma": -1.0}, "sigma = -1"),
        ({}, {"place_sd": float("nan")}, "place_sd = nan"),
        ({}, {"priors": {"gains": 0.0}}, "prior gains = 0"),
        ({"probe": None}, {}, "probe"),
        ({"load.kind": "rigid"}, {}, 'load.kind = "rigid"'),
        ({"readout.kind": "voltage"}, {"unknown": ["film.thickness_um"]}, "unknown film.thickness"),
    ],
)
def test_arguments_are_refused_before_any_solve(changes, arguments, key):
    with pytest.raises(ValueError, match=f"^{key}"):
        calibrate(SCENE.with_(**changes), {}, **arguments)

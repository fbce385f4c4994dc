"""Calibrations of a made-up sensor: what is found, what is left out, and what is wrong."""

import numpy as np
import pytest

from pvdf_fem import Scene, calibrate
from pvdf_fem.calibration.model import TouchModel
from pvdf_fem.calibration.touches import read_touches
from pvdf_fem.calibration.unknowns import unknowns_of
from tests.helpers.touched_sensor import NAMES, SCENE, TRUE, UNKNOWN, drawn, made, made_up


@pytest.fixture(scope="module", autouse=True)
def made_up_sensor():
    with pytest.MonkeyPatch.context() as patched:
        made_up(patched)
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
        assert of["value"] == pytest.approx(true, rel=1e-3, abs=1e-3), name


def test_the_first_solves_are_never_the_last():
    """They are coarse; at a sensor that is like the scene no further ones are needed."""
    told, like = [], {"film.pretension_N_m": 8.0}
    columns = made(10, true=like)
    found = calibrate(SCENE, columns, UNKNOWN, sigma=4e-3, progress=lambda *n: told.append(n))
    assert (found.status, len(told)) == ("calibrated", 20)


@pytest.mark.parametrize(("unit", "pC"), [("pC", 1.0), ("V", 500.0)])
def test_the_noise_is_by_default_the_readout_s(unit, pC):
    readout = {"feedback_capacitance_pF": 500.0, "noise_V": {"A": 0.03, "B": 0.01}}
    columns = made(10, sigma=0.01)
    columns |= {name: columns[name] / pC for name in NAMES}
    scene = SCENE.with_(readout=readout)
    default, none = (calibrate(scene, columns, UNKNOWN, unit=unit, noise=n) for n in (None, 0.0))
    added = default.fit.deviations**2 - none.fit.deviations**2
    expected = np.square([15.0, 5.0, 0.0, 0.0]) / pC**2
    # deviations follow the readings that are found, which differ a little
    assert added.mean(axis=0) == pytest.approx(expected, rel=0.1, abs=0.1 / pC**2)


def test_noise_and_places_are_within_the_deviations(found):
    assert found.status == "calibrated"
    assert found.fit.p_value > 0.01
    _, true, *_ = drawn(24, 0.3, 1)
    given = found.fit.model.touches.touches[:, :2]
    before, after = (np.linalg.norm(true - at, axis=1) for at in (given, found.places_mm))
    assert np.median(after) < 0.7 * np.median(before)


def test_deviations_and_chi_square_are_those_of_many_sensors():
    """25 sensors, 10 touches each: 68 % are within a deviation, and chi-square is what it is."""
    pulls, excess = [], []
    for seed in range(25):
        columns = made(10, sigma=0.01, seed=seed)
        of = calibrate(SCENE, columns, UNKNOWN)
        pulls.append([(p["value"] - TRUE[n]) / p["deviation"] for n, p in of.parameters.items()])
        excess.append(of.fit.chi_square - of.fit.degrees_of_freedom)
        assert of.fit.degrees_of_freedom == 40 - 8
    sizes = np.abs(pulls)
    assert 0.58 < np.mean(sizes < 1.0) < 0.78
    assert np.mean(sizes < 3.0) > 0.985
    assert abs(np.mean(excess)) < 3.0 * np.sqrt(2.0 * 32 / 25)


def test_readings_that_scatter_more_than_said_widen_the_deviations():
    columns = made(sigma=0.02)
    said, less = (calibrate(SCENE, columns, UNKNOWN, sigma=of) for of in (0.02, 0.01))
    assert less.status == "calibrated"
    assert less.fit.scale == pytest.approx(2.0, rel=0.2)
    for name, of in said.parameters.items():
        assert less.parameters[name]["deviation"] == pytest.approx(of["deviation"], rel=0.25)


def test_leaving_one_out_is_a_calibration_with_the_others():
    columns = made(8, sigma=0.01)
    whole, i = calibrate(SCENE, columns, UNKNOWN), 3
    others = {name: np.delete(column, i) for name, column in columns.items()}
    without = calibrate(SCENE, others, UNKNOWN)
    touch = read_touches(columns, SCENE).some([i, i])
    model = whole.fit.model.changed(touch, "change")
    model.solve(without.fit.values, np.zeros((2, 2)), np.ones(2, dtype=bool))
    expected = touch.readings[0] - model.predict(without.fit.values, np.zeros((2, 2))).readings[0]
    deleted = whole.fit.whitened[0][i] @ whole.fit.deleted()[0][i]
    np.testing.assert_allclose(deleted, expected, atol=0.05 * np.abs(expected).max())


def test_residuals_from_a_fit_to_the_others_have_its_errors():
    """Closed form: less those of the fit in which a touch has part, plus those of another fit."""
    columns = made(10, sigma=0.01)
    columns["force_N"][4] *= 1.5
    found = calibrate(SCENE, columns, UNKNOWN)
    assert list(found.outliers) == [5]
    fit, covariance = found.fit, found.fit.covariance
    others, lengths = fit.deleted()
    for i, sign in ((0, -1.0), (4, 1.0)):
        root, slopes = fit.whitened[0][i], fit.prediction.by_parameter[i]
        of_noise, residual = root @ root.T, root @ fit.whitened[1][i]
        total = of_noise + sign * slopes @ covariance @ slopes.T
        solved = np.linalg.solve(total, residual)
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


def test_the_calibrated_scene_reads_as_the_sensor_does(found):
    scene = Scene.parse(found.scene.to_toml())
    assert scene == found.scene
    assert scene.film.pretension_N_m == found.parameters["film.pretension_N_m"]["value"]
    assert scene.readout.gain == {n: found.parameters[f"gain.{n}"]["value"] for n in NAMES}
    assert scene.readout.reading == "change"
    assert scene.stage.x_mm == found.parameters["stage.x_mm"]["value"]


def test_what_was_uncertain_has_the_deviations_that_were_found():
    uncertain = {"film.pretension_N_m": "30 %", "film.thickness_um": "5 %"}
    found = calibrate(SCENE.with_(uncertain=uncertain), made(8, sigma=0.01), UNKNOWN)
    deviation = found.parameters["film.pretension_N_m"]["deviation"]
    assert found.scene.uncertain == {**uncertain, "film.pretension_N_m": deviation}
    assert 0.0 < deviation < 0.3 * 8.0


def test_derivatives_are_those_of_solves():
    """By parameters of film and stage, place and force, against differences of solves."""
    unknowns = unknowns_of(SCENE, ("film.pretension_N_m", "gain.B", "shift", "turn"), {})
    columns = {name: column[:2] for name, column in made().items()}
    values, moves = unknowns.start + 0.1, np.array([[0.1, -0.2], [0.0, 0.0]])

    def readings(step=(0.0, 0.0, 0.0), at=values):
        changed = zip(("x_mm", "y_mm", "force_N"), step, strict=True)
        touches = read_touches({**columns, **{n: columns[n] + h for n, h in changed}}, SCENE)
        of_touches = TouchModel(unknowns, touches, "change", "V", 1e-5)
        of_touches.solve(at, moves, np.array([True, True]))
        return of_touches.predict(at, moves)

    prediction, h = readings(), 1e-4
    scale = np.abs(prediction.readings).max()
    for i, step in enumerate(h * np.eye(len(values))):
        ends = [readings(at=values + sign * step).readings for sign in (1.0, -1.0)]
        slope = (ends[0] - ends[1]) / (2.0 * h)
        np.testing.assert_allclose(prediction.by_parameter[:, :, i], slope, atol=1e-5 * scale)
    for i, step in enumerate(h * np.eye(3)):
        ends = [readings(step=sign * step).readings for sign in (1.0, -1.0)]
        slope = (ends[0] - ends[1]) / (2.0 * h)
        np.testing.assert_allclose(prediction.by_touch[:, :, i], slope, atol=1e-5 * scale)


@pytest.mark.parametrize(("column", "said"), [("x_mm", "misplaced"), ("force_N", "force_N")])
def test_one_wrong_touch_is_named_and_does_not_bias(found, column, said):
    columns = made(sigma=0.01, place_sd=0.3)
    values = columns[column].copy()
    values[4] *= 1.5
    values[4] += 4.0 * (column == "x_mm")
    wrong = calibrate(SCENE, {**columns, column: values}, UNKNOWN, place_sd=0.3)
    assert wrong.status == "calibrated"
    assert list(wrong.outliers) == [5]
    assert said in wrong.outliers[5]
    for name, of in found.parameters.items():
        assert abs(wrong.parameters[name]["value"] - of["value"]) < 2.0 * of["deviation"]


def test_what_cannot_be_told_apart_is_decided_by_the_priors():
    words = ("film.d31_pC_N", "film.d32_pC_N", "gains")
    truth = SCENE.with_(**{"film.pretension_N_m": 9.5, "stage.x_mm": 0.6, "stage.y_mm": -0.4})
    truth = truth.with_(**{"stage.rotation_deg": 2.0})
    columns = made(sigma=0.01)
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


def test_touches_of_another_sensor_are_not_explained():
    columns = made(10, sigma=0.01)
    shuffled = {n: np.roll(columns[n], i) for i, n in enumerate(NAMES)}
    assert calibrate(SCENE, {**columns, **shuffled}, UNKNOWN).status == "not_explained"
    same = {"force_N": np.ones(10)}
    assert calibrate(SCENE, {**columns, **same}, UNKNOWN).status == "wrong_force"


def test_parameters_far_from_the_scenes_are_remarked():
    columns, word = made(10, sigma=2e-3), "film.pretension_N_m"
    for prior, count in ((0.3, 0), (0.03, 1)):
        remarks = calibrate(SCENE, columns, UNKNOWN, sigma=2e-3, priors={word: prior}).remarks
        assert sum(word in remark for remark in remarks) == count


def test_too_few_touches_are_named():
    columns = {name: column[:6] for name, column in made(sigma=0.01, place_sd=0.3).items()}
    calibration = calibrate(SCENE, columns, UNKNOWN, place_sd=0.3)
    assert calibration.status == "too_few_touches"
    assert calibration.reason.startswith("6 touches (24 readings) for 8 unknowns")


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

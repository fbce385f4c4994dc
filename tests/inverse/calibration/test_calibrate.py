"""Calibrations of a made-up sensor: its parameters, outliers, and mistakes in files of touches."""

import numpy as np
import pytest

from pvdf_fem import Scene, calibrate
from pvdf_fem.files import FileError
from pvdf_fem.inverse.calibration import reading_model
from pvdf_fem.inverse.calibration.parameters import get_parameter, select_parameters
from pvdf_fem.inverse.calibration.reading_model import ReadingModel
from pvdf_fem.inverse.calibration.touch_table import read_touches
from pvdf_fem.inverse.normal_equations import apply_robust_loss
from tests.helpers import touched_sensor
from tests.helpers.touched_sensor import (
    NAMES,
    SCENE,
    TRUE,
    UNKNOWN,
    draw_placements,
    make_columns,
    patch_solver,
)

PRETENSION = "film.pretension_N_m"
UNCERTAIN = {PRETENSION: "30 %", "film.thickness_um": "5 %"}


@pytest.fixture(scope="module", autouse=True)
def made_up_sensor():
    """Let calibrations solve a made-up sensor."""
    with pytest.MonkeyPatch.context() as patch:
        patch_solver(patch)
        yield


@pytest.fixture(scope="module")
def calibration():
    """A calibration by noisy readings at misplaced touches."""
    scene = SCENE.with_(uncertain=UNCERTAIN)
    return calibrate(scene, make_columns(sigma=0.01, place_sd=0.3), UNKNOWN, place_sd=0.3)


@pytest.mark.parametrize(("true", "is_like_scene"), [(TRUE, False), ({PRETENSION: 8.0}, True)])
def test_exact_readings_give_the_true_parameters(true, is_like_scene):
    """The first solves are coarse, so that they are never the last ones.

    At a sensor that is like the scene a second round is enough.
    """
    progress = []
    calibration = calibrate(
        SCENE,
        make_columns(true=true),
        UNKNOWN,
        sigma=4e-3,
        progress=lambda *numbers: progress.append(numbers),
    )
    assert (len(progress) == 2 * 24) == is_like_scene
    assert calibration.status == "calibrated"
    assert calibration.outliers == {}
    for name in TRUE:
        parameter = calibration.parameters[name]
        value = true.get(name, get_parameter(SCENE, name))
        assert abs(parameter["value"] - value) < 1.5 * parameter["deviation"], name
        assert parameter["value"] == pytest.approx(value, rel=1e-3, abs=1e-3), name


def test_derivatives_of_readings_agree_with_differences_of_solves():
    """By parameters of film and stage, and by place and force."""
    parameters = select_parameters(SCENE, (PRETENSION, "gain.B", "shift", "turn"), {})
    count = len(parameters)
    columns = {name: column[:2] for name, column in make_columns().items()}
    place_corrections_mm = np.array([[0.1, -0.2], [0.0, 0.0]])
    values = parameters.initial + 0.1

    def predict(step):
        changed = dict(columns)
        for name, change in zip(("x_mm", "y_mm", "force_N"), step[count:], strict=True):
            changed[name] = columns[name] + change
        model = ReadingModel(parameters, read_touches(changed, SCENE), "change", "V", 1e-5)
        stepped = values + step[:count]
        model.solve_touches(stepped, place_corrections_mm, np.array([True, True]))
        return model.predict(stepped, place_corrections_mm)

    h = 1e-4
    prediction = predict(np.zeros(count + 3))
    rates = np.concatenate([prediction.by_parameter, prediction.by_touch], axis=-1)
    scale = np.abs(prediction.readings).max()
    for i, step in enumerate(h * np.eye(count + 3)):
        difference = predict(step).readings - predict(-step).readings
        np.testing.assert_allclose(rates[:, :, i], difference / (2.0 * h), atol=1e-5 * scale)


def test_places_are_corrected(calibration):
    assert calibration.status == "calibrated"
    assert calibration.fit.p_value > 0.01
    true_mm = draw_placements(24, 0.3, 1).true_mm
    written_mm = calibration.fit.model.table.probe_loads[:, :2]
    before = np.linalg.norm(true_mm - written_mm, axis=1)
    after = np.linalg.norm(true_mm - calibration.places_mm, axis=1)
    assert np.median(after) < 0.7 * np.median(before)


def test_the_calibrated_scene_has_the_fitted_values(calibration):
    """Fitted parameters that were uncertain have the deviations of the calibration."""
    scene = Scene.parse(calibration.scene.to_toml())
    parameters = calibration.parameters
    assert scene == calibration.scene
    assert scene.film.pretension_N_m == parameters[PRETENSION]["value"]
    assert scene.readout.gain == {name: parameters[f"gain.{name}"]["value"] for name in NAMES}
    assert scene.readout.reading == "change"
    assert scene.stage.x_mm == parameters["stage.x_mm"]["value"]
    assert scene.uncertain == {**UNCERTAIN, PRETENSION: parameters[PRETENSION]["deviation"]}


def make_readings_with_offset(unit):
    """Make columns of readings with an offset of 0.02 V, from channels with 220 pF."""
    columns = make_columns(sigma=0.01, place_sd=0.3)
    units_per_volt = 1.0 if unit == "V" else 220.0
    for name in NAMES:
        columns[name] = units_per_volt * (columns[name] / 220.0 + 0.02)
    return columns


@pytest.mark.parametrize("unit", ["pC", "V"])
def test_offsets_and_noise_have_the_unit_of_the_channels(unit):
    noise_V = {"A": 0.03, "B": 0.01}
    scene = SCENE.with_(readout={"feedback_capacitance_pF": 220.0, "noise_V": noise_V})
    columns = make_readings_with_offset(unit)
    result = calibrate(scene, columns, (*UNKNOWN, "offsets"), unit=unit, place_sd=0.3)
    assert result.status == "calibrated"
    for name in NAMES:
        offset = result.parameters[f"offset.{name}"]
        assert abs(offset["value"] - 0.02) < 3.0 * offset["deviation"]
        assert offset["deviation"] < 0.05  # half of the prior's
    readings = np.stack([columns[name] for name in NAMES], axis=1)
    size = np.maximum(np.abs(readings), np.abs(result.fit.prediction.readings))
    units_per_volt = 1.0 if unit == "V" else 220.0
    noise = units_per_volt * np.array([noise_V.get(name, 0.0) for name in NAMES])
    np.testing.assert_allclose(result.fit.deviations, np.hypot(0.01 * size, noise), rtol=1e-6)


@pytest.mark.parametrize("unit", ["pC", "V"])
def test_noise_pC_is_in_nominal_pC_whatever_the_unit_of_readings(unit):
    noise_V = dict.fromkeys(NAMES, 0.0) | {"A": 0.03, "B": 0.01}
    noise_pC = {name: 220.0 * noise for name, noise in noise_V.items()}
    quiet = SCENE.with_(readout={"feedback_capacitance_pF": 220.0})
    noisy = SCENE.with_(readout={"feedback_capacitance_pF": 220.0, "noise_V": noise_V})
    columns = make_readings_with_offset(unit)
    words = (*UNKNOWN, "offsets")
    expected = calibrate(noisy, columns, words, unit=unit, place_sd=0.3)
    result = calibrate(quiet, columns, words, unit=unit, place_sd=0.3, noise_pC=noise_pC)
    np.testing.assert_allclose(result.fit.values, expected.fit.values, rtol=1e-9)
    with pytest.raises(ValueError, match=r"^noise_pC\.D: is required"):
        calibrate(quiet, columns, noise_pC={"A": 1.0, "B": 1.0, "C": 1.0})


def test_parameters_that_readings_do_not_separate_are_decided_by_the_priors():
    """Readings determine the product of gain and coefficient, the priors the factors."""
    truth = SCENE.with_(**{key: of for key, of in TRUE.items() if not key.startswith("gain.")})
    words = ("film.d31_pC_N", "film.d32_pC_N", "gains")
    calibration = calibrate(truth, make_columns(sigma=0.01), words)
    (text,) = calibration.undetermined
    assert all(name in text for name in calibration.parameters)
    assert calibration.fit.degrees_of_freedom == 24 * 4 - (6 - 1)
    gain = calibration.parameters["gain.A"]
    d31 = calibration.parameters["film.d31_pC_N"]
    assert gain["value"] * d31["value"] == pytest.approx(8.0 * 1.07, rel=0.02)
    assert gain["deviation"] > 0.03


def test_the_prior_of_a_cooled_film_is_at_its_tension():
    cooled = Scene.parse('[probe]\nshape = "triangle"\n')
    parameters = select_parameters(cooled, [PRETENSION], {})
    assert parameters.initial[0] == pytest.approx(25e-6 * 2e9 / 0.66 * 110e-6)


def test_deviations_and_chi_square_agree_with_the_scatter_over_many_sensors():
    """Of 25 sensors with 10 touches each, 68 % of the errors are within a deviation."""
    pulls = []
    excess = []
    for seed in range(25):
        calibration = calibrate(SCENE, make_columns(10, sigma=0.01, seed=seed), UNKNOWN)
        for name, parameter in calibration.parameters.items():
            pulls.append((parameter["value"] - TRUE[name]) / parameter["deviation"])
        fit = calibration.fit
        excess.append(fit.chi_square - fit.degrees_of_freedom)
        assert fit.degrees_of_freedom == 40 - 8
        assert fit.scatter >= 1.0
    sizes = np.abs(pulls)
    assert 0.58 < np.mean(sizes < 1.0) < 0.78
    assert np.mean(sizes < 3.0) > 0.985
    assert abs(np.mean(excess)) < 3.0 * np.sqrt(2.0 * 32 / 25)


def test_scatter_above_the_stated_noise_widens_the_deviations():
    columns = make_columns(sigma=0.02)
    expected = calibrate(SCENE, columns, UNKNOWN, sigma=0.02)
    understated = calibrate(SCENE, columns, UNKNOWN, sigma=0.01)
    assert understated.status == "calibrated"
    # a robust scale of 96 residuals: 1.62
    assert understated.fit.scatter == pytest.approx(2.0, rel=0.4)
    for name, parameter in expected.parameters.items():
        deviation = understated.parameters[name]["deviation"]
        assert deviation == pytest.approx(parameter["deviation"], rel=0.25)


def test_deleted_residuals_have_the_errors_of_a_fit_to_the_others():
    """Closed form: their covariance is smaller for a used touch, and larger for an outlier."""
    columns = make_columns(10, sigma=0.01)
    columns["force_N"][4] *= 1.5
    result = calibrate(SCENE, columns, UNKNOWN)
    assert list(result.outliers) == [5]
    fit = result.fit
    deleted = fit.compute_deleted_residuals()
    for i, sign in ((0, -1.0), (4, 1.0)):
        root = fit.whitened.roots[i]
        slopes = fit.prediction.by_parameter[i]
        noise_covariance = root @ root.T
        residual = root @ fit.whitened.residuals[i]
        covariance = noise_covariance + sign * slopes @ fit.covariance @ slopes.T
        weighted = np.linalg.solve(covariance, residual)
        assert deleted.squared_lengths[i] == pytest.approx(residual @ weighted, rel=1e-6)
        expected = noise_covariance @ weighted if sign < 0.0 else residual
        np.testing.assert_allclose(root @ deleted.residuals[i], expected, rtol=1e-6)


@pytest.mark.parametrize(
    ("column", "key", "size"),
    [("y_mm", "place_mm", 0.5), ("x_mm", "place_mm", 0.5), ("force_N", "force", 0.05)],
)
def test_leave_one_out_errors_are_those_of_places_and_forces_in_the_file(column, key, size):
    columns = make_columns()
    signs = np.where(np.arange(24) % 2, 1.0, -1.0)
    factor = columns["force_N"] if column == "force_N" else 1.0
    columns[column] = columns[column] + signs * size * factor
    errors = calibrate(SCENE, columns, UNKNOWN, sigma=0.05).leave_one_out
    assert errors[key] == pytest.approx(size, rel=0.35)


@pytest.mark.parametrize(
    ("limit", "loss"), [(12.5, 12.5 * (1.0 + np.log(2.0))), (50.0, 25.0), (np.inf, 25.0)]
)
def test_a_robust_loss_grows_as_the_logarithm_beyond_its_limit(limit, loss):
    """Groups with a squared length of 25: of twice the limit, of half of it, and without one."""
    system = np.zeros((3, 2, 2))
    system[:, :, 0] = [3.0, 4.0]
    residuals = apply_robust_loss(system, np.full(3, limit))[0, :, 0]
    assert np.square(residuals).sum() == pytest.approx(3.0 * loss)


@pytest.mark.parametrize(
    ("column", "word"), [("x_mm", "another position"), ("force_N", "another force")]
)
def test_one_wrong_touch_is_named_and_does_not_bias(calibration, column, word):
    columns = make_columns(sigma=0.01, place_sd=0.3)
    columns[column][4] = 1.5 * columns[column][4] + 4.0 * (column == "x_mm")
    result = calibrate(SCENE, columns, UNKNOWN, place_sd=0.3)
    assert result.status == "calibrated"
    assert list(result.outliers) == [5]
    assert word in result.outliers[5]
    for name, parameter in calibration.parameters.items():
        change = abs(result.parameters[name]["value"] - parameter["value"])
        assert change < 2.0 * parameter["deviation"]


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


@pytest.mark.parametrize("word", MISTAKES)
def test_mistakes_in_the_file_are_named(word):
    columns = make_columns(sigma=0.01, place_sd=0.3)
    status, change = MISTAKES[word]
    calibration = calibrate(SCENE, columns | change(columns), UNKNOWN, place_sd=0.3)
    assert calibration.status == status
    assert word in calibration.reason
    assert "parameters" not in calibration.to_json()
    with pytest.raises(ValueError, match=status):
        calibration.scene  # noqa: B018


def clip(columns, limit, names=NAMES):
    """Return columns whose readings in pC are clipped at a limit."""
    return columns | {name: np.minimum(columns[name], limit) for name in names}


@pytest.mark.parametrize("unit", ["pC", "V"])
def test_clipped_readings_are_left_out_and_named(calibration, unit):
    """With and without a stated range, in the unit of the readings."""
    columns = make_columns(sigma=0.01, place_sd=0.3)
    limit = float(np.quantile([columns[name] for name in NAMES], 0.9))
    size = 1.0 if unit == "pC" else 1e-3  # channels of 1000 pF
    scaled = {name: size * columns[name] for name in NAMES}
    clipped = clip(columns | scaled, size * limit)
    expected = set()
    for name in NAMES:
        for row in np.flatnonzero(columns[name] >= limit) + 1:
            expected.add((int(row), name))
    scene = SCENE.with_(readout={"range_V": 1e-3 * limit}, uncertain=UNCERTAIN)
    for sensor in (SCENE.with_(readout={}), scene):
        result = calibrate(sensor, clipped, UNKNOWN, place_sd=0.3, unit=unit)
        assert result.status == "calibrated"
        assert result.outliers == {}
        found = {(each["row"], each["electrode"]) for each in result.to_json()["clipped"]}
        assert found == expected
        assert np.isnan(result.fit.model.table.readings).sum() == len(expected)
        texts = [note for note in result.notes if " is clipped (" in note]
        assert len(texts) == len({name for _, name in expected})
        assert all(unit in text for text in texts)
        for name, parameter in calibration.parameters.items():
            found = result.parameters[name]
            assert abs(found["value"] - TRUE[name]) < 3.5 * found["deviation"]
            assert found["deviation"] > 0.98 * parameter["deviation"]


def test_readings_that_are_marked_as_beyond_the_range_are_clipped(calibration):
    """Without a stated range they are above the largest reading of their channel."""
    columns = make_columns(sigma=0.01, place_sd=0.3)
    readings = columns["A"].copy()
    strongest = int(readings.argmax())
    readings[strongest] = np.inf
    result = calibrate(SCENE, columns | {"A": readings}, UNKNOWN, place_sd=0.3, unit="pC")
    assert result.status == "calibrated"
    (clipped,) = result.to_json()["clipped"]
    assert (clipped["row"], clipped["electrode"]) == (strongest + 1, "A")
    (reading,) = result.fit.model.table.clipped
    assert reading.limit == pytest.approx(np.delete(readings, strongest).max(), rel=1e-9)
    assert any(f"row {strongest + 1}: A is clipped" in note for note in result.notes)
    marked = columns | {"A": np.full_like(readings, np.inf)}
    with pytest.raises(ValueError, match="column A: is beyond the range in every row"):
        calibrate(SCENE, marked, UNKNOWN, unit="pC")


def test_touches_are_read_from_the_files_of_loggers(tmp_path):
    """A sample for each touch, with electrodes by the names of their channels in the scene."""
    parquet = pytest.importorskip("pyarrow.parquet")
    pyarrow = pytest.importorskip("pyarrow")
    columns = make_columns(sigma=0.01, place_sd=0.3)
    named = {("ai7" if name == "B" else name): values for name, values in columns.items()}
    path = tmp_path / "touches.parquet"
    parquet.write_table(pyarrow.table(named), path)
    sensor = SCENE.with_(readout={"unit": "pC", "channels": {"B": "ai7"}}, uncertain=UNCERTAIN)
    touches = read_touches(str(path), sensor)
    expected = read_touches(columns, SCENE)
    assert touches.readings.tolist() == expected.readings.tolist()
    assert touches.probe_loads.tolist() == expected.probe_loads.tolist()
    del named["x_mm"]
    parquet.write_table(pyarrow.table(named), path)
    with pytest.raises(FileError, match="Parquet, without x_mm of touches"):
        read_touches(path, SCENE)


def test_touches_without_a_reading_that_is_not_clipped_are_left_out():
    columns = make_columns(sigma=0.01)
    limit = max(columns[name].max() for name in NAMES)
    for name in NAMES:
        columns[name][[4, 9]] = limit
    result = calibrate(SCENE, columns, UNKNOWN)
    assert result.status == "calibrated"
    expected = np.delete(np.arange(1, 25), [4, 9])
    assert result.fit.model.table.rows.tolist() == expected.tolist()
    for name, parameter in result.parameters.items():
        assert abs(parameter["value"] - TRUE[name]) < 3.5 * parameter["deviation"]


def test_too_many_clipped_readings_have_a_status():
    """Five touches remain for eight parameters; and columns may be clipped throughout."""
    columns = make_columns(12, sigma=0.01)
    limit = 1.01 * max(columns[name].max() for name in NAMES)
    readout = {"range_V": 1e-3 * limit}
    for name in NAMES:
        columns[name][5:] = limit * np.linspace(1.0, 1.1, 7)
    result = calibrate(SCENE.with_(readout=readout), columns, UNKNOWN, unit="pC")
    assert result.status == "clipped"
    assert "range_V" in result.reason
    columns["A"][:5] = columns["C"][:5] = limit
    with pytest.raises(ValueError, match=r"(?s)column A: is clipped in every row.*column C: is cl"):
        calibrate(SCENE.with_(readout=readout), columns, UNKNOWN, unit="pC")


def test_readings_that_only_look_clipped_are_named():
    """A channel is stuck at the end of its range in one touch, far above what the touch gives."""
    columns = make_columns(sigma=0.01)
    weakest = int(np.argmin(columns["B"]))
    limit = 1.05 * max(columns[name].max() for name in NAMES)
    columns["B"][weakest] = limit
    scene = SCENE.with_(readout={"range_V": 1e-3 * limit})
    result = calibrate(scene, columns, UNKNOWN, unit="pC")
    assert result.status == "calibrated"
    (note,) = [note for note in result.notes if "looks clipped" in note]
    assert note.startswith(f"row {weakest + 1}: B ")


def test_swapped_channels_are_named_beside_clipped_readings():
    columns = make_columns(sigma=0.01, place_sd=0.3)
    limit = float(np.quantile([columns[name] for name in NAMES], 0.93))
    clipped = clip(columns, limit)
    swapped = clipped | {"A": clipped["B"], "B": clipped["A"]}
    result = calibrate(SCENE, swapped, UNKNOWN, place_sd=0.3)
    assert result.status == "swapped_channels"
    assert {each["electrode"] for each in result.to_json()["clipped"]} == {"B", "C"}
    assert "A and B" in result.reason


def test_a_model_of_other_readings_knows_why_touches_were_not_solved():
    columns = make_columns()
    parameters = select_parameters(SCENE, (PRETENSION,), {})
    model = ReadingModel(parameters, read_touches(columns, SCENE), "change", "pC", 1e-5)
    everything = np.ones(24, dtype=bool)
    off_film = np.zeros((24, 2))
    off_film[3] = 44.0
    model.solve_touches(parameters.initial, off_film, everything)
    assert list(model.failures) == [3]
    other = model.with_table(read_touches(columns, SCENE), "total")
    assert other.failures == model.failures
    assert other.is_solved.tolist() == model.is_solved.tolist()
    other.failures.clear()
    assert list(model.failures) == [3]
    moved = read_touches(columns | {"x_mm": columns["x_mm"] + 0.1}, SCENE)
    assert model.with_table(moved, "change").failures == {}


def test_too_few_touches_and_touches_of_another_sensor_have_a_status():
    columns = make_columns(10, sigma=0.01)
    shuffled = {name: np.roll(columns[name], shift) for shift, name in enumerate(NAMES)}
    assert calibrate(SCENE, columns | shuffled, UNKNOWN).status == "not_explained"
    same_force = {"force_N": np.ones(10)}
    assert calibrate(SCENE, columns | same_force, UNKNOWN).status == "wrong_force"
    for count in (2, 6):
        first = {name: column[:count] for name, column in columns.items()}
        calibration = calibrate(SCENE, first, UNKNOWN, sigma=1e-4)
        assert calibration.status == "too_few_touches"
        assert 0.0 <= calibration.fit.p_value <= 1.0  # two touches have no degree of freedom


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
def test_wrong_arguments_are_rejected_before_any_solve(changes, arguments, key):
    with pytest.raises(ValueError, match=f"^{key}"):
        calibrate(SCENE.with_(**changes), {}, **arguments)


IN_220_PF = {"feedback_capacitance_pF": 220.0, "reading": "change"}


@pytest.mark.parametrize("sd", [0.0, 0.5])
def test_readings_in_another_unit_than_the_default_are_used_and_said(sd):
    """The default is V with a readout. Readings of hundreds in pC are not V."""
    columns = make_columns(sigma=0.01, place_sd=sd)
    scene = SCENE.with_(readout=IN_220_PF)
    expected = calibrate(scene, columns, UNKNOWN, unit="pC", place_sd=sd)
    found = calibrate(scene, columns, UNKNOWN, place_sd=sd)
    assert found.fit.values == pytest.approx(expected.fit.values, rel=1e-6)
    assert (found.to_json()["unit"], "in pC, not in V" in found.notes[0]) == ("pC", True)
    in_volts = {name: columns[name] / 220.0 for name in NAMES}
    assert calibrate(scene, columns | in_volts, UNKNOWN, place_sd=sd).notes == expected.notes
    by_readout = scene.with_(**{"readout.unit": "pC"})
    assert calibrate(by_readout, columns, UNKNOWN, place_sd=sd).notes == expected.notes


@pytest.mark.parametrize(
    ("readout", "unit", "factor", "words"),
    [
        (IN_220_PF, "V", 1.0, "in pC, not in V; give --unit pC"),
        (IN_220_PF, "pC", 1 / 220.0, "in V, not in pC; give --unit V"),
        (None, None, 1e-3, "in nC or V, not in pC; give --unit nC, or add a [readout]"),
    ],
)
def test_a_wrong_unit_is_refused_after_three_solves(monkeypatch, readout, unit, factor, words):
    solves = []

    def solve(problem):
        solves.append(problem)
        return touched_sensor.solve_outputs(problem)

    monkeypatch.setattr(reading_model, "solve_outputs", solve)
    columns = make_columns(sigma=0.01)
    columns |= {name: factor * columns[name] for name in NAMES}
    result = calibrate(SCENE.with_(readout=readout), columns, UNKNOWN, unit=unit)
    assert (result.status, words in result.reason, len(solves)) == ("wrong_unit", True, 3)
    assert result.to_json()["status"] == "wrong_unit"


def test_a_calibrated_sensor_reads_in_the_unit_of_its_touches(calibration):
    """The nominal scene has no readout; another one keeps its own unit."""
    assert calibration.scene.readout.unit == "pC"
    wired = SCENE.with_(readout=IN_220_PF)
    assert calibrate(wired, make_columns(sigma=0.01), UNKNOWN).scene.readout.unit == "V"

"""Readings of channels: changes or total charges, gains and offsets, places on a stage."""

import re
from dataclasses import replace

import numpy as np
import pytest

from pvdf_fem.response.model import QUANTITIES
from pvdf_fem.solution.solve import rest_charges
from pvdf_fem.touch.least_squares import SearchOptions
from pvdf_fem.touch.locate import locate, weigh
from pvdf_fem.touch.locate_many import locate_many
from pvdf_fem.touch.search import LocateOptions
from pvdf_fem.touch.touch import TouchStatus
from tests.helpers.touch_models import bumps, random_touches

TOUCH = np.array([3.0, -4.0, 25.0, 0.7])
KNOWN = {"rotation_deg": 25.0}
CHANNELS = {
    "kind": "charge",
    "feedback_capacitance_pF": {"A": 500.0, "B": 2000.0},
    "gain": {"A": 1.1, "C": -0.9},
    "offset_V": {"B": 0.02, "D": -0.1},
    "noise_V": 0.003,
    "reading": "total",
}
CAPACITANCES_PF = np.array([500.0, 2000.0, 1000.0, 1000.0])
GAINS = np.array([1.1, 1.0, -0.9, 1.0])
OFFSETS_V = np.array([0.0, 0.02, 0.0, -0.1])
STAGE = {"x_mm": 30.0, "y_mm": -5.0, "rotation_deg": 50.0}


def model_with(shape="rectangle", **sections):
    """A stand-in whose charges without a touch are the scene's."""
    model = bumps(shape)
    scene = model.scene.with_(**sections)
    return replace(model, scene=scene, rest_pC=1e12 * rest_charges(scene)[0])


def readings_of(model, touch=TOUCH, less_pC=0.0):
    charges = model.evaluate(np.atleast_2d(touch))[0][0] - less_pC
    return dict(zip(model.names, charges.tolist(), strict=True))


# ---------------------------------------------------------------------------- totals and changes


def test_changes_are_located_as_changes():
    model = model_with()
    changes = readings_of(model, less_pC=model.rest_pC)
    found = locate(model, changes, known=KNOWN, reading="change")
    assert found.best.values == pytest.approx(TOUCH, abs=1e-4)
    assert found.reading == "change"
    assert found.remarks == ()
    [probe] = weigh({"one": model}, changes, unknown=found.unknown, known=KNOWN, reading="change")
    assert probe.location.best.values == pytest.approx(TOUCH, abs=1e-4)


@pytest.mark.parametrize(
    ("factor", "text"),
    [
        (1e-3, "readings are in nC, not in pC"),
        (1e-12, "readings are in C, not in pC"),
        (-1.0, "readings have the wrong sign"),
        (1.0 / CAPACITANCES_PF, "readings are in V, not in pC"),
        (np.array([1.0, -1.0, 1.0, 1.0]), "channel B has the wrong sign"),
    ],
)
def test_a_wrong_unit_or_sign_is_told(factor, text):
    model = model_with(readout=CHANNELS | {"gain": 1.0, "offset_V": 0.0, "noise_V": 0.0})
    charges = readings_of(model)
    scaled = dict(zip(charges, factor * np.array([*charges.values()]), strict=True))
    found = locate(model, scaled, 0.002, known=KNOWN)
    assert found.status == "unexplained"
    right = {mistake: touch for mistake, touch in found.explanations}
    assert right[text].values == pytest.approx(TOUCH, abs=1e-3)
    many = locate_many(model, [list(scaled.values())], 0.002, rotations_deg=[25.0])
    assert text in many.to_table()["remark"][0]


def test_readings_in_volts_are_read_by_their_channels():
    model = model_with(readout=CHANNELS | {"gain": 1.0, "offset_V": 0.0, "noise_V": 0.0})
    charges = np.array([*readings_of(model).values()])
    volts = dict(zip(model.names, charges / CAPACITANCES_PF, strict=True))
    found = locate(model, volts, 0.002, known=KNOWN, unit="V")
    assert found.best.values == pytest.approx(TOUCH, abs=1e-3)
    rows = [[*volts.values()], [1e3 * volt for volt in volts.values()], charges]
    many = locate_many(model, rows, 0.002, rotations_deg=[25.0] * 3, unit="V")
    assert many.values[0] == pytest.approx(TOUCH, abs=1e-3)
    assert many.explanations[0] == ""
    assert "readings are in mV, not in V" in many.explanations[1]
    assert "readings are in pC, not in V" in many.explanations[2]


def test_units_that_are_alike_are_told_together():
    """1 V on 1000 pF is 1 nC: nobody can tell which of them was read."""
    model = model_with(readout={"feedback_capacitance_pF": 1000.0, "reading": "total"})
    charges = readings_of(model)
    found = locate(model, {n: 1e-3 * q for n, q in charges.items()}, 0.002, known=KNOWN)
    assert [text for text, _ in found.explanations] == ["readings are in nC or V, not in pC"]


@pytest.mark.parametrize(("unit", "readout"), [("nV", CHANNELS), ("V", None)])
def test_a_unit_that_channels_have_not_is_refused(unit, readout):
    model = model_with(readout=readout)
    with pytest.raises(ValueError, match=r"^unit = "):
        locate(model, readings_of(model), known=KNOWN, unit=unit)
    with pytest.raises(ValueError, match=r"^unit = "):
        locate_many(model, [[*readings_of(model).values()]], unit=unit)


def test_exchanged_channels_are_told():
    model = model_with()
    charges = readings_of(model)
    swapped = {**charges, "A": charges["B"], "B": charges["A"]}
    found = locate(model, swapped, 0.002, known=KNOWN)
    assert found.status == "unexplained"
    right = {mistake: touch for mistake, touch in found.explanations}
    assert right["channels A and B are swapped"].values == pytest.approx(TOUCH, abs=1e-3)


@pytest.mark.parametrize(("given", "other"), [("change", "total"), ("total", "change")])
def test_a_wrong_reading_is_told(given, other):
    """Changes given as totals used to be some other touch, without a word about changes."""
    model = model_with()
    readings = readings_of(model, less_pC=model.rest_pC if other == "change" else 0.0)
    result = locate(model, readings, 0.002, known=KNOWN, reading=given).to_json()
    assert (result["reading"], result["status"]) == (given, "unexplained")
    assert result["explanations"][0]["force_N"] == pytest.approx(0.7, abs=1e-4)
    rows = [list(readings.values())] * 2, 0.002
    many = locate_many(model, *rows, rotations_deg=[25.0, 25.0], reading=given)
    word = {"total": "total charges", "change": "changes by the touch"}[other]
    assert f"explained if readings are {word}" in many.to_table()["remark"][1]
    right = locate_many(model, *rows, rotations_deg=[25.0, 25.0], reading=other)
    assert right.to_table()["remark"].tolist() == ["", ""]


def test_too_few_charges_may_fit_no_touch():
    """Three charges for three unknown quantities have no p-value; the edge of the domain holds."""
    model = model_with("circle")
    charges = {"A": 5.0, "B": 9000.0, "C": 5.0}
    found = locate(model, charges)
    assert np.isnan(found.best.p_value)
    assert not found.best.explained
    assert any(text.startswith("unexplained: no touch of") for text in found.remarks)
    many = locate_many(
        model, {name: [charge] for name, charge in charges.items()}, rotations_deg=[0]
    )
    assert not many.explained[0]
    fitting = {name: charge for name, charge in readings_of(model).items() if name != "D"}
    assert locate(model, fitting).best.explained


@pytest.mark.parametrize("reading", ["total", "change"])
def test_the_relative_deviation_is_of_what_is_read(reading):
    model = model_with()
    rest = model.rest_pC if reading == "change" else 0.0
    readings = readings_of(model, less_pC=rest)
    found = locate(model, readings, 0.02, known=KNOWN, reading=reading, noise_pC=2.0)
    signals = np.array(list(readings.values()))
    variance = (0.02 * signals) ** 2 + (1e-4 * (signals + rest)) ** 2 / 3.0 + 4.0
    assert found.problem.deviations_pC[0] == pytest.approx(np.sqrt(variance))


# ------------------------------------------------------------------------------------- channels


def test_gains_offsets_and_noise_are_those_of_the_readout():
    model = model_with(readout=CHANNELS)
    charges = np.array(list(readings_of(model).values()))
    nominal = GAINS * charges + OFFSETS_V * CAPACITANCES_PF
    readings = dict(zip(model.names, nominal.tolist(), strict=True))
    found = locate(model, readings, known=KNOWN)
    assert found.best.values == pytest.approx(TOUCH, abs=1e-4)
    noise = 0.003 * CAPACITANCES_PF / GAINS
    variance = (0.01**2 + 1e-8 / 3.0) * charges**2 + noise**2
    assert found.problem.deviations_pC[0] == pytest.approx(np.sqrt(variance))
    many = locate_many(model, nominal[None], rotations_deg=[25.0])
    assert many.values[0] == pytest.approx(TOUCH, abs=1e-3)
    quiet = locate(model, readings, known=KNOWN, noise_pC=0.0)
    assert quiet.best.deviations["force_N"] < found.best.deviations["force_N"]


def test_a_readout_says_what_is_read():
    model = model_with(readout={"reading": "change"})
    changes = readings_of(model, less_pC=model.rest_pC)
    assert locate(model, changes, known=KNOWN).best.values == pytest.approx(TOUCH, abs=1e-4)
    many = locate_many(model, [list(changes.values())], rotations_deg=[25.0])
    assert many.values[0] == pytest.approx(TOUCH, abs=1e-3)


# ---------------------------------------------------------------------------------------- stage


def on_stage(touches):
    """Touches (..., 4) on the film in the frame of `STAGE`."""
    c, s = np.cos(np.radians(50.0)), np.sin(np.radians(50.0))
    x, y, rotation, force = np.moveaxis(np.asarray(touches), -1, 0)
    place = [c * x - s * y + 30.0, s * x + c * y - 5.0, rotation + 50.0, force]
    return np.stack(place, axis=-1)


def test_touches_are_told_on_the_stage():
    model, film = model_with(stage=STAGE), model_with()
    touch = on_stage(TOUCH)
    # slopes are those before the last step
    options = LocateOptions(search=SearchOptions(arrived=1e-8))
    known = {"rotation_deg": touch[2]}
    found = locate(model, readings_of(model), known=known, options=options)
    assert found.best.values == pytest.approx(touch, abs=1e-4)
    same = locate(film, readings_of(film), known=KNOWN, options=options)
    c, s = np.cos(np.radians(50.0)), np.sin(np.radians(50.0))
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    expected = turn @ same.best.covariance @ turn.T
    assert found.best.covariance == pytest.approx(expected, rel=1e-3, abs=1e-9)
    sizes = np.sqrt(np.diag(expected))
    assert list(found.deviations.values()) == pytest.approx(sizes, rel=0.15)
    anywhere = locate(model, readings_of(model), 1e-3, unknown=QUANTITIES)
    assert any(one.values == pytest.approx(touch, abs=1e-3) for one in anywhere.touches)


@pytest.mark.parametrize("unknown", [("x_mm",), ("y_mm", "force_N"), ("rotation_deg",)])
def test_what_is_known_is_on_the_stage(unknown):
    model, touch = model_with(stage=STAGE), on_stage(TOUCH)
    known = {n: v for n, v in zip(QUANTITIES, touch, strict=True) if n not in unknown}
    found = locate(model, readings_of(model), 1e-3, unknown=unknown, known=known)
    assert found.best.values == pytest.approx(touch, abs=1e-4)


def test_the_scenes_probe_is_on_the_film():
    model = model_with(stage=STAGE, probe={"shape": "rectangle", "rotation_deg": 25.0})
    assert locate(model, readings_of(model)).best.values == pytest.approx(on_stage(TOUCH), abs=1e-4)


def test_a_place_beyond_the_reach_is_measured_from_the_films_centre():
    model = model_with(stage=STAGE)
    with pytest.raises(ValueError, match="known x_mm = 3: beyond the 12 mm"):
        locate(model, readings_of(model), unknown=("y_mm",), known={"x_mm": 3.0})
    locate(model, readings_of(model), unknown=("y_mm",), known={"x_mm": 31.0})


# ------------------------------------------------------------------------------- rows and tables


def test_calibrated_rows_have_the_deviations_of_a_location():
    model, touches = bumps("circle", width_mm=4.0), random_touches(12, seed=5)
    factors = 1.0 + 0.01 * np.random.default_rng(6).standard_normal((12, 4))
    charges = model.evaluate(touches)[0] * factors
    found = locate_many(model, charges, rotations_deg=np.zeros(12), calibrated=True)
    quick = locate_many(model, charges, rotations_deg=np.zeros(12))
    for k, row in enumerate(charges.tolist()):
        one = locate(model, dict(zip(model.names, row, strict=True)))
        # the best of two may be either, as they have the same chi-square
        same = min(one.touches, key=lambda touch: abs(touch.x_mm - found.values[k, 0]))
        assert found.values[k] == pytest.approx(same.values, abs=2e-3)
        sizes = list(one.deviations_of(same).values())
        assert found.deviations[k] == pytest.approx(sizes, rel=0.15)
        assert found.alternatives[k] == one.alternatives
    assert (found.alternatives > 0).any()
    assert np.isnan(quick.alternatives).all()
    variances = np.einsum("nuu->nu", quick.covariances)
    assert quick.deviations == pytest.approx(np.sqrt(variances))


def test_a_table_has_a_column_for_each_number():
    model = bumps("rectangle")
    charges = [list(readings_of(model).values()), [np.nan, 1.0, 1.0, 1.0]]
    table = locate_many(model, charges, rotations_deg=[25.0, 25.0]).to_table()
    assert [table[name][0] for name in QUANTITIES] == pytest.approx(TOUCH, abs=1e-3)
    assert table["x_deviation_mm"][0] > 0.0
    assert np.isnan(table["rotation_deviation_deg"][0])
    assert table["status"].tolist() == ["located", "not_finite"]
    assert np.isnan(table["x_mm"][1])
    assert table["remark"].tolist() == ["", ""]


# -------------------------------------------------------------------------------------- mistakes


TWO = {"A": 700.0, "B": 600.0}


@pytest.mark.parametrize(
    ("charges", "options", "key"),
    [
        ({}, {}, "charges: "),
        ({"A": "12", "B": 3.0}, {}, "charges.A = '12'"),
        ({"A": None, "B": 3.0}, {}, "charges.A = None"),
        ({"A": 1.0, "B": 0.0}, {}, "charges.B = 0"),
        ({"A": 1e13, "B": 1.0}, {}, "charges.A = 10000000000000.0"),
        (TWO, {"sigma": "little"}, "sigma = 'little'"),
        (TWO, {"sigma": {"A": 0.1}}, "sigma.B"),
        (TWO, {"noise_pC": -1.0}, "noise_pC = -1"),
        (TWO, {"unknown": ()}, "unknown: "),
        (TWO, {"known": {"y_mm": "up"}, "unknown": ["x_mm"]}, "known.y_mm = 'up'"),
        (TWO, {"reading": "both"}, "reading = both"),
        (TWO, {"touches": 2}, "touches = 2"),
    ],
)
def test_mistakes_are_told_by_their_keys(charges, options, key):
    with pytest.raises(ValueError, match="^" + re.escape(key)):
        locate(bumps(), charges, **options)


def test_without_any_error_there_is_no_likelihood():
    model = bumps(error_bound=0.0)
    with pytest.raises(ValueError, match="sigma = 0"):
        locate(model, TWO, 0.0)
    with pytest.raises(ValueError, match="sigma = 0"):
        locate_many(model, np.ones((1, 4)), 0.0)


def test_a_reading_of_the_offset_is_a_charge_of_zero():
    readout = {"offset_V": {"B": 0.02}, "reading": "total"}
    model = model_with(readout=readout)
    with pytest.raises(ValueError, match=r"charges\.B = 20: a charge of 0"):
        locate(model, {"A": 700.0, "B": 20.0})
    rows = locate_many(model, [[700.0, 20.0, 600.0, 500.0]], rotations_deg=[0.0])
    assert rows.status[0] is TouchStatus.ZERO

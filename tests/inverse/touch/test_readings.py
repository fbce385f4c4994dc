"""Readings of channels: meaning, gains, offsets, noise, positions on a stage, and validation."""

from dataclasses import replace

import numpy as np
import pytest

from pvdf_fem.inverse.touch.locate import locate
from pvdf_fem.inverse.touch.locate_many import locate_many
from pvdf_fem.problem.problem import Problem
from pvdf_fem.solver.adaptive import compute_unloaded_charges
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES
from tests.helpers.bump_response import make_bump_response, read_charges

TOUCH = np.array([3.0, -4.0, 25.0, 0.7])
ROTATION = {"rotation_deg": 25.0}
POSITION_AND_FORCE = ("x_mm", "y_mm", "force_N")
CHANNELS = {
    "kind": "charge",
    "feedback_capacitance_pF": {"A": 500.0, "B": 2000.0},
    "gain": {"A": 1.1, "C": -0.9},
    "offset_V": {"B": 0.02, "D": -0.1},
    "noise_V": 0.003,
}
CAPACITANCES_PF = np.array([500.0, 2000.0, 1000.0, 1000.0])
GAINS = np.array([1.1, 1.0, -0.9, 1.0])
OFFSETS_V = np.array([0.0, 0.02, 0.0, -0.1])
#: Channels of charges without gains, offsets and noise.
PLAIN_CHANNELS = CHANNELS | {"gain": 1.0, "offset_V": 0.0, "noise_V": 0.0, "reading": "total"}
PLAIN_CHANNELS["unit"] = "pC"
STAGE = {"x_mm": 30.0, "y_mm": -5.0, "rotation_deg": float(np.degrees(np.arctan2(4.0, 3.0)))}
TOUCH_ON_STAGE = np.array([30.0 + 5.0, -5.0, 25.0 + STAGE["rotation_deg"], 0.7])
REST_PC = 48.0


def make_response(shape="rectangle", **sections):
    """Make a response whose charges without a touch are those of its scene."""
    response = make_bump_response(shape)
    scene = response.scene.with_(**sections)
    unloaded_C = compute_unloaded_charges(Problem.from_scene(scene))[0]  # all are equal
    return replace(response, scene=scene, rest_pC=1e12 * unloaded_C)


def by_name(readings):
    return dict(zip("ABCD", np.asarray(readings).tolist(), strict=True))


def compute_charges(response):
    return np.array([*read_charges(response, TOUCH).values()])


@pytest.mark.parametrize("reading", ["total", "change"])
@pytest.mark.parametrize("by_readout", [True, False])
@pytest.mark.parametrize("unit", ["pC", "V"])
def test_readings_are_those_of_the_channels(reading, by_readout, unit):
    """The meaning of readings comes from the readout, or from the argument, which wins."""
    other = {"total": "change", "change": "total"}[reading]
    response = make_response(readout={**CHANNELS, "reading": reading if by_readout else other})
    charges = compute_charges(response)
    signals = charges - REST_PC if reading == "change" else charges
    nominal_pC = GAINS * signals + OFFSETS_V * CAPACITANCES_PF
    readings = nominal_pC / (1.0 if unit == "pC" else CAPACITANCES_PF)
    options = {"unit": unit} if by_readout else {"unit": unit, "reading": reading}
    for noise_pC in (None, 2.0):
        channel_noise = 0.003 * CAPACITANCES_PF if noise_pC is None else noise_pC
        variance = np.square(0.01 * signals) + np.square(1e-4 * charges) / 3.0
        variance += np.square(channel_noise / GAINS)
        location = locate(response, by_name(readings), known=ROTATION, noise_pC=noise_pC, **options)
        assert (location.status, location.reading, location.notes) == ("located", reading, ())
        assert location.best.values == pytest.approx(TOUCH, abs=1e-4)
        assert location.problem.deviations_pC[0] == pytest.approx(np.sqrt(variance))
    touches = locate_many(response, readings[None], rotations_deg=[25.0], **options)
    assert touches.values[0] == pytest.approx(TOUCH, abs=1e-3)
    assert touches.to_table()["remark"].tolist() == [""]


@pytest.mark.parametrize("by_readout", ["V", "mV", "pC", "nC", None])
def test_readings_are_in_the_unit_of_the_readout_or_in_pC_without_one(by_readout):
    """Their unit is V unless the readout says otherwise; an argument wins."""
    readout = PLAIN_CHANNELS | {"unit": by_readout} if by_readout else None
    response = make_response(readout=readout)
    charges = compute_charges(response)
    units_pC = {"V": CAPACITANCES_PF, "mV": 1e-3 * CAPACITANCES_PF, "nC": 1e3}
    readings = charges / units_pC.get(by_readout, 1.0)
    touches = locate_many(response, readings[None], rotations_deg=[25.0])
    assert touches.values[0] == pytest.approx(TOUCH, abs=1e-3)
    location = locate(response, by_name(charges), known=ROTATION, unit="pC")
    assert location.best.values == pytest.approx(TOUCH, abs=1e-3)


#: Words of the explanation, options, and the mistake that is made with charges.
MISTAKES = [
    ("nC", {}, lambda q: 1e-3 * q),
    (" C,", {}, lambda q: 1e-12 * q),
    (" V,", {}, lambda q: q / CAPACITANCES_PF),
    ("mV", {"unit": "V"}, lambda q: 1e3 * q / CAPACITANCES_PF),
    (" pC,", {"unit": "V"}, lambda q: q),
    ("readings have the wrong sign", {}, lambda q: -q),
    ("channel B", {}, lambda q: q * [1.0, -1.0, 1.0, 1.0]),
    ("channels A and B", {}, lambda q: q[[1, 0, 2, 3]]),
    ("changes by the touch", {}, lambda q: q - REST_PC),
    ("total charges", {"reading": "change"}, lambda q: q),
]


@pytest.mark.parametrize(
    ("words", "options", "make_mistake"), MISTAKES, ids=[case[0] for case in MISTAKES]
)
def test_the_mistake_in_readings_is_named(words, options, make_mistake):
    response = make_response(readout=PLAIN_CHANNELS)
    readings = make_mistake(compute_charges(response))
    location = locate(response, by_name(readings), 0.002, known=ROTATION, **options)
    assert location.status == "unexplained"
    [touch] = [touch for text, touch in location.explanations if words in text]
    assert touch.values == pytest.approx(TOUCH, abs=1e-3)
    explanations = location.to_json()["explanations"]
    assert touch.force_N in [explanation["force_N"] for explanation in explanations]
    touches = locate_many(response, [readings], 0.002, rotations_deg=[25.0], **options)
    assert words in touches.to_table()["remark"][0]


@pytest.mark.parametrize(
    "unknown",
    [
        ("force_N",),
        ("x_mm",),
        ("rotation_deg",),
        ("y_mm", "force_N"),
        POSITION_AND_FORCE,
        TOUCH_QUANTITIES,
    ],
)
@pytest.mark.parametrize("is_given", [True, False])
def test_fixed_quantities_are_given_on_the_stage_or_are_those_of_the_scene(unknown, is_given):
    """The scene's probe has its position on the film."""
    position = dict(zip(TOUCH_QUANTITIES[:3], TOUCH.tolist(), strict=False))
    sections = {"probe": {"shape": "rectangle", **position}, "load": {"force_N": 0.7}}
    response = make_response(stage=STAGE, **({} if is_given else sections))
    known = {}
    for name, value in zip(TOUCH_QUANTITIES, TOUCH_ON_STAGE, strict=True):
        if is_given and name not in unknown:
            known[name] = value
    charges = read_charges(response, TOUCH)
    location = locate(response, charges, 1e-3, unknown=unknown, known=known)
    assert location.unknown == unknown
    touches = location.touches if unknown == TOUCH_QUANTITIES else [location.best]
    assert any(touch.values == pytest.approx(TOUCH_ON_STAGE, abs=1e-4) for touch in touches)


TWO_READINGS = {"A": 700.0, "B": 600.0}


@pytest.mark.parametrize(
    ("readings", "options", "keys"),
    [
        ({}, {}, ["readings"]),
        ({"A": "12", "B": None, "C": 1e13, "D": 0.0}, {}, [f"readings.{n}" for n in "ABCD"]),
        (
            {"A": 700.0, "E": 1.0, "B": np.nan},
            {"sigma": -0.1},
            ["readings.E", "readings.B", "sigma"],
        ),
        (TWO_READINGS, {"sigma": {"A": 0.1}}, ["sigma.B"]),
        (TWO_READINGS, {"noise_pC": -1.0, "reading": "both"}, ["noise_pC", "reading"]),
        (TWO_READINGS, {"unit": "V"}, ["unit"]),
        (TWO_READINGS, {"touches": 2, "unknown": ("mass",)}, ["touches", "mass"]),
        (TWO_READINGS, {"unknown": ("x_mm", "mass"), "known": {"x_mm": 3.0}}, ["x_mm", "mass"]),
        (
            TWO_READINGS,
            {"known": {"y_mm": 18.0, "force_N": 9.0}, "unknown": ["x_mm"]},
            ["known y_mm", "known force_N"],
        ),
    ],
)
def test_all_mistakes_are_reported_by_their_keys(readings, options, keys):
    """Places are on a stage whose origin is 10 mm from the film's centre, along -y."""
    response = make_response(stage={"y_mm": -10.0})
    with pytest.raises(ValueError, match=r".") as error:
        locate(response, readings, **options)
    lines = str(error.value).splitlines()
    assert [line.partition(":")[0].partition(" =")[0] for line in lines] == keys


def test_readings_without_any_error_are_rejected():
    response = make_bump_response(error_bound=0.0)
    with pytest.raises(ValueError, match=r"^sigma = 0"):
        locate(response, TWO_READINGS, 0.0)
    with pytest.raises(ValueError, match=r"^sigma = 0"):
        locate_many(response, np.ones((1, 4)), 0.0)

"""Readings of channels: changes or total charges, gains, offsets and noise, places on a stage, and
what is wrong with readings."""

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
KNOWN = {"rotation_deg": 25.0}
USUAL = ("x_mm", "y_mm", "force_N")
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
PLAIN = CHANNELS | {"gain": 1.0, "offset_V": 0.0, "noise_V": 0.0, "reading": "total"}
STAGE = {"x_mm": 30.0, "y_mm": -5.0, "rotation_deg": float(np.degrees(np.arctan2(4.0, 3.0)))}
ON_STAGE = np.array([30.0 + 5.0, -5.0, 25.0 + STAGE["rotation_deg"], 0.7])
REST_PC = 48.0


def model_with(shape="rectangle", **sections):
    """A stand-in whose charges without a touch are the scene's."""
    model = make_bump_response(shape)
    scene = model.scene.with_(**sections)
    return replace(
        model, scene=scene, rest_pC=1e12 * compute_unloaded_charges(Problem.from_scene(scene))[0]
    )


def by_name(readings):
    return dict(zip("ABCD", np.asarray(readings).tolist(), strict=True))


def charges_of(model):
    return np.array([*read_charges(model, TOUCH).values()])


@pytest.mark.parametrize("reading", ["total", "change"])
@pytest.mark.parametrize("said", [True, False])
@pytest.mark.parametrize("unit", ["pC", "V"])
def test_readings_are_those_of_the_channels(reading, said, unit):
    """What is read is said by the readout, or by an argument, which wins."""
    other = {"total": "change", "change": "total"}[reading]
    model = model_with(readout={**CHANNELS, "reading": reading if said else other})
    charges = charges_of(model)
    signals = charges - REST_PC * (reading == "change")
    nominal_pC = GAINS * signals + OFFSETS_V * CAPACITANCES_PF
    given = nominal_pC / (1.0 if unit == "pC" else CAPACITANCES_PF)
    how = {"unit": unit} | ({} if said else {"reading": reading})
    for noise_pC in (None, 2.0):
        of_channels = 0.003 * CAPACITANCES_PF if noise_pC is None else noise_pC
        variance = np.square(0.01 * signals) + np.square(1e-4 * charges) / 3.0
        variance += np.square(of_channels / GAINS)
        found = locate(model, by_name(given), known=KNOWN, noise_pC=noise_pC, **how)
        assert (found.status, found.reading, found.remarks) == ("located", reading, ())
        assert found.best.values == pytest.approx(TOUCH, abs=1e-4)
        assert found.problem.deviations_pC[0] == pytest.approx(np.sqrt(variance))
    many = locate_many(model, given[None], rotations_deg=[25.0], **how)
    assert many.values[0] == pytest.approx(TOUCH, abs=1e-3)
    assert many.to_table()["remark"].tolist() == [""]


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


@pytest.mark.parametrize(("word", "how", "changed"), MISTAKES, ids=[of[0] for of in MISTAKES])
def test_the_mistake_in_readings_is_told(word, how, changed):
    model = model_with(readout=PLAIN)
    given = changed(charges_of(model))
    found = locate(model, by_name(given), 0.002, known=KNOWN, **how)
    assert found.status == "unexplained"
    [right] = [touch for text, touch in found.explanations if word in text]
    assert right.values == pytest.approx(TOUCH, abs=1e-3)
    assert right.force_N in [one["force_N"] for one in found.to_json()["explanations"]]
    many = locate_many(model, [given], 0.002, rotations_deg=[25.0], **how)
    assert word in many.to_table()["remark"][0]


@pytest.mark.parametrize(
    "unknown",
    [("force_N",), ("x_mm",), ("rotation_deg",), ("y_mm", "force_N"), USUAL, TOUCH_QUANTITIES],
)
@pytest.mark.parametrize("given", [True, False])
def test_what_is_not_sought_is_given_on_the_stage_or_is_the_scenes_touch(unknown, given):
    """The scene's touch is on the film."""
    place = dict(zip(TOUCH_QUANTITIES[:3], TOUCH.tolist(), strict=False))
    sections = {"probe": {"shape": "rectangle", **place}, "load": {"force_N": 0.7}}
    model, touch = model_with(stage=STAGE, **({} if given else sections)), ON_STAGE
    known = {n: v for n, v in zip(TOUCH_QUANTITIES, touch, strict=True) if n not in unknown}
    found = locate(
        model, read_charges(model, TOUCH), 1e-3, unknown=unknown, known=known if given else {}
    )
    assert found.unknown == unknown
    fits = found.touches if unknown == TOUCH_QUANTITIES else [found.best]
    assert any(one.values == pytest.approx(touch, abs=1e-4) for one in fits)


TWO = {"A": 700.0, "B": 600.0}


@pytest.mark.parametrize(
    ("charges", "options", "keys"),
    [
        ({}, {}, ["readings"]),
        ({"A": "12", "B": None, "C": 1e13, "D": 0.0}, {}, [f"readings.{n}" for n in "ABCD"]),
        (
            {"A": 700.0, "E": 1.0, "B": np.nan},
            {"sigma": -0.1},
            ["readings.E", "readings.B", "sigma"],
        ),
        (TWO, {"sigma": {"A": 0.1}}, ["sigma.B"]),
        (TWO, {"noise_pC": -1.0, "reading": "both"}, ["noise_pC", "reading"]),
        (TWO, {"unit": "V"}, ["unit"]),
        (TWO, {"touches": 2, "unknown": ("mass",)}, ["touches", "mass"]),
        (TWO, {"unknown": ("x_mm", "mass"), "known": {"x_mm": 3.0}}, ["x_mm", "mass"]),
        (
            TWO,
            {"known": {"y_mm": 18.0, "force_N": 9.0}, "unknown": ["x_mm"]},
            ["known y_mm", "known force_N"],
        ),
    ],
)
def test_all_mistakes_are_told_by_their_keys(charges, options, keys):
    """Places are on a stage whose origin is 10 mm from the film's centre, along -y."""
    model = model_with(stage={"y_mm": -10.0})
    with pytest.raises(ValueError, match=r".") as told:
        locate(model, charges, **options)
    lines = str(told.value).splitlines()
    assert [line.partition(":")[0].partition(" =")[0] for line in lines] == keys


def test_without_any_error_there_is_no_likelihood():
    model = make_bump_response(error_bound=0.0)
    with pytest.raises(ValueError, match=r"^sigma = 0"):
        locate(model, TWO, 0.0)
    with pytest.raises(ValueError, match=r"^sigma = 0"):
        locate_many(model, np.ones((1, 4)), 0.0)

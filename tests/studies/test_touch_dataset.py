"""Random touches to learn from: their distribution, their readings, and their files."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
import xarray

from pvdf_fem import Scene, dataset, locate_many
from pvdf_fem.studies.touch_dataset import make_table, write_dataset
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES
from tests.helpers.bump_response import make_bump_response

READOUT = {"gain": {"A": 2.0, "B": -1.0}, "offset_V": {"C": 0.1}, "reading": "total"}
STAGE = {"x_mm": 30.0, "y_mm": -5.0, "rotation_deg": 90.0}


def draw_dataset(touches=2000, seed=1, sigma=0.01, scene=None, **options):
    """Draw a dataset of made-up charges."""
    response = make_bump_response("rectangle")
    scene = scene or response.scene
    return dataset(scene, touches, seed, sigma, response=response, **options)


def stack_touches(data):
    """Return the touches of a dataset, (touches, 4)."""
    return np.stack([data[name].values for name in TOUCH_QUANTITIES], axis=1)


def test_equal_seeds_draw_equal_touches_and_noise():
    data = draw_dataset(seed=3)
    other = draw_dataset(seed=4)
    xarray.testing.assert_identical(data, draw_dataset(seed=3))
    assert not np.isin(data.x_mm, other.x_mm).any()
    noise = (data.reading_pC / data.charge_pC).values
    other_noise = (other.reading_pC / other.charge_pC).values
    assert not np.isin(noise, other_noise).any()


def test_touches_are_even_over_the_domain():
    """Means and standard deviations of uniform numbers, within four of their standard errors.

    The numbers are squared distance over the reach, rotation, logarithm of the force and direction,
    each over its range.
    """
    touches = stack_touches(draw_dataset())
    square = np.square(touches[:, :2]).sum(axis=1) / 12.0**2
    rotation = touches[:, 2] / 180.0
    log_force = np.log(touches[:, 3] / 0.1) / np.log(50.0)
    direction = np.arctan2(touches[:, 1], touches[:, 0]) / (2.0 * np.pi) + 0.5
    for share in (square, rotation, log_force, direction):
        assert 0.0 <= share.min() < 0.01
        assert 0.99 < share.max() <= 1.0
        assert share.mean() == pytest.approx(0.5, abs=4.0 * 12**-0.5 / 2000**0.5)
        assert share.std() == pytest.approx(12**-0.5, rel=0.06)


@pytest.mark.parametrize("reading", ["total", "change"])
def test_charges_are_those_of_the_response_and_noise_has_the_stated_size(reading):
    """Unloaded squares of 3 mm have 48 pC; 3 % are four standard errors of 8000 numbers."""
    response = make_bump_response("rectangle")
    scene = response.scene.with_(readout=READOUT)
    data = draw_dataset(scene=scene, sigma=0.02, noise_pC=3.0, reading=reading)
    charges_pC = response.evaluate(stack_touches(data))[0]
    np.testing.assert_allclose(data.charge_pC, charges_pC, rtol=1e-12)
    error_bounds_pC = response.error_bound * charges_pC
    np.testing.assert_allclose(data.model_error_pC, error_bounds_pC, rtol=1e-12)
    signals_pC = charges_pC - (48.0 if reading == "change" else 0.0)
    gains = np.array([2.0, -1.0, 1.0, 1.0])
    offsets_pC = np.array([0.0, 0.0, 100.0, 0.0])
    noise_pC = data.reading_pC.values - offsets_pC - gains * signals_pC
    pulls = noise_pC / np.hypot(0.02 * gains * signals_pC, 3.0)
    assert pulls.std() == pytest.approx(1.0, abs=0.035)
    assert pulls.mean() == pytest.approx(0.0, abs=0.05)


def test_readings_are_located_at_the_touches_on_the_stage():
    scene = make_bump_response("rectangle").scene.with_(stage=STAGE, readout=READOUT)
    data = draw_dataset(50, 2, 0.0, scene)
    response = make_bump_response("rectangle").for_scene(scene)
    readings_pC = data.reading_pC.values
    result = locate_many(response, readings_pC, 1e-3, rotations_deg=data.rotation_deg, unit="pC")
    assert np.median(np.abs(result.values - stack_touches(data))) < 1e-3
    assert np.hypot(data.x_mm - 30.0, data.y_mm + 5.0).max() <= 12.0


def test_files_have_touches_and_scene(tmp_path):
    data = draw_dataset(20, noise_pC=2.0)
    scene = make_bump_response("rectangle").scene
    assert (data.seed, data.sigma, data.noise_pC) == (1, 0.01, [2.0] * 4)
    write_dataset(data, tmp_path / "touches.nc")
    with xarray.open_dataset(tmp_path / "touches.nc") as read:
        xarray.testing.assert_equal(read, data)
        assert Scene.parse(read.attrs["scene"]) == scene
    write_dataset(data, tmp_path / "touches.csv")
    rows = pd.read_csv(tmp_path / "touches.csv", comment="#")
    assert list(rows.columns[3:6]) == ["force_N", "charge_pC.A", "charge_pC.B"]
    pd.testing.assert_frame_equal(rows, make_table(data), rtol=1e-8)
    lines = (tmp_path / "touches.csv").read_text().splitlines()
    head = "\n".join(line[2:] for line in lines if line.startswith("#"))
    scene_text = head.partition("scene = ")[2].partition("\nsource = ")[0]
    assert Scene.parse(scene_text) == scene


def test_parquet_has_the_scene_as_metadata(tmp_path):
    pytest.importorskip("pyarrow")
    write_dataset(draw_dataset(20), tmp_path / "touches.parquet")
    rows = pd.read_parquet(tmp_path / "touches.parquet")
    pd.testing.assert_frame_equal(rows, make_table(draw_dataset(20)))
    assert Scene.parse(rows.attrs["scene"]) == make_bump_response("rectangle").scene

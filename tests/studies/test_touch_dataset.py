"""Random touches: where they are, what their readings are, and that files have all of it."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
import xarray

from pvdf_fem import Scene, dataset, locate_many
from pvdf_fem.studies.touch_dataset import make_table, write_dataset
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES
from tests.helpers.touch_models import bumps

READOUT = {"gain": {"A": 2.0, "B": -1.0}, "offset_V": {"C": 0.1}, "reading": "total"}
STAGE = {"x_mm": 30.0, "y_mm": -5.0, "rotation_deg": 90.0}


def drawn(touches=2000, seed=1, sigma=0.01, scene=None, **how):
    """A dataset of made-up charges."""
    model = bumps("rectangle")
    return dataset(scene or model.scene, touches, seed, sigma, response=model, **how)


def rows_of(data):
    return np.stack([data[name].values for name in TOUCH_QUANTITIES], axis=1)


def test_a_seed_draws_the_same_again():
    data, other = drawn(seed=3), drawn(seed=4)
    xarray.testing.assert_identical(data, drawn(seed=3))
    noise = [(of.reading_pC / of.charge_pC).values for of in (data, other)]
    assert not np.isin(data.x_mm, other.x_mm).any() | np.isin(*noise).any()


def test_touches_are_even_over_the_domain():
    """Squared distance over the reach, rotation and logarithm of the force, each over its range:
    their means and standard deviations, within four of the standard errors of 2000."""
    touches = rows_of(drawn())
    square = np.square(touches[:, :2]).sum(axis=1) / 12.0**2
    shares = square, touches[:, 2] / 180.0, np.log(touches[:, 3] / 0.1) / np.log(50.0)
    angle = np.arctan2(touches[:, 1], touches[:, 0]) / (2.0 * np.pi) + 0.5
    for share in (*shares, angle):
        assert 0.0 <= share.min() < 0.01 < 0.99 < share.max() <= 1.0
        assert share.mean() == pytest.approx(0.5, abs=4.0 * 12**-0.5 / 2000**0.5)
        assert share.std() == pytest.approx(12**-0.5, rel=0.06)


@pytest.mark.parametrize("reading", ["total", "change"])
def test_charges_are_the_models_and_noise_has_the_stated_size(reading):
    """Squares of 3 mm have 48 pC at rest; four standard errors of 8000 normal numbers are 3 %."""
    model = bumps("rectangle")
    scene = model.scene.with_(readout=READOUT)
    data = drawn(scene=scene, sigma=0.02, noise_pC=3.0, reading=reading)
    charges = model.evaluate(rows_of(data))[0]
    np.testing.assert_allclose(data.charge_pC, charges, rtol=1e-12)
    np.testing.assert_allclose(data.model_error_pC, model.error_bound * charges, rtol=1e-12)
    signals = charges - (48.0 if reading == "change" else 0.0)
    gains, offsets = np.array([2.0, -1.0, 1.0, 1.0]), np.array([0.0, 0.0, 100.0, 0.0])
    noise = data.reading_pC.values - offsets - gains * signals
    pulls = noise / np.hypot(0.02 * gains * signals, 3.0)
    assert pulls.std() == pytest.approx(1.0, abs=0.035)
    assert pulls.mean() == pytest.approx(0.0, abs=0.05)


def test_readings_are_located_at_the_touches_on_the_stage():
    scene = bumps("rectangle").scene.with_(stage=STAGE, readout=READOUT)
    data, model = drawn(50, 2, 0.0, scene), bumps("rectangle").for_scene(scene)
    found = locate_many(model, data.reading_pC.values, 1e-3, rotations_deg=data.rotation_deg)
    assert np.median(np.abs(found.values - rows_of(data))) < 1e-3
    assert np.hypot(data.x_mm - 30.0, data.y_mm + 5.0).max() <= 12.0


def test_files_have_touches_and_scene(tmp_path):
    data, scene = drawn(20, noise_pC=2.0), bumps("rectangle").scene
    assert (data.seed, data.sigma, data.noise_pC) == (1, 0.01, [2.0] * 4)
    write_dataset(data, tmp_path / "touches.nc")
    with xarray.open_dataset(tmp_path / "touches.nc") as kept:
        xarray.testing.assert_equal(kept, data)
        assert Scene.parse(kept.attrs["scene"]) == scene
    write_dataset(data, tmp_path / "touches.csv")
    rows = pd.read_csv(tmp_path / "touches.csv", comment="#")
    assert list(rows.columns[3:6]) == ["force_N", "charge_pC.A", "charge_pC.B"]
    pd.testing.assert_frame_equal(rows, make_table(data), rtol=1e-8)
    text = (tmp_path / "touches.csv").read_text()
    head = "\n".join(line[2:] for line in text.splitlines() if line.startswith("#"))
    assert Scene.parse(head.partition("scene = ")[2].partition("\nsource = ")[0]) == scene


def test_parquet_has_the_scene_as_metadata(tmp_path):
    pytest.importorskip("pyarrow")
    write_dataset(drawn(20), tmp_path / "touches.parquet")
    rows = pd.read_parquet(tmp_path / "touches.parquet")
    pd.testing.assert_frame_equal(rows, make_table(drawn(20)))
    assert Scene.parse(rows.attrs["scene"]) == bumps("rectangle").scene

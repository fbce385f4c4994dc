"""Designs: bounds against the scatter of located touches, symmetry, and refusals before models."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import xarray

from pvdf_fem import Scene, design, locate_many
from pvdf_fem.designs.design import best, table
from pvdf_fem.sweeps.dataset import write_netcdf
from tests.helpers.touch_models import bumps

RING = bumps("circle").scene.with_(electrodes={"layout": "ring", "shape": "circle", "radius_mm": 1})
LATTICE = {"reach_mm": 12.0, "step_mm": 3.0}


def studied(vary, noise=0.01, scene=RING, **how):
    """A study with made-up charges, for which nothing is solved."""
    how = {**LATTICE, "progress": lambda done, of: None, **how}
    return design(scene, vary, noise, model=lambda of: bumps("circle").for_scene(of), **how)


def square(name, x_mm, y_mm):
    return {"name": name, "shape": "square", "side_mm": 1.0, "x_mm": x_mm, "y_mm": y_mm}


@pytest.mark.parametrize("noise_pC", [None, 2.0])
def test_located_touches_scatter_by_the_bound(noise_pC):
    data = studied({"electrodes.count": [6]}, 0.003, noise_pC=noise_pC).squeeze("count")
    model = replace(bumps("circle").for_scene(RING.with_(**{"electrodes.count": 6})), error_bound=0)
    rng, count = np.random.default_rng(1), 3000
    for x, y in ((3.0, 0.0), (-3.0, 6.0)):
        charges = model.evaluate(np.array([[x, y, 0.0, 1.0]]))[0]
        sigma = np.hypot(0.003 * charges, noise_pC or 0.0)
        readings = charges + sigma * rng.standard_normal((count, charges.size))
        turns = np.zeros(count)
        found = locate_many(model, readings, 0.003, noise_pC=noise_pC, rotations_deg=turns)
        scatter = math.sqrt(np.square(found.values[:, :2] - (x, y)).sum(axis=1).mean())
        of_force = math.sqrt(np.square(found.values[:, 3] - 1.0).mean())
        place = data.sel(x_mm=x, y_mm=y)
        assert scatter == pytest.approx(float(place.place_deviation_mm), rel=0.05)
        assert of_force == pytest.approx(float(place.force_deviation), rel=0.05)


def test_a_turned_layout_has_turned_maps():
    data = studied(
        {"electrodes.first_angle_deg": [20.0, 110.0]}, scene=RING.with_(**{"electrodes.count": 3})
    )
    for name in ("place_deviation_mm", "force_deviation", "ambiguous"):
        first, turned = data[name].values
        np.testing.assert_allclose(turned, first[::-1].T, rtol=1e-3)


def test_more_electrodes_are_never_worse():
    few = [square(f"E{i}", x, y) for i, (x, y) in enumerate([(9, 0), (-3, 8), (-4, -7), (2, 3)])]
    more = [*few, square("F", -8.0, 2.0), square("G", 5.0, -8.0)]
    deviations = studied({"electrodes": [few, more]}).place_deviation_mm.values
    inside = np.isfinite(deviations[0])
    assert (deviations[1] < 1.001 * deviations[0])[inside].all()
    assert inside.sum() == np.isfinite(deviations[1]).sum() == 49


def test_bounds_are_linear_in_the_noise():
    once, thrice = (studied({"electrodes.count": [6]}, noise) for noise in (0.001, 0.003))
    for name in ("place_deviation_mm", "force_deviation_median"):
        np.testing.assert_allclose(thrice[name], 3.0 * once[name], rtol=1e-3)


def test_mirror_images_in_a_line_of_electrodes_are_ambiguous():
    """What stands on a line does not tell its two sides apart; one electrode beside it does."""
    line = [square(name, x, 0.0) for name, x in zip("ABCD", (-10, -4, 3, 9), strict=True)]
    data = studied({"electrodes": [line, [*line, square("E", 1.0, 9.0)]]}, 0.001)
    off = data.ambiguous.where(np.abs(data.y_mm) > 2.0)
    assert float(off.isel(electrodes=0).min()) == 1.0
    assert float(off.isel(electrodes=1).max()) == 0.0
    assert data.ambiguous_share[0] > 0.8 > 0.2 > data.ambiguous_share[1]


def test_one_model_serves_all_designs_whose_films_deform_alike():
    asked = []

    def model_of(scene):
        asked.append(scene.film.thickness_um)
        return bumps("circle").for_scene(scene)

    vary = {"film.thickness_um": [9.0, 25.0], "electrodes.count": [4, 6], "load.force_N": [0.5, 1]}
    data = design(RING, vary, model=model_of, progress=lambda done, of: None, **LATTICE)
    assert asked == [9.0, 25.0]
    assert data.place_deviation_mm.dims == ("thickness_um", "count", "force_N", "y_mm", "x_mm")
    scene = Scene.parse(data.scene.sel(thickness_um=9.0, count=6, force_N=0.5).item())
    assert (scene.film.thickness_um, len(scene.electrode_list), scene.load.force_N) == (9.0, 6, 0.5)


def test_noise_is_a_share_of_what_is_read():
    """At the centre all charges are equal; 48 pC is at rest on squares of 3 mm."""
    change, total = (
        studied({}, scene=RING.with_(readout={"kind": "charge", "reading": reading}))
        for reading in ("change", "total")
    )
    charge = bumps("circle").for_scene(RING).evaluate(np.array([[0.0, 0.0, 0.0, 1.0]]))[0][0, 0]
    ratio = (total.place_deviation_mm / change.place_deviation_mm).sel(x_mm=0.0, y_mm=0.0)
    assert float(ratio) == pytest.approx(charge / (charge - 48.0 * math.pi / 9.0), rel=1e-4)


def test_the_dataset_has_units_a_best_design_and_survives_a_file(tmp_path):
    data = studied({"electrodes.count": [4, 6], "electrodes.ring_radius_mm": [6.0, 14.0]})
    assert {data[name].attrs["units"] for name in ("place_deviation_median_mm", "x_mm")} == {"mm"}
    assert data["count"].attrs["key"] == "electrodes.count"
    medians = data.place_deviation_mm.median(["x_mm", "y_mm"])
    np.testing.assert_array_equal(medians, data.place_deviation_median_mm)
    few = medians.where(data.ambiguous_share <= 0.05)
    assert 0 < few.count() < few.size
    assert float(best(data).place_deviation_median_mm) == few.min()
    assert float(best(data, 1.0).place_deviation_median_mm) == medians.min()
    assert (
        float(best(data.sel(ring_radius_mm=6.0), 0.0).ambiguous_share)
        == data.ambiguous_share.sel(ring_radius_mm=6.0).min()
    )
    assert np.isnan(data.ambiguous.sel(x_mm=12.0, y_mm=12.0)).all()
    rows = table(data)
    assert list(rows.columns[:3]) == ["count", "ring_radius_mm", "place_deviation_median_mm"]
    assert len(rows) == 4
    write_netcdf(data, tmp_path / "design.nc")
    with xarray.open_dataset(tmp_path / "design.nc") as kept:
        xarray.testing.assert_equal(kept, data)


def test_gains_by_electrode_are_of_the_electrodes_of_the_scene():
    """Where a design has others, no design has the gains; where all have these, all keep them."""
    six = {"electrodes.count": 6}
    calibrated = RING.with_(**six, **{"readout.gain": {"F": 0.9}, "readout.reading": "total"})
    counts = studied({"electrodes.count": [6, 4]}, scene=calibrated)
    plain = studied({"electrodes.count": [6, 4]}, scene=RING.with_(**{"readout.reading": "total"}))
    assert counts.attrs["dropped"] == "readout.gain"
    np.testing.assert_array_equal(counts.place_deviation_mm, plain.place_deviation_mm)
    moved = studied({"electrodes.ring_radius_mm": [9.0, 11.0]}, scene=calibrated)
    assert "dropped" not in moved.attrs
    assert Scene.parse(moved.scene.values[1]).readout.gain == {"F": 0.9}


def test_equal_ends_of_keys_have_dimensions_of_their_own():
    first, second = "electrodes[0].x_mm", "electrodes[1].x_mm"
    scene = RING.with_(electrodes=[square("A", 9, 0), square("B", -5, 8), square("C", -4, -7)])
    data = studied({first: [8.0, 9.0], second: [-5.0]}, scene=scene, step_mm=6.0)
    assert data.scene.dims == (first, second)


@pytest.mark.parametrize(
    ("vary", "how", "key"),
    [
        ({"electrodes.counts": [4]}, {}, "electrodes.counts"),
        ({"electrodes.count": 4}, {}, "electrodes.count"),
        ({"electrodes.ring_radius_mm": [10.0, 60.0]}, {}, "electrodes"),
        ({"probe.x_mm": [1.0]}, {}, "probe.x_mm"),
        ({"load.force_N": [1.0, 50.0]}, {}, "load.force_N = 50"),
        ({"load.kind": ["dead", "rigid"]}, {}, "load.kind"),
        ({}, {"noise": 0.0}, "noise = 0"),
        ({}, {"noise": -0.1}, "noise = -0.1"),
        ({}, {"noise_pC": math.nan}, "noise_pC = nan"),
        ({}, {"step_mm": 13.0}, "step_mm = 13"),
        ({}, {"reach_mm": 60.0, "step_mm": 5.0}, "reach_mm"),
        ({}, {"scene": Scene()}, "probe"),
    ],
)
def test_mistakes_are_told_by_key_before_any_model(vary, how, key):
    with pytest.raises(ValueError, match=key):
        design(
            how.pop("scene", RING),
            vary,
            how.pop("noise", 0.01),
            model=lambda of: pytest.fail("a model was asked for"),
            **{**LATTICE, **how},
        )

"""Designs: bounds against the scatter of located touches, symmetry, and refusals before models."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from pvdf_fem import Scene, design, locate_many
from pvdf_fem.studies.design import find_best_design
from pvdf_fem.surrogate.touch_domain import choose_default_reach_mm
from tests.helpers.touch_models import bumps

RING = bumps("circle").scene.with_(electrodes={"layout": "ring", "shape": "circle", "radius_mm": 1})


def studied(vary, sigma=0.01, scene=RING, **how):
    """A study with made-up charges, for which nothing is solved."""
    usual = {"reach_mm": 12.0, "step_mm": 6.0, "progress": lambda done, of: None}
    usual["response"] = lambda of: bumps("circle").for_scene(of)
    return design(scene, vary, sigma, **{**usual, **how})


def square(name, x_mm, y_mm):
    return {"name": name, "shape": "square", "side_mm": 1.0, "x_mm": x_mm, "y_mm": y_mm}


def test_located_touches_scatter_by_the_bound():
    """By the noise of changes, of which squares of 3 mm have 48 pC less than of charges."""
    scene = RING.with_(**{"electrodes.count": 6, "readout.reading": "change"})
    data = studied({}, 0.003, scene, noise_pC=2.0, step_mm=None)
    model = replace(bumps("circle").for_scene(scene), error_bound=0.0)
    rng, count = np.random.default_rng(1), 3000
    for x, y in ((3.0, 0.0), (-3.0, 6.0)):
        changes = model.evaluate(np.array([[x, y, 0.0, 1.0]]))[0] - 48.0 * math.pi / 9.0
        sigma = np.hypot(0.003 * changes, 2.0)
        readings = changes + sigma * rng.standard_normal((count, changes.size))
        turns = np.zeros(count)
        found = locate_many(model, readings, 0.003, noise_pC=2.0, rotations_deg=turns)
        scatter = math.sqrt(np.square(found.values[:, :2] - (x, y)).sum(axis=1).mean())
        of_force = math.sqrt(np.square(found.values[:, 3] - 1.0).mean())
        place = data.sel(x_mm=x, y_mm=y)
        assert scatter == pytest.approx(float(place.place_deviation_mm), rel=0.05)
        assert of_force == pytest.approx(float(place.force_deviation), rel=0.05)


def test_mirror_images_in_a_line_of_electrodes_are_ambiguous():
    """What stands on a line does not tell its two sides apart; one electrode beside it does."""
    line = [square(name, x, 0.0) for name, x in zip("ABCD", (-10, -4, 3, 9), strict=True)]
    data = studied({"electrodes": [line, [*line, square("E", 1.0, 9.0)]]}, 0.001)
    off = data.ambiguous.where(np.abs(data.y_mm) > 2.0)
    assert float(off.isel(electrodes=0).min()) == 1.0
    assert float(off.isel(electrodes=1).max()) == 0.0
    assert data.ambiguous_share[0] > 0.6 > 0.2 > data.ambiguous_share[1]


def test_one_model_serves_all_designs_whose_films_deform_alike():
    """The smallest film decides how far touches reach."""
    asked = []

    def model_of(scene):
        asked.append(scene.film.radius_mm)
        return bumps("circle").for_scene(scene)

    vary = {"film.radius_mm": [18.0, 45.0], "electrodes.count": [4, 6], "load.force_N": [0.5, 1]}
    data = studied(vary, response=model_of, reach_mm=None)
    assert asked == [18.0, 45.0]
    assert (
        data.attrs["reach_mm"]
        == choose_default_reach_mm(RING.with_(**{"film.radius_mm": 18.0}))
        < 12.0
    )
    assert data.place_deviation_mm.dims == ("radius_mm", "count", "force_N", "y_mm", "x_mm")


def test_the_best_design_has_the_least_deviation_of_those_that_are_not_ambiguous():
    data = studied({"electrodes.count": [4, 6], "electrodes.ring_radius_mm": [6.0, 14.0]})
    assert np.isnan(data.ambiguous.sel(x_mm=12.0, y_mm=12.0)).all()
    assert np.isfinite(data.place_deviation_mm.sel(x_mm=12.0, y_mm=0.0)).all()
    places = ["x_mm", "y_mm"]
    medians, worst = data.place_deviation_mm.median(places), data.force_deviation.max(places)
    np.testing.assert_array_equal(medians, data.place_deviation_median_mm)
    np.testing.assert_array_equal(worst, data.force_deviation_worst)
    few = medians.where(data.ambiguous_share <= 0.05)
    assert 0 < few.count() < few.size
    assert float(find_best_design(data).place_deviation_median_mm) == few.min()
    assert float(find_best_design(data, 1.0).place_deviation_median_mm) == medians.min()
    near = data.sel(ring_radius_mm=6.0)
    assert float(find_best_design(near, 0.0).ambiguous_share) == near.ambiguous_share.min()


def test_gains_by_electrode_are_of_the_electrodes_of_the_scene():
    """Where a design has others, no design has the gains; where all have these, all keep them."""
    total = {"readout.reading": "total", "electrodes.count": 6}
    plain, calibrated = RING.with_(**total), RING.with_(**total, **{"readout.gain": {"F": 0.9}})
    found, expected = (
        studied({"electrodes.count": [6, 4], "load.force_N": [1.0]}, scene=scene)
        for scene in (calibrated, plain)
    )
    assert found.attrs["dropped"] == "readout.gain"
    np.testing.assert_array_equal(found.place_deviation_mm, expected.place_deviation_mm)
    moved = studied({"electrodes.ring_radius_mm": [9.0, 11.0]}, scene=calibrated)
    assert "dropped" not in moved.attrs
    assert Scene.parse(moved.scene.values[1]).readout.gain == {"F": 0.9}


@pytest.mark.parametrize(
    ("vary", "how", "key"),
    [
        ({"electrodes.ring_radius_mm": [10.0, 60.0]}, {}, "electrodes"),
        ({"probe.x_mm": [1.0]}, {}, "probe.x_mm"),
        ({"load.force_N": [1.0, 50.0]}, {}, "load.force_N = 50"),
        ({"load.kind": ["dead", "rigid"]}, {}, "load.kind"),
        ({}, {"sigma": -0.1, "noise_pC": math.nan}, "noise_pC = nan"),
        ({}, {"scene": Scene()}, "probe"),
    ],
)
def test_mistakes_are_told_by_key_before_any_model(vary, how, key):
    with pytest.raises(ValueError, match=key):
        studied(vary, **{"response": lambda of: pytest.fail("a model was asked for"), **how})

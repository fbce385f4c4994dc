"""Designs: bounds against the scatter of located touches, symmetry, and errors before any solve."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from pvdf_fem import Scene, design, locate_many
from pvdf_fem.studies.design import find_best_design
from pvdf_fem.surrogate.touch_domain import choose_default_reach_mm
from tests.helpers.bump_response import make_bump_response

RING = make_bump_response("circle").scene.with_(
    electrodes={"layout": "ring", "shape": "circle", "radius_mm": 1}
)


def run_study(vary, sigma=0.01, scene=RING, **options):
    """Run a study with made-up charges, for which nothing is solved."""
    defaults = {
        "reach_mm": 12.0,
        "step_mm": 6.0,
        "progress": False,
        "response": lambda design_scene: make_bump_response("circle").for_scene(design_scene),
    }
    return design(scene, vary, sigma, **{**defaults, **options})


def make_square(name, x_mm, y_mm):
    """Make the table of a square electrode."""
    return {"name": name, "shape": "square", "side_mm": 1.0, "x_mm": x_mm, "y_mm": y_mm}


def test_located_touches_scatter_by_the_bound():
    """Noise is relative to changes; unloaded squares of 3 mm have 48 pC."""
    scene = RING.with_(**{"electrodes.count": 6, "readout.reading": "change"})
    data = run_study({}, 0.003, scene, noise_pC=2.0, step_mm=None)
    response = replace(make_bump_response("circle").for_scene(scene), error_bound=0.0)
    rng = np.random.default_rng(1)
    count = 3000
    for x_mm, y_mm in ((3.0, 0.0), (-3.0, 6.0)):
        charges_pC = response.evaluate(np.array([[x_mm, y_mm, 0.0, 1.0]]))[0]
        changes_pC = charges_pC - 48.0 * math.pi / 9.0
        deviations_pC = np.hypot(0.003 * changes_pC, 2.0)
        readings = changes_pC + deviations_pC * rng.standard_normal((count, changes_pC.size))
        rotations = np.zeros(count)
        result = locate_many(
            response, readings, 0.003, noise_pC=2.0, unit="pC", rotations_deg=rotations
        )
        squared_distances = np.square(result.values[:, :2] - (x_mm, y_mm)).sum(axis=1)
        scatter_mm = math.sqrt(squared_distances.mean())
        force_scatter = math.sqrt(np.square(result.values[:, 3] - 1.0).mean())
        place = data.sel(x_mm=x_mm, y_mm=y_mm)
        assert scatter_mm == pytest.approx(float(place.place_deviation_mm), rel=0.05)
        assert force_scatter == pytest.approx(float(place.force_deviation), rel=0.05)


def test_mirror_images_in_a_line_of_electrodes_are_ambiguous():
    """Electrodes on a line do not separate its two sides; one electrode beside it does."""
    line = [make_square(name, x, 0.0) for name, x in zip("ABCD", (-10, -4, 3, 9), strict=True)]
    layouts = [line, [*line, make_square("E", 1.0, 9.0)]]
    data = run_study({"electrodes": layouts}, 0.001)
    off_line = data.ambiguous.where(np.abs(data.y_mm) > 2.0)
    assert float(off_line.isel(electrodes=0).min()) == 1.0
    assert float(off_line.isel(electrodes=1).max()) == 0.0
    assert data.ambiguous_share[0] > 0.6
    assert data.ambiguous_share[1] < 0.2


def test_designs_whose_films_deform_alike_share_a_response():
    """The smallest film decides how far touches reach."""
    radii_mm = []

    def make_response(scene):
        radii_mm.append(scene.film.radius_mm)
        return make_bump_response("circle").for_scene(scene)

    vary = {"film.radius_mm": [18.0, 45.0], "electrodes.count": [4, 6], "load.force_N": [0.5, 1]}
    data = run_study(vary, response=make_response, reach_mm=None)
    assert radii_mm == [18.0, 45.0]
    smallest = RING.with_(**{"film.radius_mm": 18.0})
    assert data.attrs["reach_mm"] == choose_default_reach_mm(smallest) < 12.0
    assert data.place_deviation_mm.dims == ("radius_mm", "count", "force_N", "y_mm", "x_mm")


def test_the_best_design_has_the_least_deviation_of_those_that_are_not_ambiguous():
    data = run_study({"electrodes.count": [4, 6], "electrodes.ring_radius_mm": [6.0, 14.0]})
    assert np.isnan(data.ambiguous.sel(x_mm=12.0, y_mm=12.0)).all()
    assert np.isfinite(data.place_deviation_mm.sel(x_mm=12.0, y_mm=0.0)).all()
    places = ["x_mm", "y_mm"]
    medians = data.place_deviation_mm.median(places)
    worst = data.force_deviation.max(places)
    np.testing.assert_array_equal(medians, data.place_deviation_median_mm)
    np.testing.assert_array_equal(worst, data.force_deviation_worst)
    unambiguous = medians.where(data.ambiguous_share <= 0.05)
    assert 0 < unambiguous.count() < unambiguous.size
    best = find_best_design(data)
    assert float(best.place_deviation_median_mm) == unambiguous.min()
    best_of_all = find_best_design(data, 1.0)
    assert float(best_of_all.place_deviation_median_mm) == medians.min()
    near = data.sel(ring_radius_mm=6.0)
    assert float(find_best_design(near, 0.0).ambiguous_share) == near.ambiguous_share.min()


def test_gains_by_electrode_are_dropped_only_if_electrodes_change():
    """If a design has other electrodes, all have default gains; else all keep the scene's."""
    total = {"readout.reading": "total", "electrodes.count": 6}
    plain = RING.with_(**total)
    calibrated = RING.with_(**total, **{"readout.gain": {"F": 0.9}})
    vary = {"electrodes.count": [6, 4], "load.force_N": [1.0]}
    result = run_study(vary, scene=calibrated)
    expected = run_study(vary, scene=plain)
    assert result.attrs["dropped"] == "readout.gain"
    np.testing.assert_array_equal(result.place_deviation_mm, expected.place_deviation_mm)
    moved = run_study({"electrodes.ring_radius_mm": [9.0, 11.0]}, scene=calibrated)
    assert "dropped" not in moved.attrs
    assert Scene.parse(moved.scene.values[1]).readout.gain == {"F": 0.9}


@pytest.mark.parametrize(
    ("vary", "options", "key"),
    [
        ({"electrodes.ring_radius_mm": [10.0, 60.0]}, {}, "electrodes"),
        ({"probe.x_mm": [1.0]}, {}, "probe.x_mm"),
        ({"load.force_N": [1.0, 50.0]}, {}, "load.force_N = 50"),
        ({"load.kind": ["dead", "rigid"]}, {}, "load.kind"),
        ({}, {"sigma": -0.1, "noise_pC": math.nan}, "noise_pC = nan"),
        ({}, {"scene": Scene()}, "probe"),
    ],
)
def test_errors_name_their_key_before_any_response_is_built(vary, options, key):
    def make_response(scene):
        pytest.fail("a response was built")

    with pytest.raises(ValueError, match=key):
        run_study(vary, response=make_response, **options)

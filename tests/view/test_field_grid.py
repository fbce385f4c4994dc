"""Fields on a grid: those at points, NaN off the film, components with names."""

import numpy as np
import pytest

from pvdf_fem import Scene, solve

SCENE = Scene().with_(**{"film.radius_mm": 12.0, "electrodes.ring_radius_mm": 6.0})
SCENE = SCENE.with_(**{"probe.shape": "circle", "probe.x_mm": 2.0, "numerics.tolerance": 0.02})


@pytest.fixture(scope="module")
def solution():
    return solve(SCENE)


def test_the_dataset_has_the_fields_at_the_grid_points(solution):
    fields = solution.to_xarray(step_mm=2.0)
    assert dict(fields.sizes)["x_mm"] == dict(fields.sizes)["y_mm"] == 13
    radius = np.hypot(fields.x_mm, fields.y_mm)
    off_film = fields.deflection_mm.isnull().transpose(*radius.dims)
    assert (off_film == (radius > 12.0 * (1.0 + 1e-9))).all()
    here, there = {"x_mm": 4.0, "y_mm": -2.0}, solution.at(4.0, -2.0)
    one = fields.sel(**here)
    found = [
        *(one.deflection_mm, one.displacement_mm.sel(direction="w"), one.charge_density_pC_mm2),
        *(one.stress_MPa.sel(stress_component="S12"), one.strain.sel(strain_component="2 E12")),
    ]
    expected = [there.deflection_mm, there.deflection_mm, there.charge_density_pC_mm2]
    expected += [there.stress_MPa[2], there.strain[2]]
    np.testing.assert_allclose([value.item() for value in found], expected, rtol=1e-9)
    assert Scene.parse(fields.attrs["scene"]) == SCENE
    with pytest.raises(ValueError, match="step_mm"):  # more points than memory has
        solution.to_xarray(1e-6)


def test_slopes_are_derivatives_of_the_deflection(solution):
    step = 1e-3
    for axis in range(2):
        ahead, behind = (3.0 + s * step * np.eye(2)[axis] for s in (1.0, -1.0))
        rise = solution.at(*ahead).deflection_mm - solution.at(*behind).deflection_mm
        slope = solution.at(3.0, 3.0).slopes[axis]
        assert slope == pytest.approx(rise / (2.0 * step), rel=1e-4, abs=1e-9)

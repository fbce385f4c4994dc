"""Pressure profiles: their total, their moments, files and functions that say the same."""

import numpy as np
import pytest
import xarray

from pvdf_fem import Scene, SceneError, solve
from pvdf_fem.film.equilibrium import Equilibrium
from tests.helpers.discs import graded_mesh

DISC = {"shape": "circle", "radius_mm": 4.0, "x_mm": 5.0, "y_mm": 1.0}
ELLIPSE = {**DISC, "shape": "ellipse", "semi_axes_mm": [4.0, 2.0], "rotation_deg": 30.0}
ELLIPSE.pop("radius_mm")
SCENE = Scene().with_(probe=DISC)


def moments(scene):
    """Total force in N, its centre and its mean square distance from there in mm, mm²."""
    equilibrium = Equilibrium(scene, graded_mesh(scene, 0.5, 10.0), 2)
    (load,) = equilibrium.loads
    x = equilibrium.space.basis.doflocs * 1e3
    forces = load.forces(equilibrium.state(np.zeros(equilibrium.unknowns.count)))[2::3]
    centre = x @ forces / forces.sum()
    square = ((x - centre[:, None]) ** 2).sum(axis=0)
    return forces.sum(), centre, square @ forces / forces.sum()


@pytest.mark.parametrize(
    ("probe", "profile", "square"),
    [
        (DISC, "uniform", 16.0 / 2.0),
        (DISC, "hertz", 16.0 * 2.0 / 5.0),
        (ELLIPSE, "hertz", (16.0 + 4.0) / 5.0),
        (DISC, "gaussian", 16.0 * (0.5 - np.exp(-2.0) / (1.0 - np.exp(-2.0)))),
    ],
)
def test_moments_are_the_exact_ones(probe, profile, square):
    force, centre, found = moments(SCENE.with_(probe=probe, **{"load.profile": profile}))
    assert force == pytest.approx(1.0, rel=1e-12)
    assert centre == pytest.approx([5.0, 1.0], rel=1e-4)
    assert found == pytest.approx(square, rel=1e-4)


def bilinear(x_mm, y_mm):
    """A pressure that a grid of any size holds exactly."""
    return (1.0 + 0.15 * x_mm) * (1.0 - 0.1 * y_mm)


@pytest.fixture(params=["csv", "nc"])
def table(request, tmp_path):
    path = tmp_path / f"p.{request.param}"
    x, y = np.array([-6.0, -1.0, 6.0]), np.array([-5.0, 5.0])
    values = bilinear(x[:, None], y)
    if request.param == "nc":
        data = xarray.Dataset({"pressure": (("y_mm", "x_mm"), values.T)}, {"x_mm": x, "y_mm": y})
        data.to_netcdf(path, engine="scipy")
    else:
        rows = [
            f"{b},{v},{a}"
            for a, r in zip(x, values, strict=True)
            for b, v in zip(y, r, strict=True)
        ]
        path.write_text("\n".join(["y_mm,pressure,x_mm", *rows]))
    return path


def test_a_table_is_the_function_that_it_holds(table):
    scene = SCENE.with_(**{"probe.rotation_deg": 40.0, "numerics.tolerance": 1e-4})
    by_function = solve(scene, pressure=lambda x, y: 3.0 * bilinear(x, y))
    # on a mesh of its own, rounding of the sizes would make other elements
    by_table = solve(scene.with_(**{"load.profile": str(table)}), mesh=by_function.mesh)
    assert by_table.charges_pC == pytest.approx(by_function.charges_pC, rel=1e-9)
    uniform = solve(scene)
    assert by_function.charges_pC["A"] != pytest.approx(uniform.charges_pC["A"], rel=1e-3)
    assert by_function.force_balance < 1e-6


@pytest.mark.parametrize(
    "text",
    [
        "x_mm,y_mm\n0,0",
        "x_mm,y_mm,pressure\n0,0,1\n1,0,1\n0,1,1",
        "x_mm,y_mm,pressure\n0,0,a",
        "",
        None,
        "x_mm,y_mm,pressure\n8,8,1\n9,8,1\n8,9,1\n9,9,1",  # zero under the probe
    ],
)
@pytest.mark.parametrize("name", ["table.csv", "none.nc"])
def test_files_that_hold_no_pressure_are_refused(tmp_path, text, name):
    path = tmp_path / name
    if text is not None:
        path.write_text(text)
    with pytest.raises(SceneError) as refused:
        solve(SCENE.with_(**{"load.profile": str(path)}))
    (line,) = refused.value.problems
    assert line.startswith("load.profile = ")


def test_a_profile_that_is_zero_under_its_probe_is_refused():
    narrow = {"load.profile": "gaussian", "load.profile_width_mm": 1e-3}
    with pytest.raises(SceneError) as refused:
        solve(SCENE.with_(**narrow))
    (line,) = refused.value.problems
    assert line.startswith("load.profile")

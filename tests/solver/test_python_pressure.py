"""Pressures in Python: the solution keeps the pressure, which is no part of its scene."""

import pickle

import meshio
import numpy as np
import pytest

from pvdf_fem import Scene, SceneError, gradients, solve
from pvdf_fem.dynamics.frequency_response import respond
from pvdf_fem.scene.scene_file import quote
from tests.helpers.discs import LOADS
from tests.helpers.refusals import keys, refused

DISC = {"shape": "circle", "radius_mm": 4.0, "x_mm": 5.0, "y_mm": 1.0}
SCENE = Scene().with_(probe=DISC)
COARSE = SCENE.with_(**{"numerics.tolerance": 1e-2})


def ramp(x_mm, y_mm):
    """A pressure that rises along x to the probe's edge."""
    return (4.0 + x_mm) ** 2


@pytest.fixture(scope="module")
def ramped():
    return solve(COARSE, order=2, pressure=ramp)


def test_finer_derivatives_use_the_pressure(ramped):
    derivatives = gradients(ramped, ["load.force_N"], tolerance=2e-4)
    rate, error = (table["load.force_N"]["A"] for table in (derivatives, derivatives.errors))
    forces = (SCENE.with_(**{"load.force_N": f, "numerics.tolerance": 1e-4}) for f in (1.02, 0.98))
    more, less = (solve(scene, pressure=ramp).charges_pC["A"] for scene in forces)
    assert rate == pytest.approx((more - less) / 0.04, rel=4e-4)
    assert error < 2e-4 * rate
    assert abs(rate - gradients(COARSE)["load.force_N"]["A"]) > 1e-2 * rate
    assert derivatives.solution.scene.numerics.tolerance < COARSE.numerics.tolerance
    assert derivatives.solution.pressure is ramp


def test_places_have_no_derivative_and_slow_oscillations_follow_the_force(ramped):
    rates = gradients(ramped)
    assert not any(key.startswith("probe") for key in rates)
    with pytest.raises(ValueError, match=r"probe\.x_mm"):
        gradients(ramped, ["probe.x_mm"])
    slow = respond(ramped, [0.01]).charges_pC_N["A"].real
    assert slow == pytest.approx([rates["load.force_N"]["A"]], rel=1e-6)


def test_the_scene_can_be_pickled_and_the_solution_keeps_its_pressure(ramped, tmp_path):
    assert pickle.loads(pickle.dumps(ramped.scene)) == COARSE
    assert ramped.pressure is ramp
    ramped.to_vtu(tmp_path / "a.vtu")
    written = meshio.read(tmp_path / "a.vtu").field_data["included"].astype(np.uint8)
    for text in (str(ramped), str(ramped.to_json()["included"]), bytes(written).decode()):
        assert "ramp" in text
    plain = solve(COARSE)
    assert plain.pressure is None
    assert "ramp" not in str(plain)


def test_a_function_of_one_number_is_a_uniform_pressure():
    by_number = solve(SCENE, pressure=lambda x, y: 7.0)
    assert by_number.charges_pC == pytest.approx(solve(SCENE).charges_pC, rel=2e-3)


@pytest.mark.parametrize(
    ("scene", "key"),
    [
        (Scene(), "probe"),
        (Scene(probe=[DISC]), "probe"),
        *((SCENE.with_(**LOADS[kind]), "load.kind") for kind in ("follower", "sliding")),
        (SCENE.with_(**{"load.profile": "hertz"}), "load.profile"),
    ],
)
def test_refuses_loads_without_a_pressure_profile_by_key(scene, key, monkeypatch):
    monkeypatch.setattr("pvdf_fem.mesh.gmsh_mesh.gmsh", None)
    assert keys(refused(solve, scene, pressure=ramp)) == [key]


@pytest.mark.parametrize(
    ("pressure", "cause"),
    [
        (lambda x_mm, y_mm: 1.0 if x_mm > 0.0 else 2.0, ValueError),  # of one point only
        (lambda x_mm: x_mm**2, TypeError),
        (lambda x_mm, y_mm: np.ones((2, 3)), None),
        (lambda x_mm, y_mm: x_mm**2 + 1j, None),
        (lambda x_mm, y_mm: x_mm, None),  # negative somewhere
        (lambda x_mm, y_mm: np.where(x_mm > 0.0, np.nan, 1.0), None),
        (3.0, None),
    ],
)
def test_refuses_a_useless_pressure_by_name_before_meshing(pressure, cause, monkeypatch):
    monkeypatch.setattr("pvdf_fem.mesh.gmsh_mesh.gmsh", None)
    with pytest.raises(SceneError) as caught:
        solve(SCENE, pressure=pressure)
    name = quote(getattr(pressure, "__name__", pressure))
    assert caught.value.problems[0].startswith(f"pressure = {name}: ")
    assert type(caught.value.__cause__) is (cause or type(None))

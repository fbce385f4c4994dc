"""Films that are stretched to a given tension, against those that are cooled and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from skfem import Basis, BilinearForm, ElementTriP2, LinearForm, condense
from skfem import solve as solve_linear
from skfem.helpers import dot

from pvdf_fem import Scene, solve
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.scene.film import Film
from pvdf_fem.solution.solve import rest_charges, rest_forces
from pvdf_fem.solvers.status import Status
from tests.helpers.discs import LOADS, TRIANGLE, graded_mesh
from tests.helpers.solvers import newton_result


def values(by_name):
    return np.array(list(by_name.values()))


@given(
    tension=st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3)),
    thickness_um=st.floats(1.0, 500.0),
    moduli=st.tuples(st.floats(0.5, 5.0), st.floats(0.5, 5.0)),
)
def test_the_flat_film_has_the_tension_that_is_given(tension, thickness_um, moduli):
    film = Film(
        pretension_N_m=tension,
        thickness_um=thickness_um,
        youngs_modulus_GPa=moduli,
        poisson_ratio=0.3,
    )
    stress = np.array([*tension, 0.0]) / (1e-6 * thickness_um)
    assert film.stress_at_rest == pytest.approx(stress, rel=1e-15)
    scale = max(np.abs(stress).max(), 1.0)
    assert film.stiffness @ film.strain_at_rest == pytest.approx(stress, abs=1e-14 * scale)
    scene = Scene(film=film)
    if min(tension) < 0.0:  # in compression no membrane is at rest
        return
    charges = 9e-6 * 8e-12 * (stress[0] + stress[1]) * np.ones(4)
    assert rest_charges(scene) == pytest.approx(charges, abs=1e-12 * 9e-6 * 8e-12 * scale)


@pytest.mark.parametrize(
    "film",
    [
        {"film.bending": True},
        {"film.youngs_modulus_GPa": [3.0, 1.5]},
        LOADS["follower"],
        {"film.temperature_change_K": 5.0, "film.compression": "tension-field"},
    ],
)
def test_charges_are_those_of_the_film_that_is_cooled_to_the_same_tension(film):
    cooled = TRIANGLE.with_(**film)
    tight = cooled.with_(
        **{"film.pretension_N_m": (cooled.film.thickness * cooled.film.stress_at_rest[:2]).tolist()}
    )
    assert tight.film.temperature_change_K is None
    expected, found = solve(cooled), solve(tight)
    assert found.status is expected.status
    assert values(found.charges_pC) == pytest.approx(values(expected.charges_pC), rel=1e-12)


@pytest.mark.parametrize(
    ("pair", "status"), [([9.0, 0.0], Status.CONVERGED), ([9.0, -1.0], Status.UNSTABLE)]
)
def test_the_smaller_tension_decides_whether_a_flat_film_is_stable(pair, status):
    scene = TRIANGLE.with_(**{"film.pretension_N_m": pair, "load.force_N": 0.0})
    assert solve(scene).status is status
    # wrinkles along x leave E h times the strain along x, which is (N1 - ν N2)/(E h)
    wrinkled = scene.with_(**{"film.compression": "tension-field"})
    tension = rest_forces(wrinkled).values[0] / 9e-6 * scene.film.thickness
    assert tension == pytest.approx([9.0 - 0.34 * pair[1], 0.0], abs=1e-9)
    assert np.isnan(solve(scene).rest_charges_pC["A"]) == (status is Status.UNSTABLE)


def test_a_film_that_cooling_compresses_in_one_direction_is_unstable():
    """Cooled, E1 + ν12 E2 < 0 pushes along x, however negative the free strain is."""
    film = {"film.youngs_modulus_GPa": [1.0, 10.0], "film.poisson_ratio": -0.3}
    scene = TRIANGLE.with_(**film, **{"load.force_N": 0.0})
    assert scene.film.stress_at_rest[0] < 0.0 < scene.film.stress_at_rest[1]
    assert solve(scene).status is Status.UNSTABLE


def test_a_patch_on_a_tight_film_is_that_of_poissons_equation():
    """N_x w,xx + N_y w,yy = -p by scikit-fem's own elements, at all vertices."""
    probe = {"shape": "rectangle", "x_mm": 18.0, "y_mm": 9.0}
    scene = Scene().with_(probe=probe, **{"film.pretension_N_m": [12.0, 5.0], "load.force_N": 1e-6})
    film = Equilibrium(scene, graded_mesh(scene, 2.0, 8.0), 2)
    found = film.unknowns.expand(newton_result(film).q)[2::3][film.space.basis.nodal_dofs[0]]
    basis, tensions = Basis(film.space.mesh, ElementTriP2()), np.array([[[12.0]], [[5.0]]])
    form = BilinearForm(lambda w, v, _: dot(tensions * w.grad, v.grad)).assemble(basis)
    patch = basis.with_elements(film.space.mesh.subdomains["probe"])
    load = LinearForm(lambda v, _: 1e-6 / 98e-6 * v).assemble(patch)
    expected = solve_linear(*condense(form, load, D=basis.get_dofs()))[basis.nodal_dofs[0]]
    assert found == pytest.approx(expected, abs=1e-6 * found.max())

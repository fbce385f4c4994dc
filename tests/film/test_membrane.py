"""The membrane's kernel against its forms and against automatic differentiation; exact states."""

from __future__ import annotations

import numpy as np
import pytest
from skfem import BilinearForm

from pvdf_fem import Scene
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.membrane import Membrane, tensile_part
from pvdf_fem.film.space import Space
from pvdf_fem.film.unknowns import Assembly, Unknowns
from pvdf_fem.film.weak_form import residual_form, tangent_form, vector_basis
from pvdf_fem.scene.film import Film
from tests.helpers.discs import LOADS, graded_mesh

COLD = {"temperature_change_K": -20.0}
MODULI = {"youngs_modulus_GPa": (3.0, 1.5), "poisson_ratio": 0.4, "shear_modulus_GPa": 0.3}
FILMS = {
    "isotropic": Film(**COLD),
    "orthotropic": Film(**MODULI, **COLD),
    "unequal tensions": Film(youngs_modulus_GPa=(3.0, 1.5), pretension_N_m=(220.0, 90.0)),
}
# A straight edge, a curved one and a corner in few elements.
SCENE = Scene().with_(
    electrodes={"side_mm": 8.0}, probe={"shape": "circle", "radius_mm": 12.0, "x_mm": 8.0}
)


@pytest.fixture(scope="module")
def mesh():
    return graded_mesh(SCENE, 8.0, 20.0)


def displacements(space):
    """Random dofs in m, of slopes about 0.3: all of the equations' terms matter."""
    size = np.sqrt(np.median(space.weights.sum(axis=1))) / space.order
    return 0.3 * size * np.random.default_rng(7).uniform(-1.0, 1.0, space.dof_count)


def assembled(space, matrices):
    every_dof = Unknowns(space.dof_count, np.empty(0, dtype=np.int64))
    return Assembly(space, every_dof).matrix(matrices)


def assert_close(found, expected, exact=1e-14):
    assert abs(found - expected).max() <= exact * abs(expected).max()


@pytest.mark.parametrize("film", FILMS.values(), ids=FILMS.keys())
@pytest.mark.parametrize("order", [1, 2, 3])
def test_kernel_equals_the_forms(mesh, order, film):
    space = Space(mesh, order)
    membrane, x, basis = Membrane(space, film), displacements(space), vector_basis(space)
    state, field = membrane.state(x), {"displacement": basis.interpolate(x)}
    assert_close(membrane.internal_forces(state), residual_form(film).assemble(basis, **field))
    kernel = assembled(space, membrane.tangent_matrices(state))
    assert_close(kernel, tangent_form(film).assemble(basis, **field))
    laplace = BilinearForm(lambda u, v, _: np.einsum("ia...,ia...", u.grad, v.grad))
    assert_close(assembled(space, space.laplace()), laplace.assemble(basis))


def test_kernel_is_the_derivative_that_jax_makes_of_the_energy(mesh):
    """Of the potential alone, by reverse and forward differentiation."""
    pytest.importorskip("jax")
    from skfem.autodiff import NonlinearForm

    film, space = FILMS["orthotropic"], Space(mesh, 2)

    @NonlinearForm(hessian=True)
    def energy(u, _):
        F = [[u.grad[i, j] + float(i == j) for j in (0, 1)] for i in range(3)]
        C = [[sum(row[a] * row[b] for row in F) for a in (0, 1)] for b in (0, 1)]
        E = [0.5 * (C[0][0] - 1.0), 0.5 * (C[1][1] - 1.0), C[0][1]]
        E = [e + e0 for e, e0 in zip(E, film.strain_at_rest, strict=True)]
        pairs = [(i, j) for i in range(3) for j in range(3)]
        return 0.5 * film.thickness * sum(film.stiffness[i, j] * E[i] * E[j] for i, j in pairs)

    membrane, x = Membrane(space, film), displacements(space)
    tangent, forces = energy.assemble(vector_basis(space), x=x)
    state = membrane.state(x)
    assert_close(-forces, membrane.internal_forces(state), 1e-12)
    assert_close(tangent, assembled(space, membrane.tangent_matrices(state)), 1e-12)


def test_punch_moves_as_one_and_sticks_only_when_told(mesh):
    for kind, slides in (("sliding", True), ("stuck", False)):
        problem = Equilibrium(SCENE.with_(**LOADS[kind]), mesh)
        q = displacements(problem.space)[: problem.unknowns.count]
        x = problem.unknowns.expand(q).reshape(-1, 3)
        nodes = np.unique(problem.space.basis.element_dofs[:, mesh.subdomains["probe"]])
        assert np.ptp(x[nodes, 2]) == 0
        assert x[nodes, 2].max() == q[-1]
        assert bool(x[nodes, :2].any()) is slides
        assert not x[problem.space.basis.get_dofs("rim").all()].any()
        assert len(np.unique(x)) == problem.unknowns.count + 1  # and nothing else is tied
        assert problem.unknowns.restrict(x.ravel()) == pytest.approx(q, rel=1e-13)


@pytest.mark.parametrize("order", [2, 3])
def test_homogeneous_strain_of_an_orthotropic_film(mesh, order):
    """Uniaxial stretch and shear, stress by hand from the compliance of the film."""
    membrane = Membrane(Space(mesh, order), FILMS["orthotropic"])
    G = np.array([[0.02, 0.01], [0.03, -0.01], [0.1, -0.2]])
    state = membrane.state((membrane.space.basis.doflocs.T @ G.T).ravel())
    F = np.eye(3, 2) + G
    E = 0.5 * (F.T @ F - np.eye(2))
    compliance = np.array([[1 / 3, -0.4 / 3, 0], [-0.4 / 3, 1 / 1.5, 0], [0, 0, 1 / 0.3]]) / 1e9
    elastic = [E[0, 0] + 110e-6 * 20, E[1, 1] + 110e-6 * 20, 2 * E[0, 1]]
    expected = np.linalg.solve(compliance, elastic)
    assert np.abs(state.stress - expected).max() < 1e-10 * np.abs(expected).max()
    energy = 0.5 * 25e-6 * membrane.space.weights.sum() * expected @ elastic
    assert membrane.energy(state) == pytest.approx(energy, rel=1e-11)


def test_the_tensile_part_has_the_positive_principal_stresses():
    """Of film in tension, in compression along a direction, along all, and without shear."""
    stress = np.random.default_rng(3).normal(size=(200, 3))
    stress[:50, :2] -= 3.0
    stress[-2:] = [[-1.0, -1.0, 0.0], [2.0, 2.0, 0.0]]
    values, vectors = np.linalg.eigh(stress[:, [[0, 2], [2, 1]]])
    assert {tuple(signs) for signs in values > 0.0} == {(False, False), (False, True), (True, True)}
    positive = np.einsum("nik,nk,njk->nij", vectors, np.maximum(values, 0.0), vectors)
    expected = positive.reshape(-1, 4)[:, [0, 3, 1]]
    np.testing.assert_allclose(tensile_part(stress), expected, atol=1e-12)

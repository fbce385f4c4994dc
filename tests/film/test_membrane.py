"""The membrane's kernel against its forms, its energy and itself; loads and constraints with it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.polynomial import polynomial
from skfem import BilinearForm

from pvdf_fem import Scene
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.membrane import Membrane, tensile_part
from pvdf_fem.film.space import Space
from pvdf_fem.film.weak_form import residual_form, tangent_form, vector_basis
from pvdf_fem.scene.film import Film
from tests.helpers.discs import LOADS, graded_mesh

FILMS = {
    "isotropic": Film(temperature_change_K=-20.0),
    "orthotropic": Film(
        youngs_modulus_GPa=(3.0, 1.5),
        poisson_ratio=0.4,
        shear_modulus_GPa=0.3,
        temperature_change_K=-20.0,
    ),
    "unequal tensions": Film(youngs_modulus_GPa=(3.0, 1.5), pretension_N_m=(220.0, 90.0)),
}
# A straight edge, a curved one and a corner in few elements.
SCENE = Scene.parse(
    """
    [electrodes]
    side_mm = 8.0
    [probe]
    shape = "circle"
    radius_mm = 12.0
    x_mm = 8.0
    """
)
SLOPE = 0.3


@pytest.fixture(scope="module")
def mesh():
    return graded_mesh(SCENE, 8.0, 20.0)


def displacements(membrane, count=1, seed=7):
    """Random dofs in m, of slopes about `SLOPE`: all of the equations' terms matter."""
    random = np.random.default_rng(seed)
    size = math.sqrt(np.median(membrane.space.weights.sum(axis=1))) / membrane.space.order
    return SLOPE * size * random.uniform(-1, 1, (count, membrane.space.dof_count))


def assembled_matrix(membrane, matrices):
    total = np.zeros((membrane.space.dof_count, membrane.space.dof_count))
    rows, columns = np.broadcast_arrays(
        membrane.space.element_dofs[:, :, None], membrane.space.element_dofs[:, None, :]
    )
    np.add.at(total, (rows, columns), matrices)
    return total


@pytest.mark.parametrize("film", FILMS.values(), ids=FILMS.keys())
@pytest.mark.parametrize("order", [1, 2, 3])
def test_kernel_equals_the_forms(mesh, order, film):
    membrane = Membrane(Space(mesh, order), film)
    (x,) = displacements(membrane)
    state = membrane.state(x)
    basis = vector_basis(membrane.space)
    field = basis.interpolate(x)
    residual = residual_form(film).assemble(basis, displacement=field)
    tangent = tangent_form(film).assemble(basis, displacement=field).toarray()
    for kernel, form in (
        (membrane.internal_forces(state), residual),
        (assembled_matrix(membrane, membrane.tangent_matrices(state)), tangent),
    ):
        assert np.abs(kernel - form).max() <= 1e-14 * np.abs(form).max()


@pytest.mark.parametrize("order", [1, 2, 3])
def test_laplace_equals_its_form(mesh, order):
    membrane = Membrane(Space(mesh, order), FILMS["isotropic"])
    form = BilinearForm(lambda u, v, _: np.einsum("ia...,ia...", u.grad, v.grad))
    expected = form.assemble(vector_basis(membrane.space)).toarray()
    kernel = assembled_matrix(membrane, membrane.space.laplace())
    assert np.abs(kernel - expected).max() <= 1e-14 * np.abs(expected).max()


@pytest.mark.parametrize("film", FILMS.values(), ids=FILMS.keys())
@pytest.mark.parametrize("order", [1, 2, 3])
def test_residual_is_the_derivative_of_the_energy(mesh, order, film):
    """The energy is a quartic along a line, where the five-point difference is exact."""
    membrane = Membrane(Space(mesh, order), film)
    x, d = displacements(membrane, 2)
    energy = {s: membrane.energy(membrane.state(x + s * d)) for s in (-2, -1, 1, 2)}
    difference = (energy[-2] - 8 * energy[-1] + 8 * energy[1] - energy[2]) / 12
    residual = membrane.internal_forces(membrane.state(x))
    assert residual @ d == pytest.approx(difference, abs=1e-12 * max(energy.values()))


@pytest.mark.parametrize("film", FILMS.values(), ids=FILMS.keys())
def test_energy_along_a_line_is_the_quartic(mesh, film):
    membrane = Membrane(Space(mesh, 2), film)
    x, d = displacements(membrane, 2)
    quartic = membrane.along(membrane.state(x), d)
    s = np.array([-1.5, -0.2, 0.0, 0.7, 2.0, 3.0])
    energy = [membrane.energy(membrane.state(x + length * d)) for length in s]
    assert polynomial.polyval(s, quartic) == pytest.approx(energy, rel=1e-12)


# loads and constraints


def loaded(mesh, changes, order=2):
    """A problem in which the probe's forces are as large as the film's, with random states."""
    problem = Equilibrium(SCENE.with_(**{"load.force_N": 2e3}, **changes), mesh, order)
    x = displacements(problem.membrane, 2)
    return problem, *x[:, : problem.unknowns.count]


@pytest.mark.parametrize("changes", LOADS.values(), ids=LOADS.keys())
def test_taylor_remainder_of_the_residual_is_of_second_order(mesh, changes):
    problem, q, d = loaded(mesh, changes)
    state = problem.state(q)
    residual, slope = problem.residual(state), problem.tangent(state) @ d
    remainders = [
        np.linalg.norm(problem.residual(problem.state(q + s * d)) - residual - s * slope)
        for s in 0.05 * 0.5 ** np.arange(6)
    ]
    assert remainders[0] > 1e-4 * np.linalg.norm(residual)
    assert np.diff(np.log2(remainders)) == pytest.approx(-2, abs=0.1)


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("changes", LOADS.values(), ids=LOADS.keys())
def test_tangent_is_the_derivative_of_the_residual(mesh, changes, order):
    """The residual is a cubic along a line, where the five-point difference is exact."""
    problem, q, d = loaded(mesh, changes, order)
    residual = {s: problem.residual(problem.state(q + s * d)) for s in (-2, -1, 1, 2)}
    difference = (residual[-2] - 8 * residual[-1] + 8 * residual[1] - residual[2]) / 12
    derivative = problem.tangent(problem.state(q)) @ d
    assert np.abs(derivative - difference).max() <= 1e-11 * np.abs(difference).max()


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_action_and_diagonal_are_those_of_the_tangent(mesh, order):
    problem, q, d = loaded(mesh, {}, order)
    state, membrane = problem.state(q), problem.membrane
    tangent, step = membrane.tangent_matrices(state), problem.unknowns.expand(d)
    product = np.matmul(tangent, step[membrane.space.element_dofs][..., None])[..., 0]
    action = membrane.element_action(state, step)
    assert np.abs(action - product).max() <= 1e-13 * np.abs(product).max()
    diagonal = membrane.element_diagonal(state)
    assert np.abs(diagonal / np.einsum("eii->ei", tangent) - 1.0).max() < 1e-10


@pytest.mark.parametrize("changes", [LOADS["dead"], LOADS["sliding"], LOADS["stuck"]])
def test_energy_along_a_step_has_the_residual_as_its_slope(mesh, changes):
    problem, q, d = loaded(mesh, changes)
    state = problem.state(q)

    def potential(s):
        x = problem.unknowns.expand(q + s * d)
        work = problem.load_forces(state) @ x
        return problem.membrane.energy(problem.membrane.state(x)) - work

    quartic = problem.energy_along(state, d, float(problem.residual(state) @ d))
    s = np.array([-1.0, 0.5, 2.0])
    changes_of_energy = [potential(length) - potential(0) for length in s]
    values = polynomial.polyval(s, quartic) - quartic[0]
    assert values == pytest.approx(changes_of_energy, rel=1e-11)


@pytest.mark.parametrize("kind", ["dead", "sliding", "stuck", "follower"])
def test_flat_film_bears_the_whole_force_along_z(mesh, kind):
    """Pressure of any kind integrates to F on the flat film, about the probe's centroid."""
    problem, q, _ = loaded(mesh, LOADS[kind])
    total = problem.load_forces(problem.state(0 * q)).reshape(-1, 3)
    assert total.sum(axis=0) == pytest.approx([0, 0, 2e3], rel=1e-12, abs=1e-9)
    x, y = problem.membrane.space.basis.doflocs
    # to the accuracy of the curved outline
    assert [x @ total[:, 2] / 2e3, y @ total[:, 2] / 2e3] == pytest.approx([8e-3, 0], abs=1e-6)


def test_follower_force_is_the_pressure_on_the_turned_film(mesh):
    """A film turned about y by t: the force turns with it and keeps its size."""
    problem, _, _ = loaded(mesh, LOADS["follower"])
    x = turned(problem.membrane, 0.4)
    state = problem.membrane.state(x)
    total = problem.load_forces(state).reshape(-1, 3).sum(axis=0)
    expected = 2e3 * np.array([math.sin(0.4), 0, math.cos(0.4)])
    assert total == pytest.approx(expected, rel=1e-12, abs=1e-9)


def test_punch_moves_as_one_and_sticks_only_when_told(mesh):
    for kind, in_plane_is_free in (("sliding", True), ("stuck", False)):
        problem, q, _ = loaded(mesh, LOADS[kind])
        x = problem.unknowns.expand(q).reshape(-1, 3)
        nodes = np.unique(problem.membrane.space.basis.element_dofs[:, mesh.subdomains["probe"]])
        assert np.ptp(x[nodes, 2]) == 0
        assert x[nodes, 2].max() == q[-1]
        assert bool(x[nodes, :2].any()) is in_plane_is_free
        rim = problem.membrane.space.basis.get_dofs("rim").all()
        assert not x[rim].any()
        assert len(np.unique(x)) == problem.unknowns.count + 1  # and nothing else is tied
        assert problem.unknowns.restrict(x.ravel()) == pytest.approx(q, rel=1e-13)


# exact states


def turned(membrane, angle):
    """Dofs of the whole film turned about the y axis."""
    x = membrane.space.basis.doflocs[0]
    shift = np.stack([(math.cos(angle) - 1) * x, 0 * x, -math.sin(angle) * x], axis=-1)
    return shift.ravel()


@pytest.mark.parametrize("order", [2, 3])
def test_rigid_motions_do_not_strain(mesh, order):
    """Also on the curved elements: order 2 is isoparametric."""
    membrane = Membrane(Space(mesh, order), FILMS["orthotropic"])
    x, y = membrane.space.basis.doflocs
    place = np.stack([x, y, 0 * x], axis=-1)
    random = np.random.default_rng(3)
    rotation, _ = np.linalg.qr(random.normal(size=(3, 3)))
    rotation *= np.linalg.det(rotation)
    motion = place @ rotation.T + [0.01, -0.02, 0.03] - place
    state = membrane.state(motion.ravel())
    assert np.abs(state.strain).max() < 1e-12
    assert np.abs(motion).max() > 0.05


@pytest.mark.parametrize("order", [1, 2, 3])
def test_clamped_cold_film_is_evenly_tense(mesh, order):
    """N0 = E h alpha |dT|/(1 - nu), 8.33 N/m for -1 K, and no force on any free dof."""
    problem = Equilibrium(SCENE.with_(probe=None), mesh, order)
    flat = problem.state(np.zeros(problem.unknowns.count))
    tension = problem.film.thickness * flat.stress
    N0 = 2e9 * 25e-6 * 110e-6 / (1 - 0.34)
    assert pytest.approx(8.33, abs=5e-3) == N0
    assert tension[..., :2] == pytest.approx(N0, rel=1e-13)
    assert np.abs(tension[..., 2]).max() < 1e-13 * N0
    assert np.abs(problem.residual(flat)).max() < 1e-12 * N0 * 5e-3


@pytest.mark.parametrize("order", [2, 3])
def test_homogeneous_strain_of_an_orthotropic_film(mesh, order):
    """Uniaxial stretch and shear, stress by hand from the compliance of the film."""
    film = FILMS["orthotropic"]
    membrane = Membrane(Space(mesh, order), film)
    x, y = membrane.space.basis.doflocs
    G = np.array([[0.02, 0.01], [0.03, -0.01], [0.1, -0.2]])
    state = membrane.state((np.stack([x, y], axis=-1) @ G.T).ravel())
    F = np.eye(3, 2) + G
    E = 0.5 * (F.T @ F - np.eye(2))
    compliance = np.array([[1 / 3, -0.4 / 3, 0], [-0.4 / 3, 1 / 1.5, 0], [0, 0, 1 / 0.3]]) / 1e9
    elastic = [E[0, 0] + 110e-6 * 20, E[1, 1] + 110e-6 * 20, 2 * E[0, 1]]
    expected = np.linalg.solve(compliance, elastic)
    assert np.abs(state.stress - expected).max() < 1e-10 * np.abs(expected).max()
    area = membrane.space.weights.sum()
    energy = 0.5 * 25e-6 * area * expected @ elastic
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

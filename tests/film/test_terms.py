"""The terms of the equations: derivatives against differences, and constraints of punches.

The membrane's kernel is compared with its weak form and with automatic differentiation.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.polynomial import polynomial
from skfem import BilinearForm

from pvdf_fem import Scene
from pvdf_fem.arrays import ALL, Array
from pvdf_fem.film.membrane import compute_tensile_part
from pvdf_fem.film.term import ElementMatrices, State, Term
from pvdf_fem.film.unknowns import Assembly, Unknowns
from pvdf_fem.film.weak_form import make_residual_form, make_tangent_form, make_vector_basis
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.problem.problem import Problem
from pvdf_fem.solver.nonlinear.factors import factorise
from tests.helpers.discs import LOADS, graded_mesh

# A curved outline and the corners of four electrodes in few elements; loads as large as the film's.
SCENE = Scene().with_(
    electrodes={"side_mm": 8.0},
    probe={"shape": "circle", "radius_mm": 12.0, "x_mm": 8.0},
    film={"temperature_change_K": -20.0, "bending": False},
    load={"force_N": 2e3},
)
ORTHOTROPIC = {"film.youngs_modulus_GPa": [3.0, 1.5], "film.poisson_ratio": 0.4}
ORTHOTROPIC |= {"film.shear_modulus_GPa": 0.3}
TAPE = {"shape": "square", "x_mm": -20.0, "y_mm": 18.0, "side_mm": 8.0, "thickness_um": 40.0}
TAPE |= {"youngs_modulus_GPa": 3.0, "poisson_ratio": 0.3}
BEFORE = [{**TAPE, "thermal_expansion_per_K": 2e-5, "bonded": "before stretching"}]
UNDER = {"shape": "circle", "x_mm": 10.0, "y_mm": -8.0, "radius_mm": 11.0, "backing_N_m3": 1e8}
PLATE = {"film.bending": True, "film.thickness_um": 1e3}
WIRED = {"film.d31_pC_N": 60.0, "film.d32_pC_N": -20.0, "film.coupling": True}
WIRED |= {"readout.kind": {"A": "voltage", "B": "voltage"}}
WIRED |= {"readout.cable_capacitance_pF": {"B": 20.0}}


@dataclass(frozen=True)
class Case:
    """Changes of `SCENE`, and how exactly differences agree with derivatives: with the step 1 along
    random displacements, five-point differences are exact for polynomials."""

    changes: dict[str, object]
    order: int = 3
    step: float = 1.0
    exact: float = 1e-10


CASES = {
    **{f"order {order}": Case({}, order) for order in (1, 4)},
    **{kind: Case(load) for kind, load in LOADS.items()},
    "tilting": Case({"load.kind": "rigid", "load.tilt": "free"}),
    "sideways": Case({**LOADS["stuck"], "load.tangential_N": [500.0, -300.0]}),
    "orthotropic": Case(ORTHOTROPIC, 2),
    "unequal tensions": Case({**ORTHOTROPIC, "film.pretension_N_m": [220.0, 90.0]}),
    "neo-hookean": Case({"film.law": "neo-hookean"}, 2, 1e-3, 1e-6),
    # at the kinks of its law differences are not exact, and the tangent has a floor
    "tension field": Case(
        {"film.compression": "tension-field", "film.temperature_change_K": 20.0}, 3, 1e-6, 1e-5
    ),
    "plate": Case({**PLATE, **LOADS["dead"]}),
    "plate under a punch": Case({**PLATE, **LOADS["sliding"]}),
    "weight and pressure": Case({"film.gravity_m_s2": 1e5, "film.pressure_Pa": 1e5}),
    "pressure that follows": Case({"film.pressure_Pa": 1e5, "film.pressure_follows": True}),
    "rim and warm probe": Case({"film.rim_displacement_um": [9.0], "probe.temperature_K": 40.0}),
    "tape under a warm probe": Case({"film.patches": BEFORE, "probe.temperature_K": 40.0}),
    "backing": Case({"film.backing_N_m3": 1e8}),
    # lifted off in a part of the film; where it is about to, differences are not exact
    "one-sided backings": Case(
        {
            "film.backing_N_m3": 1e7,
            "film.backing_one_sided": True,
            "film.patches": [{**UNDER, "backing_one_sided": True}, TAPE],
        },
        2,
        1e-7,
        1e-5,
    ),
    "voltages": Case({**WIRED, "numerics.observable": "material"}),
    "voltages and a tape": Case({**WIRED, "film.patches": [TAPE]}),
}


@dataclass(frozen=True)
class Sample:
    """The equations at a random displacement `q`, and a random step `d`, both (unknowns,); slopes
    are about 0.3, so that all of the equations' terms matter."""

    case: Case
    equations: Equilibrium
    q: Array
    d: Array

    def at(self, s: float) -> State:
        """At `q` + s `d`."""
        return self.equations.state(self.q + s * self.d)

    def energy(self, s: float) -> float:
        """Energy of all terms in J."""
        return sum(term.energy(self.at(s)) for term in self.equations.terms)

    def residual(self, s: float) -> Array:
        return self.equations.residual(self.at(s))

    def difference(self, of) -> Array:
        """Derivative by s at 0."""
        h = self.case.step
        ahead, behind = (8.0 * (np.asarray(of(s)) - np.asarray(of(-s))) for s in (h, 2.0 * h))
        return (ahead - behind / 8.0) / (12.0 * h)

    def close(self, found: Array, expected: Array) -> bool:
        """Whether arrays agree to a part of the largest number."""
        return close(found, expected, self.case.exact)

    def of_every_dof(self, equations: Equilibrium) -> Equilibrium:
        """The equations with every dof free."""
        free = copy(equations)
        free.unknowns = Unknowns(free.space.dof_count, np.empty(0, dtype=np.int64))
        free.assembly = Assembly(free.space, free.unknowns)
        return free


def close(found, expected, exact):
    return abs(found - expected).max() <= exact * abs(expected).max()


@pytest.fixture(params=CASES, scope="module")
def sample(request):
    case = CASES[request.param]
    scene = SCENE.with_(**case.changes)
    equations = Equilibrium(Problem.from_scene(scene), graded_mesh(scene, 8.0, 20.0), case.order)
    size = 0.3 * np.sqrt(np.median(equations.space.weights.sum(axis=1))) / case.order
    q, d = size * np.random.default_rng(7).uniform(-1.0, 1.0, (2, equations.unknowns.count))
    return Sample(case, equations, q, d)


def of_cases(*names):
    return pytest.mark.parametrize("sample", names, indirect=True)


def test_residual_is_the_derivative_of_the_energy(sample):
    """A load that is not conservative gives its forces in place of an energy."""
    slope = sample.residual(0.0) @ sample.d
    if sample.equations.conservative:
        largest = max(abs(sample.energy(s)) for s in (-1.0, 1.0))
        expected = sample.difference(sample.energy)
        assert slope == pytest.approx(expected, abs=sample.case.exact * largest)
    state, x = sample.at(0.0), sample.equations.unknowns.expand(sample.d)
    for load in sample.equations.loads:
        assert load.residual(state) @ x == pytest.approx(-load.forces(state) @ x, rel=1e-12)
        assert load.energy(state) == pytest.approx(-load.forces(state) @ state.dofs)


def test_tangent_is_the_derivative_of_the_residual(sample):
    tangent = sample.equations.tangent(sample.at(0.0))
    assert sample.close(tangent @ sample.d, sample.difference(sample.residual))
    e = np.random.default_rng(8).uniform(-1.0, 1.0, len(sample.q))
    symmetric = e @ (tangent @ sample.d) == pytest.approx(sample.d @ (tangent @ e), rel=1e-9)
    assert bool(symmetric) == sample.equations.conservative
    if sample.equations.conservative:
        found = factorise(tangent).solve(tangent @ sample.d)
        assert found == pytest.approx(sample.d, abs=1e-6 * np.abs(sample.d).max())


def test_action_and_diagonal_are_those_of_the_symmetric_tangent(sample):
    equations, state = sample.equations, sample.at(0.0)
    symmetric = equations.with_terms(term for term in equations.terms if term.conservative)
    assert sample.close(equations.action(state, sample.d), symmetric.tangent(state) @ sample.d)
    if not equations.problem.floating_electrodes:  # no diagonal is needed with coupling
        diagonal = sample.of_every_dof(symmetric).sparse_tangent(state).diagonal()
        expected = equations.unknowns.fold_diagonal(diagonal)
        assert sample.close(equations.diagonal(state), expected)


def test_energy_along_a_step_is_a_quartic(sample):
    equations = sample.equations
    slope = float(sample.residual(0.0) @ sample.d)
    quartic = equations.energy_along(sample.at(0.0), sample.d, slope)
    if equations.conservative and equations.membrane.law.is_linear:  # else it is no polynomial
        # with a film that lifts off, only the energies at both ends of a step are exact
        lifts = "film.backing_one_sided" in sample.case.changes
        lengths = np.array([0.0, 1.0] if lifts else [-1.5, -0.2, 0.7, 3.0])
        energies = np.array([sample.energy(s) for s in lengths])
        values = polynomial.polyval(lengths, quartic)
        assert values == pytest.approx(energies, rel=1e-9, abs=1e-9 * np.abs(energies).max())


class ElasticBed(Term):
    """Springs below the film, as a term with the three members that have no default."""

    def __init__(self, space, stiffness=1e11):
        self.space = space
        self.matrices = stiffness * space.mass_matrices()

    def energy(self, state):
        return 0.5 * float(self.residual(state) @ state.dofs)

    def residual(self, state):
        local = state.dofs[self.space.element_dofs]
        return self.space.sum_at_dofs(np.einsum("eij,ej->ei", self.matrices, local))

    def element_tangent(self, state):
        return ElementMatrices(ALL, self.matrices)


@of_cases("dead")
def test_products_diagonal_and_energy_along_a_step_follow_from_the_element_tangent(sample):
    membrane, state, d = sample.equations.membrane, sample.at(0.0), sample.d
    bed = ElasticBed(sample.equations.space)
    equations = sample.equations.with_terms([membrane, bed])
    tangent = equations.tangent(state)
    alone = tangent - sample.equations.with_terms([membrane]).tangent(state)
    assert abs(alone).max() > 1e-3 * abs(tangent).max()
    assert sample.close(equations.action(state, d), tangent @ d)
    diagonal = sample.of_every_dof(equations).sparse_tangent(state).diagonal()
    assert sample.close(equations.diagonal(state), equations.unknowns.fold_diagonal(diagonal))
    x = equations.unknowns.expand(d)
    polynomial_of_bed = bed.energy_along(state, x)
    for s in (-1.0, 0.5, 2.0):
        energy = bed.energy(sample.at(s))
        assert polynomial.polyval(s, polynomial_of_bed) == pytest.approx(energy, rel=1e-9)


@of_cases("order 1", "orthotropic", "unequal tensions")
def test_kernel_equals_the_forms(sample):
    free, state = sample.of_every_dof(sample.equations), sample.at(0.0)
    membrane, basis = free.membrane, make_vector_basis(free.space)
    forces, tangent = (
        form(membrane.film).assemble(basis, displacement=basis.interpolate(state.dofs))
        for form in (make_residual_form, make_tangent_form)
    )
    assert close(membrane.internal_forces(state), forces, 1e-14)
    assert close(free.assembly.matrix(membrane.tangent_matrices(state)), tangent, 1e-14)
    laplace = BilinearForm(lambda u, v, _: np.einsum("ia...,ia...", u.grad, v.grad))
    assert close(
        free.assembly.matrix(free.space.laplace_matrices()), laplace.assemble(basis), 1e-14
    )


@of_cases("orthotropic")
def test_kernel_is_the_derivative_that_jax_makes_of_the_energy(sample):
    """Of the potential alone, by reverse and forward differentiation."""
    pytest.importorskip("jax")
    from skfem.autodiff import NonlinearForm

    free, state = sample.of_every_dof(sample.equations), sample.at(0.0)
    membrane, film = free.membrane, free.film

    @NonlinearForm(hessian=True)
    def energy(u, _):
        F = [[u.grad[i, j] + float(i == j) for j in (0, 1)] for i in range(3)]
        C = [[sum(row[a] * row[b] for row in F) for a in (0, 1)] for b in (0, 1)]
        E = [0.5 * (C[0][0] - 1.0), 0.5 * (C[1][1] - 1.0), C[0][1]]
        E = [e + e0 for e, e0 in zip(E, film.prestrain, strict=True)]
        pairs = [(i, j) for i in range(3) for j in range(3)]
        return 0.5 * film.thickness * sum(film.stiffness[i, j] * E[i] * E[j] for i, j in pairs)

    tangent, forces = energy.assemble(make_vector_basis(free.space), x=state.dofs)
    assert close(-forces, membrane.internal_forces(state), 1e-12)
    assert close(tangent, free.assembly.matrix(membrane.tangent_matrices(state)), 1e-12)


@of_cases("sliding", "stuck", "sideways")
def test_film_under_a_punch_has_a_common_deflection_and_sticks_if_the_scene_says_so(sample):
    space, unknowns = sample.equations.space, sample.equations.unknowns
    load, x = sample.equations.scene.load, unknowns.expand(sample.q).reshape(-1, 3)
    moves = x[np.unique(space.basis.element_dofs[:, space.mesh.subdomains["probe"]])]
    sticks = load.contact == "stuck"
    assert list(np.ptp(moves, axis=0) == 0.0) == [sticks, sticks, True]
    assert list(moves.any(axis=0)) == [not sticks or load.tangential_N is not None] * 2 + [True]
    assert moves[:, 2].max() == sample.q[-1]
    assert not x[space.basis.get_dofs("rim").all()].any()
    assert len(np.unique(x)) == unknowns.count + 1  # and nothing else is tied
    assert unknowns.restrict(x.ravel()) == pytest.approx(sample.q, rel=1e-13)


def test_the_tensile_part_has_the_positive_principal_stresses():
    """Of film in tension, in compression along a direction, along all, and without shear."""
    stress = np.random.default_rng(3).normal(size=(200, 3))
    stress[:50, :2] -= 3.0
    stress[-2:] = [[-1.0, -1.0, 0.0], [2.0, 2.0, 0.0]]
    values, vectors = np.linalg.eigh(stress[:, [[0, 2], [2, 1]]])
    assert {tuple(signs) for signs in values > 0.0} == {(False, False), (False, True), (True, True)}
    positive = np.einsum("nik,nk,njk->nij", vectors, np.maximum(values, 0.0), vectors)
    expected = positive.reshape(-1, 4)[:, [0, 3, 1]]
    np.testing.assert_allclose(compute_tensile_part(stress), expected, atol=1e-12)

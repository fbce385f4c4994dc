"""Every term of the energy: its derivatives against differences, and its actions against them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.polynomial import polynomial

from pvdf_fem import Scene
from pvdf_fem.arrays import Array
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.loads.pressure import DeadPressure, FollowerPressure, Punch
from pvdf_fem.film.membrane import Membrane
from pvdf_fem.film.plate import Plate
from pvdf_fem.film.term import State, Term
from pvdf_fem.film.unknowns import Assembly, Unknowns
from tests.helpers.discs import LOADS, graded_mesh

# A curved outline and the corners of four electrodes in few elements.
SCENE = Scene.parse(
    """
    [film]
    temperature_change_K = -20.0
    [electrodes]
    side_mm = 8.0
    [probe]
    shape = "circle"
    radius_mm = 12.0
    x_mm = 8.0
    [load]
    force_N = 2e3
    """
)
ORTHOTROPIC = {
    "film.youngs_modulus_GPa": [3.0, 1.5],
    "film.poisson_ratio": 0.4,
    "film.shear_modulus_GPa": 0.3,
}
WRINKLING = {"film.compression": "tension-field", "film.temperature_change_K": 20.0}
SLOPE = 0.3


@dataclass(frozen=True)
class Case:
    """A term within the equations of a scene, and how exactly differences agree with it.

    Attributes
    ----------
    kind : type
        The term's class.
    changes : dict
        Of `SCENE`.
    step : float
        Of the five-point differences along random displacements; with 1 they are exact for the
        terms that are polynomials.
    exact : float
        Relative error of differences.
    """

    kind: type[Term]
    changes: dict[str, object]
    step: float = 1.0
    exact: float = 1e-10


CASES = {
    "membrane": Case(Membrane, {}),
    "orthotropic membrane": Case(Membrane, ORTHOTROPIC),
    "membrane under a stuck punch": Case(Membrane, LOADS["stuck"]),
    # at the kinks of its law differences are not exact, and the tangent has a floor
    "tension field": Case(Membrane, WRINKLING, 1e-6, 1e-5),
    "plate": Case(Plate, {"film.bending": True, "film.thickness_um": 1e3}),
    "plate under a punch": Case(Plate, {"film.bending": True, **LOADS["sliding"]}),
    "dead": Case(DeadPressure, LOADS["dead"]),
    "follower": Case(FollowerPressure, LOADS["follower"]),
    "sliding": Case(Punch, LOADS["sliding"]),
    "stuck": Case(Punch, LOADS["stuck"]),
}


@dataclass(frozen=True)
class Sample:
    """A term at a random displacement `q`, and a random step `d` of the unknowns."""

    case: Case
    equilibrium: Equilibrium
    term: Term
    q: Array
    d: Array

    @property
    def state(self) -> State:
        """At `q`."""
        return self.at(0.0)

    def at(self, s: float) -> State:
        """At `q` + s `d`."""
        return self.equilibrium.state(self.q + s * self.d)

    @property
    def step(self) -> Array:
        """The dofs of `d`."""
        return self.equilibrium.unknowns.expand(self.d)

    def residual(self, s: float) -> Array:
        """Of the term on the unknowns at `q` + s `d`."""
        return self.equilibrium.unknowns.fold(self.term.residual(self.at(s)))

    def difference(self, of: Callable[[float], Array | float]) -> Array:
        """Derivative by s at 0, exact for a quartic where the step is 1."""
        h = self.case.step
        ahead, behind = (8.0 * (np.asarray(of(s)) - np.asarray(of(-s))) for s in (h, 2.0 * h))
        return (ahead - behind / 8.0) / (12.0 * h)


@pytest.fixture(scope="module")
def mesh():
    return graded_mesh(SCENE, 8.0, 20.0)


@pytest.fixture(params=CASES)
def sample(request, mesh):
    case = CASES[request.param]
    scene = SCENE.with_(**{"film.bending": False}).with_(**case.changes)
    equilibrium = Equilibrium(scene, mesh, 3)
    [term] = [term for term in equilibrium.terms if type(term) is case.kind]
    size = SLOPE * np.sqrt(np.median(equilibrium.space.weights.sum(axis=1))) / 3.0
    random = np.random.default_rng(7)
    q, d = size * random.uniform(-1.0, 1.0, (2, equilibrium.unknowns.count))
    return Sample(case, equilibrium, term, q, d)


def test_residual_is_the_derivative_of_the_energy(sample):
    """Of a load that is not conservative, that of the work of its forces as they are."""
    slope = sample.residual(0.0) @ sample.d
    if sample.term.conservative:
        difference = sample.difference(lambda s: sample.term.energy(sample.at(s)))
        largest = max(abs(sample.term.energy(sample.at(s))) for s in (-1.0, 1.0))
        assert slope == pytest.approx(difference, abs=sample.case.exact * largest)
    else:
        forces = sample.term.forces(sample.state)
        assert slope == pytest.approx(-forces @ sample.step, rel=1e-12)
        assert sample.term.energy(sample.state) == pytest.approx(-forces @ sample.state.dofs)
    assert slope != 0.0


def tangent_of(term, state, assembly):
    """The tangent of one term on the unknowns; None if it vanishes."""
    local = term.element_tangent(state)
    if local is None:
        return term.coupled_tangent(assembly, state)
    elements, values = local
    dofs = term.space.element_dofs.shape
    matrices = np.zeros((*dofs, dofs[1]))
    matrices[elements] = values
    return assembly.matrix(matrices)


def test_tangent_is_the_derivative_of_the_residual(sample):
    tangent = tangent_of(sample.term, sample.state, sample.equilibrium.assembly)
    difference = sample.difference(sample.residual)
    if tangent is None:
        assert np.abs(difference).max() <= 1e-13 * np.abs(sample.residual(0.0)).max()
        return
    product = tangent @ sample.d
    assert np.abs(product - difference).max() <= sample.case.exact * np.abs(product).max()
    assert np.abs(product).max() > 0.0
    symmetric = abs(tangent - tangent.T).max() < 1e-10 * abs(tangent).max()
    assert bool(symmetric) is sample.term.conservative


def test_only_a_pressure_that_follows_has_no_energy(sample):
    assert sample.term.conservative is not isinstance(sample.term, FollowerPressure)
    assert sample.equilibrium.conservative is sample.equilibrium.loads[0].conservative


def test_action_is_the_tangent_times_a_step(sample):
    action = sample.term.element_action(sample.state, sample.step)
    tangent = tangent_of(sample.term, sample.state, sample.equilibrium.assembly)
    if isinstance(sample.term, DeadPressure):  # the loads' tangents are left out
        assert action is None
        return
    assert action.shape == sample.equilibrium.space.element_dofs.shape
    product = tangent @ sample.d
    found = sample.equilibrium.unknowns.fold(sample.equilibrium.space.sum(action))
    assert np.abs(found - product).max() <= 1e-12 * np.abs(product).max()


def test_diagonal_is_that_of_the_tangent_of_all_dofs(sample):
    space = sample.equilibrium.space
    none = np.empty(0, dtype=np.int64)
    all_free = Assembly(space, Unknowns(space.dof_count, none, ()))
    tangent = tangent_of(sample.term, sample.state, all_free)
    diagonal = sample.term.diagonal(sample.state)
    if isinstance(sample.term, DeadPressure):
        assert diagonal is None
        return
    assert np.abs(diagonal - tangent.diagonal()).max() <= 1e-12 * np.abs(diagonal).max()
    # the matrix of the unknowns is still theirs after one of all dofs was asked for
    folded = tangent_of(sample.term, sample.state, sample.equilibrium.assembly)
    assert folded.shape == 2 * (sample.equilibrium.unknowns.count,)


def test_energy_along_a_step(sample):
    coefficients = sample.term.along(sample.state, sample.step)
    assert coefficients.shape == (5,)
    assert coefficients[0] == pytest.approx(sample.term.energy(sample.state), rel=1e-12)
    slope = sample.residual(0.0) @ sample.d
    assert coefficients[1] == pytest.approx(slope, rel=1e-9)
    lengths = np.array([-1.5, -0.2, 0.7, 3.0])
    values = polynomial.polyval(lengths, coefficients)
    energies = np.array([sample.term.energy(sample.at(s)) for s in lengths])
    if not sample.term.conservative:
        forces = sample.term.forces(sample.state)
        energies = np.array([-forces @ sample.at(s).dofs for s in lengths])
    if sample.equilibrium.model.wrinkles and isinstance(sample.term, Membrane):  # no polynomial
        assert values != pytest.approx(energies, rel=1e-3)
    else:
        assert values == pytest.approx(energies, rel=1e-11)


def test_the_sum_of_the_terms_is_the_equilibrium(sample):
    equilibrium, state, d = sample.equilibrium, sample.state, sample.d
    unknowns, terms = equilibrium.unknowns, equilibrium.terms
    residual = sum(unknowns.fold(term.residual(state)) for term in terms)
    assert equilibrium.residual(state) == pytest.approx(residual, rel=1e-9, abs=1e-9)
    along = sum(term.along(state, sample.step) for term in terms)
    slope = float(equilibrium.residual(state) @ d)
    assert equilibrium.energy_along(state, d, slope) == pytest.approx(along, rel=1e-9)
    tangents = [tangent_of(term, state, equilibrium.assembly) for term in terms]
    product = sum(tangent @ d for tangent in tangents if tangent is not None)
    scale = np.abs(product).max()
    assert np.abs(equilibrium.tangent(state) @ d - product).max() <= 1e-13 * scale
    if equilibrium.conservative:
        assert np.abs(equilibrium.action(state, d) - product).max() <= 1e-12 * scale


@pytest.mark.parametrize("kind", LOADS)
def test_a_film_without_a_probe_has_no_load(mesh, kind):
    bare = Equilibrium(SCENE.with_(probe=None, **LOADS[kind]), mesh, 2)
    assert not bare.loads
    assert bare.force == 0.0
    assert not bare.load_forces(bare.state(np.zeros(bare.unknowns.count))).any()

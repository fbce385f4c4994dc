"""The equations of a scene: each derivative of the energy against differences, with all terms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.polynomial import polynomial

from pvdf_fem import Scene
from pvdf_fem.arrays import Array
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.term import State
from pvdf_fem.film.unknowns import Assembly, Unknowns
from pvdf_fem.solvers.newton import factorise
from tests.helpers.discs import LOADS, graded_mesh

# A curved outline and the corners of four electrodes in few elements; loads as large as the film's.
SCENE = Scene().with_(
    electrodes={"side_mm": 8.0},
    probe={"shape": "circle", "radius_mm": 12.0, "x_mm": 8.0},
    film={"temperature_change_K": -20.0, "bending": False},
    load={"force_N": 2e3},
)
ORTHOTROPIC = {
    "film.youngs_modulus_GPa": [3.0, 1.5],
    "film.poisson_ratio": 0.4,
    "film.shear_modulus_GPa": 0.3,
}
TAPE = {"shape": "square", "x_mm": -20.0, "y_mm": 18.0, "side_mm": 8.0, "thickness_um": 40.0}
TAPE |= {"youngs_modulus_GPa": 3.0, "poisson_ratio": 0.3}
BEFORE = [{**TAPE, "thermal_expansion_per_K": 2e-5, "bonded": "before stretching"}]
PLATE = {"film.bending": True, "film.thickness_um": 1e3}
WIRED = {"film.d31_pC_N": 60.0, "film.d32_pC_N": -20.0, "film.coupling": True}
WIRED |= {"readout.kind": {"A": "voltage", "B": "voltage"}}
WIRED |= {"readout.cable_capacitance_pF": {"B": 20.0}}


@dataclass(frozen=True)
class Case:
    """Changes of `SCENE`, and how exactly differences agree with derivatives.

    With the step 1 along random displacements, five-point differences are exact for polynomials.
    """

    changes: dict[str, object]
    order: int = 3
    step: float = 1.0
    exact: float = 1e-10


CASES = {
    **{f"order {order}": Case({}, order) for order in (1, 2, 4)},
    **{kind: Case(load) for kind, load in LOADS.items()},
    "tilting": Case({"load.kind": "rigid", "load.tilt": "free"}),
    "sideways": Case({**LOADS["stuck"], "load.tangential_N": [500.0, -300.0]}),
    "orthotropic": Case(ORTHOTROPIC),
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
    "voltages": Case({**WIRED, "numerics.observable": "material"}),
    "voltages and a tape": Case({**WIRED, "film.patches": [TAPE]}),
}


@dataclass(frozen=True)
class Sample:
    """The equations at a random displacement `q`, and a random step `d`, both (unknowns,)."""

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

    def close(self, found: Array, expected: Array, part: float = 1.0) -> bool:
        """Whether arrays agree to a part of the largest number."""
        return np.abs(found - expected).max() <= part * self.case.exact * np.abs(expected).max()


@pytest.fixture(params=CASES, scope="module")
def sample(request):
    case = CASES[request.param]
    scene = SCENE.with_(**case.changes)
    equations = Equilibrium(scene, graded_mesh(scene, 8.0, 20.0), case.order)
    size = 0.3 * np.sqrt(np.median(equations.space.weights.sum(axis=1))) / case.order
    q, d = size * np.random.default_rng(7).uniform(-1.0, 1.0, (2, equations.unknowns.count))
    return Sample(case, equations, q, d)


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
    following = [term for term in equations.terms if not term.conservative]
    symmetric = equations.with_terms(term for term in equations.terms if term not in following)
    assert sample.close(equations.action(state, sample.d), symmetric.tangent(state) @ sample.d)
    if equations.model.floating:  # the diagonal is not asked for
        return
    others, free = copy_with_all_dofs(symmetric), equations.unknowns.fold_diagonal
    diagonal = others.sparse_tangent(state).diagonal()
    assert sample.close(equations.diagonal(state), free(diagonal))


def copy_with_all_dofs(equations: Equilibrium) -> Equilibrium:
    """The equations with every dof free."""
    other, none = equations.with_terms(equations.terms), np.empty(0, dtype=np.int64)
    other.unknowns = Unknowns(equations.space.dof_count, none, ())
    other.assembly = Assembly(equations.space, other.unknowns)
    return other


def test_energy_along_a_step_is_a_quartic(sample):
    """The forces of a load that follows are held as they are."""
    equations, state = sample.equations, sample.at(0.0)
    slope = float(sample.residual(0.0) @ sample.d)
    quartic = equations.energy_along(state, sample.d, slope)
    assert quartic[1] == pytest.approx(slope, rel=1e-9)
    lengths = np.array([-1.5, -0.2, 0.7, 3.0])
    energies = np.array([sample.energy(s) for s in lengths])
    if not equations.conservative:
        for load in (term for term in equations.terms if not term.conservative):
            forces = load.forces(state)
            energies += [-load.energy(sample.at(s)) - forces @ sample.at(s).dofs for s in lengths]
        energies -= energies[1]
        quartic[0] -= polynomial.polyval(lengths[1], quartic)
    values = polynomial.polyval(lengths, quartic)
    if equations.membrane.law.linear:
        assert values == pytest.approx(energies, rel=1e-9, abs=1e-9 * np.abs(energies).max())
    else:  # no polynomial
        assert values != pytest.approx(energies, rel=1e-3)


@pytest.mark.parametrize("kind", LOADS)
def test_a_film_without_a_probe_has_no_load(kind):
    scene = SCENE.with_(probe=None, **LOADS[kind])
    bare = Equilibrium(scene, graded_mesh(scene, 8.0, 20.0), 2)
    assert not bare.loads
    assert bare.force == 0.0
    assert not bare.load_forces(bare.state(np.zeros(bare.unknowns.count))).any()

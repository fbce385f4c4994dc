"""Electromechanical coupling: closed forms, a solve with voltages as unknowns, and energy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.constants import epsilon_0

from pvdf_fem import Scene, SceneError, gradients, modes, solve
from pvdf_fem.charges.forces import charges_of, goal_forces, goal_gradients
from pvdf_fem.charges.goals import goals_of
from pvdf_fem.film.electric.coupling import Coupling, coupling_effect, floating
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.response.response_file import mechanics_of
from pvdf_fem.solution.solve import rest_charges
from pvdf_fem.solvers.ladder import equilibrate
from pvdf_fem.solvers.newton import factorise, negative_pivots
from pvdf_fem.sweeps.equivalence import mechanics
from pvdf_fem.sweeps.records import record_of, records_of
from reports.accuracy.drawn import random_scene
from tests.helpers.discs import TRIANGLE, uniform_mesh

CABLES = {"kind": {"A": "voltage", "B": "voltage"}, "cable_capacitance_pF": {"B": 20.0}}
STRONG = {"film.d31_pC_N": 60.0, "film.d32_pC_N": -20.0, "film.coupling": True, "readout": CABLES}
WIRED = TRIANGLE.with_(**STRONG)
COVERED = {"name": "A", "shape": "circle", "x_mm": 0.0, "y_mm": 0.0, "radius_mm": 44.0}


@pytest.fixture(scope="module")
def equilibrium():
    return Equilibrium(WIRED, uniform_mesh(WIRED, 12.0), 2)


@pytest.fixture(scope="module")
def solved(equilibrium):
    return equilibrate(equilibrium, tolerance=1e-9).q


@pytest.fixture(scope="module")
def solution():
    return solve(WIRED)


def test_covered_film_under_uniform_tension_is_stiffer_by_k_squared():
    """Stiffness up by 1/(1 - k²), k² = 2 d² E/(ε_T (1 - ν)), over the electrode."""
    changes = {"film.d31_pC_N": 23.0, "film.d32_pC_N": 23.0, "readout.kind": "voltage"}
    scene = Scene().with_(**changes, electrodes=[COVERED], **{"film.coupling": True})
    equilibrium = Equilibrium(scene, uniform_mesh(scene, 12.0), 2)
    (coupling,) = (term for term in equilibrium.terms if isinstance(term, Coupling))
    places = equilibrium.space.basis.doflocs.T
    x = 1e-6 * np.column_stack([places, 0.0 * places[:, 0]]).ravel()
    state = equilibrium.membrane.state(x)
    film, space = scene.film, equilibrium.space
    k2 = 2.0 * film.d31**2 * 2e9 / (11.0 * epsilon_0 * (1.0 - film.poisson_ratio))
    density = np.einsum("epi,ij,epj->ep", state.strain, film.stiffness, state.strain)
    covered = coupling.elements
    short = 0.5 * film.thickness * (density * space.weights)[covered].sum()
    short *= 0.044**2 * np.pi / space.weights[covered].sum()
    # the meshed circle has the electrode's area, so that only rounding and this are left
    assert coupling.energy(state) / short == pytest.approx(1.0 / (1.0 - k2) - 1.0, rel=1e-6)


def test_forces_are_those_of_the_energy(equilibrium, solved):
    random = np.random.default_rng(3)
    d = random.standard_normal(len(solved)) * np.abs(solved).max() * 1e-3
    state = equilibrium.state(solved)
    for term in (term for term in equilibrium.terms if isinstance(term, Coupling)):
        x = equilibrium.unknowns.expand(d)
        energies = [term.energy(equilibrium.state(solved + s * d)) for s in (0.5, 1.0, 2.0)]
        quartic = term.along(state, x)
        assert np.polyval(quartic[::-1], [0.5, 1.0, 2.0]) == pytest.approx(energies, rel=1e-12)
        assert term.residual(state) @ x == pytest.approx(quartic[1], rel=1e-9)
    ahead, behind = (equilibrium.residual(equilibrium.state(solved + s * d)) for s in (1e-3, -1e-3))
    tangent = equilibrium.tangent(state)
    difference = (ahead - behind) / 2e-3
    assert np.abs(tangent @ d - difference).max() <= 1e-6 * np.abs(difference).max()
    assert equilibrium.action(state, d) == pytest.approx(tangent @ d, rel=1e-9, abs=1e-9)
    factors = factorise(tangent)
    for trans in "NT":
        assert factors.solve(tangent @ d, trans) == pytest.approx(d, rel=1e-7, abs=1e-14)
    dense = tangent @ np.eye(len(d))
    assert negative_pivots(factors) == 0 < np.linalg.eigvalsh(dense).min()


def test_solve_with_the_field_as_unknowns(equilibrium, solved):
    """Bordered Newton for displacement and voltages, on the uncoupled film's forces and charges."""
    plain = WIRED.with_(**{"film.coupling": False})
    film = Equilibrium(plain, equilibrium.space.mesh, 2)
    goals, d = goals_of(plain)[:2], np.array([60e-12, -20e-12])
    clamped = 11.0 * epsilon_0 - d @ plain.film.stiffness[:2, :2] @ d
    capacitances = np.diag(clamped * 9e-6 / 25e-6 + [0.0, 20e-12])
    q, voltages, unit = equilibrate(film).q, np.zeros(2), 1e6
    for _ in range(12):
        state, x = film.state(q), film.dofs(q)
        slopes = film.unknowns.fold(goal_gradients(goals, film.membrane, x))
        charges = charges_of(goals, goal_forces(goals, film.membrane, x)) - rest_charges(plain)[:2]
        K = film.tangent(state).toarray()
        system = np.block([[K, unit * slopes], [unit * slopes.T, -(unit**2) * capacitances]])
        lacking = film.residual(state) + slopes @ voltages
        step = np.linalg.solve(
            system, np.append(lacking, unit * (charges - capacitances @ voltages))
        )
        q, voltages = q - step[: len(q)], voltages - unit * step[len(q) :]
    assert q == pytest.approx(solved, rel=1e-8, abs=1e-12)
    state = equilibrium.state(solved)
    terms = [term for term in equilibrium.terms if isinstance(term, Coupling)]
    assert [t.voltage(state) for t in terms] == pytest.approx(voltages, rel=1e-8)


def test_work_of_the_load_is_elastic_and_electric_energy():
    nodes, weights = np.polynomial.legendre.leggauss(8)
    mesh = uniform_mesh(WIRED, 10.0)
    works, loads = [], [*(nodes + 1.0) ** 2 / 4.0, 1.0]
    for force in loads:
        equilibrium = Equilibrium(WIRED.with_(**{"load.force_N": force}), mesh, 2)
        result = equilibrate(equilibrium, tolerance=1e-9)
        state = equilibrium.state(result.q)
        works.append(equilibrium.work(state, result.q))
    inner = [term for term in equilibrium.terms if term not in equilibrium.loads]
    flat = equilibrium.state(0.0 * result.q)
    stored = sum(term.energy(state) - term.energy(flat) for term in inner)
    # F w less the complementary energy ∫ w dF, with F = s²
    complement = sum(
        w * work / force * (s + 1.0) / 2.0
        for w, s, work, force in zip(weights, nodes, works, loads, strict=False)
    )
    assert stored == pytest.approx(works[-1] - complement, rel=1e-5)


def test_reading_is_the_voltage_of_the_equations(solution):
    state = solution.fields.solved_state
    terms = [term for term in solution.fields.solved.terms if isinstance(term, Coupling)]
    voltages = {term.electrode.name: term.voltage(state) for term in terms}
    expected = {"C": 0.0, "D": 0.0, **voltages}
    assert solution.electrode_voltages_V == pytest.approx(expected, rel=1e-9)
    assert {name: solution.readings_V[name] for name in "AB"} == pytest.approx(voltages, rel=1e-9)
    assert solution.to_json()["electrode_voltages_V"] == solution.electrode_voltages_V


def test_derivatives_of_coupled_charges(solution):
    """By the force, on one mesh; by what changes voltages there are none."""
    found = gradients(solution, ["load.force_N"])["load.force_N"]
    ahead, behind = (
        solve(WIRED.with_(**{"load.force_N": 1.0 + s}), mesh=solution.mesh).charges_pC
        for s in (0.01, -0.01)
    )
    differences = {name: (ahead[name] - behind[name]) / 0.02 for name in found}
    assert found == pytest.approx(differences, rel=1e-4)
    for key in ("film.d31_pC_N", "film.thickness_um"):
        with pytest.raises(ValueError, match="voltages"):
            gradients(solution, [key])


@pytest.mark.parametrize("seed", range(200, 203))
def test_estimate_is_between_a_third_and_thirty_times_the_effect(seed):
    random = np.random.default_rng(seed)
    d = random.uniform(3.0, 30.0, 2)
    changes = {"film.d31_pC_N": d[0], "film.d32_pC_N": d[1], "readout.kind": "voltage"}
    changes |= {"numerics.tolerance": 2e-3, "numerics.observable": "material"}
    scene = random_scene(random, **changes)
    coupled = solve(scene.with_(**{"film.coupling": True}))
    without = solve(scene, mesh=coupled.mesh)
    pairs = zip(coupled.charges_pC.values(), without.charges_pC.values(), strict=True)
    change = max(abs(a / b - 1.0) for a, b in pairs)
    assert change / 3.0 <= coupling_effect(scene) <= 30.0 * change


def test_what_was_decided_is_said():
    short = TRIANGLE.with_(**{"film.coupling": True})
    assert not floating(short)
    assert solve(short).charges_pC == solve(TRIANGLE).charges_pC
    wired = TRIANGLE.with_(**{"readout.kind": "voltage"})
    left = solve(wired)
    assert left.charges_pC == solve(TRIANGLE).charges_pC
    assert any("film.coupling = false" in text and "A, B, C, D" in text for text in left.left_out)
    for tolerance, joins in ((1e-2, False), (4e-4, True)):
        auto = solve(wired.with_(**{"film.coupling": "auto", "numerics.tolerance": tolerance}))
        said = auto.included if joins else auto.left_out
        assert any('film.coupling = "auto"' in text for text in said)


def test_modes_are_stiffened():
    coarse = WIRED.with_(**{"numerics.tolerance": 0.02})
    short, wired = (
        modes(coarse.with_(**{"film.coupling": joins}), 1, loaded=True) for joins in (False, True)
    )
    assert 1.0 < wired.frequencies_Hz[0] / short.frequencies_Hz[0] < 1.01
    assert ["coupling" in "".join(found.left_out) for found in (short, wired)] == [True, False]


def test_sweeps_solve_alone_and_responses_refuse(solution):
    assert mechanics(WIRED)[0] != mechanics(WIRED.with_(**{"readout": None}))[0]
    (record,) = records_of([WIRED], np.eye(2)[None])
    assert record.forces.keys() == {"material"}
    assert record.force_errors == record_of(solution).force_errors
    assert record.charges_pC(60.0, -20.0) == pytest.approx(solution.charges_pC, rel=1e-9)
    with pytest.raises(ValueError, match=r"film\.coupling"):
        mechanics_of(WIRED)


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"film.compression": "tension-field"}, "film.compression"),
        ({"film.coupling": "yes"}, "film.coupling"),
        ({"film.d31_pC_N": 200.0, "film.permittivity": 1.0}, "film.permittivity"),
        ({"film.warming_K": 1.0}, "film.coupling"),
        ({"numerics.observable": "thesis-edge"}, "film.coupling"),
    ],
)
def test_impossible_films_are_refused(changes, key):
    with pytest.raises(SceneError, match=key.replace(".", r"\.")):
        WIRED.with_(**changes)

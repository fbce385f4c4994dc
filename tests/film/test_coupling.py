"""Electromechanical coupling: closed forms, what is decided, and what follows from voltages."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.constants import epsilon_0

from pvdf_fem import Scene, modes, solve
from pvdf_fem.film.electric.coupling import Coupling, coupling_effect, floating
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.models import film_model
from pvdf_fem.response.response_file import mechanics_of
from pvdf_fem.sweeps.equivalence import mechanics
from pvdf_fem.sweeps.records import record_of, records_of
from reports.accuracy.drawn import random_scene
from tests.helpers.discs import TRIANGLE, uniform_mesh

CABLES = {"kind": {"A": "voltage", "B": "voltage"}, "cable_capacitance_pF": {"B": 20.0}}
STRONG = {"film.d31_pC_N": 60.0, "film.d32_pC_N": -20.0, "film.coupling": True, "readout": CABLES}
WIRED = TRIANGLE.with_(**STRONG)
COVERED = {"name": "A", "shape": "circle", "x_mm": 0.0, "y_mm": 0.0, "radius_mm": 44.0}


@pytest.fixture(scope="module")
def solution():
    return solve(WIRED)


@pytest.mark.parametrize("cable_pF", [0.0, 3e4])
def test_covered_film_under_uniform_tension_is_stiffer_by_k_squared(cable_pF):
    """Stiffness up by k²/(1 - k²) C/(C + C_L), k² = 2 d² E/(ε_T (1 - ν)), over the electrode with
    C = ε_T (1 - k²) A/h."""
    readout = {"kind": "voltage", "cable_capacitance_pF": cable_pF}
    changes = {"film.d31_pC_N": 23.0, "film.d32_pC_N": 23.0, "readout": readout}
    scene = Scene().with_(**changes, electrodes=[COVERED], **{"film.coupling": True})
    equilibrium = Equilibrium(scene, uniform_mesh(scene, 12.0), 2)
    (coupling,) = (term for term in equilibrium.terms if isinstance(term, Coupling))
    places = equilibrium.space.basis.doflocs.T
    x = 1e-6 * np.column_stack([places, 0.0 * places[:, 0]]).ravel()
    state = equilibrium.membrane.state(x)
    film, space = scene.film, equilibrium.space
    permittivity, area = 11.0 * epsilon_0, 0.044**2 * np.pi
    k2 = 2.0 * film.d31**2 * 2e9 / (permittivity * (1.0 - film.poisson_ratio))
    capacitance = permittivity * (1.0 - k2) * area / film.thickness
    density = np.einsum("epi,ij,epj->ep", state.strain, film.stiffness, state.strain)
    covered = coupling.elements
    short = 0.5 * film.thickness * (density * space.weights)[covered].sum()
    short *= area / space.weights[covered].sum()
    # the meshed circle has the electrode's area, so that only rounding and this are left
    stiffer = k2 / (1.0 - k2) * capacitance / (capacitance + 1e-12 * cable_pF)
    assert coupling.energy(state) / short == pytest.approx(stiffer, rel=1e-6)


def test_reading_is_the_voltage_of_the_equations(solution):
    state = solution.fields.solved_state
    terms = [term for term in solution.fields.solved.terms if isinstance(term, Coupling)]
    voltages = {term.electrode.name: term.voltage(state) for term in terms}
    expected = {"C": 0.0, "D": 0.0, **voltages}
    assert solution.electrode_voltages_V == pytest.approx(expected, rel=1e-9)
    assert {name: solution.readings_V[name] for name in "AB"} == pytest.approx(voltages, rel=1e-9)
    assert solution.to_json()["electrode_voltages_V"] == solution.electrode_voltages_V


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
    wired = TRIANGLE.with_(**{"readout.kind": "voltage", "numerics.tolerance": 1e-2})
    for coupling, joins in ((False, False), ("auto", False), (True, True)):
        found = solve(wired.with_(**{"film.coupling": coupling}))
        told = [["film.coupling" in text for text in t] for t in (found.left_out, found.included)]
        assert [any(texts) for texts in told] == [not joins, joins]
    auto = wired.with_(**{"film.coupling": "auto", "numerics.tolerance": 4e-4})
    assert len(film_model(auto).floating) == 4


def test_modes_are_stiffened():
    coarse = WIRED.with_(**{"numerics.tolerance": 0.02})
    short, wired = (
        modes(coarse.with_(**{"film.coupling": joins}), 1, loaded=True) for joins in (False, True)
    )
    assert 1.0 < wired.frequencies_Hz[0] / short.frequencies_Hz[0] < 1.01


def test_sweeps_solve_alone_and_responses_refuse(solution):
    assert mechanics(WIRED)[0] != mechanics(WIRED.with_(**{"readout": None}))[0]
    (record,) = records_of([WIRED], np.eye(2)[None])
    assert record.forces.keys() == {"material"}
    assert record.force_errors == record_of(solution).force_errors
    assert record.charges_pC(60.0, -20.0) == pytest.approx(solution.charges_pC, rel=1e-9)
    with pytest.raises(ValueError, match=r"film\.coupling"):
        mechanics_of(WIRED)

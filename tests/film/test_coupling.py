"""Electromechanical coupling: a closed form, and readings of voltages."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.constants import epsilon_0

from pvdf_fem import Scene, solve
from pvdf_fem.film.coupling import Coupling
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.problem.problem import Problem
from tests.helpers.discs import TRIANGLE, uniform_mesh

CABLES = {"kind": {"A": "voltage", "B": "voltage"}, "cable_capacitance_pF": {"B": 20.0}}
STRONG = {"film.d31_pC_N": 60.0, "film.d32_pC_N": -20.0, "film.coupling": True, "readout": CABLES}
WIRED = TRIANGLE.with_(**STRONG)
COVERED = {"name": "A", "shape": "circle", "x_mm": 0.0, "y_mm": 0.0, "radius_mm": 44.0}


@pytest.mark.parametrize("cable_pF", [0.0, 3e4])
def test_covered_film_under_uniform_tension_is_stiffer_by_k_squared(cable_pF):
    """Stiffness up by k²/(1 - k²) C/(C + C_L), k² = 2 d² E/(ε_T (1 - ν)), over the electrode with
    C = ε_T (1 - k²) A/h."""
    readout = {"kind": "voltage", "cable_capacitance_pF": cable_pF}
    changes = {"film.d31_pC_N": 23.0, "film.d32_pC_N": 23.0, "readout": readout}
    scene = Scene().with_(**changes, electrodes=[COVERED], **{"film.coupling": True})
    equilibrium = Equilibrium(Problem.from_scene(scene), uniform_mesh(scene, 12.0), 2)
    film, space, (_, coupling) = scene.film, equilibrium.space, equilibrium.terms
    places, covered = space.basis.doflocs.T, coupling.elements
    state = equilibrium.membrane.state((1e-6 * np.insert(places, 2, 0.0, axis=1)).ravel())
    permittivity, area = 11.0 * epsilon_0, 0.044**2 * np.pi
    k2 = 2.0 * film.d31**2 * 2e9 / (permittivity * (1.0 - film.poisson_ratio))
    capacitance = permittivity * (1.0 - k2) * area / film.thickness
    density = np.einsum("epi,ij,epj->ep", state.strain, film.stiffness, state.strain)
    short = 0.5 * film.thickness * (density * space.weights)[covered].sum()
    short *= area / space.weights[covered].sum()
    # the meshed circle has the electrode's area, so that only rounding and this are left
    stiffer = k2 / (1.0 - k2) * capacitance / (capacitance + 1e-12 * cable_pF)
    assert coupling.energy(state) / short == pytest.approx(stiffer, rel=1e-6)


def test_readings_are_the_voltages_of_the_equations():
    solution = solve(WIRED)
    state = solution.discrete.solved_state
    terms = [term for term in solution.discrete.solved.terms if isinstance(term, Coupling)]
    voltages = {term.electrode.name: term.voltage(state) for term in terms}
    expected = {"C": 0.0, "D": 0.0, **voltages}
    assert solution.electrode_voltages_V == pytest.approx(expected, rel=1e-9)
    assert {name: solution.readings_V[name] for name in "AB"} == pytest.approx(voltages, rel=1e-9)
    assert solution.to_json()["electrode_voltages_V"] == solution.electrode_voltages_V

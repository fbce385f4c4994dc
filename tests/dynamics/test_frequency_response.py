"""Frequency responses against static derivatives, direct solves, and errors on finer meshes."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg

from pvdf_fem import Scene, gradients, respond
from pvdf_fem.dynamics.air import AirLoad
from pvdf_fem.dynamics.motion_equations import MotionEquations, linearise_about
from pvdf_fem.dynamics.spectrum import assemble_pencil
from pvdf_fem.electrodes.channel import make_channels
from pvdf_fem.solver.estimate.next_order import factorise_tangent
from tests.helpers.discs import LOADS, TRIANGLE, on_mesh
from tests.helpers.refusals import keys, refused

DAMPED = TRIANGLE.with_(air={"baffle": True}, **{"film.loss_tangent": 0.08})


@pytest.mark.parametrize("load", LOADS)
def test_static_limit_equals_the_static_derivative(load: str) -> None:
    scene = TRIANGLE.with_(air={"baffle": True}, **LOADS[load])
    solution = on_mesh(scene)
    found, rates = respond(solution, [0.0, 0.2]), gradients(solution)["load.force_N"]
    for name, charge in found.charges_pC_N.items():
        np.testing.assert_allclose(charge[0], rates[name], rtol=1e-9)
        np.testing.assert_allclose(charge[1], rates[name], rtol=1e-6)
        assert charge[1].imag != 0.0  # a little sound


@pytest.mark.parametrize("scene", [DAMPED, DAMPED.with_(**{"air.baffle": False})])
def test_ritz_vectors_agree_with_direct_solves(scene: Scene) -> None:
    """Solve (K + i d K_e - omega^2 M + i omega^3 r v v^T) q = f with dense matrices."""
    solution = on_mesh(scene)
    equilibrium, q, _ = factorise_tangent(solution.discrete)
    full = linearise_about(solution).equations
    air, (stiffness, mass) = AirLoad.from_equilibrium(equilibrium), assemble_pencil(equilibrium, q)
    frequencies = np.array([90.0, 480.0])
    found = respond(solution, frequencies)
    for i, omega in enumerate(2.0 * np.pi * frequencies):
        moved = stiffness + 1j * full.loss_tangent * full.elastic - omega**2 * mass
        dense = moved.toarray() - omega**2 * air.root @ air.root.T
        dense = dense + 1j * omega**3 * air.radiation * np.outer(air.volume, air.volume)
        charges = (1.0 + 1j * full.loss_tangent) * np.linalg.solve(dense, full.force) @ full.rates
        values = np.array([charge[i] for charge in found.charges_pC_N.values()])
        np.testing.assert_allclose(values, 1e12 * charges, rtol=1e-4)


def test_resonances_are_frequencies_of_the_loaded_film() -> None:
    solution = on_mesh(TRIANGLE)
    equilibrium, q, _ = factorise_tangent(solution.discrete)
    stiffness, mass = (matrix.toarray() for matrix in assemble_pencil(equilibrium, q))
    all_of = np.sqrt(scipy.linalg.eigh(stiffness, mass, eigvals_only=True)) / (2.0 * np.pi)
    found = respond(solution, [300.0, 700.0], refined=True)
    assert 1 <= found.resonances_Hz.size <= (all_of <= 700.0).sum()
    for resonance in found.resonances_Hz:
        assert np.abs(all_of / resonance - 1.0).min() < 1e-4
    apart = np.abs(found.frequencies_Hz[:, None] / found.resonances_Hz - 1.0)
    assert 0.0 < apart.min() < 2e-3
    assert found.frequencies_Hz[[0, -1]].tolist() == [300.0, 700.0]


def test_only_stretching_has_losses() -> None:
    """K_e x is 0 for deflections x, and K x - N laplace x for displacements in the plane.

    Only the tension N resists the deflection of the flat film, and only the moduli resist
    displacements in its plane.
    """
    solution = on_mesh(TRIANGLE.with_(**{"load.force_N": 0.0, "film.loss_tangent": 0.1}))
    equilibrium, q, _ = factorise_tangent(solution.discrete)
    full, space = MotionEquations.linearise(equilibrium, q), equilibrium.space
    tension = equilibrium.film.prestress[0] * equilibrium.film.thickness
    laplace = tension * equilibrium.assembly.matrix(space.laplace_matrices())
    step = np.random.default_rng(1).standard_normal(len(q))
    expected = full.stiffness @ step - laplace @ step
    np.testing.assert_allclose(full.elastic @ step, expected, atol=1e-9 * np.abs(expected).max())
    deflections = np.where(equilibrium.unknowns.mark_deflections(), step, 0.0)
    assert np.abs(full.elastic @ deflections).max() < 1e-9 * np.abs(laplace @ step).max()


def test_errors_are_of_the_right_size() -> None:
    frequencies = [1.0, 100.0, 200.0]
    coarse, fine = (
        respond(TRIANGLE.with_(**{"numerics.tolerance": t}), frequencies) for t in (1e-2, 3e-4)
    )
    true = [np.abs(coarse.charges_pC_N[n] - fine.charges_pC_N[n]).max() for n in "ABCD"]
    stated = [coarse.charge_errors_pC_N[n].max() for n in "ABCD"]
    assert 0.3 * max(true) < max(stated) < 5.0 * max(true)


def test_readings_follow_from_the_channels() -> None:
    readout = {"feedback_resistance_MOhm": 10.0, "gain": {"A": 2.0}}
    scene = TRIANGLE.with_(readout=readout)
    found = respond(on_mesh(scene), [1.0, 15.9, 300.0])
    assert list(found.readings_V_N) == list("ABCD")
    for channel in make_channels(scene):
        expected = channel.harmonic(found.frequencies_Hz) * found.charges_pC_N[channel.name] / 1e12
        np.testing.assert_allclose(found.readings_V_N[channel.name], expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"probe": None}, "probe"),
        ({"probe": {"shape": "sphere", "radius_mm": 5.0}, "load.kind": "contact"}, "load.kind"),
        ({"probe": [{"shape": "circle", "radius_mm": 2.0}]}, "probe"),
    ],
)
def test_scenes_without_an_oscillating_force_are_rejected(
    changes: dict[str, object], key: str
) -> None:
    assert keys(refused(respond, TRIANGLE.with_(**changes), 20.0)) == [key]

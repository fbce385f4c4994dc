"""The added mass of air against Lamb's and Sneddon's closed forms and Rayleigh's integral."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import j0, j1, jn_zeros

from pvdf_fem import Scene, SceneError, modes
from pvdf_fem.dynamics.air import AirLoad, _functions
from pvdf_fem.dynamics.spectrum import AIR, VACUUM

Array = NDArray[np.float64]
BAFFLED, FREE = -0.5, 0.5
ZEROS = jn_zeros(0, 12)


def energies(s: float, *shapes: str, degree: int = 30) -> Array:
    """What stands for w/|k| w on the unit disc, of shapes at Gauss points in polar coordinates."""
    x, weight = np.polynomial.legendre.leggauss(120)
    height = (x + 1.0) * np.pi / 4.0  # r = sin(height), which is smooth at the rim
    r, angle = np.meshgrid(np.sin(height), np.arange(64) * np.pi / 32.0, indexing="ij")
    area = (weight * np.pi / 8.0 * np.sin(2.0 * height))[:, None] * np.full(64, np.pi / 32.0)
    area = area * np.maximum(1.0 - r**2, 0.0) ** max(s, 0.0)
    unit = np.stack([r * np.cos(angle), r * np.sin(angle)], axis=-1).reshape(-1, 2)
    functions = np.hstack([*_functions(unit, degree, s)])
    known = {"piston": np.ones_like(r), "rocking": r * np.cos(angle)}
    found = []
    for shape in shapes:
        w = known[shape] if shape in known else j0(ZEROS[int(shape)] * r)
        found.append(np.square((w * area).ravel() @ functions).sum())
    return np.array(found)


def test_rigid_discs() -> None:
    """Lamb, Hydrodynamics, sections 102 and 108: a free disc has 8/3 rho a^3, and 16/45 rho a^5
    about a diameter; a piston in a baffle has 8/3 rho a^3 on each side (Rayleigh)."""
    np.testing.assert_allclose(energies(FREE, "piston", "rocking"), [4 / 3, 8 / 45], rtol=1e-7)
    np.testing.assert_allclose(energies(BAFFLED, "piston"), [8 / 3], rtol=1e-4)


def test_modes_in_a_baffle() -> None:
    """Gamma, added over film's mass on one side, rho_air a/(rho h) taken out."""
    gamma = energies(BAFFLED, "0", "1", "2") / (np.pi * j1(ZEROS[:3]) ** 2)
    np.testing.assert_allclose(gamma, [0.7464, 0.2616, 0.1522], atol=5e-5)


def _sneddon(i: float, j: float) -> float:
    """4 int g_i g_j dt with g = int_0^t s J0(j s)/sqrt(t^2 - s^2) ds = sin(j t)/j: Sneddon, Mixed
    Boundary Value Problems in Potential Theory (1966), section 3.5."""
    minus = 0.5 * np.sinc((i - j) / np.pi)
    return float(4.0 * (minus - 0.5 * np.sinc((i + j) / np.pi)) / (i * j * np.pi * j1(i) * j1(j)))


def test_modes_without_a_baffle() -> None:
    gamma = energies(FREE, "0", "1", "2") / (np.pi * j1(ZEROS[:3]) ** 2)
    np.testing.assert_allclose(gamma, [_sneddon(j, j) for j in ZEROS[:3]], rtol=1e-6)


def test_frequencies_in_air() -> None:
    """In a baffle by another program; without one by Sneddon's added mass of each mode alone."""
    in_air = Scene().with_(air={"density_kg_m3": 1.204}, **{"numerics.tolerance": 3e-3})
    baffled, free = (modes(in_air.with_(**{"air.baffle": b}), 15) for b in (True, False))
    spectrum = baffled.spectra[AIR]
    assert spectrum is not None
    known = np.array([69.304, 213.16, 363.28])
    true = np.abs(spectrum.frequencies[[0, 5, 14]] - known)
    assert np.all(true < 1e-3 * known)
    assert np.all(true < 2.0 * spectrum.errors[[0, 5, 14]] + 5e-5 * known)
    added = 2.0 * 1.204 * 45e-3 / (1760.0 * 25e-6) * np.array([_sneddon(j, j) for j in ZEROS[:2]])
    found = np.asarray(free.frequencies_in_air_Hz)[[0, 5]] / free.frequencies_Hz[[0, 5]]
    np.testing.assert_allclose(found, 1.0 / np.sqrt(1.0 + added), rtol=2e-2)


def test_a_punch_under_which_air_moves_along() -> None:
    """The volume that the unknowns displace is that of the deflection, and so is the mass."""
    probe = {"shape": "circle", "radius_mm": 8.0}
    scene = Scene().with_(probe=probe, load={"kind": "rigid"}, air={"baffle": False})
    found = modes(scene, 1)
    spectrum = found.spectra[VACUUM]
    equilibrium, (vector,) = spectrum.equilibrium, spectrum.vectors.T
    air = AirLoad.of(equilibrium)
    w = equilibrium.unknowns.expand(vector)[2::3]
    at_points = equilibrium.space.values @ w[equilibrium.space.nodes][..., None]
    expected = (at_points[..., 0] * equilibrium.space.weights).sum()
    assert air.volume @ vector == pytest.approx(expected, rel=1e-9)
    assert found.frequencies_in_air_Hz is not None
    assert found.frequencies_in_air_Hz[0] < 0.8 * found.frequencies_Hz[0]


def test_air_of_no_density_is_a_vacuum() -> None:
    found = modes(Scene().with_(air={"density_kg_m3": 0.0}), 3)
    np.testing.assert_allclose(found.frequencies_in_air_Hz, found.frequencies_Hz, rtol=1e-9)


def test_mistakes_are_told_by_key() -> None:
    with pytest.raises(SceneError) as error:
        Scene.parse('[air]\nbaffle = "no"\ndensity_kg_m3 = -1\n[film]\nloss_tangent = 2\n')
    keys = {text.partition(" = ")[0] for text in error.value.problems}
    assert keys == {"air.baffle", "air.density_kg_m3", "film.loss_tangent"}

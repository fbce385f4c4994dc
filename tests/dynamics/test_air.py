"""The added mass of air against Lamb's and Sneddon's closed forms and Rayleigh's integral."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import j0, j1, jn_zeros

from pvdf_fem import Scene, modes
from pvdf_fem.dynamics.air import AirLoad, _evaluate_functions
from pvdf_fem.dynamics.spectrum import AIR, VACUUM

Array = NDArray[np.float64]
BAFFLED, FREE = -0.5, 0.5
ZEROS = jn_zeros(0, 12)
#: Square of a mode, integrated over the unit disc.
MODAL = np.pi * j1(ZEROS[:3]) ** 2


def compute_energies(s: float, *shapes: str, degree: int = 30) -> Array:
    """Integrate w/|k| w over the unit disc for each shape w, at Gauss points."""
    x, weight = np.polynomial.legendre.leggauss(120)
    height = (x + 1.0) * np.pi / 4.0  # r = sin(height), which is smooth at the rim
    r, angle = np.meshgrid(np.sin(height), np.arange(64) * np.pi / 32.0, indexing="ij")
    area = (weight * np.pi / 8.0 * np.sin(2.0 * height))[:, None] * np.full(64, np.pi / 32.0)
    area = area * np.maximum(1.0 - r**2, 0.0) ** max(s, 0.0)
    unit = np.stack([r * np.cos(angle), r * np.sin(angle)], axis=-1).reshape(-1, 2)
    functions = np.hstack([*_evaluate_functions(unit, degree, s)])
    simple_shapes = {"piston": np.ones_like(r), "rocking": r * np.cos(angle)}
    found = []
    for shape in shapes:
        w = simple_shapes[shape] if shape in simple_shapes else j0(ZEROS[int(shape)] * r)
        found.append(np.square((w * area).ravel() @ functions).sum())
    return np.array(found)


def compute_added_mass(mode: int) -> float:
    """Return the added mass of a mode without a baffle.

    It is 4 int g^2 dt with g = int_0^t s J0(j s)/sqrt(t^2 - s^2) ds = sin(j t)/j (Sneddon, Mixed
    Boundary Value Problems (1966), section 3.5).
    """
    j = ZEROS[mode]
    return float(2.0 * (1.0 - np.sinc(2.0 * j / np.pi)) / (j**2 * np.pi * j1(j) ** 2))


@pytest.mark.parametrize(
    ("s", "shapes", "expected", "rtol"),
    [
        # Lamb, Hydrodynamics, sections 102 and 108: 8/3 rho a^3, and 16/45 rho a^5 about a diameter
        (FREE, ["piston", "rocking"], [4 / 3, 8 / 45], 1e-7),
        (BAFFLED, ["piston"], [8 / 3], 1e-4),  # Rayleigh: 8/3 rho a^3 on each side
        # Gamma, added over film's mass on one side, rho_air a/(rho h) taken out
        (BAFFLED, ["0", "1", "2"], MODAL * [0.7464, 0.2616, 0.1522], 2e-4),
        (FREE, ["0", "1", "2"], MODAL * [compute_added_mass(mode) for mode in range(3)], 1e-6),
    ],
)
def test_energies_agree_with_closed_forms(
    s: float, shapes: list[str], expected: Array, rtol: float
) -> None:
    np.testing.assert_allclose(compute_energies(s, *shapes), expected, rtol=rtol)


def test_frequencies_in_air() -> None:
    """Compare with another program in a baffle, and with Sneddon's added mass without one."""
    in_air = Scene().with_(air={"density_kg_m3": 1.204}, **{"numerics.tolerance": 3e-3})
    baffled, free = (modes(in_air.with_(**{"air.baffle": b}), 15) for b in (True, False))
    spectrum = baffled.spectra[AIR]
    assert spectrum is not None
    known = np.array([69.304, 213.16, 363.28])
    true = np.abs(spectrum.frequencies[[0, 5, 14]] - known)
    assert np.all(true < 2e-3 * known)  # solved to 3e-3
    assert np.all(true < 2.0 * spectrum.errors[[0, 5, 14]] + 5e-5 * known)
    weight = 2.0 * 1.204 * 45e-3 / (1760.0 * 25e-6)
    found = np.asarray(free.frequencies_in_air_Hz)[[0, 5]] / free.frequencies_Hz[[0, 5]]
    expected = [1.0 / np.sqrt(1.0 + weight * compute_added_mass(mode)) for mode in (0, 1)]
    np.testing.assert_allclose(found, expected, rtol=2e-2)


def test_air_moves_with_the_film_under_a_punch() -> None:
    """The unknowns displace the volume of the deflection, and have its added mass."""
    probe = {"shape": "circle", "radius_mm": 8.0}
    scene = Scene().with_(probe=probe, load={"kind": "rigid"}, air={"baffle": False})
    found = modes(scene, 1)
    spectrum = found.spectra[VACUUM]
    equilibrium, (vector,) = spectrum.equilibrium, spectrum.vectors.T
    air = AirLoad.from_equilibrium(equilibrium)
    w = equilibrium.unknowns.expand(vector)[2::3]
    at_points = equilibrium.space.values @ w[equilibrium.space.nodes][..., None]
    expected = (at_points[..., 0] * equilibrium.space.weights).sum()
    assert air.volume @ vector == pytest.approx(expected, rel=1e-9)
    assert found.frequencies_in_air_Hz is not None
    assert found.frequencies_in_air_Hz[0] < 0.8 * found.frequencies_Hz[0]

"""A neo-Hookean film: closed forms of its law, an inflated disc, patches, heat and derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from pvdf_fem import Scene, solve
from pvdf_fem.film.laws.neo_hookean import NeoHookean
from pvdf_fem.scene.film import plane_stress
from reports.reference.neo_hookean_inflation import inflated

NONE = np.zeros(3)
RUBBER = Scene().with_(
    **{
        "film.law": "neo-hookean",
        "film.youngs_modulus_GPa": 1e-3,
        "film.poisson_ratio": 0.49,
        "film.thickness_um": 200.0,
        "film.temperature_change_K": 0.0,
        "numerics.tolerance": 1e-3,
    }
)
DISC = {"shape": "circle", "radius_mm": 4.0, "x_mm": 6.0, "y_mm": 2.0}
PATCH = {"shape": "circle", "x_mm": -18.0, "y_mm": 4.0, "radius_mm": 6.0, "thickness_um": 300.0}


def law(nu: float, kind: type = NeoHookean) -> NeoHookean:
    """A law of Young's modulus 1 Pa."""
    return kind(plane_stress(1.0, 1.0, nu))


def green(F: np.ndarray) -> np.ndarray:
    """Voigt components of (F^T F - 1)/2."""
    E = 0.5 * (F.T @ F - np.eye(2))
    return np.array([E[0, 0], E[1, 1], 2.0 * E[0, 1]])


@pytest.mark.parametrize("stretch", [0.7, 1.05, 2.0])
@pytest.mark.parametrize("nu", [0.0, 0.3, 0.4999999])
def test_stretches_in_one_and_two_directions(nu, stretch):
    """Nominal stress mu (l - l^(-1-2 nu)) of a bar, which narrows by l^-nu; of a sheet that is
    stretched in all directions mu (l - l^(-1-4 m)), which is mu (l - l^-5) for nu = 1/2."""
    mu, m = 0.5 / (1.0 + nu), nu / (1.0 - nu)
    along, across = law(nu).stress(green(np.diag([stretch, stretch**-nu])), NONE)[:2]
    assert stretch * along == pytest.approx(mu * (stretch - stretch ** (-1.0 - 2.0 * nu)))
    assert across == pytest.approx(0.0, abs=1e-14)
    both = law(nu).stress(green(stretch * np.eye(2)), NONE)
    wanted = mu * (stretch - stretch ** (-1.0 - 4.0 * m))
    assert stretch * both == pytest.approx([wanted, wanted, 0.0], abs=1e-15)


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.49])
def test_stress_and_moduli_are_derivatives_of_the_energy(nu):
    random = np.random.default_rng(3)
    strain, rest = 0.2 * random.uniform(-1.0, 1.0, (2, 20, 3))
    of, h = law(nu), 1e-30
    for i, e in enumerate(np.eye(3)):
        moved = strain + 1j * h * e
        assert of.energy(moved, rest).imag / h == pytest.approx(of.stress(strain, rest)[:, i])
        changes = of.stress(moved, rest).imag / h
        assert changes == pytest.approx(of.moduli(strain, rest)[..., i], rel=1e-12)


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.49])
def test_a_strain_at_rest_is_a_deformation_before(nu):
    """S = U Se(U C U) U/J of the solid that was stretched by U."""
    F, before = np.array([[1.2, 0.3], [0.1, 0.9]]), np.array([[1.3, 0.2], [0.2, 1.1]])
    whole = law(nu).stress(green(F @ before), NONE)[[[0, 2], [2, 1]]]
    J = np.linalg.det(before) ** (1.0 - nu / (1.0 - nu))
    wanted = before @ whole @ before / J
    found = law(nu).stress(green(F), green(before))
    assert found == pytest.approx([wanted[0, 0], wanted[1, 1], wanted[0, 1]], rel=1e-12)
    energy = law(nu).energy(green(F), green(before))
    assert energy == pytest.approx(law(nu).energy(green(F @ before), NONE) / J)


def test_a_pretension_that_is_given_is_the_tension_at_rest():
    taut = RUBBER.with_(**{"film.pretension_N_m": [40.0, 15.0], "film.d31_pC_N": 1.0})
    area = 9.0  # mm², of an electrode
    charges = solve(taut.with_(**{"film.d32_pC_N": 0.0})).charges_pC
    assert charges["A"] == pytest.approx(area * 1e-6 * 40.0 / 200e-6, rel=1e-12)


@pytest.mark.parametrize(("nu", "stretch"), [(0.49, 1.3), (0.3, 1.15)])
def test_an_inflated_disc_is_that_in_one_dimension(nu, stretch):
    exact, mu = inflated(stretch, nu), 1e6 / (2.0 * (1.0 + nu))
    pascal = exact.pressure * mu * 200e-6 / 45e-3
    changes = {"film.poisson_ratio": nu, "film.pressure_Pa": pascal}
    solution = solve(RUBBER.with_(**changes, **{"film.pressure_follows": True}))
    assert solution.deflection_max_mm / 45.0 == pytest.approx(exact.height, rel=2e-4)
    centre = 1e6 * float(solution.at(0.0, 0.0).stress_MPa[0])
    m = nu / (1.0 - nu)
    assert centre == pytest.approx(mu * (1.0 - stretch ** (-4.0 * m - 2.0)), rel=2e-3)


def test_large_strains_are_remarked_where_the_law_ends():
    def about_strain(scene):
        return [text for text in solve(scene).warnings if text.startswith("strain")]

    stretched = RUBBER.with_(**{"film.pressure_Pa": 600.0})
    assert not about_strain(stretched)
    assert about_strain(stretched.with_(**{"film.law": "hooke"}))
    assert about_strain(RUBBER.with_(**{"film.pressure_Pa": 4500.0}))

"""Material laws: derivatives of every law, closed forms, and the conditions of a tension field."""

from __future__ import annotations

import numpy as np
import pytest

from pvdf_fem import Scene
from pvdf_fem.film.laws.laminate import LAWS
from pvdf_fem.film.laws.law import Law
from pvdf_fem.film.laws.neo_hookean import NeoHookean
from pvdf_fem.film.laws.tension_field import TensionField
from pvdf_fem.scene.placed.patch import compute_plane_stress_stiffness

NONE = np.zeros(3)
#: Young's moduli of about 1 Pa, a Poisson's ratio, and what else a film has.
MATERIALS = {
    "isotropic": compute_plane_stress_stiffness(1.0, 1.0, 0.34),
    "without Poisson's ratio": compute_plane_stress_stiffness(1.0, 1.0, 0.0),
    "incompressible": compute_plane_stress_stiffness(1.0, 1.0, 0.499),
    "orthotropic": compute_plane_stress_stiffness(1.0, 0.02, 0.3),
    "soft in shear": compute_plane_stress_stiffness(0.02, 1.0, 0.005, 2e-4),
}
ISOTROPIC = list(MATERIALS)[:3]
CASES = [(kind, name) for kind in (*LAWS.values(), TensionField) for name in MATERIALS]
CASES = [(kind, name) for kind, name in CASES if kind is not NeoHookean or name in ISOTROPIC]


@pytest.mark.parametrize(("kind", "material"), CASES)
def test_stress_and_moduli_are_derivatives(kind, material):
    """Of the energy and of the stress, in 99 of 100 strains: a wrinkling film has kinks."""
    law, h = kind(MATERIALS[material]), 1e-5
    strain, rest, step = 0.1 * np.random.default_rng(3).uniform(-1.0, 1.0, (3, 500, 3))

    def differences(of):
        return (of(strain + h * step, rest) - of(strain - h * step, rest)) / (2.0 * h)

    def close(found, expected):
        error = np.abs(found - expected).reshape(len(strain), -1).max(axis=1)
        return np.quantile(error, 0.99) < 1e-6 * np.abs(expected).max()

    stress, moduli = law.stress(strain, rest), law.tangent_stiffness(strain, rest)
    change = np.matmul(moduli, step[..., None])[..., 0]
    assert close((stress * step).sum(axis=1), differences(law.energy))
    assert close(change, differences(law.stress))
    assert close(law.stress(strain + 1e-20j * step, rest).imag / 1e-20, change)


class Wrapped:
    """Holds the law of which a test takes the energy or the stress alone."""

    def __init__(self, stiffness):
        super().__init__(stiffness)
        self.solid = NeoHookean(stiffness)


class ByEnergy(Wrapped, Law):
    def energy(self, strain, prestrain):
        return self.solid.energy(strain, prestrain)


class ByStress(Wrapped, Law):
    def stress(self, strain, prestrain):
        return self.solid.stress(strain, prestrain)


@pytest.mark.parametrize("law_class", [ByEnergy, ByStress])
def test_an_energy_or_a_stress_makes_a_law(law_class):
    """The rest follows by complex steps, and along a path; second derivatives of an energy by
    differences."""
    solid, law = (kind(MATERIALS["isotropic"]) for kind in (NeoHookean, law_class))
    strain, rest, step = 0.1 * np.random.default_rng(3).uniform(-1.0, 1.0, (3, 50, 3))
    np.testing.assert_allclose(law.stress(strain, rest), solid.stress(strain, rest), atol=1e-14)
    exact = 1e-13 if law_class is ByStress else 1e-9
    moduli = solid.tangent_stiffness(strain, rest)
    np.testing.assert_allclose(law.tangent_stiffness(strain, rest), moduli, atol=exact)
    rate = law.stress(strain + 1e-20j * step, rest).imag / 1e-20
    np.testing.assert_allclose(rate, np.matmul(moduli, step[..., None])[..., 0], atol=exact)
    since_flat = [one.energy(strain, rest) - one.energy(0.0 * strain, rest) for one in (law, solid)]
    np.testing.assert_allclose(*since_flat, rtol=1e-10)
    film = Scene().with_(**{"film.pretension_N_m": 50.0}).film
    kinds = law_class, NeoHookean
    found = [kind(film.stiffness).compute_prestrain(film) for kind in kinds]
    np.testing.assert_allclose(*found, rtol=1e-9)


def test_a_law_without_energy_and_stress_is_refused():
    with pytest.raises(TypeError, match="define one of them"):
        type("Empty", (Law,), {})


def green(F):
    """Voigt components of (F^T F - 1)/2."""
    E = 0.5 * (F.T @ F - np.eye(2))
    return np.array([E[0, 0], E[1, 1], 2.0 * E[0, 1]])


@pytest.mark.parametrize("stretch", [0.7, 1.05, 2.0])
@pytest.mark.parametrize("nu", [0.0, 0.3, 0.4999999])
def test_neo_hookean_stretches_in_one_and_two_directions(nu, stretch):
    """Nominal stress mu (l - l^(-1-2 nu)) of a bar, which narrows by l^-nu; of a sheet that is
    stretched in all directions mu (l - l^(-1-4 m)), which is mu (l - l^-5) for nu = 1/2."""
    law, mu, m = (
        NeoHookean(compute_plane_stress_stiffness(1.0, 1.0, nu)),
        0.5 / (1.0 + nu),
        nu / (1.0 - nu),
    )
    along, across, _ = law.stress(green(np.diag([stretch, stretch**-nu])), NONE)
    assert stretch * along == pytest.approx(mu * (stretch - stretch ** (-1.0 - 2.0 * nu)))
    assert across == pytest.approx(0.0, abs=1e-14)
    both = law.stress(green(stretch * np.eye(2)), NONE)
    wanted = mu * (stretch - stretch ** (-1.0 - 4.0 * m))
    assert stretch * both == pytest.approx([wanted, wanted, 0.0], abs=1e-14)


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.49])
def test_a_neo_hookean_strain_at_rest_is_a_deformation_before(nu):
    """S = U Se(U C U) U/J of the solid that was stretched by U."""
    law = NeoHookean(compute_plane_stress_stiffness(1.0, 1.0, nu))
    F, before = np.array([[1.2, 0.3], [0.1, 0.9]]), np.array([[1.3, 0.2], [0.2, 1.1]])
    whole = law.stress(green(F @ before), NONE)[[[0, 2], [2, 1]]]
    J = np.linalg.det(before) ** (1.0 - nu / (1.0 - nu))
    wanted = before @ whole @ before / J
    found = law.stress(green(F), green(before))
    assert found == pytest.approx([wanted[0, 0], wanted[1, 1], wanted[0, 1]], rel=1e-12)
    energy = law.energy(green(F), green(before))
    assert energy == pytest.approx(law.energy(green(F @ before), NONE) / J)


def determinant(tensor, shear=1.0):
    return tensor[..., 0] * tensor[..., 1] - (shear * tensor[..., 2]) ** 2


@pytest.mark.parametrize("material", MATERIALS)
def test_stress_and_wrinkles_are_complementary(material):
    """The conditions of the minimum over P, which has no other solution."""
    law, strain = TensionField(MATERIALS[material]), np.random.default_rng(3).normal(size=(3000, 3))
    stress = law.stress(strain)
    wrinkles = stress @ law.compliance - strain
    size, most = np.abs(stress).max(), np.abs(strain).max()
    assert stress[:, :2].sum(axis=1).min() >= 0.0
    assert wrinkles[:, :2].sum(axis=1).min() > -1e-12 * most
    assert determinant(stress).min() > -1e-12 * size**2
    assert determinant(wrinkles, 0.5).min() > -1e-10 * most**2
    assert np.abs((stress * wrinkles).sum(axis=1)).max() < 1e-12 * size * most
    taut = np.abs(wrinkles).max(axis=1) < 1e-12 * most
    slack = ~stress.any(axis=1)
    assert min(taut.mean(), slack.mean(), (~taut & ~slack).mean()) > 0.1

"""Frequencies against closed forms, and eigenpairs against the equations they come from."""

from __future__ import annotations

import re

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import jn_zeros, jv, jvp, mathieu_modcem1, yv, yvp
from skfem import BilinearForm
from skfem.helpers import dot

from pvdf_fem import Scene
from pvdf_fem.dynamics.modes import Modes, modes
from pvdf_fem.dynamics.spectrum import VACUUM
from pvdf_fem.film.weak_form import vector_basis
from pvdf_fem.solvers.status import NotConvergedError, Status
from reports.accuracy.drawn import random_scene
from reports.reference.closed_form import disc_frequencies

TRIANGLE = '[probe]\nshape = "triangle"\nx_mm = 5.0714\ny_mm = 0.8757\n'


def with_tolerance(scene: Scene, tolerance: float) -> Scene:
    return scene.with_(**{"numerics.tolerance": tolerance})


def wave_speed(scene: Scene) -> float:
    """sqrt(N/(rho h)) of the flat isotropic film, with N/h = E alpha |dT|/(1 - nu)."""
    film = scene.film
    modulus = film.youngs_modulus_GPa
    assert isinstance(modulus, float)
    stress = 1e9 * modulus * film.strain_at_rest[0] / (1.0 - film.poisson_ratio)
    return float(np.sqrt(stress / film.density))


def exact(scene: Scene, count: int) -> NDArray[np.float64]:
    """Rayleigh's stretched disc."""
    film = scene.film
    areal = film.density * film.thickness
    return disc_frequencies(
        count, radius=film.radius, tension=areal * wave_speed(scene) ** 2, areal_density=areal
    )


def test_thesis_film_sounds_at_117_hertz() -> None:
    """Mirbagheri's thesis gives 117 Hz; j01 c/(2 pi a) with its film is 117.05 Hz."""
    found = modes(Scene(), 1)
    np.testing.assert_allclose(found.frequencies_Hz, [117.0508], rtol=1e-3)


def test_disc_to_five_digits() -> None:
    """j01, j11 twice, j21 twice, j02: Rayleigh, Theory of Sound, chapter IX."""
    scene = with_tolerance(Scene(), 1e-5)
    zeros = [jn_zeros(m, n)[-1] for m, n in ((0, 1), (1, 1), (1, 1), (2, 1), (2, 1), (0, 2))]
    expected = np.array(zeros) * wave_speed(scene) / (2.0 * np.pi * scene.film.radius)
    np.testing.assert_allclose(modes(scene).frequencies_Hz, expected, rtol=1e-5)


@pytest.mark.parametrize("changes", [{}, {"film.radius_mm": 4.0, "film.temperature_change_K": -90}])
@pytest.mark.parametrize(("count", "tolerance"), [(1, 1e-2), (6, 1e-3), (40, 1e-2)])
def test_tolerance_is_met_and_no_mode_is_missed(
    changes: dict[str, float], count: int, tolerance: float
) -> None:
    layout = {"electrodes.ring_radius_mm": 2.0, "electrodes.side_mm": 0.5}
    scene = with_tolerance(Scene().with_(**layout, **changes), tolerance)
    found = modes(scene, count)
    errors = np.abs(found.frequencies_Hz - exact(scene, count))
    assert np.all(errors <= tolerance * exact(scene, count))
    # the estimate leaves out the rim's polynomial shape, which matters to the lowest mode alone
    np.testing.assert_allclose(found.frequency_errors_Hz, errors, rtol=0.2)


#: Under this punch the next order lowers the first frequency through the mode's shape by nearly
#: what it raises it through the film's stress: the sum of both was 0.03 of the true error.
CANCELLING = Scene.parse(
    """
    [film]
    poisson_ratio = 0.3197
    temperature_change_K = -1.5806
    [probe]
    shape = "rectangle"
    width_mm = 6.3395
    height_mm = 3.8933
    x_mm = -10.9077
    y_mm = -4.4821
    rotation_deg = 139.597
    [load]
    kind = "rigid"
    contact = "stuck"
    force_N = 2.2131
    """
)


def errors_of_modes(
    scene: Scene, tolerance: float, count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Stated and true errors of the loaded film's frequencies."""
    coarse, fine = (
        modes(with_tolerance(scene, t), count, loaded=True) for t in (tolerance, tolerance / 10)
    )
    return coarse.frequency_errors_Hz, np.abs(coarse.frequencies_Hz - fine.frequencies_Hz)


def test_errors_that_could_cancel() -> None:
    stated, true = errors_of_modes(CANCELLING, 1e-2, 4)
    assert np.all(stated >= 0.3 * true)
    assert np.all(stated <= 10.0 * true)


@pytest.mark.parametrize("seed", range(4))
def test_errors_are_of_the_right_size(seed: int) -> None:
    """A membrane, two punches and a film that bends, with any probe, place and moduli."""
    rng = np.random.default_rng(seed)
    kinds: list[dict[str, object]] = [
        {},
        {"load.kind": "rigid"},
        {"load.kind": "rigid", "load.contact": "stuck"},
        {"film.bending": True, "film.thickness_um": 110.0},
    ]
    tolerance = 6e-2 if seed == 3 else 2e-2  # films that bend take longer
    stated, true = errors_of_modes(random_scene(rng, **kinds[seed]), tolerance, 3)
    assert np.all(stated >= 0.3 * true)


def test_shapes_are_bessel_functions() -> None:
    """Axisymmetric modes J0(j0n r/a), scaled to 1 at the centre; none moves in the plane."""
    found = modes(with_tolerance(Scene(), 1e-4))
    radius = np.linalg.norm(found.basis.doflocs, axis=0) / found.scene.film.radius
    for mode, n in ((0, 1), (5, 2)):
        expected = jv(0, jn_zeros(0, n)[-1] * radius)
        np.testing.assert_allclose(found.shapes[mode, :, 2], expected, atol=2e-3)
    assert found.shapes.shape == (6, found.basis.N, 3)
    assert np.abs(found.shapes[..., :2]).max() < 1e-9
    np.testing.assert_allclose(found.shapes.max(axis=(1, 2)), 1.0)


def test_orthotropic_film_under_unequal_tensions() -> None:
    """N1 w,xx + N2 w,yy is the Laplacian in x/sqrt(N1), y/sqrt(N2), there on an ellipse.

    Its first eigenvalue lies between those of the discs inside and around it, and by Faber and
    Krahn (1923) above that of the disc of the same area.
    """
    scene = Scene.parse("[film]\nyoungs_modulus_GPa = [4.0, 1.0]\n")
    film = scene.film
    n1, n2 = film.thickness * (film.stiffness @ film.strain_at_rest)[:2]
    assert n1 > 2.0 * n2
    (found,) = modes(scene, 1).frequencies_Hz
    areal = film.density * film.thickness
    disc, larger = (
        disc_frequencies(1, radius=film.radius, tension=n, areal_density=areal)[0]
        for n in (np.sqrt(n1 * n2), n1)
    )
    assert disc < found < larger


def test_unequal_tensions_make_an_elliptic_drum() -> None:
    """In x/sqrt(N1), y/sqrt(N2) it is a drum with Mathieu's functions ce_0 and Mc_0.

    McLachlan, Theory and Application of Mathieu Functions (1947), section 16.13.
    """
    scene = with_tolerance(Scene().with_(**{"film.pretension_N_m": [12.0, 5.0]}), 1e-5)
    film = scene.film
    long, short = film.radius / np.sqrt([5.0, 12.0])
    rim = np.arctanh(short / long)
    # between the drums inside and around the ellipse
    focus = np.sqrt(long**2 - short**2)
    low, high = (0.25 * (2.4048 / a * focus) ** 2 for a in (long, short))
    q = brentq(lambda q: mathieu_modcem1(0, q, rim)[0], low, high)
    expected = np.sqrt(q) / (np.pi * focus * np.sqrt(film.density * film.thickness))
    assert modes(scene, 1).frequencies_Hz[0] == pytest.approx(expected, rel=1e-5)


def test_frequencies_of_a_given_tension() -> None:
    scene = Scene().with_(**{"film.pretension_N_m": 20.0, "film.youngs_modulus_GPa": [3.0, 1.0]})
    film = scene.film
    expected = disc_frequencies(
        3, radius=film.radius, tension=20.0, areal_density=film.density * film.thickness
    )
    np.testing.assert_allclose(modes(scene, 3).frequencies_Hz, expected, rtol=1e-3)


def punched(scene: Scene, diameters: int) -> float:
    """First frequency of the annulus around a centred punch, Hz.

    Annular membrane (Rayleigh, Theory of Sound, section 201) on c^2 laplace w = -omega^2 w, fixed
    outside. Inside, a punch that stays horizontal follows an axisymmetric mode with the mass of the
    film below it, 2 pi b N w' = -omega^2 rho h pi b^2 w, and is at rest in the others.
    """
    a, b = scene.film.radius, 8e-3

    def determinant(k: float) -> float:
        outer, inner = (
            np.array([jv(diameters, k * r), yv(diameters, k * r)], dtype=float) for r in (a, b)
        )
        if diameters == 0:
            inner = k * np.array([jvp(0, k * b), yvp(0, k * b)]) + 0.5 * k**2 * b * inner
        return float(outer[0] * inner[1] - outer[1] * inner[0])

    k = (
        brentq(determinant, 2.0 / a, 2.8 / a)
        if diameters == 0
        else brentq(determinant, 3.5 / a, 5.0 / a)
    )
    return float(k) * wave_speed(scene) / (2.0 * np.pi)


def test_of_several_probes_only_rigid_ones_bind_the_flat_film() -> None:
    rigid = {"shape": "circle", "radius_mm": 4.0, "x_mm": -8.0, "load": {"kind": "rigid"}}
    tip = {"shape": "sphere", "radius_mm": 5.0, "x_mm": 9.0, "load": {"kind": "contact"}}
    dead = {"shape": "circle", "radius_mm": 2.0, "y_mm": 12.0}
    alone, beside = (modes(Scene(probe=p), 2) for p in ([rigid], [rigid, tip, dead]))
    assert beside.frequencies_Hz == pytest.approx(alone.frequencies_Hz, rel=1e-12)


def test_rigid_punch_binds_the_flat_film() -> None:
    text = '[probe]\nshape = "circle"\nradius_mm = 8\n[load]\nkind = "rigid"\n'
    found = modes(with_tolerance(Scene.parse(text), 1e-3), 3)
    expected = [punched(found.scene, m) for m in (0, 1, 1)]
    np.testing.assert_allclose(found.frequencies_Hz, expected, rtol=1e-3)
    assert expected[1] > 1.02 * exact(found.scene, 2)[1]
    below = np.unique(found.basis.element_dofs[:, found.basis.mesh.subdomains["probe"]])
    assert np.ptp(found.shapes[0, below, 2]) == 0.0


@pytest.mark.parametrize(
    "load",
    ['kind = "dead"', 'kind = "follower"', 'kind = "rigid"', 'kind = "rigid"\ncontact = "stuck"'],
)
def test_loaded_modes_solve_the_linearised_motion(load: str) -> None:
    """omega^2 M phi against the change of the residual along phi, by central differences."""
    found = modes(Scene.parse(f"{TRIANGLE}[load]\n{load}\n"), 6, loaded=True)
    assert np.all(np.diff(found.frequencies_Hz) > 0.0)
    spectrum = found.spectra[VACUUM]
    equilibrium, q = spectrum.equilibrium, spectrum.q
    basis, film = vector_basis(equilibrium.space), found.scene.film
    mass = film.density * film.thickness * BilinearForm(lambda u, v, _: dot(u, v)).assemble(basis)
    for frequency, vector in zip(found.frequencies_Hz, spectrum.vectors.T, strict=True):
        step = 1e-7 * vector / np.abs(vector).max()
        before, after = (equilibrium.residual(equilibrium.state(q + s * step)) for s in (-1, 1))
        forces = mass @ equilibrium.unknowns.expand(step)
        inertia = np.zeros(len(q) + 1)
        np.add.at(inertia, equilibrium.unknowns.of_dof, (2 * np.pi * frequency) ** 2 * forces)
        scale = np.abs(inertia[:-1]).max()
        np.testing.assert_allclose(0.5 * (after - before), inertia[:-1], atol=1e-6 * scale)


def test_vanishing_load_gives_the_flat_film() -> None:
    scene = Scene.parse(TRIANGLE)
    slight = modes(scene.with_(**{"load.force_N": 1e-5}), 3, loaded=True)
    np.testing.assert_allclose(slight.frequencies_Hz, exact(scene, 3), rtol=1e-3)


def test_follower_does_not_act_on_the_flat_film() -> None:
    scene = Scene.parse(f'{TRIANGLE}[load]\nkind = "follower"\nforce_N = 5.0\n')
    np.testing.assert_allclose(modes(scene, 3).frequencies_Hz, exact(scene, 3), rtol=1e-3)


def test_loaded_film_needs_no_pretension() -> None:
    scene = Scene.parse(f"{TRIANGLE}[film]\ntemperature_change_K = 0\n")
    assert modes(scene, 1, loaded=True).frequencies_Hz[0] > 117.0


@pytest.mark.parametrize("loaded", [False, True])
@pytest.mark.parametrize(("dT", "status"), [(0.0, Status.SINGULAR), (1.0, Status.UNSTABLE)])
def test_no_frequencies_without_tension(dT: float, status: Status, loaded: bool) -> None:
    found = modes(Scene().with_(**{"film.temperature_change_K": dT}), loaded=loaded)
    assert found.status is status
    assert "film.temperature_change_K below zero" in found.reason
    with pytest.raises(NotConvergedError, match=r"film\.temperature_change_K below zero"):
        _ = found.frequencies_Hz
    assert "frequencies_Hz" not in found.to_json()


@pytest.mark.parametrize(
    ("pair", "film", "status"),
    [
        ([9.0, 0.0], {}, Status.SINGULAR),
        ([9.0, -1.0], {}, Status.UNSTABLE),
        ([9.0, -1.0], {"film.compression": "tension-field"}, Status.SINGULAR),
    ],
)
def test_no_frequencies_without_tension_in_one_direction(pair, film, status) -> None:
    found = modes(Scene().with_(**{"film.pretension_N_m": pair}, **film))
    assert found.status is status
    assert "film.pretension_N_m above" in found.reason


def test_unreachable_tolerance_is_said_before_meshing() -> None:
    found = modes(with_tolerance(Scene(), 2e-8), 100)
    assert found.status is Status.TOLERANCE
    assert "numerics.max_unknowns" in found.reason
    assert "raise numerics.tolerance" in found.reason
    assert "mesh" not in found.seconds


def test_neglected_terms_have_sizes() -> None:
    """Bending length 0.594 mm over 45 mm, and half its square times that of the wavenumber, which
    is taken as 3.2; 1.2 kg/m3 x 45 mm over 1760 kg/m3 x 25 um.

    With bending in the model the frequency rises by 1.32 %.
    """

    def left_out(found: Modes) -> str:
        return " ".join(found.left_out)

    assert "about 1.4%" in left_out(modes(Scene(), 1))
    told = re.search(
        r"about ([\d.]+) times the film's mass, ([\d.]+) without a baffle",
        left_out(modes(Scene(), 1)),
    )
    for baffle, size in zip((True, False), told.groups(), strict=True):
        found = modes(Scene().with_(air={"baffle": baffle}), 1)
        added = (found.frequencies_Hz / found.frequencies_in_air_Hz) ** 2 - 1.0
        assert float(size) == pytest.approx(added[0], rel=0.05)
    thick = modes(Scene().with_(**{"film.thickness_um": 1000.0}), 1)
    assert "as a plate" in left_out(thick)

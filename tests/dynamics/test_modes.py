"""Frequencies against closed forms, and eigenpairs against the equations of motion."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import jn_zeros, jv, jvp, mathieu_modcem1, yv, yvp
from skfem import BilinearForm
from skfem.helpers import dot

from pvdf_fem import NotConvergedError, Scene
from pvdf_fem.dynamics.modes import modes
from pvdf_fem.dynamics.spectrum import VACUUM
from pvdf_fem.film.weak_form import make_vector_basis
from pvdf_fem.solver.nonlinear.status import Status
from reports.accuracy.drawn import make_random_scene
from reports.reference.closed_form import disc_frequencies
from tests.helpers.discs import LOADS, TRIANGLE

TIGHT = Scene().with_(**{"film.pretension_N_m": 20.0, "film.youngs_modulus_GPa": [3.0, 1.0]})
SMALL = {"film.radius_mm": 4.0, "electrodes.ring_radius_mm": 2.0, "electrodes.side_mm": 0.5}


def compute_exact_frequencies(scene, count):
    """Return the frequencies in Hz of Rayleigh's stretched disc."""
    film = scene.film
    shape = {"radius": film.radius, "areal_density": film.density * film.thickness}
    tension = float(film.thickness * film.prestress[0])
    return disc_frequencies(count, tension=tension, **shape)


@pytest.mark.parametrize(
    ("scene", "count", "tolerance"),
    [(Scene(), 1, 1e-2), (TIGHT, 6, 1e-3), (Scene().with_(**SMALL), 40, 1e-2)],
)
def test_frequencies_meet_the_tolerance_and_no_mode_is_missing(scene, count, tolerance):
    found = modes(scene.with_(**{"numerics.tolerance": tolerance}), count)
    errors = np.abs(found.frequencies_Hz - compute_exact_frequencies(scene, count))
    assert np.all(errors <= tolerance * compute_exact_frequencies(scene, count))
    # the estimate neglects the polynomial shape of the rim, which matters to the lowest mode only
    np.testing.assert_allclose(found.frequency_errors_Hz, errors, rtol=0.2)


#: Under this punch the next order raises the first frequency through the film's stress and lowers
#: it through the mode's shape by nearly as much: the sum of both was 0.03 of the true error.
CANCELLING = Scene().with_(
    film={"poisson_ratio": 0.3197, "temperature_change_K": -1.5806},
    probe={"shape": "rectangle", "width_mm": 6.3395, "height_mm": 3.8933}
    | {"x_mm": -10.9077, "y_mm": -4.4821, "rotation_deg": 139.597},
    load={"kind": "rigid", "contact": "stuck", "force_N": 2.2131},
)


SLIDING = make_random_scene(np.random.default_rng(1), **LOADS["sliding"])


@pytest.mark.parametrize(("scene", "tolerance"), [(CANCELLING, 1e-2), (SLIDING, 2e-2)])
def test_errors_are_of_the_right_size(scene, tolerance):
    coarse, fine = (
        modes(scene.with_(**{"numerics.tolerance": t}), 3, loaded=True)
        for t in (tolerance, tolerance / 10.0)
    )
    stated, true = coarse.frequency_errors_Hz, np.abs(coarse.frequencies_Hz - fine.frequencies_Hz)
    assert np.all(stated >= 0.3 * true)
    assert np.max(stated) <= 20.0 * np.max(true)


def test_shapes_are_bessel_functions():
    """Axisymmetric modes J0(j0n r/a), scaled to 1 at the centre; none moves in the plane."""
    found = modes(Scene().with_(**{"numerics.tolerance": 1e-4}))
    radius = np.linalg.norm(found.basis.doflocs, axis=0) / found.scene.film.radius
    for mode, n in ((0, 1), (5, 2)):
        expected = jv(0, jn_zeros(0, n)[-1] * radius)
        np.testing.assert_allclose(found.shapes[mode, :, 2], expected, atol=2e-3)
    assert found.shapes.shape == (6, found.basis.N, 3)
    assert np.abs(found.shapes[..., :2]).max() < 1e-9
    np.testing.assert_allclose(found.shapes.max(axis=(1, 2)), 1.0)


def test_unequal_tensions_make_an_elliptic_drum():
    """In x/sqrt(N1), y/sqrt(N2) it is a drum with Mathieu's functions ce_0 and Mc_0.

    McLachlan, Theory and Application of Mathieu Functions (1947), section 16.13.
    """
    changes = {"film.pretension_N_m": [12.0, 5.0], "numerics.tolerance": 1e-5}
    scene = Scene().with_(**changes)
    film = scene.film
    long, short = film.radius / np.sqrt([5.0, 12.0])
    rim = np.arctanh(short / long)
    # between the drums inside and around the ellipse
    focus = np.sqrt(long**2 - short**2)
    low, high = (0.25 * (2.4048 / a * focus) ** 2 for a in (long, short))
    q = brentq(lambda q: mathieu_modcem1(0, q, rim)[0], low, high)
    expected = np.sqrt(q) / (np.pi * focus * np.sqrt(film.density * film.thickness))
    assert modes(scene, 1).frequencies_Hz[0] == pytest.approx(expected, rel=1e-5)


def compute_punched_ratio(scene, diameters, bounds):
    """Return the first frequency of the annulus around a centred punch over that of the drum.

    Annular membrane (Rayleigh, Theory of Sound, section 201) on c^2 laplace w = -omega^2 w, fixed
    outside. Inside, a punch that stays horizontal follows an axisymmetric mode with the mass of the
    film below it, 2 pi b N w' = -omega^2 rho h pi b^2 w, and is at rest in the others.
    """
    b = scene.probe.radius_mm / scene.film.radius_mm

    def determinant(k):
        outer, inner = (
            np.array([jv(diameters, k * r), yv(diameters, k * r)], dtype=float) for r in (1.0, b)
        )
        if diameters == 0:
            inner = k * np.array([jvp(0, k * b), yvp(0, k * b)]) + 0.5 * k**2 * b * inner
        return float(outer[0] * inner[1] - outer[1] * inner[0])

    return brentq(determinant, *bounds) / jn_zeros(0, 1)[0]


def test_rigid_punch_binds_the_flat_film():
    scene = Scene().with_(probe={"shape": "circle", "radius_mm": 8.0}, **LOADS["sliding"])
    found, (drum,) = modes(scene, 3), compute_exact_frequencies(scene, 1)
    ratios = [
        compute_punched_ratio(scene, 0, (2.0, 2.8)),
        *2 * [compute_punched_ratio(scene, 1, (3.5, 5.0))],
    ]
    np.testing.assert_allclose(found.frequencies_Hz / drum, ratios, rtol=1e-3)
    below = np.unique(found.basis.element_dofs[:, found.basis.mesh.subdomains["probe"]])
    assert np.ptp(found.shapes[0, below, 2]) == 0.0


def test_only_rigid_probes_change_the_modes_of_the_flat_film():
    rigid = {"shape": "circle", "radius_mm": 4.0, "x_mm": -8.0, "load": {"kind": "rigid"}}
    tip = {"shape": "sphere", "radius_mm": 5.0, "x_mm": 9.0, "load": {"kind": "contact"}}
    dead = {"shape": "circle", "radius_mm": 2.0, "y_mm": 12.0}
    alone, beside = (modes(Scene(probe=p), 2) for p in ([rigid], [rigid, tip, dead]))
    assert beside.frequencies_Hz == pytest.approx(alone.frequencies_Hz, rel=1e-12)
    moved = {"film.rim_displacement_um": [0.1], "numerics.tolerance": 1e-2}
    pushed = {**LOADS["stuck"], "load.tangential_N": [1.0, 0.0], "probe.temperature_K": 3.0}
    touches = (LOADS["stuck"], {**pushed, "load.force_N": 5.0})
    found = [modes(TRIANGLE.with_(**moved, **touch), 1).frequencies_Hz[0] for touch in touches]
    assert found[0] == pytest.approx(found[1], rel=1e-12)
    follower = TRIANGLE.with_(**LOADS["follower"], **{"load.force_N": 5.0})
    np.testing.assert_allclose(
        modes(follower, 3).frequencies_Hz, compute_exact_frequencies(follower, 3), rtol=1e-3
    )


@pytest.mark.parametrize("load", LOADS)
def test_loaded_modes_solve_the_linearised_motion(load):
    """omega^2 M phi against the change of the residual along phi, by central differences."""
    slack = {"film.temperature_change_K": 0.0} if load == "dead" else {}
    found = modes(TRIANGLE.with_(**LOADS[load], **slack), 6, loaded=True)
    assert np.all(np.diff(found.frequencies_Hz) > 0.0)
    spectrum = found.spectra[VACUUM]
    equilibrium, q = spectrum.equilibrium, spectrum.q
    basis, film = make_vector_basis(equilibrium.space), found.scene.film
    mass = film.density * film.thickness * BilinearForm(lambda u, v, _: dot(u, v)).assemble(basis)
    for frequency, vector in zip(found.frequencies_Hz, spectrum.vectors.T, strict=True):
        step = 1e-7 * vector / np.abs(vector).max()
        before, after = (equilibrium.residual(equilibrium.state(q + s * step)) for s in (-1, 1))
        forces = mass @ equilibrium.unknowns.expand(step)
        inertia = (2 * np.pi * frequency) ** 2 * equilibrium.unknowns.fold(forces)
        limit = 1e-6 * np.abs(inertia).max()
        np.testing.assert_allclose(0.5 * (after - before), inertia, atol=limit)


@pytest.mark.parametrize(
    ("film", "loaded", "status"),
    [
        ({"temperature_change_K": 0.0}, True, Status.SINGULAR),
        ({"temperature_change_K": 1.0}, False, Status.UNSTABLE),
        ({"pretension_N_m": [9.0, 0.0]}, False, Status.SINGULAR),
        ({"pretension_N_m": [9.0, -1.0]}, False, Status.UNSTABLE),
        ({"pretension_N_m": [9.0, -1.0], "compression": "tension-field"}, False, Status.SINGULAR),
    ],
)
def test_no_frequencies_without_tension(film, loaded, status):
    found = modes(Scene().with_(film=film), loaded=loaded)
    assert found.status is status
    assert f"film.{next(iter(film))}" in found.reason
    with pytest.raises(NotConvergedError):
        _ = found.frequencies_Hz
    assert "frequencies_Hz" not in found.to_json()


def test_unreachable_tolerance_is_reported_before_meshing():
    found = modes(Scene().with_(**{"numerics.tolerance": 2e-8}), 100)
    assert found.status is Status.TOLERANCE
    assert "numerics.max_unknowns" in found.reason
    assert "mesh" not in found.seconds


def test_note_on_missing_air_agrees_with_modes_in_air():
    note = modes(Scene(), 1).neglected[-1]
    sizes = re.search(r"about ([\d.]+) times the film's mass, ([\d.]+) without a baffle", note)
    for baffle, size in zip((True, False), sizes.groups(), strict=True):
        found = modes(Scene().with_(air={"baffle": baffle}), 1)
        added = (found.frequencies_Hz / found.frequencies_in_air_Hz) ** 2 - 1.0
        assert float(size) == pytest.approx(added[0], rel=0.05)

"""Heat of warm probes against the equation of heat, and films that are warm all over."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.linalg import expm
from scipy.sparse.linalg import splu

from pvdf_fem import Scene, solve
from pvdf_fem.film.loads.heat import AddedStrain, heat_remarks, warmed
from pvdf_fem.mesh.symmetry import WHOLE, part_of
from pvdf_fem.scene.scene import Replaced
from pvdf_fem.solution import solve as solving
from pvdf_fem.solvers.status import Status

WARM = {"temperature_K": 10.0, "contact_time_s": 1.0}
TRIANGLE = {"shape": "triangle", "x_mm": 5.0714, "y_mm": 0.8757, "side_mm": 7.0}
PYROELECTRIC = {"film.pyroelectric_uC_m2K": 25.0}
ROUND = {"shape": "circle", "radius_mm": 1.5}


def charges(scene):
    solution = solve(scene)
    assert solution.status is Status.CONVERGED, solution.reason
    return np.array(list(solution.charges_pC.values()))


@pytest.mark.parametrize("fourier", [0.002, 0.0499, 0.0501, 0.3, 2.0])
def test_heat_goes_through_the_film_as_the_equation_of_heat_says(fourier):
    count = 400
    z = (np.arange(count) + 0.5) / count  # middles of cells; the face z = 0 is held at 1
    matrix = np.diag(np.full(count - 1, 1.0), 1) + np.diag(np.full(count - 1, 1.0), -1)
    matrix -= np.diag([3.0, *np.full(count - 2, 2.0), 1.0])
    cold = expm(fourier * count**2 * matrix) @ np.ones_like(z)
    assert warmed(fourier) == pytest.approx(1.0 - cold.mean(), rel=1e-3)


def spread(laplace, held, T, steps=200):
    """Temperatures after a second beside what is held at 1, by implicit Euler steps."""
    free, dt = np.flatnonzero(~held), 6e-8 / steps
    rows = laplace.tocsr()[free]
    implicit = splu((sp.identity(len(free)) - dt * rows[:, free]).tocsc())
    heated = dt * rows[:, np.flatnonzero(held)].sum(axis=1)
    for _ in range(steps):
        T[free] = implicit.solve(T[free] + np.asarray(heated).ravel())
    return T


def line(count):
    """Second differences, with symmetry about both ends."""
    upper, lower = np.r_[2.0, np.ones(count - 2)], np.r_[np.ones(count - 2), 2.0]
    return sp.diags_array([lower, np.full(count, -2.0), upper], offsets=[-1, 0, 1])


def test_heat_spreads_beside_a_disc_as_the_equation_of_heat_says():
    r, step = np.linspace(2e-3, 4e-3, 201, retstep=True)
    slope = sp.diags_array([-1.0, 1.0], offsets=[-1, 1], shape=(len(r), len(r))).tocsr()
    slope = sp.diags_array(0.5 / r / step) @ slope
    expected = spread(line(len(r)) / step**2 + slope, r == r[0], np.where(r == r[0], 1.0, 0.0))
    disc = Scene().with_(probe={"shape": "circle", "radius_mm": 2.0, **WARM})
    found = AddedStrain.of(disc).temperature(np.column_stack([r, 0.0 * r])) / 10.0
    assert found == pytest.approx(expected, abs=2e-3)


@pytest.mark.parametrize(
    ("shape", "excess"),
    [
        ({"shape": "circle", "radius_mm": 3.0}, 1.11e-2),
        ({"shape": "ellipse", "semi_axes_mm": [4.0, 1.5]}, 0.192),
        ({"shape": "triangle", "side_mm": 7.0}, 0.331),
    ],
)
def test_heat_beside_other_outlines_is_off_as_stated(shape, excess):
    """Against finite elements of the heat equation on meshes with these outlines, after 30 s."""
    scene = Scene().with_(probe={**shape, "temperature_K": 1.0, "contact_time_s": 30.0})
    told = float(next(heat_remarks(scene))[1].split("about ")[1].split()[0])
    assert 0.6 * excess < told / 100.0 < 2.0 * excess


def test_a_film_that_is_warm_all_over_is_one_that_was_cooled_less():
    disc = {"shape": "circle", "radius_mm": 45.0}
    probe = {**disc, "temperature_K": 0.5, "contact_time_s": 1e3}
    warm = Scene().with_(probe=probe, **{"load.force_N": 20.0, "film.bending": False})
    cooled = solve(warm.with_(probe=Replaced(disc), **{"film.temperature_change_K": -0.5}))
    for coefficient, added in ((0.0, 0.0), (25.0, 25.0 * 9.0 * 0.5)):  # pC on 9 mm2
        found = solve(warm.with_(**{"film.pyroelectric_uC_m2K": coefficient}))
        expected = {name: charge + added for name, charge in cooled.charges_pC.items()}
        assert found.charges_pC == pytest.approx(expected, rel=1e-6)
    found, expected = (solution.at(3.0, 4.0).stress_MPa for solution in (found, cooled))
    assert found == pytest.approx(expected, rel=1e-6, abs=1e-9)


def test_a_tape_under_a_warm_probe_expands_by_its_own_coefficient():
    """Film and tape share a small load F as a membrane of their tensions' sum N: w = F/(4 pi N)."""
    tape = {"shape": "circle", "x_mm": 0.0, "y_mm": 0.0, "radius_mm": 45.0, "thickness_um": 40.0}
    tape |= {"youngs_modulus_GPa": 3.0, "poisson_ratio": 0.3, "thermal_expansion_per_K": 2e-5}
    probe = {"shape": "circle", "radius_mm": 45.0, "temperature_K": 5.0, "contact_time_s": 1e3}
    film = {
        "film.temperature_change_K": -20.0,
        "film.patches": [{**tape, "bonded": "before stretching"}],
    }
    found = solve(Scene().with_(probe=probe, **film, **{"load.force_N": 1e-3}))
    film_tension = 25e-6 * 2e9 / (1 - 0.34) * 110e-6 * (20.0 - 5.0)
    tape_tension = 40e-6 * 3e9 / (1 - 0.3) * 2e-5 * (20.0 - 5.0)
    expected = 1e3 * 1e-3 / (4.0 * np.pi * (film_tension + tape_tension))
    assert found.deflection_max_mm == pytest.approx(expected, rel=1e-3)


def test_heat_on_an_electrode_is_its_area_times_the_pyroelectric_coefficient():
    finger = {"shape": "circle", "x_mm": 10.0, "radius_mm": 4.0}
    scene = Scene().with_(probe={**finger, **WARM}, **PYROELECTRIC)
    warm, mechanical = charges(scene), charges(scene.with_(**{"film.pyroelectric_uC_m2K": None}))
    assert warm - mechanical == pytest.approx([2250.0, 0.0, 0.0, 0.0], rel=1e-4, abs=1e-6)
    # what the film would do if it could not move: 8e-12 · 2 · E α ΔT/(1 - ν) · 9 mm2
    clamped = charges(scene.with_(probe=Replaced(finger))) - mechanical
    assert 0.0 < clamped[0] < 480.0


def test_a_part_of_a_symmetric_film_has_the_heat_of_all_of_it(monkeypatch):
    finger = {"shape": "circle", "x_mm": 9.0, "radius_mm": 2.0, **WARM}
    scene = Scene().with_(probe=finger, **PYROELECTRIC)
    assert part_of(scene).mirrored == (1,)
    on_part = charges(scene)
    monkeypatch.setattr(solving, "part_of", lambda scene: WHOLE)
    assert on_part == pytest.approx(charges(scene), rel=1e-3)
    # about a line at 35°, to which the part's axes are turned
    oblique = {"x_mm": 9.0 * np.cos(np.radians(35.0)), "y_mm": 9.0 * np.sin(np.radians(35.0))}
    single = scene.with_(
        probe=Replaced({**finger, **oblique}), electrodes=[{"name": "A", **ROUND, **oblique}]
    )
    whole = charges(single)
    monkeypatch.undo()
    assert not np.allclose(part_of(single).frame, np.eye(2))
    assert charges(single) == pytest.approx(whole, rel=1e-3)
    cold = {**finger, "x_mm": -9.0, "temperature_K": 5.0}
    unlike = scene.with_(probe=[{**finger, "force_N": 1.0}, {**cold, "force_N": 1.0}])
    assert part_of(unlike).mirrored == (1,)

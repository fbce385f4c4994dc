"""Values of a solution at points: against a closed form, the charges, symmetry and the mesh."""

from __future__ import annotations

import numpy as np
import pytest

from pvdf_fem import Solution, solve
from pvdf_fem.mesh.points import located
from reports.reference.closed_form import campbell
from tests.helpers.discs import RECTANGLE, free_disc, graded_mesh, uniform_mesh

DISC = RECTANGLE.with_(**{"probe": {"shape": "circle", "radius_mm": 6.0, "x_mm": 4.0}})


@pytest.fixture(scope="module")
def halved() -> Solution:
    """The rectangle turned, off the centre: a half of the film was solved, in turned axes."""
    place = {"probe.x_mm": 6.0, "probe.y_mm": 6.0, "probe.rotation_deg": 45.0}
    solution = solve(RECTANGLE.with_(**place, **{"numerics.tolerance": 1e-4}))
    assert len(solution.fields.solved.part.signs) == 2
    return solution


def test_deflection_and_stress_are_those_of_the_closed_form() -> None:
    """Uniform pressure on a stretched film at vanishing slopes (Campbell 1956)."""
    small = 1e-10
    scene = free_disc(np.pi * small, poisson_ratio=0.3, pretension=small ** (2 / 3))
    exact, film = campbell(1.0, 0.3), scene.film
    values = solve(scene, mesh=uniform_mesh(scene, 4.0)).along([(0, 0), (0, film.radius_mm)], 101)
    r = np.linspace(0.0, 1.0, 101)
    np.testing.assert_allclose(values.distance_mm, r * film.radius_mm, rtol=1e-12)
    deflection = values.deflection_mm / film.radius_mm / small ** (1 / 3)
    np.testing.assert_allclose(deflection, exact.deflection(r), atol=1e-5)
    tension = values.stress_MPa[:, 1] / 1e3 / film.youngs_modulus_GPa / small ** (2 / 3)
    np.testing.assert_allclose(tension, exact.radial_tension(r), rtol=1e-4)


def test_charge_density_adds_up_to_the_charges(halved: Solution) -> None:
    space = halved.fields.equilibrium.space
    for name, charge in halved.charges_pC.items():
        elements = halved.mesh.subdomains[f"electrode {name}"]
        x, y = 1e3 * halved.mesh.mapping().F(space.basis.X)[:, elements]
        density = halved.at(x, y).charge_density_pC_mm2
        assert density.shape == x.shape
        found = (density * 1e6 * space.weights[elements]).sum()
        assert found == pytest.approx(charge, rel=1e-10)


def test_values_are_those_of_the_fields(halved: Solution) -> None:
    places, displacement = 1e3 * halved.basis.doflocs, 1e3 * halved.displacement
    inside = np.hypot(*places) <= halved.scene.film.radius_mm
    values = halved.at(*places[:, inside])
    np.testing.assert_allclose(values.displacement_mm, displacement[inside], atol=1e-12)
    single = halved.at(3.0, -2.0)
    assert single.deflection_mm.shape == ()
    assert single.strain.shape == (3,)
    assert single.deflection_mm == halved.along([(0, -2), (3, -2), (3, -7)], 9).deflection_mm[3]


def test_points_are_found_in_curved_and_in_graded_elements() -> None:
    """Elements of the rim and of a disc's edge are curved, and next to coarse ones are fine."""
    mesh = graded_mesh(DISC, 0.4, 16.0, growth=2.0)
    local = np.random.default_rng(2).dirichlet([0.4, 0.4, 0.4], 60)[:, :2].T
    points = mesh.mapping().F(local)
    elements, found = located(mesh, points.reshape(2, -1))
    expected = np.repeat(np.arange(mesh.nelements), 60)
    side = np.minimum(local.min(axis=0), 1.0 - local.sum(axis=0)) < 1e-6
    assert (elements == expected)[~np.tile(side, mesh.nelements)].all()
    np.testing.assert_allclose(
        mesh.mapping().F(found[:, :, None], elements)[:, :, 0], points.reshape(2, -1), atol=1e-12
    )


def test_points_off_the_film_are_named() -> None:
    solution = solve(DISC, mesh=uniform_mesh(DISC, 8.0))
    with pytest.raises(ValueError, match=r"\(0, -45.1\) mm is not on the film; .* to 45 mm"):
        solution.at([0.0, 0.0, 99.0], [45.0, -45.1, 0.0])
    with pytest.raises(ValueError, match=r"\(nan, 0\) mm is not on the film"):
        solution.at(np.nan, 0.0)
    assert solution.at([], []).stress_MPa.shape == (0, 3)

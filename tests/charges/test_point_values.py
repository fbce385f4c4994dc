"""Values of a solution at points: against a closed form, the charges, symmetry and the mesh."""

from __future__ import annotations

import numpy as np
import pytest

from pvdf_fem import solve
from reports.reference.closed_form import campbell
from tests.helpers.discs import RECTANGLE, TRIANGLE, free_disc, uniform_mesh

#: The rectangle turned, off the centre: a half of the film is solved, in turned axes.
HALVED = RECTANGLE.with_(**{"probe.x_mm": 6.0, "probe.y_mm": 6.0, "probe.rotation_deg": 45.0})
UNEVEN = TRIANGLE.with_(**{"film.rim_displacement_um": [0.0, 0.0, 0.0, 0.5, 0.0]})
UNEVEN = UNEVEN.with_(**{"electrodes.ring_radius_mm": 30.0, "numerics.tolerance": 1e-4})
TAPE = {"x_mm": 8.0, "y_mm": 1.0, "side_mm": 5.0, "thickness_um": 50.0}
COUPLED = {"film.d31_pC_N": 60.0, "film.d32_pC_N": -20.0, "film.coupling": True}
TAPED = TRIANGLE.with_(**COUPLED, **{"readout.kind": "voltage", "film.patches": [TAPE]})


def test_deflection_and_stress_are_those_of_the_closed_form():
    """Uniform pressure on a stretched film at vanishing slopes (Campbell 1956)."""
    small = 1e-10
    scene = free_disc(np.pi * small, poisson_ratio=0.3, pretension=small ** (2 / 3))
    exact, film = campbell(1.0, 0.3), scene.film
    values = solve(scene, mesh=uniform_mesh(scene, 4.0)).along([(0, 0), (0, film.radius_mm)], 101)
    r = np.linspace(0.0, 1.0, 101)
    assert values.distance_mm == pytest.approx(r * film.radius_mm, rel=1e-12)
    deflection = values.deflection_mm / film.radius_mm / small ** (1 / 3)
    assert deflection == pytest.approx(exact.deflection(r), abs=1e-5)
    tension = values.stress_MPa[:, 1] / 1e3 / film.youngs_modulus_GPa / small ** (2 / 3)
    assert tension == pytest.approx(exact.radial_tension(r), rel=1e-4)


@pytest.mark.parametrize(("scene", "most"), [(HALVED, 1e-10), (UNEVEN, 2e-3), (TAPED, 1e-10)])
def test_charge_density_adds_up_to_the_charges(scene, most):
    """With what is added to the strain's stress, by the rim and by voltages, and without tapes."""
    solution = solve(scene)
    space = solution.fields.equilibrium.space
    for name, charge in solution.charges_pC.items():
        elements = solution.mesh.subdomains[f"electrode {name}"]
        x, y = 1e3 * solution.mesh.mapping().F(space.basis.X)[:, elements]
        density = solution.at(x, y).charge_density_pC_mm2
        assert density.shape == x.shape
        found = (density * 1e6 * space.weights[elements]).sum()
        assert found == pytest.approx(charge, rel=most)


def test_values_are_those_of_the_fields():
    halved = solve(HALVED)
    assert len(halved.fields.solved.part.signs) == 2
    places, displacement = 1e3 * halved.basis.doflocs, 1e3 * halved.displacement
    inside = np.hypot(*places) <= halved.scene.film.radius_mm
    values = halved.at(*places[:, inside])
    np.testing.assert_allclose(values.displacement_mm, displacement[inside], atol=1e-12)
    single = halved.at(3.0, -2.0)
    assert single.deflection_mm.shape == ()
    assert single.strain.shape == (3,)
    assert single.deflection_mm == halved.along([(0, -2), (3, -2), (3, -7)], 9).deflection_mm[3]


def test_points_off_the_film_are_named():
    solution = solve(RECTANGLE, mesh=uniform_mesh(RECTANGLE, 8.0))
    with pytest.raises(ValueError, match=r"\(0, -45.1\) mm is not on the film; .* to 45 mm"):
        solution.at([0.0, 0.0, 99.0], [45.0, -45.1, 0.0])
    with pytest.raises(ValueError, match=r"\(nan, 0\) mm is not on the film"):
        solution.at(np.nan, 0.0)
    assert solution.at([], []).stress_MPa.shape == (0, 3)

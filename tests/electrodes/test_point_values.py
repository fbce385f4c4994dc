"""Values of a solution at points: against the charges, the fields and the mesh."""

from __future__ import annotations

import numpy as np
import pytest

from pvdf_fem import solve
from tests.helpers.discs import RECTANGLE, TRIANGLE, uniform_mesh

#: The rectangle turned, off the centre: a half of the film is solved, in turned axes.
HALVED = RECTANGLE.with_(**{"probe.x_mm": 6.0, "probe.y_mm": 6.0, "probe.rotation_deg": 45.0})
UNEVEN = TRIANGLE.with_(**{"film.rim_displacement_um": [0.0, 0.0, 0.0, 0.5, 0.0]})
UNEVEN = UNEVEN.with_(**{"electrodes.ring_radius_mm": 30.0, "numerics.tolerance": 1e-4})
TAPE = {"x_mm": 8.0, "y_mm": 1.0, "side_mm": 5.0, "thickness_um": 50.0}
COUPLED = {"film.d31_pC_N": 60.0, "film.d32_pC_N": -20.0, "film.coupling": True}
TAPED = TRIANGLE.with_(**COUPLED, **{"readout.kind": "voltage", "film.patches": [TAPE]})


@pytest.mark.parametrize(("scene", "most"), [(HALVED, 1e-10), (UNEVEN, 2e-3), (TAPED, 1e-10)])
def test_values_at_quadrature_points_add_up_to_the_charges(scene, most):
    """With what is added to the strain's stress, by the rim and by voltages, and without tapes."""
    solution = solve(scene)
    space, state = solution.discrete.equilibrium.space, solution.discrete.state
    for name, charge in solution.charges_pC.items():
        elements = solution.mesh.subdomains[f"electrode {name}"]
        x, y = 1e3 * solution.mesh.mapping().F(space.basis.X)[:, elements]
        at = solution.at(x, y)
        assert at.strain == pytest.approx(state.strain[elements], abs=1e-12)
        assert at.slopes == pytest.approx(state.deformation_gradient[elements, :, 2], abs=1e-9)
        found = (at.charge_density_pC_mm2 * 1e6 * space.weights[elements]).sum()
        assert found == pytest.approx(charge, rel=most)
    if scene is HALVED:
        assert 1e6 * at.stress_MPa == pytest.approx(state.stress[elements], rel=1e-7)


def test_values_are_those_of_the_fields():
    halved = solve(HALVED)
    assert len(halved.discrete.solved.sector.signs) == 2
    places, displacement = 1e3 * halved.basis.doflocs, 1e3 * halved.displacement
    inside = np.hypot(*places) <= halved.scene.film.radius_mm
    values = halved.at(*places[:, inside])
    np.testing.assert_allclose(values.displacement_mm, displacement[inside], atol=1e-12)
    single = halved.at(3.0, -2.0)
    assert single.deflection_mm.shape == ()
    assert single.strain.shape == (3,)
    line = halved.along([(0, -2), (3, -2), (3, -7)], 9)
    assert single.deflection_mm == line.deflection_mm[3]
    assert line.distance_mm == pytest.approx(np.arange(9.0), rel=1e-12)
    assert line.x_mm == pytest.approx(np.minimum(np.arange(9.0), 3.0), rel=1e-12)


def test_points_off_the_film_are_named():
    solution = solve(RECTANGLE, mesh=uniform_mesh(RECTANGLE, 8.0))
    with pytest.raises(ValueError, match=r"\(0, -45.1\) mm is not on the film; .* to 45 mm"):
        solution.at([0.0, 0.0, 99.0], [45.0, -45.1, 0.0])
    with pytest.raises(ValueError, match=r"\(nan, 0\) mm is not on the film"):
        solution.at(np.nan, 0.0)
    assert solution.at([], []).stress_MPa.shape == (0, 3)

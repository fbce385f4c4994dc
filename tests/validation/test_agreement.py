"""Charges against the values of independent codes, converged to five digits at least.

The values were computed for this project by two other codes that agree to 1e-7 in the dead charges.
Film of the thesis: 25 um, -1 K.
"""

from __future__ import annotations

import pytest

from pvdf_fem import Scene, solve
from tests.helpers.discs import LOADS, RECTANGLE, TRIANGLE

DEAD = {
    "rectangle": (
        RECTANGLE,
        {"A": 799.3932, "B": 768.6400, "C": 799.3932, "D": 768.6400},
        2.81166,
    ),
    "triangle": (
        TRIANGLE,
        {"A": 1217.9357, "B": 734.6291, "C": 578.6109, "D": 672.5436},
        2.99885,
    ),
}


@pytest.mark.parametrize("tolerance", [1e-3, 1e-5])
@pytest.mark.parametrize("case", DEAD)
def test_dead_load(case, tolerance):
    scene, charges, deflection_mm = DEAD[case]
    solution = solve(scene.with_(**{"numerics.tolerance": tolerance}))
    assert solution.charges_pC == pytest.approx(charges, rel=tolerance)
    if tolerance == 1e-5:
        assert solution.deflection_max_mm == pytest.approx(deflection_mm, rel=1e-4)


@pytest.mark.parametrize(
    ("force_N", "A", "B"),
    [(0.25, 324.57, 313.83), (1.0, 800.72, 770.88), (7.5, 3061.37, 2939.68)],
)
def test_follower_pressure(force_N, A, B):
    scene = RECTANGLE.with_(
        **LOADS["follower"], **{"load.force_N": force_N, "numerics.tolerance": 1e-5}
    )
    charges = solve(scene).charges_pC
    for name, value in (("A", A), ("B", B), ("C", A), ("D", B)):
        # half a unit of the last printed digit, and the tolerance
        assert charges[name] == pytest.approx(value, abs=5e-3 + 1e-5 * value)


@pytest.mark.parametrize(
    ("scene", "contact", "charges", "digit"),
    [
        (RECTANGLE, "sliding", {"A": 895, "B": 741}, 1),
        (RECTANGLE, "stuck", {"A": 873, "B": 623}, 1),
        (TRIANGLE, "sliding", {"A": 1392}, 10),
        (TRIANGLE, "stuck", {"A": 1485}, 10),
    ],
)
def test_rigid_punch(scene, contact, charges, digit):
    """To a unit of the third digit: the corners of a rigid face make any code slow to converge."""
    solution = solve(scene.with_(**LOADS[contact], **{"numerics.tolerance": 3e-4}))
    computed = {name: solution.charges_pC[name] for name in charges}
    assert computed == pytest.approx(charges, abs=digit)


@pytest.mark.parametrize("observable", ["material", "thesis-edge"])
@pytest.mark.parametrize("scene", [Scene(), RECTANGLE.with_(**{"load.force_N": 0.0})])
def test_pretension_alone(scene, observable):
    """8 + 8 pC/N times 9 mm2 times E alpha/(1 - nu) = 1/3 MPa."""
    solution = solve(scene.with_(**{"numerics.observable": observable}))
    assert solution.charges_pC == pytest.approx(dict.fromkeys("ABCD", 48.0), rel=1e-10)
    assert solution.deflection_max_mm == 0

"""The 1-D solver against independently computed digits, its equilibrium and its limits."""

import math
from itertools import product

import numpy as np
import pytest

from reports.reference.axisymmetric import axisymmetric_membrane

FVK = "foeppl-von-karman"
FORCE = 4.444e-4  # F/(E h a): 1 N on the 25 um film of 45 mm radius


@pytest.mark.parametrize(
    ("radius_mm", "pretension", "strain", "deflection"),
    [
        (5, 0, FVK, 0.8644167),
        (5, 0.03, FVK, 0.8435909),
        (5, 0.03, "green-lagrange", 0.8435545),
        (2, 0.03, "green-lagrange", 0.9022513),
    ],
)
def test_patch_has_the_known_digits(radius_mm, pretension, strain, deflection):
    """W0 = w0/(F a^2/(E h))^(1/3) for N0 counted in (E h F^2/a^2)^(1/3)."""
    scale = FORCE ** (1 / 3)
    film = {"poisson_ratio": 0.3, "pretension": pretension * scale**2, "strain": strain}
    found = axisymmetric_membrane(FORCE, patch_radius=radius_mm / 45, **film).centre_deflection
    assert found / scale == pytest.approx(deflection, abs=5e-8)


CASES = [
    {"kind": "dead", "strain": FVK},
    {"kind": "dead"},
    {"kind": "follower"},
    {"kind": "rigid", "contact": "sliding"},
    {"kind": "rigid", "contact": "stuck"},
    {"kind": "rigid", "contact": "stuck", "strain": FVK},
]


@pytest.fixture(params=product(CASES, [0.0, 2e-3], [0.2]), ids=str)
def deflected(request):
    """A film with slopes of 0.3 or so, its load kind and the radius of the patch."""
    options, pretension, patch_radius = request.param
    membrane = axisymmetric_membrane(
        5e-3, poisson_ratio=0.34, pretension=pretension, patch_radius=patch_radius, **options
    )
    return membrane, options, patch_radius


def test_vertical_force_passes_through_every_circle(deflected):
    """2 pi r N_r w' is the load within r; of a follower pressure, p times the area spanned."""
    membrane, options, b = deflected
    r = np.array([0.3 * b, 0.8 * b, 0.9 * b + 0.1, 0.5 * b + 0.5, 1.0])
    if options["kind"] == "rigid":
        r = r[2:]  # below its face the punch takes the load itself
    loaded = np.minimum(r, b)
    expected = -5e-3 * (loaded / b) ** 2
    if options["kind"] == "follower":
        expected *= (1 + membrane.radial_displacement(loaded) / loaded) ** 2
    force = 2 * math.pi * r * membrane.radial_tension(r) * membrane.slope(r)
    assert force == pytest.approx(expected, rel=1e-10)


def test_radial_forces_balance_between_circles(deflected):
    """r (1 + u') N_r grows by N_t (1 + u/r), and by p (r + u) w' under a follower pressure."""
    membrane, options, b = deflected
    exact = 0.0 if options.get("strain") == FVK else 1.0
    for inner, outer in [(0.2 * b, 0.9 * b), (1.1 * b, 0.95)]:
        if inner < b and options.get("contact") == "stuck":
            continue  # the punch holds the film
        node, weight = np.polynomial.legendre.leggauss(60)
        r = inner + (outer - inner) * (1 + node) / 2
        u = membrane.radial_displacement(r)
        growth = membrane.hoop_tension(r) * (1 + exact * u / r)
        if options["kind"] == "follower" and inner < b:
            growth += 5e-3 / (math.pi * b**2) * (r + u) * membrane.slope(r)
        ends = np.array([inner, outer])
        stretch = 1 + exact * membrane.radial_stretch(ends)
        pull = ends * stretch * membrane.radial_tension(ends)
        assert pull[1] - pull[0] == pytest.approx((outer - inner) / 2 * weight @ growth, rel=1e-9)

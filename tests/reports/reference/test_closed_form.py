"""Closed forms against published or independently computed digits, limits and each other."""

import math

import numpy as np
import pytest

from reports.reference.axisymmetric import axisymmetric_membrane
from reports.reference.closed_form import (
    _fall,
    campbell,
    disc_frequencies,
    hencky,
    linear_patch_deflection,
    schwerin,
)

# ------------------------------------------------------------------------------- uniform pressure


@pytest.mark.parametrize(
    ("poisson_ratio", "deflection", "tension"),
    [
        (0.2, 0.6774353258, 0.3161092885),
        (0.3, 0.6534433447, 0.3329568069),
        (1 / 3, 0.6447764163, 0.3392768087),
        (0.4, 0.6262550794, 0.3532327451),
    ],
)
def test_hencky_has_the_known_digits(poisson_ratio, deflection, tension):
    membrane = hencky(poisson_ratio)
    assert membrane.centre_deflection == pytest.approx(deflection, abs=5e-11)
    assert membrane.edge_tension == pytest.approx(tension, abs=5e-11)


@pytest.mark.parametrize(
    ("pretension", "deflection", "half_digit"),
    [(0.01, 0.64808, 5e-6), (0.1, 0.59931, 5e-6), (1, 0.23857, 5e-6), (10, 0.0249987, 5e-8)],
)
def test_campbell_has_the_known_digits(pretension, deflection, half_digit):
    assert campbell(pretension, 0.3).centre_deflection == pytest.approx(deflection, abs=half_digit)


def test_campbell_tends_to_hencky_and_to_the_linear_membrane():
    nearly_free, tight = campbell(1e-10, 0.3), campbell(1e4, 0.3)
    assert nearly_free.centre_deflection == pytest.approx(hencky(0.3).centre_deflection, rel=1e-9)
    assert tight.centre_deflection == pytest.approx(1 / 4e4, rel=1e-11)
    r = np.linspace(0, 1, 5)
    assert tight.deflection(r) == pytest.approx((1 - r**2) / 4e4, rel=1e-10, abs=1e-18)


@pytest.mark.parametrize("pretension", [0.0, 0.3])
@pytest.mark.parametrize("poisson_ratio", [0.0, 0.34, 0.5, 0.9])
def test_pressure_series_solves_the_membrane_equations(poisson_ratio, pretension):
    """Same problem by energy minimisation: no step in common with the series."""
    membrane = campbell(pretension, poisson_ratio)
    scale = 1e-3  # slope scale (p a/(E h))^(1/3); the FvK problem is the same for any
    numerical = axisymmetric_membrane(
        math.pi * scale**3,
        poisson_ratio=poisson_ratio,
        pretension=pretension * scale**2,
        strain="foeppl-von-karman",
    )
    r = np.linspace(0, 1, 9)
    assert membrane.deflection(r) * scale == pytest.approx(numerical.deflection(r), abs=1e-15)
    assert membrane.radial_tension(r) * scale**2 == pytest.approx(
        numerical.radial_tension(r), rel=1e-10
    )
    assert membrane.radial_tension(0) == pytest.approx(membrane.centre_tension, rel=1e-14)
    assert membrane.radial_tension(1) == pytest.approx(membrane.edge_tension, rel=1e-14)


# ------------------------------------------------------------------------------------- point load


@pytest.mark.parametrize(
    ("pretension", "deflection"), [(0, 0.9927524), (0.03, 0.9719539), (1, 0.5085027)]
)
def test_schwerin_has_the_known_digits(pretension, deflection):
    assert schwerin(pretension, 0.3).centre_deflection == pytest.approx(deflection, abs=5e-8)


def test_schwerin_is_a_pure_power_of_r_at_one_third():
    """w = w0 (1 - r^(2/3)): F = (pi/3) E h w0^3/a^2, and 2 pi r N w' = F at the rim."""
    membrane = schwerin(0, 1 / 3)
    w0 = (3 / math.pi) ** (1 / 3)
    assert membrane.centre_deflection == pytest.approx(w0, rel=1e-14)
    assert membrane.edge_tension == pytest.approx(3 / (4 * math.pi * w0), rel=1e-14)


@pytest.mark.parametrize("square", [-1.0, 1.0])
def test_schwerin_is_smooth_where_its_formulas_change(square):
    """Series and closed form of the same function meet at theta^2 = +-1."""
    inside, outside = _fall(square * (1 - 1e-15)), _fall(square * (1 + 1e-15))
    assert inside == pytest.approx(outside, rel=1e-14)


@pytest.mark.parametrize("poisson_ratio", [0.0, 0.3, 0.45])
@pytest.mark.parametrize("pretension", [0.0, 0.03, 0.2])
def test_small_patch_tends_to_the_point_load(poisson_ratio, pretension):
    """The difference goes with b^(2/3): eliminate it between b and b/8."""
    wide, narrow = (
        axisymmetric_membrane(
            1e-9,
            poisson_ratio=poisson_ratio,
            patch_radius=b,
            pretension=pretension * 1e-6,
            strain="foeppl-von-karman",
        )
        for b in (8e-5, 1e-5)
    )
    point = schwerin(pretension, poisson_ratio)
    extrapolated = (4 * narrow.centre_deflection - wide.centre_deflection) / 3e-3
    assert extrapolated == pytest.approx(point.centre_deflection, rel=1e-9)
    assert narrow.edge_tension / 1e-6 == pytest.approx(point.edge_tension, rel=1e-9)


def test_schwerin_tends_to_the_linear_logarithm():
    """Tight film: w0 = ln(a/core)/(2 pi N0), cut off where the load alone stretches as much.

    For large theta, k = n0 and k^3 = (c/8) e^(2 theta).
    """
    membrane = schwerin(1e5, 0.3)
    assert membrane.edge_tension == pytest.approx(1e5, rel=1e-12)
    logarithm = math.log(8 * (8 * math.pi**2) * 1e15) / 2
    assert membrane.centre_deflection == pytest.approx(logarithm / (2e5 * math.pi), rel=1e-12)


# ------------------------------------------------------------------------------- linear membrane

FILM = {"film_radius": 0.045, "force": 1.3, "tension": 8.33}
OFF_CENTRE = {"centre": (0.012, -0.007), "patch_radius": 0.004, **FILM}


def test_centred_patch_has_the_textbook_deflection_at_its_centre():
    w0 = linear_patch_deflection((0, 0), centre=(0, 0), patch_radius=0.005, **FILM)
    assert w0 == pytest.approx(1.3 / (4 * math.pi * 8.33) * (1 + 2 * math.log(9)), rel=1e-14)


def test_centred_patch_is_the_limit_of_the_tight_membrane():
    radius = np.linspace(0, 1, 11)
    points = np.stack([radius, 0 * radius], axis=-1)
    linear = linear_patch_deflection(
        points, centre=(0, 0), patch_radius=0.3, film_radius=1, force=1e-9, tension=1e-3
    )
    tight = axisymmetric_membrane(1e-9, poisson_ratio=0.3, patch_radius=0.3, pretension=1e-3)
    assert tight.deflection(radius) == pytest.approx(linear, rel=1e-8, abs=1e-20)


def test_off_centre_patch_is_the_mean_of_point_sources():
    """Green's function integrated over the patch, seen from outside of it and from the rim."""
    node, weight = np.polynomial.legendre.leggauss(20)
    rho = (1 + node) / 2
    angle = np.arange(600) * 2 * math.pi / 600
    source = complex(0.012, -0.007) + 0.004 * rho[:, None] * np.exp(1j * angle)
    z = np.array([0.03 + 0.01j, -0.02j, 0.0165 - 0.007j, 0.045 * np.exp(0.7j)])
    kernel = np.log(
        np.abs(0.045**2 - z[:, None, None] * source.conj())
        / 0.045
        / np.abs(z[:, None, None] - source)
    )
    mean = np.einsum("i,kij->k", weight * rho, kernel) / 600
    expected = 1.3 / (2 * math.pi * 8.33) * mean
    points = np.stack([z.real, z.imag], axis=-1)
    w = linear_patch_deflection(points, **OFF_CENTRE)
    assert w == pytest.approx(expected, rel=1e-11, abs=1e-16)
    assert abs(w[3]) < 1e-16


def test_off_centre_patch_carries_its_pressure_and_is_smooth_at_its_edge():
    step = 2e-4
    cross = step * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])

    def laplacian(point):
        w = linear_patch_deflection(np.add(point, cross), **OFF_CENTRE)
        return (w.sum() - 4 * linear_patch_deflection(point, **OFF_CENTRE)) / step**2

    pressure = 1.3 / (math.pi * 0.004**2)
    assert laplacian((0.0135, -0.0055)) == pytest.approx(-pressure / 8.33, rel=1e-7)
    assert abs(laplacian((-0.02, 0.01))) < 1e-6 * pressure / 8.33

    outward = np.array([math.cos(1.0), math.sin(1.0)])
    places = [np.array([0.012, -0.007]) + (0.004 + d) * outward for d in (-1e-7, 0, 1e-7)]
    inner, edge, outer = linear_patch_deflection(places, **OFF_CENTRE)
    assert edge - inner == pytest.approx(outer - edge, rel=1e-4)


def test_linear_patch_keeps_the_shape_of_the_points():
    w = linear_patch_deflection(np.zeros((3, 4, 2)), **OFF_CENTRE)
    assert w.shape == (3, 4)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"centre": (0.042, 0)}, "0.046"),
        ({"patch_radius": 0.0}, "patch must lie"),
        ({"tension": 0.0}, "tension must be positive, got 0.0"),
        ({"centre": (0, 0, 0)}, r"\(3,\)"),
    ],
)
def test_linear_patch_refuses(change, message):
    with pytest.raises(ValueError, match=message):
        linear_patch_deflection((0, 0), **{**OFF_CENTRE, **change})


# -------------------------------------------------------------------------------------- vibration

PRETENSION = 2e9 * 25e-6 * 110e-6 / (1 - 0.34)  # E h alpha |dT|/(1 - nu), N/m
TIGHT = {"radius": 0.045, "tension": PRETENSION, "areal_density": 1760 * 25e-6}


def test_lowest_frequencies_are_the_zeros_of_bessel_functions_with_pairs_twice():
    """Zeros j01, j11, j21, j02: Abramowitz and Stegun, table 9.5."""
    zeros = [2.40482556, *2 * [3.83170597], *2 * [5.13562230], 5.52007811]
    unit = {"radius": 1 / (2 * math.pi), "tension": 4.0, "areal_density": 4.0}
    assert disc_frequencies(6, **unit) == pytest.approx(zeros, abs=6e-9)


def test_film_of_the_thesis_rings_at_117_hertz():
    assert disc_frequencies(1, **TIGHT)[0] == pytest.approx(117, abs=0.5)


@pytest.mark.parametrize("count", [1, 2, 40])
def test_fewer_frequencies_are_the_first_of_more(count):
    more = disc_frequencies(60, **TIGHT)
    assert disc_frequencies(count, **TIGHT) == pytest.approx(more[:count], rel=1e-14)


# --------------------------------------------------------------------------------------- refusals


@pytest.mark.parametrize("solution", [campbell, schwerin])
@pytest.mark.parametrize(
    ("pretension", "poisson_ratio", "message"),
    [(-0.1, 0.3, "pretension .* -0.1"), (math.nan, 0.3, "nan"), (0.1, 1.0, "poisson_ratio .* 1.0")],
)
def test_slack_or_impossible_films_are_refused(solution, pretension, poisson_ratio, message):
    with pytest.raises(ValueError, match=message):
        solution(pretension, poisson_ratio)

"""Closed forms against published or independently computed digits, limits and each other."""

import math

import numpy as np
import pytest

from reports.reference.axisymmetric import axisymmetric_membrane
from reports.reference.closed_form import campbell, hencky, schwerin


@pytest.mark.parametrize(
    ("known", "quantity", "digits", "half_digit"),
    [
        (hencky(0.2), "centre_deflection", 0.6774353258, 5e-11),
        (hencky(0.3), "centre_deflection", 0.6534433447, 5e-11),
        (hencky(1 / 3), "centre_deflection", 0.6447764163, 5e-11),
        (hencky(0.4), "centre_deflection", 0.6262550794, 5e-11),
        (hencky(0.2), "edge_tension", 0.3161092885, 5e-11),
        (hencky(0.3), "edge_tension", 0.3329568069, 5e-11),
        (hencky(1 / 3), "edge_tension", 0.3392768087, 5e-11),
        (hencky(0.4), "edge_tension", 0.3532327451, 5e-11),
        (campbell(0.01, 0.3), "centre_deflection", 0.64808, 5e-6),
        (campbell(0.1, 0.3), "centre_deflection", 0.59931, 5e-6),
        (campbell(1, 0.3), "centre_deflection", 0.23857, 5e-6),
        (campbell(10, 0.3), "centre_deflection", 0.0249987, 5e-8),
        (schwerin(0, 0.3), "centre_deflection", 0.9927524, 5e-8),
        (schwerin(0.03, 0.3), "centre_deflection", 0.9719539, 5e-8),
        (schwerin(1, 0.3), "centre_deflection", 0.5085027, 5e-8),
    ],
)
def test_closed_forms_have_the_known_digits(known, quantity, digits, half_digit):
    assert getattr(known, quantity) == pytest.approx(digits, abs=half_digit)


@pytest.mark.parametrize("pretension", [0.0, 0.3])
@pytest.mark.parametrize("poisson_ratio", [0.0, 0.34, 0.9])
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

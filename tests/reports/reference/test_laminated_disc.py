"""The laminated disc against an axisymmetric membrane and a plate's closed form."""

from __future__ import annotations

import numpy as np
import pytest

from reports.reference.axisymmetric import axisymmetric_membrane
from reports.reference.circular_plate import clamped_plate_deflection
from reports.reference.laminated_disc import LaminatedDisc, Ply

PLANE = np.array([[1.0, 0.34], [0.34, 1.0]]) / (1.0 - 0.34**2)
FILM = Ply(2e9 * PLANE, 25e-6, 0.0, 110e-6, 45e-3)
CENTRED = np.array([[0.0, 0.0, 4e-3], [0.0, 0.0, 9e-3]])


def test_a_film_alone_is_the_axisymmetric_membrane() -> None:
    """By balance in the plane an electrode of radius b has the charge 2 pi b^2 N_r(b) d31/h."""
    found = LaminatedDisc((FILM,), 3e-3, 0.01, CENTRED).as_membrane()
    force, rest, b = 0.01 / (2e9 * 25e-6 * 45e-3), 110e-6 / 0.66, CENTRED[:, 2]
    film = {"poisson_ratio": 0.34, "patch_radius": 3 / 45, "pretension": rest}
    known = axisymmetric_membrane(force, **film, strain="foeppl-von-karman")
    assert found.deflections[0] == pytest.approx(45e-3 * known.centre_deflection, rel=1e-5)
    tension = 2e9 * known.radial_tension(b / 45e-3)
    np.testing.assert_allclose(found.charges(8.0, 8.0), 16 * np.pi * b**2 * tension, rtol=1e-4)


def test_a_small_load_bends_it_as_a_clamped_plate() -> None:
    thick = Ply(2e9 * PLANE, 1e-3, 0.0, 0.0, 45e-3)
    disc = LaminatedDisc((thick,), 9e-3, 1e-4, CENTRED)
    D = 2e9 * 1e-9 / 12.0 / (1.0 - 0.34**2)
    depth = disc.deflections[0]
    assert depth == pytest.approx(clamped_plate_deflection(0.2) * 1e-4 * 0.045**2 / D, rel=1e-4)


def test_directions_matter_where_coefficients_differ() -> None:
    places = [[0.01, angle, 1.5e-3] for angle in (0.0, np.pi / 4, np.pi / 2)]
    along, between, across = LaminatedDisc((FILM,), 3e-3, 1.0, np.array(places)).charges(18.0, 2.0)
    assert along > 1.2 * across
    assert between == pytest.approx(0.5 * (along + across), rel=1e-9)

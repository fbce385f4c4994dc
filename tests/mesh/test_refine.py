"""Sizes of the next mesh from the shares of elements in the error."""

from __future__ import annotations

import numpy as np
import pytest
from skfem import MeshTri, MeshTri2

from pvdf_fem.mesh.size_field import element_sizes, refined_sizes
from tests.helpers.discs import RECTANGLE, graded_mesh


def test_an_error_an_eighth_as_large_takes_sizes_half_as_large() -> None:
    """Equal shares e h^3: a reduction by 8 halves all sizes."""
    mesh = graded_mesh(RECTANGLE, 1.5, 8.0)
    even = np.ones(mesh.nelements)
    whole, halved = (refined_sizes(mesh, even, reduction).sizes for reduction in (1.0, 0.125))
    assert halved == pytest.approx(0.5 * whole, rel=0.05)


def test_the_size_of_an_element_is_that_of_an_equilateral_one_or_half_a_slivers_length() -> None:
    for height, size in ((np.sqrt(0.75), 1.0), (1e-3, 0.5)):
        triangle = MeshTri(np.array([[0.0, 1.0, 0.5], [0.0, 0.0, height]]), np.array([[0, 1, 2]]).T)
        assert element_sizes(MeshTri2.from_mesh(triangle)) == pytest.approx([size])

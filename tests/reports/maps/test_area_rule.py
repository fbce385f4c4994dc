"""Quadrature over outlines against their area, centroid and second moments."""

from __future__ import annotations

import numpy as np
import pytest

from pvdf_fem.scene.outlines.circle import Circle
from pvdf_fem.scene.outlines.ellipse import Ellipse
from pvdf_fem.scene.outlines.polygon import Polygon, rectangle
from reports.maps.area_rule import area_rule

CENTRE = np.array([0.5, 0.3])
NOTCHED = np.array([[0, 0], [6, 0], [6, 6], [4, 6], [4, 2], [2, 2], [2, 6], [0, 6]])
#: Outlines with the second moment of their area about the centroid.
OUTLINES = {
    "rectangle": (Polygon(rectangle(2.0, 1.0) + CENTRE), 2.0 * (4.0 + 1.0) / 12.0),
    "circle": (Circle(CENTRE, 2.0), 0.5 * np.pi * 2.0**4),
    "ellipse": (Ellipse(CENTRE, np.array([3.0, 1.0]), 0.7), None),
    "polygon": (Polygon(NOTCHED), None),
}


@pytest.mark.parametrize("name", OUTLINES)
def test_polynomials_are_integrated_exactly(name: str) -> None:
    outline, second_moment = OUTLINES[name]
    points, weights = area_rule(outline, 4)
    assert weights.sum() == pytest.approx(outline.area, rel=1e-12)
    assert weights @ points == pytest.approx(outline.area * outline.centroid, rel=1e-12)
    if second_moment is not None:
        polar = weights @ ((points - outline.centroid) ** 2).sum(axis=1)
        assert polar == pytest.approx(second_moment, rel=1e-12)
    assert outline.signed_distance(points).max() < 0.0

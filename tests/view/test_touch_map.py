"""Maps over places of a touch: charges of a model, likelihood with its ellipse."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pvdf_fem import locate
from pvdf_fem.inverse.posterior import profile_chi_square
from pvdf_fem.inverse.touch.location import Location
from pvdf_fem.view.touch_map import draw_charge_map
from tests.helpers.bump_response import make_bump_response

TOUCH = np.array([[3.0, -4.0, 25.0, 0.7]])


def located(sigma: float) -> Location:
    model, unknown = make_bump_response(), ("x_mm", "y_mm", "force_N")
    charges = dict(zip(model.names, model.evaluate(TOUCH)[0][0], strict=True))
    return locate(model, charges, unknown=unknown, known={"rotation_deg": 25.0}, sigma=sigma)


def test_the_response_has_the_charge_of_an_isocharge_line_on_it():
    model = make_bump_response()

    def charge(places: np.ndarray) -> np.ndarray:
        touches = np.hstack([places, np.tile([30.0, 1.5], (len(places), 1))])
        return np.asarray(model.evaluate(touches)[0][:, 1])

    ax = draw_charge_map(model.scene, 12.0, charge, "B", None).axes[0]
    filled, lines = ax.collections[:2]
    for level, path in zip(lines.levels, lines.get_paths(), strict=True):
        np.testing.assert_allclose(charge(path.vertices.reshape(-1, 2)), level, rtol=2e-3)
    assert np.hypot(*filled.get_paths()[0].vertices.T).max() <= 12.0 + 1e-9


def test_the_ellipse_has_the_covariance_of_the_touch():
    found = located(sigma=0.01)
    near = found.plot().axes[1]
    [drawn] = [line.get_xydata() for line in near.lines if len(line.get_xdata()) > 1]
    apart = drawn - found.best.values[:2]
    squares = np.einsum("ni,ij,nj->n", apart, np.linalg.inv(found.covariance[:2, :2]), apart)
    np.testing.assert_allclose(squares, 1.0, rtol=1e-9)
    deviations = [found.deviations["x_mm"], found.deviations["y_mm"]]
    np.testing.assert_allclose(apart.max(axis=0), deviations, rtol=1e-2)


def test_the_likelihood_map_uses_the_most_likely_force():
    """With small errors its logarithm falls by a half on the ellipse of the curvature."""
    found = located(sigma=1e-3)
    root, angles = np.linalg.cholesky(found.best.covariance[:2, :2]), np.linspace(0.0, 6.0, 9)
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1) @ root.T
    places = found.best.values[:2] + np.vstack([ring, np.zeros(2)])
    least = profile_chi_square(found.problem, found.best, places)
    *around, middle = least - found.best.chi_square
    assert middle == pytest.approx(0.0, abs=1e-6)
    np.testing.assert_allclose(around, 1.0, rtol=0.02)


def test_maps_are_in_the_coordinates_of_the_stage():
    """A touch in the middle of electrode A is drawn in the middle of what is drawn of A."""
    model = make_bump_response()
    stage = {"x_mm": 100.0, "y_mm": 50.0, "rotation_deg": 30.0}
    model = replace(model, scene=model.scene.with_(stage=stage))
    charges = dict(
        zip(model.names, model.evaluate(np.array([[10.0, 0, 0, 1.0]]))[0][0], strict=True)
    )
    film = locate(model, charges, known={"rotation_deg": 30.0}).plot().axes[0]
    [mark] = [line.get_xydata()[0] for line in film.lines if len(line.get_xdata()) == 1]
    corners = film.patches[0].get_xy()[:-1]
    np.testing.assert_allclose(mark, corners.mean(axis=0), atol=1e-3)
    assert np.hypot(*(mark - [100.0, 50.0])) == pytest.approx(10.0, abs=1e-3)

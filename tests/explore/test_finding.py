"""The image of the film against values at points, and ellipses against their covariance."""

from __future__ import annotations

import numpy as np
import pytest

from pvdf_fem.explore.finding import find, isocharge_lines
from pvdf_fem.explore.picture import ORDER, PIXELS, image_of, picture_of
from pvdf_fem.output.touch_map import deviation_ellipse
from pvdf_fem.response.model import SCENE_KEYS
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solution.solve import solve
from tests.helpers.touch_models import bumps

SCENE = Scene.example("triangle").with_(**{"numerics.tolerance": 1e-2})


def test_image_is_the_field():
    solution = solve(SCENE)
    image = image_of(solution, 1e3 * solution.displacement[:, 2])
    rows, columns = np.divmod(np.arange(37, PIXELS**2, 397), PIXELS)
    x, y = (SCENE.film.radius_mm * ((k + 0.5) / PIXELS * 2.0 - 1.0) for k in (columns, rows))
    inside = np.hypot(x, y) < 1.0 * SCENE.film.radius_mm
    exact = solution.at(x[inside], y[inside]).deflection_mm
    assert image[rows, columns][inside] == pytest.approx(exact, abs=6e-3)
    assert np.nanmax(abs(image[0])) < 0.02  # about the rim, which does not move
    assert np.isnan(image[0, 0])


def test_picture_says_what_solve_says():
    picture = picture_of(SCENE, "stress")
    assert picture.result["charges_pC"] == solve(SCENE, order=ORDER).charges_pC
    at = solve(SCENE).at([0.0, -20.0], [10.0, 5.0])
    stress = at.stress_MPa[:, :2].sum(axis=1)
    pixels = [(int((v / 45.0 + 1.0) / 2.0 * PIXELS)) for v in (0.0, 10.0, -20.0, 5.0)]
    image = picture.image
    assert image is not None
    found = [image[pixels[1], pixels[0]], image[pixels[3], pixels[2]]]
    assert found == pytest.approx(stress, rel=0.02)


def test_a_failed_solve_has_no_image():
    small = SCENE.with_(**{"numerics.max_unknowns": 100})
    picture = picture_of(small, "deflection")
    assert picture.image is None
    assert picture.result["status"] != "converged"


def test_ellipse_has_the_covariance():
    covariance = [[4.0, 0.0, 1.0], [0.0, 9.0, 0.0], [1.0, 0.0, 1.0]]
    touch = {"x_mm": 1.0, "force_N": 2.0, "y_mm": -3.0, "covariance": covariance}
    touch["standard_deviations"] = {"x_mm": 2.0, "force_N": 3.0, "y_mm": 1.0}
    points = deviation_ellipse(touch, "x_mm") - [1.0, -3.0]
    inverse = np.linalg.inv([[4.0, 1.0], [1.0, 1.0]])
    assert np.einsum("ni,ij,nj->n", points, inverse, points) == pytest.approx(1.0)


def test_isocharge_lines_go_through_the_touch():
    model = bumps()
    touch = np.array([[3.0, -2.0, 20.0, 1.5]])
    pressed = {key.split(".")[1]: value for key, value in zip(SCENE_KEYS, touch[0], strict=True)}
    charges = dict(zip(model.names, model.evaluate(touch)[0][0].tolist(), strict=True))
    lines = isocharge_lines(model, pressed, charges)
    assert set(lines) == set(model.names)
    for name in lines:
        points = np.concatenate(lines[name])
        assert np.hypot(*(points - touch[0, :2]).T).min() < 0.3
        assert np.hypot(*points.T).max() > 8.0  # they go on
    assert isocharge_lines(model, {**pressed, "force_N": 50.0}, charges) == {}


def test_changes_without_a_film_at_rest_are_not_located():
    heated = SCENE.with_(**{"film.temperature_change_K": 1.0}, readout={"reading": "change"})
    with pytest.raises(ValueError, match="changes"):
        find(heated, solve(heated).to_json(), 0.01, None)

"""The image of the film against values at points, and deviations of a touch against differences."""

from __future__ import annotations

from base64 import b64decode
from io import BytesIO

import numpy as np
import pytest
from matplotlib.image import imread

from pvdf_fem.explore.certainty import estimate_certainty
from pvdf_fem.explore.picture import PIXELS, QUANTITIES, encode_image, sample_image
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solver.solve import solve

SCENE = Scene.example("triangle").with_(**{"numerics.tolerance": 1e-2})


@pytest.mark.parametrize(("quantity", "error"), [("deflection", 6e-3), ("stress", 0.3)])
def test_image_has_the_values_of_the_field(quantity, error):
    solution = solve(SCENE)
    image = sample_image(solution, QUANTITIES[quantity].at_dofs(solution))
    rows, columns = np.divmod(np.arange(37, PIXELS**2, 397), PIXELS)
    x, y = (SCENE.film.radius_mm * ((k + 0.5) / PIXELS * 2.0 - 1.0) for k in (columns, rows))
    inside = np.hypot(x, y) < 1.0 * SCENE.film.radius_mm
    at = solution.at(x[inside], y[inside])
    exact = {"deflection": at.deflection_mm, "stress": at.stress_MPa[:, :2].sum(axis=1)}
    assert image[rows, columns][inside] == pytest.approx(exact[quantity], abs=error)
    assert np.isnan(image[0, 0])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_image_is_palest_where_the_film_does_not_move(sign):
    shown = encode_image(sign * np.array([[0.0, 2.0], [1.0, np.nan]]), "deflection")
    assert sorted([float(shown["low"]), float(shown["high"])], key=abs) == [0.0, 2.0 * sign]
    pixels = imread(BytesIO(b64decode(shown["url"].partition(",")[2])))[::-1]  # the lowest y first
    assert pixels[..., 3].tolist() == [[1.0, 1.0], [1.0, 0.0]]  # the film is not where it is NaN
    still, half, most = pixels[0, 0, :3].sum(), pixels[1, 0, :3].sum(), pixels[0, 1, :3].sum()
    assert still > half > most
    assert encode_image(np.zeros((2, 2)), "deflection")["high"] == "0"


def test_deviations_are_those_of_noisy_readings_by_differences():
    values = {"probe.x_mm": 4.0, "probe.y_mm": 3.0, "load.force_N": 1.0}
    place, steps = SCENE.with_(values), dict(zip(values, (0.2, 0.2, 0.02), strict=True))

    def charges(key: str, step: float) -> np.ndarray:
        moved = place.with_(**{key: values[key] + step, "numerics.tolerance": 1e-4})
        return np.array([*solve(moved).charges_pC.values()])

    slopes = [(charges(k, h) - charges(k, -h)) / (2.0 * h) for k, h in steps.items()]
    scaled = np.array(slopes).T / (0.02 * charges("load.force_N", 0.0))[:, None]
    covariance = np.linalg.inv(scaled.T @ scaled)
    found = estimate_certainty(place.to_toml(), 0.02)
    deviations = [float(row.split("</td>")[2][4:]) for row in found["table"].split("</tr>")[1:-1]]
    assert deviations == pytest.approx(np.sqrt(covariance.diagonal()), rel=0.1)
    points = np.array(found["ellipses"][0]) - [4.0, 3.0]
    sizes = np.einsum("ni,ij,nj->n", points, np.linalg.inv(covariance[:2, :2]), points)
    assert sizes / sizes.mean() == pytest.approx(1.0, rel=0.2)  # all magnified equally


@pytest.mark.parametrize(
    ("changes", "noise", "reason"),
    [
        ({"electrodes": {"layout": "ring", "count": 2}}, 0.01, "2 electrodes"),
        ({"film.d33_pC_N": -15.0}, 0.01, "film.d33_pC_N"),
        ({}, 0.0, "noise = 0"),
        ({"film.temperature_change_K": 1.0, "readout": {"reading": "change"}}, 0.01, "changes"),
    ],
)
def test_a_touch_that_readings_do_not_determine_has_no_ellipse(changes, noise, reason):
    found = estimate_certainty(SCENE.with_(changes).to_toml(), noise)
    assert found["ellipses"] == []
    assert reason in found["message"]

"""The image of the film against values at points, and deviations of a touch against differences."""

from __future__ import annotations

from base64 import b64decode
from io import BytesIO

import numpy as np
import pytest
from matplotlib.image import imread

from pvdf_fem.explore.certainty import certainty_of
from pvdf_fem.explore.picture import ORDER, PIXELS, coloured, image_of, picture_of
from pvdf_fem.explore.results import results_of
from pvdf_fem.output.touch_map import deviation_ellipse
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solution.solve import solve

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
    picture = picture_of(SCENE.to_toml(), "stress")
    assert picture.result["charges_pC"] == solve(SCENE, order=ORDER).charges_pC
    at = solve(SCENE).at([0.0, -20.0], [10.0, 5.0])
    stress = at.stress_MPa[:, :2].sum(axis=1)
    pixels = [(int((v / 45.0 + 1.0) / 2.0 * PIXELS)) for v in (0.0, 10.0, -20.0, 5.0)]
    image = picture.image
    assert image is not None
    found = [image[pixels[1], pixels[0]], image[pixels[3], pixels[2]]]
    assert found == pytest.approx(stress, rel=0.02)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_film_is_palest_where_it_stays(sign):
    shown = coloured(sign * np.array([[0.0, 2.0], [1.0, np.nan]]), "deflection")
    assert sorted([float(shown["low"]), float(shown["high"])], key=abs) == [0.0, 2.0 * sign]
    pixels = imread(BytesIO(b64decode(shown["url"].partition(",")[2])))[::-1]  # the lowest y first
    assert pixels[..., 3].tolist() == [[1.0, 1.0], [1.0, 0.0]]  # the film is not where it is NaN
    still, half, most = pixels[0, 0, :3].sum(), pixels[1, 0, :3].sum(), pixels[0, 1, :3].sum()
    assert still > half > most


def test_bars_reach_from_zero_to_the_numbers():
    scene = SCENE.with_(**{"film.d31_pC_N": 20.0, "film.d32_pC_N": -20.0})
    scene = scene.with_(readout={"feedback_capacitance_pF": 500.0})
    charges, readings = results_of(scene.to_toml(), "deflection")["bars"]
    values = np.array([row["value"] for row in charges["rows"]])
    assert values.min() < 0.0 < values.max()
    left, width = (np.array([row[k] for row in charges["rows"]]) for k in ("from", "width"))
    zero, span = -100.0 * values.min() / np.ptp(values), 100.0 / np.ptp(values)
    assert left == pytest.approx(zero + span * np.minimum(values, 0.0))
    assert width == pytest.approx(span * np.abs(values))
    assert [row["value"] for row in readings["rows"]] == pytest.approx(values / 500.0)


def test_a_failed_solve_has_a_reason_and_no_numbers():
    results = results_of(SCENE.with_(**{"numerics.max_unknowns": 100}).to_toml(), "deflection")
    assert results["image"] is None
    assert "numerics.max_unknowns" in results["reason"]
    assert not any(bars["rows"] for bars in results["bars"])


def test_deviations_are_those_of_noisy_readings_by_differences():
    steps = {"probe.x_mm": 0.2, "probe.y_mm": 0.2, "load.force_N": 0.02}
    place = SCENE.with_(**{"probe.x_mm": 4.0, "probe.y_mm": 3.0})
    values = {"probe.x_mm": 4.0, "probe.y_mm": 3.0, "load.force_N": 1.0}

    def charges(key: str, step: float) -> np.ndarray:
        moved = place.with_(**{key: values[key] + step, "numerics.tolerance": 1e-4})
        return np.array([*solve(moved).charges_pC.values()])

    slopes = [(charges(k, h) - charges(k, -h)) / (2.0 * h) for k, h in steps.items()]
    scaled = np.array(slopes).T / (0.02 * charges("load.force_N", 0.0))[:, None]
    expected = np.sqrt(np.linalg.inv(scaled.T @ scaled).diagonal())
    found = certainty_of(place.to_toml(), 0.02)
    told = [float(row.split("</td>")[2][4:]) for row in found["table"].split("</tr>")[1:-1]]
    assert told == pytest.approx(expected, rel=0.1)
    (ellipse,) = found["ellipses"]
    sizes = np.ptp(ellipse, axis=0) / (2.0 * expected[:2])
    assert sizes / sizes.mean() == pytest.approx([1.0, 1.0], rel=0.1)  # magnified alike
    assert np.mean(ellipse[:-1], axis=0) == pytest.approx([4.0, 3.0], abs=1e-3)


@pytest.mark.parametrize(
    ("changes", "noise", "told"),
    [
        ({"electrodes": {"layout": "ring", "count": 2}}, 0.01, "2 electrodes"),
        ({"film.d33_pC_N": -15.0}, 0.01, "film.d33_pC_N"),
        ({}, 0.0, "noise = 0"),
        ({"film.temperature_change_K": 1.0, "readout": {"reading": "change"}}, 0.01, "changes"),
    ],
)
def test_a_touch_that_readings_do_not_tell_has_no_ellipse(changes, noise, told):
    found = certainty_of(SCENE.with_(changes).to_toml(), noise)
    assert found["ellipses"] == []
    assert told in found["told"]


def test_ellipse_has_the_covariance():
    covariance = [[4.0, 0.0, 1.0], [0.0, 9.0, 0.0], [1.0, 0.0, 1.0]]
    touch = {"x_mm": 1.0, "force_N": 2.0, "y_mm": -3.0, "covariance": covariance}
    touch["standard_deviations"] = {"x_mm": 2.0, "force_N": 3.0, "y_mm": 1.0}
    points = deviation_ellipse(touch, "x_mm") - [1.0, -3.0]
    inverse = np.linalg.inv([[4.0, 1.0], [1.0, 1.0]])
    assert np.einsum("ni,ij,nj->n", points, inverse, points) == pytest.approx(1.0)

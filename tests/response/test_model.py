"""Which touches a model is of where nobody says it."""

import pytest

from pvdf_fem import Scene
from pvdf_fem.response.model import default_reach_mm


@pytest.mark.parametrize(
    ("film_mm", "probe_mm", "reach_mm"),
    [(45.0, 2.0, 12.0), (15.0, 2.0, 9.0), (15.0, 4.0, 7.0), (15.0, 8.0, 3.0)],
)
def test_touches_stay_away_from_the_rim(film_mm, probe_mm, reach_mm):
    probe = {"shape": "circle", "radius_mm": probe_mm}
    scene = Scene().with_(**{"film.radius_mm": film_mm}, probe=probe)
    assert default_reach_mm(scene) == pytest.approx(reach_mm)


def test_the_reach_is_the_same_wherever_the_probe_is():
    """To the last digit: a response is found by it."""
    scene = Scene().with_(**{"film.radius_mm": 15.0}, probe={"shape": "triangle", "side_mm": 9.0})
    places = [(0.0, 0.0, 0.0), (1.1, 0.0, 10.0), (2.3, 0.7, 33.0)]
    moved = [
        scene.with_(**{"probe.x_mm": x, "probe.y_mm": y, "probe.rotation_deg": turn})
        for x, y, turn in places
    ]
    assert len({default_reach_mm(scene) for scene in moved}) == 1

"""Keys of changes: what each of their spellings means, and which are none."""

from __future__ import annotations

import pytest

from pvdf_fem import Scene, SceneError
from pvdf_fem.scene.change import spelled

LISTED = Scene().with_(
    electrodes=[{"name": f"E{i}", "x_mm": 9.0 * i, "y_mm": 0.0} for i in (1, -1)]
)
EMPTY = '""'
BY_INDEX = "electrodes are addressed by index in a list [[electrodes]], as in electrodes[0].x_mm"


@pytest.mark.parametrize("key", ["electrodes[1].x_mm", "electrodes.1.x_mm", "electrodes[01].x_mm"])
def test_every_spelling_of_a_key_means_the_same(key):
    assert spelled(key) == "electrodes[1].x_mm"
    assert LISTED.with_(**{key: -8.0}).electrodes[1].x_mm == -8.0


def test_two_spellings_of_one_key_are_refused():
    with pytest.raises(SceneError, match=r"electrodes.1.x_mm = 1: is the same key as electrodes"):
        LISTED.with_(**{"electrodes[1].x_mm": -8.0, "electrodes.1.x_mm": 1})


@pytest.mark.parametrize("scene", [Scene(), LISTED])
def test_electrodes_are_addressed_by_index(scene):
    for key in ("electrodes.E1.x_mm", "electrodes.\u0661.x_mm", "electrodes.-1.x_mm"):
        with pytest.raises(SceneError) as error:
            scene.with_(**{key: 8.0})
        assert error.value.problems == (f"{key} = 8.0: {BY_INDEX}",)


@pytest.mark.parametrize(
    "key",
    ["", ".", "film..radius_mm", "film[radius_mm]", "electrodes[1.x_mm", "electrodes]1[.x_mm"],
)
def test_what_is_no_key_is_refused(key):
    with pytest.raises(SceneError) as error:
        LISTED.with_(**{key: 8.0})
    assert error.value.problems == (
        f"{key or EMPTY} = 8.0: is no key; write one such as film.radius_mm or electrodes[0].x_mm",
    )

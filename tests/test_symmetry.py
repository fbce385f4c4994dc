"""Equivalent scenes: as many as the symmetries allow, and with the charges of each other."""

import pytest

from pvdf_fem import Scene, solve
from pvdf_fem.sensing.symmetry import images, representative, solve_once
from pvdf_fem.store import Store

PLACED = Scene().with_(
    **{
        "probe": {"shape": "triangle", "x_mm": 3.0, "y_mm": -7.5, "rotation_deg": 200.0},
        "film.d31_pC_N": 18.0,
        "film.d32_pC_N": 2.0,
        "numerics.tolerance": 0.02,
    }
)
L_SHAPE = [[0.0, 0.0], [3.0, 0.0], [3.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]]


@pytest.mark.parametrize(
    ("changes", "count"),
    [
        ({}, 8),
        ({"electrodes.layout": "three"}, 2),
        ({"film.youngs_modulus_GPa": [2.0, 1.0]}, 4),
        ({"probe.shape": "polygon", "probe.vertices_mm": L_SHAPE}, 4),
    ],
)
def test_as_many_images_as_symmetries(changes, count):
    scene = PLACED.with_(**changes)
    found = images(scene)
    assert len(found) == count
    assert len({image.scene for image in found}) == count
    assert len({representative(image.scene).scene for image in found}) == 1


def test_scenes_that_only_look_alike_have_representatives_of_their_own():
    changes = [{}, {"probe.rotation_deg": 190.0}, {"probe.x_mm": 2.0}, {"film.d31_pC_N": 8.0}]
    assert len({representative(PLACED.with_(**change)).scene for change in changes}) == 4


def test_a_scene_without_a_probe_stands_for_itself():
    assert representative(Scene()).scene == Scene()


@pytest.mark.parametrize("observable", ["material", "thesis-edge"])
def test_images_have_the_charges_of_the_scene(observable, tmp_path):
    """Mesh noise is below 1 %; charges of the electrodes differ by 2 % and more."""
    scene = PLACED.with_(**{"numerics.observable": observable})
    charges = solve(scene).charges_pC
    assert min(abs(a / b - 1) for a in charges.values() for b in charges.values() if a != b) > 0.02
    scenes = [image.scene for image in images(scene)]
    solved = []
    with Store(tmp_path / "s.db") as store:
        records = solve_once(
            [scene, *scenes], store, processes=1, progress=lambda _, total: solved.append(total)
        )
    assert set(solved) == {1}
    assert records[0].charges_pC(18.0, 2.0, observable) == pytest.approx(charges, rel=0.01)
    for image, record in zip(images(scene), records[1:], strict=True):
        film = image.scene.film
        found = record.charges_pC(film.d31_pC_N, film.d32_pC_N, observable)
        names = [electrode.name for electrode in scene.electrode_list]
        moved = {name: found[names[i]] for name, i in zip(names, image.electrodes, strict=True)}
        assert moved == pytest.approx(charges, rel=0.01)

"""Films of any outline: what equal films, symmetries and rotations must have in common."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pvdf_fem import Scene, SceneError, build_response, solve
from pvdf_fem.problem.equivalence import compute_mechanical_key
from pvdf_fem.problem.problem import Problem
from pvdf_fem.problem.symmetry import find_symmetry_sector
from pvdf_fem.scene.outlines.outline import is_within
from pvdf_fem.view.files.mesh_files import write_mesh
from tests.helpers.refusals import keys, refused

#: Films of each shape on which the four electrodes fit.
FILMS = {
    "circle": {"radius_mm": 45.0},
    "ellipse": {"semi_axes_mm": [45.0, 30.0]},
    "rectangle": {"width_mm": 60.0, "height_mm": 40.0, "corner_radius_mm": 5.0},
    "square": {"side_mm": 50.0},
    "triangle": {"side_mm": 90.0},
    "polygon": {"vertices_mm": [[-40, -30], [40, -30], [40, 15], [20, 15], [20, 30], [-40, 30]]},
    "polyline": {
        "vertices_mm": [[-20, -20], [20, -20], [20, 20], [-20, 20]],
        "bulges": [0.0, 1.0, 0.0, 1.0],
    },
}
PROBE = {"shape": "rectangle", "width_mm": 4.0, "height_mm": 2.0, "x_mm": 3.0, "y_mm": 2.0}


def make_scene(shape: str, **changes: object) -> Scene:
    """Make a scene with a film of a shape and an off-centre probe."""
    film = {"shape": shape, **FILMS[shape], "temperature_change_K": -10.0}
    return Scene(film=film, probe=PROBE).with_(**changes)


def get_charges(scene: Scene) -> dict[str, float]:
    """Return the charges of a scene in pC."""
    solution = solve(scene)
    assert solution.status == "converged"
    return solution.charges_pC


def test_a_disc_may_be_given_as_circle_ellipse_arcs_and_polygon():
    count = 96
    angles = 2.0 * np.pi * np.arange(count) / count
    # the polygon has the area of the disc
    radius = 45.0 * np.sqrt(2.0 * np.pi / count / np.sin(2.0 * np.pi / count))
    vertices = radius * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    discs = [
        {"shape": "ellipse", "semi_axes_mm": [45.0, 45.0]},
        {"shape": "polyline", "vertices_mm": [[-45, 0], [45, 0]], "bulges": [1.0, 1.0]},
        {"shape": "polygon", "vertices_mm": vertices.tolist()},
    ]
    circle = Scene(probe=PROBE, numerics={"tolerance": 1e-4})
    expected = get_charges(circle)
    for film in discs:
        charges = get_charges(circle.with_(film=film))
        assert charges == pytest.approx(expected, rel=3e-4)


@pytest.mark.parametrize("shape", FILMS)
def test_a_film_may_be_turned_by_a_quarter_with_everything_on_it(shape):
    scene = make_scene(shape)
    corners = scene.film.outline.inscribed_polygon.exterior.coords[:-1]
    film = {"shape": "polygon", "vertices_mm": [[1e3 * x, 1e3 * y] for x, y in corners]}
    turned = {"shape": "polygon", "vertices_mm": [[-1e3 * y, 1e3 * x] for x, y in corners]}
    probe = {"x_mm": -PROBE["y_mm"], "y_mm": PROBE["x_mm"], "rotation_deg": 90.0}
    charges = get_charges(scene.with_(film=film))
    turned_charges = get_charges(scene.with_(film=turned, probe=probe))
    assert list(turned_charges.values()) == pytest.approx(
        [charges[name] for name in "DABC"], rel=2e-3
    )


@pytest.mark.parametrize("shape", FILMS)
def test_a_sector_has_the_charges_of_the_whole_film(shape):
    scene = make_scene(shape, **{"probe.x_mm": 0.0, "probe.y_mm": 3.0})
    has_mirror = shape != "polygon"
    assert bool(find_symmetry_sector(scene).mirror_axes) == has_mirror
    charges = get_charges(scene)
    if has_mirror:
        assert charges["A"] == pytest.approx(charges["C"], rel=1e-12)
    # a tiny tangential force breaks the symmetry
    whole = scene.with_(**{"load.tangential_N": [1e-9, 0.0]})
    assert not find_symmetry_sector(whole).mirror_axes
    assert get_charges(whole) == pytest.approx(charges, rel=2e-3)


def test_only_the_symmetries_of_the_film_make_scenes_equivalent():
    places = [(3.0, 2.0), (-3.0, 2.0), (2.0, 3.0)]
    counts = {}
    for shape in ("circle", "square", "rectangle", "polygon"):
        texts = set()
        for x_mm, y_mm in places:
            disc = {"shape": "circle", "radius_mm": 2.0, "x_mm": x_mm, "y_mm": y_mm}
            problem = Problem.from_scene(make_scene(shape).with_(probe=disc))
            texts.add(compute_mechanical_key(problem).text)
        counts[shape] = len(texts)
    assert counts == {"circle": 1, "square": 1, "rectangle": 2, "polygon": 3}


def test_a_probe_across_a_notch_is_refused():
    u_film = [[-40, -30], [40, -30], [40, 30], [25, 30], [25, 10], [-25, 10], [-25, 30], [-40, 30]]
    film = {"shape": "polygon", "vertices_mm": u_film}
    bar = {"shape": "rectangle", "width_mm": 60.0, "height_mm": 4.0, "x_mm": 0.0, "y_mm": 20.0}
    electrodes = [{"name": "A", "x_mm": 0.0, "y_mm": -20.0}]
    assert keys(refused(Scene, film=film, probe=bar, electrodes=electrodes)) == ["probe.y_mm"]
    Scene(film=film, probe={**bar, "y_mm": -20.0}, electrodes=[{"name": "A", "x_mm": 0, "y_mm": 0}])


@settings(max_examples=40, deadline=None)
@given(
    st.sampled_from(sorted(FILMS)),
    st.floats(-50.0, 50.0),
    st.floats(-50.0, 50.0),
    st.floats(0.5, 20.0),
)
def test_what_is_within_a_film_has_no_area_outside(shape, x_mm, y_mm, radius_mm):
    film = make_scene(shape).film.outline
    disc = Scene(probe={"shape": "circle", "radius_mm": radius_mm}).probe.geometry
    outline = disc.make_outline(x_mm, y_mm, 0.0)
    outside = outline.inscribed_polygon.difference(film.equal_area_polygon).area
    # the polygons are closer to the outlines than this fraction of the radius
    slack = 2.0 * np.pi * radius_mm * 1e-3 * 0.005 * film.reach
    assert is_within(outline, film) == (outside <= slack) or outside < 2.0 * slack


@pytest.mark.parametrize(("shape", "bends"), [*itertools.product(FILMS, (False, True))])
def test_every_shape_has_balanced_forces(shape, bends):
    scene = make_scene(shape, **{"film.bending": bends, "numerics.tolerance": 1e-2})
    solution = solve(scene)
    assert solution.status == "converged"
    assert abs(solution.force_balance) < 1e-3


@pytest.mark.parametrize("place", [0.0, 100.0])
def test_a_response_of_another_shape_is_refused_by_key(place):
    # (0, 0), where a response has the probe, may be outside of the film
    vertices = np.array([[-40.0, -30.0], [40.0, -30.0], [0.0, 40.0]]) + place
    film = {"shape": "polygon", "vertices_mm": vertices.tolist()}
    disc = {"shape": "circle", "radius_mm": 2.0, "x_mm": place, "y_mm": place}
    electrodes = [{"name": "A", "x_mm": place - 5.0, "y_mm": place}]
    scene = Scene(film=film, probe=disc, electrodes=electrodes)
    with pytest.raises((SceneError, ValueError), match=r"^film\.shape .* requires a disc"):
        build_response(scene)


def test_charges_near_a_reentrant_corner_are_within_the_tolerance():
    film = {"shape": "polygon", "vertices_mm": FILMS["polygon"]["vertices_mm"]}
    film["temperature_change_K"] = -10.0
    # electrode and probe are on both sides of the corner at (20, 15) mm
    electrodes = [{"name": "A", "x_mm": 15.0, "y_mm": 22.0}]
    probe = {"shape": "circle", "radius_mm": 2.0, "x_mm": 26.0, "y_mm": 8.0}
    scene = Scene(film=film, electrodes=electrodes, probe=probe, load={"force_N": 0.3})
    solution = solve(scene)
    exact = get_charges(scene.with_(numerics={"tolerance": 2e-5}))["A"]
    error = abs(solution.charges_pC["A"] - exact)
    assert error < 1e-3 * abs(solution.charges_pC["A"])
    assert error < 3.0 * solution.charge_errors_pC["A"]


@pytest.mark.parametrize("shape", FILMS)
def test_a_mesh_file_of_every_film_is_read_again(shape, tmp_path):
    scene = make_scene(shape, **{"numerics.tolerance": 1e-2})
    solution = solve(scene)
    for ending in ("msh", "inp"):
        path = tmp_path / f"film.{ending}"
        write_mesh(solution.mesh, path)
        again = solve(scene, mesh=path)
        assert again.charges_pC == pytest.approx(solution.charges_pC, rel=5e-3)
        assert again.mesh.nelements == solution.mesh.nelements

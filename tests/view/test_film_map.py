"""Maps of a solution: what is drawn is what the solution has at those places."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection

from pvdf_fem import NotConvergedError, Scene, Solution, solve
from pvdf_fem.solver.estimate.next_order import compute_error_contributions
from pvdf_fem.solver.nonlinear.status import Status
from pvdf_fem.view.figures import make_figure, render_figure, use_style
from pvdf_fem.view.film_quantities import MAPS, sample_field


@pytest.fixture(scope="module")
def solution() -> Solution:
    probe = {"shape": "rectangle", "x_mm": 5.0}
    return solve(Scene().with_(**{"probe": probe, "numerics.tolerance": 0.02}))


@pytest.fixture(scope="module")
def touched() -> Solution:
    return solve(Scene.example("sphere").with_(**{"numerics.tolerance": 0.02}))


def axes() -> Axes:
    with use_style():
        return make_figure().add_subplot()


def labels(ax: Axes) -> list[str]:
    return [text.get_text() for text in ax.texts]


def test_the_deflection_map_has_deflection_charges_and_outlines(solution):
    ax = axes()
    assert solution.plot(ax=ax) is ax.figure
    for name, charge in solution.charges_pC.items():
        assert any(name in text and f"{charge:.4g} ± " in text for text in labels(ax))
    levels = ax.collections[0].levels
    assert levels[0] <= 0.0
    assert solution.deflection_max_mm <= levels[-1] <= 1.2 * solution.deflection_max_mm
    corners = [line.get_xydata()[:-1] for line in ax.lines]
    [probe] = [c for c in corners if np.ptp(c[:, 0]) == pytest.approx(14.0)]
    np.testing.assert_allclose(probe.mean(axis=0), [5.0, 0.0], atol=1e-9)


def test_maps_of_a_flat_film_can_be_drawn():
    flat = solve(Scene())
    flat.plot(ax=(ax := axes()))
    assert len(labels(ax)) >= 4
    assert all("48 ± " in text for text in labels(ax))
    for name in ("stress", "principal directions", "error"):
        assert render_figure(flat.plot(name), ".png")
    with pytest.raises(NotConvergedError):
        Solution(Scene(), Status.MAX_ITERATIONS, "no").plot()


@pytest.mark.parametrize("name", [name for name, shown in MAPS.items() if shown.values])
def test_sampled_fields_have_the_values_at_their_points(solution, name):
    """Inside of elements, where the stress has one value; colours but those of levels go from the
    least value to the largest one."""
    shown, film = MAPS[name], solution.film_data()
    inside = film.in_elements(np.array([[0.3, 0.1, 0.5], [0.3, 0.7, 0.2]]))
    at = solution.at(inside.x_mm, inside.y_mm)
    np.testing.assert_allclose(inside.displacement_mm, at.displacement_mm, atol=1e-12)
    np.testing.assert_allclose(shown.values(inside), shown.values(at), rtol=1e-9, atol=1e-9)
    _, values = sample_field(film, shown)
    figure = solution.plot(name)
    assert figure.axes[-1].get_ylabel() == shown.label
    if name != "deflection":
        drawn = figure.axes[0].collections[0]
        np.testing.assert_array_equal(drawn.get_array(), values.ravel())
        assert drawn.get_clim() == (values.min(), values.max())


def test_strokes_follow_the_larger_principal_stress(solution):
    ax = axes()
    solution.plot("principal directions", ax=ax, reach_mm=20.0)
    [strokes] = [c for c in ax.collections if isinstance(c, LineCollection)]
    ends = np.array(strokes.get_segments())
    middles, along = ends.mean(axis=1), ends[:, 1] - ends[:, 0]
    assert len(middles) > 50
    for place, way in zip(middles[::50], along[::50], strict=True):
        s11, s22, s12 = solution.at(*place).stress_MPa
        _, vectors = np.linalg.eigh([[s11, s12], [s12, s22]])
        assert abs(vectors[:, 1] @ way) == pytest.approx(np.linalg.norm(way), rel=1e-6)


def test_mesh_and_error_maps_have_all_elements(solution):
    mesh, errors = axes(), axes()
    solution.plot("mesh", ax=mesh)
    solution.plot("error", ax=errors)
    count, shares = (
        solution.mesh.nelements,
        compute_error_contributions(solution.discrete, solution.problem.outputs),
    )
    assert f"{count} triangles" in mesh.get_title()
    lines, drawn = mesh.collections[-1], errors.collections[-1]
    assert isinstance(lines, LineCollection)
    assert isinstance(drawn, PolyCollection)
    assert len(lines.get_paths()) == len(drawn.get_paths()) == count
    np.testing.assert_allclose(drawn.get_array(), 1e12 * shares.max(axis=1))
    # B and D are mirror images, and so is the mesh
    sums = dict(zip(solution.charges_pC, 1e12 * shares.sum(axis=0), strict=True))
    assert sums["B"] == pytest.approx(sums["D"], rel=1e-6)
    for name, error in solution.charge_errors_pC.items():
        assert 0.1 * error < sums[name] < 1e3 * error


def test_the_contact_map_is_enlarged_with_limits_and_edge(touched):
    own, given = axes(), axes()
    touched.plot("contact", ax=own)
    touched.plot("contact", ax=given, reach_mm=15.0)
    [contact] = touched.contacts.values()
    limits = contact.least_pressure_MPa, contact.largest_pressure_MPa
    assert own.collections[0].get_clim() == pytest.approx(limits)
    assert any(np.array_equal(line.get_xydata(), contact.edge_mm) for line in own.lines)
    extent = np.ptp(contact.edge_mm, axis=0).max()
    assert extent < np.ptp(own.get_xlim()) < 2.0 * extent
    assert np.ptp(given.get_xlim()) == pytest.approx(30.0, rel=0.05)


def test_charges_are_a_pandas_table(solution):
    table = solution.to_dataframe()
    assert table.index.tolist() == list("ABCD")
    assert table.charges_pC.to_dict() == solution.charges_pC
    assert table.charge_changes_pC["A"] == solution.charge_changes_pC["A"]


def test_the_colour_bar_of_a_slender_film_is_as_long_as_its_labels_need():
    film = {"shape": "rectangle", "width_mm": 120.0, "height_mm": 6.0}
    electrodes = [{"name": "A", "x_mm": -10.0, "y_mm": 0.0}]
    probe = {"shape": "circle", "radius_mm": 1.0, "x_mm": 20.0, "y_mm": 0.0}
    scene = Scene(film=film, electrodes=electrodes, probe=probe, numerics={"tolerance": 0.02})
    figure = solve(scene).plot("stress")
    figure.draw_without_rendering()
    [bar] = figure.axes[0].child_axes
    texts = [text for text in bar.get_xticklabels() if text.get_text()]
    boxes = [text.get_window_extent() for text in texts]
    assert len(boxes) > 1
    assert all(first.x1 < second.x0 for first, second in itertools.pairwise(boxes))

"""Maps of a solution: what is drawn is what the solution has at those places."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection

from pvdf_fem import NotConvergedError, Scene, Solution, solve
from pvdf_fem.charges.goals import goals_of
from pvdf_fem.charges.point_values import values_in_elements
from pvdf_fem.output.figures import new_figure, save, style
from pvdf_fem.output.film_map import MAPS, sampled
from pvdf_fem.solution.next_order import error_shares
from pvdf_fem.solvers.status import Status


@pytest.fixture(scope="module")
def solution() -> Solution:
    probe = {"shape": "rectangle", "x_mm": 5.0}
    return solve(Scene().with_(**{"probe": probe, "numerics.tolerance": 0.02}))


@pytest.fixture(scope="module")
def touched() -> Solution:
    return solve(Scene.example("sphere").with_(**{"numerics.tolerance": 0.02}))


def axes() -> Axes:
    with style():
        return new_figure().add_subplot()


def labels(ax: Axes) -> list[str]:
    return [text.get_text() for text in ax.texts]


def test_deflection_map_shows_deflection_charges_and_outlines(solution: Solution) -> None:
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
    assert ax.get_aspect() == 1.0
    assert "(mm)" in ax.get_xlabel()
    assert "(mm)" in ax.get_ylabel()


def test_a_film_that_is_pulled_is_palest_where_it_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    pressed, pulled = axes(), axes()
    flat = solve(Scene.example("triangle").with_(**{"numerics.tolerance": 0.02}))
    flat.plot(ax=pressed)
    deflection = MAPS["deflection"]
    upwards = replace(deflection, values=lambda at: -at.deflection_mm)
    monkeypatch.setitem(MAPS, "deflection", upwards)
    flat.plot(ax=pulled)
    down, up = (ax.collections[0] for ax in (pressed, pulled))
    np.testing.assert_allclose(down.levels, -up.levels[::-1], atol=1e-12)
    shades = down.to_rgba(down.levels[:-1]), up.to_rgba(up.levels[:0:-1])
    np.testing.assert_allclose(*shades, atol=0.01)


def test_maps_of_a_flat_film(tmp_path: Path) -> None:
    ax, flat = axes(), solve(Scene())
    flat.plot(ax=ax)
    assert all("48 ± " in text for text in labels(ax))
    for name in ("stress", "principal directions", "error"):
        save(flat.plot(name), tmp_path / "flat.png")


def test_values_in_elements_are_those_at_their_places(solution: Solution) -> None:
    """Inside of elements, where the stress has one value."""
    local, fields = np.array([[0.3, 0.1, 0.5], [0.3, 0.7, 0.2]]), solution.fields
    inside = values_in_elements(fields.equilibrium, fields.state, local)
    at = solution.at(inside.x_mm, inside.y_mm)
    np.testing.assert_allclose(inside.displacement_mm, at.displacement_mm, atol=1e-12)
    np.testing.assert_allclose(inside.stress_MPa, at.stress_MPa, rtol=1e-9, atol=1e-9)
    density = MAPS["charge density"].values
    assert density is not None
    np.testing.assert_allclose(density(inside), at.charge_density_pC_mm2, rtol=1e-9)


@pytest.mark.parametrize("name", ["stress", "charge density", "principal directions"])
def test_colours_go_from_the_least_to_the_largest_value(solution: Solution, name: str) -> None:
    ax, quantity = axes(), MAPS[name]
    figure = solution.plot(name, ax=ax)
    _, _, values = sampled(solution.film_data(), quantity)
    drawn = ax.collections[0]
    np.testing.assert_array_equal(drawn.get_array(), values.ravel())
    assert drawn.get_clim() == (values.min(), values.max())
    assert figure.axes[-1].get_ylabel() == quantity.label


def test_the_rim_is_drawn_round(solution: Solution) -> None:
    """Straight sides between the nodes on the rim would be far inside of it."""
    at, *_ = sampled(solution.film_data(), MAPS["stress"])
    angle, radius = np.arctan2(at.y_mm, at.x_mm), np.hypot(at.x_mm, at.y_mm)
    outermost = [radius[np.abs(angle - a) < 0.05].max() for a in np.linspace(-3.0, 3.0, 40)]
    assert min(outermost) > 0.9995 * solution.scene.film.radius_mm


def test_strokes_are_along_the_larger_principal_stress(solution: Solution) -> None:
    ax = axes()
    solution.plot("principal directions", ax=ax, reach_mm=20.0)
    [strokes] = [c for c in ax.collections if isinstance(c, LineCollection)]
    ends = np.array(strokes.get_segments())
    middles, along = ends.mean(axis=1), ends[:, 1] - ends[:, 0]
    for place, way in zip(middles[::50], along[::50], strict=True):
        s11, s22, s12 = solution.at(*place).stress_MPa
        _, vectors = np.linalg.eigh([[s11, s12], [s12, s22]])
        assert abs(vectors[:, 1] @ way) == pytest.approx(np.linalg.norm(way), rel=1e-6)


def test_mesh_and_error_shares_are_of_all_elements(solution: Solution) -> None:
    mesh, errors = axes(), axes()
    solution.plot("mesh", ax=mesh)
    solution.plot("error", ax=errors)
    count, shares = solution.mesh.nelements, error_shares(solution.fields, goals_of(solution.scene))
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


def test_contact_has_the_limits_and_the_edge_of_the_touch(touched: Solution) -> None:
    ax = axes()
    touched.plot("contact", ax=ax)
    [contact] = touched.contacts.values()
    limits = contact.least_pressure_MPa, contact.largest_pressure_MPa
    assert ax.collections[0].get_clim() == pytest.approx(limits)
    assert any(np.array_equal(line.get_xydata(), contact.edge_mm) for line in ax.lines)


def test_a_quantity_that_there_is_not_is_refused(solution: Solution) -> None:
    with pytest.raises(ValueError, match="strain") as caught:
        solution.plot("strain")
    assert all(name in str(caught.value) for name in MAPS)
    with pytest.raises(ValueError, match=r"load\.kind"):
        solution.plot("contact")
    with pytest.raises(NotConvergedError):
        Solution(Scene(), Status.MAX_ITERATIONS, "no").plot()


def test_charges_as_a_table_of_pandas(solution: Solution) -> None:
    table = solution.to_dataframe()
    assert table.index.tolist() == list("ABCD")
    assert table.charges_pC.to_dict() == solution.charges_pC
    assert table.charge_changes_pC["A"] == solution.charge_changes_pC["A"]


def test_a_contact_is_enlarged_unless_a_reach_is_given(touched: Solution) -> None:
    own, given = axes(), axes()
    touched.plot("contact", ax=own)
    touched.plot("contact", ax=given, reach_mm=15.0)
    edge = touched.contacts["probe"].edge_mm
    assert np.ptp(edge, axis=0).max() < np.ptp(own.get_xlim()) < 2.0 * np.ptp(edge, axis=0).max()
    [inset] = own.child_axes
    np.testing.assert_allclose(inset.lines[-1].get_xydata()[0], [5.0, 1.0], atol=0.1)
    assert np.ptp(given.get_xlim()) == pytest.approx(30.0, rel=0.05)
    assert not given.child_axes


@pytest.mark.parametrize("reach_mm", [0.0, -5.0, float("nan")])
def test_a_reach_is_positive(solution: Solution, reach_mm: float) -> None:
    with pytest.raises(ValueError, match="reach_mm"):
        solution.plot(reach_mm=reach_mm)


def test_the_title_says_what_presses_and_many_electrodes_have_names_only(
    solution: Solution,
) -> None:
    ax = axes()
    solution.plot(ax=ax)
    assert "1 N" in ax.get_title()
    ring = {"layout": "ring", "count": 16, "shape": "circle", "radius_mm": 1.0}
    many = solve(solution.scene.with_(electrodes=ring))
    many.plot(ax=(crowded := axes()))
    assert labels(crowded) == list(many.charges_pC)

"""Hypothesis strategies for valid scenes, and pieces of scene files."""

from __future__ import annotations

import math
from typing import Any

from hypothesis import strategies as st

from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import write_toml

_WITHOUT_CONTROLS = st.characters(exclude_categories=["C", "Z"], exclude_characters='/\\,="')

names = st.text(_WITHOUT_CONTROLS, min_size=1, max_size=8)
angles_deg = st.floats(-360.0, 360.0)


def _numbers(low: float, high: float) -> st.SearchStrategy[float | int]:
    """Floats, and the integers that a user may write for them."""
    return st.floats(low, high) | st.integers(math.ceil(low), math.floor(high))


@st.composite
def films(draw: st.DrawFn) -> dict[str, Any]:
    """A [film] table, isotropic or orthotropic."""
    table: dict[str, Any] = {
        "radius_mm": draw(_numbers(20.0, 100.0)),
        "thickness_um": draw(_numbers(5.0, 200.0)),
        "density_kg_m3": draw(_numbers(500.0, 5000.0)),
        "thermal_expansion_per_K": draw(st.floats(1e-5, 1e-3)),
        "d31_pC_N": draw(_numbers(-30.0, 30.0)),
        "d32_pC_N": draw(_numbers(-30.0, 30.0)),
        "permittivity": draw(_numbers(1.0, 30.0)),
    }
    if draw(st.booleans()):
        table["temperature_change_K"] = draw(_numbers(-100.0, 0.0))
    else:
        tensions = _numbers(0.0, 500.0)
        table["pretension_N_m"] = draw(tensions | st.lists(tensions, min_size=2, max_size=2))
    if draw(st.booleans()):
        E1, E2 = draw(_numbers(0.5, 10.0)), draw(_numbers(0.5, 10.0))
        table["youngs_modulus_GPa"] = [E1, E2]
        table["poisson_ratio"] = draw(st.floats(-0.9, 0.9)) * math.sqrt(E1 / E2)
        if draw(st.booleans()):
            table["shear_modulus_GPa"] = draw(_numbers(0.1, 5.0))
    else:
        table["youngs_modulus_GPa"] = draw(_numbers(0.1, 10.0))
        table["poisson_ratio"] = draw(st.floats(0.0, 0.49))
    return table


@st.composite
def shapes(draw: st.DrawFn, kinds: tuple[str, ...], reach_mm: float) -> dict[str, Any]:
    """The keys of a shape that lies within `reach_mm` of its (x, y), however it is turned."""
    shape = draw(st.sampled_from(kinds))
    size = draw(st.floats(0.1, 1.0)) * reach_mm
    table: dict[str, Any] = {"shape": shape, "rotation_deg": draw(angles_deg)}
    if shape == "circle":
        table["radius_mm"] = size
    elif shape in ("square", "triangle"):
        table["side_mm"] = size
    elif shape == "ellipse":
        table["semi_axes_mm"] = draw(st.permutations([size, draw(st.floats(0.01, 1.0)) * size]))
    elif shape == "rectangle":
        table["width_mm"] = size
        table["height_mm"] = draw(st.floats(0.1, 1.0)) * reach_mm
    else:
        # a star about the origin is simple, convex or not
        count = draw(st.integers(3, 7))
        radii = [draw(st.floats(0.3, 1.0)) * size for _ in range(count)]
        corners = [2 * math.pi * i / count for i in range(count)]
        vertices = [[r * math.cos(t), r * math.sin(t)] for r, t in zip(radii, corners, strict=True)]
        table["vertices_mm"] = vertices if draw(st.booleans()) else vertices[::-1]
    return table


@st.composite
def electrode_lists(draw: st.DrawFn, radius_mm: float) -> list[dict[str, Any]]:
    """[[electrodes]] tables, each in a cell of its own on a grid inside the film."""
    cell = radius_mm / 4
    cells = [(i, j) for i in range(-2, 3) for j in range(-2, 3)]
    places = draw(st.lists(st.sampled_from(cells), min_size=1, max_size=4, unique=True))
    labels = draw(st.lists(names, min_size=len(places), max_size=len(places), unique=True))
    kinds = ("square", "rectangle", "circle", "ellipse", "polygon")
    return [
        {"name": name, "x_mm": i * cell, "y_mm": j * cell}
        | draw(shapes(kinds=kinds, reach_mm=0.49 * cell))
        for name, (i, j) in zip(labels, places, strict=True)
    ]


@st.composite
def rings(draw: st.DrawFn, radius_mm: float) -> dict[str, Any]:
    """An [electrodes] table of layout "ring", whose electrodes lie apart."""
    ring_mm, count = draw(st.floats(0.2, 0.7)) * radius_mm, draw(st.integers(1, 8))
    apart_mm = min(ring_mm, 2.0 * ring_mm * math.sin(math.pi / count) if count > 1 else ring_mm)
    kinds = ("square", "rectangle", "circle", "ellipse", "polygon")
    shape = draw(shapes(kinds=kinds, reach_mm=min(0.49 * apart_mm, 0.99 * radius_mm - ring_mm)))
    del shape["rotation_deg"]
    return shape | {
        "layout": "ring",
        "count": count,
        "ring_radius_mm": ring_mm,
        "first_angle_deg": draw(angles_deg),
        "centre": draw(st.booleans()),
    }


@st.composite
def probes(draw: st.DrawFn, radius_mm: float) -> dict[str, Any]:
    """A [probe] table inside the film, over electrodes or not."""
    share = draw(st.floats(0.05, 0.6))
    distance, direction = (0.99 - share) * radius_mm * draw(st.floats(0, 1)), draw(angles_deg)
    return {
        "x_mm": distance * math.cos(math.radians(direction)),
        "y_mm": distance * math.sin(math.radians(direction)),
    } | draw(shapes(("triangle", "rectangle", "circle", "ellipse", "polygon"), share * radius_mm))


@st.composite
def tables(draw: st.DrawFn) -> dict[str, Any]:
    """A valid scene as the tables of its file."""
    film = draw(films())
    radius_mm = film["radius_mm"]
    ring_mm = draw(st.floats(0.2, 0.7)) * radius_mm
    layout = {
        "layout": draw(st.sampled_from(["four", "three"])),
        "ring_radius_mm": ring_mm,
        "side_mm": draw(st.floats(0.05, 0.35)) * ring_mm,
    }
    scene: dict[str, Any] = {
        "film": film,
        "electrodes": draw(st.just(layout) | rings(radius_mm) | electrode_lists(radius_mm)),
        "load": {"force_N": draw(_numbers(0.0, 100.0))},
        "numerics": {"tolerance": draw(st.floats(1e-7, 0.1))},
    }
    if draw(st.booleans()):
        scene["numerics"]["max_unknowns"] = draw(st.integers(100, 10_000_000))
        scene["numerics"]["max_seconds"] = draw(_numbers(0.1, 1e6))
    if draw(st.booleans()):
        scene["probe"] = draw(probes(radius_mm))
    scene["load"]["kind"] = draw(st.sampled_from(["dead", "follower", "rigid"]))
    if scene["load"]["kind"] == "rigid" and draw(st.booleans()):
        scene["load"]["contact"] = draw(st.sampled_from(["sliding", "stuck"]))
    if scene["electrodes"] is layout:
        scene["numerics"]["observable"] = draw(st.sampled_from(["material", "thesis-edge"]))
    return scene


def scenes() -> st.SearchStrategy[Scene]:
    """Valid scenes."""
    return tables().map(Scene.model_validate)


def electrode(name: str = "A", **keys: object) -> str:
    """One [[electrodes]] table as text, at the centre unless told otherwise."""
    row = {"name": name, "x_mm": 0.0, "y_mm": 0.0, **keys}
    return write_toml({"electrodes": [row]})

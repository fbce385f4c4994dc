"""Extreme scenes: drawn with a seed from the ends of every range, and enlarged by a scale.

A scene is drawn by itself from ``(seed, number)``. Sizes, forces and moduli are uniform in their
logarithm. Awkward scenes have their own share: no pretension, needles, probes as large as the film,
shapes that all but touch the rim or each other, films fifty times stiffer one way than the other.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from pvdf_fem import Scene, SceneError
from pvdf_fem.scene.outlines.circle import Circle
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.placed.probe import Probe

Tables = dict[str, Any]
Random = np.random.Generator

#: Ranges of what is drawn. An aspect is the length of a needle over its width, a gap the distance
#: from the rim of a shape that all but touches the rim.
RANGES = {
    "film.radius_mm": (1.0, 1000.0),
    "film.thickness_um": (0.5, 1000.0),
    "film.youngs_modulus_GPa": (1e-3, 400.0),
    "cooling_K": (1e-3, 150.0),
    "heating_K": (1e-3, 50.0),
    "orthotropy": (1.0, 50.0),
    "load.force_N": (1e-9, 100.0),
    "aspect": (10.0, 1000.0),
    "gap_mm": (0.01, 1.0),
}
LEAST_MM = {"probe": 0.01, "needle": 1e-4, "electrode": 0.05}  #: Sizes.
LARGEST = {"probe": 0.9, "electrode": 0.5}  #: Sizes, over the film's radius.
HAIR_MM = 1e-9  #: Distance of the edges of a probe and an electrode that all but touch.
SHAPES = ("circle", "rectangle", "triangle", "polygon", "needle", "whole")
ELECTRODES = ("ring", "rim", "corner", "edge", "disc")
LOADS: tuple[Tables, ...] = (
    {"load.kind": "dead"},
    {"load.kind": "follower"},
    {"load.kind": "rigid", "load.contact": "sliding"},
    {"load.kind": "rigid", "load.contact": "stuck"},
)
TRIES = 200  #: Draws of sizes, after which another kind of electrodes is taken.


def draw_extreme_scene(number: int, seed: int) -> Scene:
    """Draw the scene of a number."""
    random = np.random.default_rng([seed, number])
    film, shape = _draw_film(random), str(random.choice(SHAPES))
    load = LOADS[int(random.integers(2 if shape == "whole" else 4))]
    radius = film["film.radius_mm"]
    probe = _draw_probe(random, shape, radius)
    changes = {
        **film,
        **load,
        "load.force_N": _draw_in_range(random, "load.force_N"),
        "probe": probe,
    }
    for kind in random.permutation(ELECTRODES):
        for _ in range(TRIES):
            try:
                electrodes = _draw_electrodes(random, str(kind), radius, probe)
                return Scene().with_(**changes, electrodes=electrodes)
            except SceneError:
                continue
    raise RuntimeError(f"no electrodes fit on scene {number} of seed {seed}")


def enlarge(scene: Scene, length: float, modulus: float) -> Scene:
    """Return a scene with all lengths and moduli times factors, and with the same strains.

    Parameters
    ----------
    scene : Scene
        The scene.
    length, modulus : float
        Factors of lengths and moduli. Forces and charges grow with the modulus and the square of
        the lengths.

    Returns
    -------
    Scene
    """

    def scale(table: Any, key: str = "") -> Any:
        if isinstance(table, dict):
            return {name: scale(value, name) for name, value in table.items()}
        if isinstance(table, list):
            return [scale(value, key) for value in table]
        factor = length if key.endswith(("_mm", "_um")) else 1.0
        factor *= modulus if key.endswith("_modulus_GPa") else 1.0
        factor *= modulus * length**2 if key == "force_N" else 1.0
        return table if factor == 1.0 else factor * table

    return Scene.model_validate(scale(scene.model_dump(mode="json", exclude_none=True)))


def _draw_film(random: Random) -> Tables:
    keys = ("film.radius_mm", "film.thickness_um", "film.youngs_modulus_GPa")
    film: Tables = {key: _draw_in_range(random, key) for key in keys}
    modulus, ratio = film[keys[2]], float(random.uniform(0.0, 0.499))
    film |= {"film.poisson_ratio": ratio, "film.temperature_change_K": _draw_temperature(random)}
    if random.random() < 0.25:
        softer = max(modulus / _draw_in_range(random, "orthotropy"), RANGES[keys[2]][0])
        film[keys[2]] = [modulus, softer]
        if random.random() < 0.5:
            film |= {keys[2]: [softer, modulus], "film.poisson_ratio": ratio * softer / modulus}
    bending = random.choice(["no", "no", "yes", "auto"])
    if film["film.temperature_change_K"] > 0.0:
        film["film.compression"] = "tension-field"
    elif bending != "no":
        film["film.bending"] = True if bending == "yes" else "auto"
    return film


def _draw_temperature(random: Random) -> float:
    kind = random.choice(["cold", "cold", "none", "rounding", "hot"])
    if kind in ("cold", "hot"):
        return (
            -_draw_in_range(random, "cooling_K")
            if kind == "cold"
            else _draw_in_range(random, "heating_K")
        )
    return 0.0 if kind == "none" else -1e-12


def _draw_probe(random: Random, shape: str, radius: float) -> Tables:
    """Draw a probe at the film's centre, anywhere, or with a small gap to the rim."""
    if shape == "whole":
        return {"shape": "circle", "radius_mm": radius}
    probe = _draw_size(
        random, shape, _draw_log_uniform(random, LEAST_MM["probe"], LARGEST["probe"] * radius)
    )
    probe["rotation_deg"] = float(random.choice([0.0, 30.0, 90.0, random.uniform(0.0, 360.0)]))
    where, angle = random.choice(["centre", "anywhere", "rim"]), random.uniform(0.0, 2.0 * np.pi)
    gap = min(_draw_in_range(random, "gap_mm"), 0.01 * radius)

    def at(distance: float) -> Tables:
        place = distance * np.array([np.cos(angle), np.sin(angle)])
        return {**probe, **dict(zip(("x_mm", "y_mm"), place.tolist(), strict=True))}

    if where == "centre":
        return at(0.0)
    # the distance, by bisection, at which the probe is a gap off the rim
    low, high = 0.0, radius
    while high - low > 1e-3 * gap:
        middle = 0.5 * (low + high)
        fits = 1e3 * _make_outline(at(middle)).reach <= radius - gap
        low, high = (middle, high) if fits else (low, middle)
    return at(low * (float(np.sqrt(random.random())) if where == "anywhere" else 1.0))


def _draw_size(random: Random, shape: str, size: float) -> Tables:
    if shape == "circle":
        return {"shape": "circle", "radius_mm": size / 2}
    if shape == "triangle":
        return {"shape": "triangle", "side_mm": size}
    if shape == "polygon":  # a star
        count = int(random.integers(4, 9))
        angles = (np.arange(count) + random.uniform(-0.3, 0.3, count)) * 2 * np.pi / count
        corners = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        radii = size / 2 * random.uniform(0.4, 1.0, (count, 1))
        return {"shape": "polygon", "vertices_mm": (radii * corners).tolist()}
    slender = _draw_in_range(random, "aspect") if shape == "needle" else random.uniform(1.0, 5.0)
    height = max(size / slender, LEAST_MM["needle"])
    return {"shape": "rectangle", "width_mm": size, "height_mm": float(height)}


def _make_outline(probe: Tables) -> Outline:
    return Probe.model_validate(probe).outline


def _draw_electrodes(random: Random, kind: str, radius: float, probe: Tables) -> list[Tables]:
    side = _draw_log_uniform(random, LEAST_MM["electrode"], LARGEST["electrode"] * radius)
    farthest = float(np.sqrt(radius**2 - side**2 / 4) - side / 2)
    if kind == "rim":  # each has two corners on the rim
        return [_make_square("A", farthest, 0.0, side), _make_square("B", 0.0, farthest, side)]
    if kind == "corner":  # a corner of each touches one of the other
        return [
            _make_square("A", side / 2, side / 2, side),
            _make_square("B", -side / 2, -side / 2, side),
        ]
    if kind == "disc":  # it touches the rim, or is close to it
        x = radius - side / 2 - float(random.choice([0.0, _draw_in_range(random, "gap_mm")]))
        return [{"name": "A", "shape": "circle", "radius_mm": side / 2, "x_mm": x, "y_mm": 0.0}]
    if kind == "edge":
        return [_draw_electrode_beside(random, probe, side)]
    ring = random.uniform(side, farthest)
    places = {"A": (ring, 0.0), "B": (0.0, ring), "C": (-ring, 0.0), "D": (0.0, -ring)}
    return [_make_square(name, x, y, side) for name, (x, y) in places.items()]


def _draw_electrode_beside(random: Random, probe: Tables, side: float) -> Tables:
    """Draw an electrode whose edge is very close to that of the probe, on either side."""
    outline, hair = _make_outline(probe), HAIR_MM * float(random.choice([-1.0, 1.0]))
    if isinstance(outline, Circle):
        place = dict(zip(("x_mm", "y_mm"), (1e3 * outline.centre).tolist(), strict=True))
        return {"name": "A", "shape": "circle", "radius_mm": 1e3 * outline.radius + hair, **place}
    corners = 1e3 * outline.corners
    corner = int(random.integers(len(corners)))
    a, b = corners[corner], corners[(corner + 1) % len(corners)]
    along = (b - a) / np.linalg.norm(b - a)
    outward = np.array([along[1], -along[0]]) * random.choice([-1.0, 1.0])
    x, y = (a + b) / 2 + outward * (side / 2 + hair)
    turned = float(np.degrees(np.arctan2(along[1], along[0])))
    return _make_square("A", float(x), float(y), side) | {"rotation_deg": turned}


def _make_square(name: str, x: float, y: float, side: float) -> Tables:
    place = {"x_mm": float(x), "y_mm": float(y)}
    return {"name": name, "shape": "square", "side_mm": float(side), **place}


def _draw_in_range(random: Random, name: str) -> float:
    """Draw a number of a range of `RANGES`, uniformly in its logarithm."""
    return _draw_log_uniform(random, *RANGES[name])


def _draw_log_uniform(random: Random, low: float, high: float) -> float:
    return float(np.exp(random.uniform(np.log(low), np.log(high))))

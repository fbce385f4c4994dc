"""Scenes over the whole range of what a file may ask for, drawn with a seed.

Every scene is drawn by itself from ``(seed, number)``, so that one of them can be made again
without the others. Sizes, forces and moduli are uniform in their logarithm. What is awkward has
its own share: no pretension, probes and electrodes that all but touch the rim or each other,
needles, probes as large as the film, films fifty times stiffer one way than the other. The kinds
of probe and electrodes are drawn first; sizes that do not fit on the film are drawn again, so that
no kind becomes rare for being hard to place.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from pvdf_fem import Scene, SceneError
from pvdf_fem.scene.outline import Circle, Outline
from pvdf_fem.scene.shapes import PROBES

SEED = 2026
#: Draws of sizes after which a kind of electrodes does not fit on the film.
TRIES = 200
THICKNESS_UM = (0.5, 1000.0)
FORCE_N = (1e-9, 100.0)
MODULUS_GPA = (1e-3, 400.0)
RADIUS_MM = (1.0, 1000.0)
COOLING_K, HEATING_K = 150.0, 50.0
ORTHOTROPY = 50.0
SMALLEST_PROBE_MM = 0.01
ELECTRODE_MM = (0.05, 30.0)
ASPECT = 1000.0
GAP_MM = (0.01, 1.0)
NEAR_EDGE_MM = 1e-9
#: A needle is no thinner than a wavelength of light.
THINNEST_MM = 1e-4
SHAPES = ("circle", "rectangle", "triangle", "polygon", "needle", "whole")
ELECTRODES = ("ring", "rim", "corner", "edge", "disc")

Tables = dict[str, Any]


def scene_of(number: int, seed: int = SEED) -> Scene:
    """The scene of that number; one that is too hot for its tension may wrinkle."""
    random = np.random.default_rng([seed, number])
    film = _film(random)
    shape = str(random.choice(SHAPES))
    kinds = ["dead", "dead", "follower", "sliding", "stuck"]
    kind = str(random.choice(kinds[:3] if shape == "whole" else kinds))
    load: Tables = {"load.force_N": _log(random, *FORCE_N), "load.kind": kind}
    if kind in ("sliding", "stuck"):
        load |= {"load.kind": "rigid", "load.contact": kind}
    radius = film["film.radius_mm"]
    scene = {**film, **load, "probe": _probe(random, shape, radius)}
    for name in random.permutation(ELECTRODES):
        for _ in range(TRIES):
            electrodes = _electrodes(random, str(name), radius, scene["probe"])
            try:
                return Scene().with_(**scene, electrodes=electrodes)
            except SceneError:
                continue
    raise RuntimeError(f"no electrodes fit on scene {number} of seed {seed}")


def scenes(count: int, seed: int = SEED) -> list[Scene]:
    """The first `count` scenes."""
    return [scene_of(number, seed) for number in range(count)]


def _log(random: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(random.uniform(np.log(low), np.log(high))))


def _film(random: np.random.Generator) -> Tables:
    modulus, ratio = _log(random, *MODULUS_GPA), float(random.uniform(0.0, 0.499))
    film: Tables = {
        "film.radius_mm": _log(random, *RADIUS_MM),
        "film.thickness_um": _log(random, *THICKNESS_UM),
        "film.youngs_modulus_GPa": modulus,
        "film.poisson_ratio": ratio,
        "film.temperature_change_K": _temperature(random),
    }
    if random.random() < 0.25:
        softer = max(modulus / _log(random, 1.0, ORTHOTROPY), MODULUS_GPA[0])
        film["film.youngs_modulus_GPa"] = [modulus, softer]
        if random.random() < 0.5:
            film["film.youngs_modulus_GPa"] = [softer, modulus]
            film["film.poisson_ratio"] = ratio * softer / modulus
    bending = random.choice(["no", "no", "yes", "auto"])
    if film["film.temperature_change_K"] > 0.0:
        film["film.compression"] = "tension-field"
    elif bending != "no":
        film["film.bending"] = True if bending == "yes" else "auto"
    return film


def _temperature(random: np.random.Generator) -> float:
    kind = random.choice(["cold", "cold", "none", "rounding", "hot"])
    if kind == "cold":
        return -_log(random, 1e-3, COOLING_K)
    if kind == "hot":
        return _log(random, 1e-3, HEATING_K)
    return 0.0 if kind == "none" else -1e-12


def _probe(random: np.random.Generator, shape: str, radius: float) -> Tables:
    """At the film's centre, anywhere, or with a small gap to the rim."""
    if shape == "whole":
        return {"shape": "circle", "radius_mm": radius, "x_mm": 0.0, "y_mm": 0.0}
    probe = _sized(random, shape, _log(random, SMALLEST_PROBE_MM, 0.9 * radius))
    probe["rotation_deg"] = float(random.choice([0.0, 30.0, 90.0, random.uniform(0.0, 360.0)]))
    where, angle = random.choice(["centre", "anywhere", "rim"]), random.uniform(0.0, 2 * np.pi)
    gap = min(_log(random, *GAP_MM), 0.01 * radius)

    def at(distance: float) -> Tables:
        x, y = distance * np.cos(angle), distance * np.sin(angle)
        return {**probe, "x_mm": float(x), "y_mm": float(y)}

    if where == "centre":
        return at(0.0)
    # where the probe's reach, which grows with the distance, is the gap short of the rim
    low, high = 0.0, radius
    while high - low > 1e-3 * gap:
        middle = 0.5 * (low + high)
        fits = 1e3 * _outline(at(middle)).reach <= radius - gap
        low, high = (middle, high) if fits else (low, middle)
    return at(low * (float(np.sqrt(random.random())) if where == "anywhere" else 1.0))


def _sized(random: np.random.Generator, shape: str, size: float) -> Tables:
    if shape == "circle":
        return {"shape": "circle", "radius_mm": size / 2}
    if shape == "triangle":
        return {"shape": "triangle", "side_mm": size}
    if shape == "polygon":
        return {"shape": "polygon", "vertices_mm": _star(random, size / 2)}
    slender = _log(random, 10.0, ASPECT) if shape == "needle" else random.uniform(1.0, 5.0)
    return {"shape": "rectangle", "width_mm": size, "height_mm": max(size / slender, THINNEST_MM)}


def _star(random: np.random.Generator, size: float) -> list[list[float]]:
    count = int(random.integers(4, 9))
    angles = (np.arange(count) + random.uniform(-0.3, 0.3, count)) * 2 * np.pi / count
    radii = size * random.uniform(0.4, 1.0, count)
    return np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=-1).tolist()


def _outline(shape: Tables) -> Outline:
    """Outline in m of a probe's table."""
    outline: Outline = PROBES[shape["shape"]](**shape).outline  # type: ignore[attr-defined]
    return outline


def _electrodes(
    random: np.random.Generator, kind: str, radius: float, probe: Tables
) -> list[Tables]:
    side = _log(random, ELECTRODE_MM[0], min(ELECTRODE_MM[1], 0.5 * radius))
    farthest = float(np.sqrt(radius**2 - side**2 / 4) - side / 2)
    if kind == "rim":  # two corners on it
        return [_square("A", farthest, 0.0, side), _square("B", 0.0, farthest, side)]
    if kind == "corner":  # of each other
        return [_square("A", side / 2, side / 2, side), _square("B", -side / 2, -side / 2, side)]
    if kind == "disc":  # touching the rim, or close to it
        gap = random.choice([0.0, _log(random, *GAP_MM)])
        x = radius - side / 2 - float(gap)
        return [{"name": "A", "shape": "circle", "radius_mm": side / 2, "x_mm": x, "y_mm": 0.0}]
    if kind == "edge":
        return [_beside(random, probe, side)]
    ring = random.uniform(side, farthest)
    places = {"A": (ring, 0.0), "B": (0.0, ring), "C": (-ring, 0.0), "D": (0.0, -ring)}
    return [_square(name, x, y, side) for name, (x, y) in places.items()]


def _beside(random: np.random.Generator, probe: Tables, side: float) -> Tables:
    """An electrode with an edge within a hair's breadth of the probe's, on either side of it."""
    outline, hair = _outline(probe), NEAR_EDGE_MM * float(random.choice([-1.0, 1.0]))
    if isinstance(outline, Circle):
        x, y = (1e3 * outline.centre).tolist()
        radius = 1e3 * outline.radius + hair
        return {"name": "A", "shape": "circle", "radius_mm": radius, "x_mm": x, "y_mm": y}
    corners = 1e3 * outline.vertices
    first = int(random.integers(len(corners)))
    a, b = corners[first], corners[(first + 1) % len(corners)]
    along = (b - a) / np.linalg.norm(b - a)
    outward = np.array([along[1], -along[0]]) * random.choice([-1.0, 1.0])
    x, y = (a + b) / 2 + outward * (side / 2 + hair)
    turned = float(np.degrees(np.arctan2(along[1], along[0])))
    return _square("A", float(x), float(y), side) | {"rotation_deg": turned}


def _square(name: str, x: float, y: float, side: float) -> Tables:
    return {"name": name, "shape": "square", "x_mm": float(x), "y_mm": float(y), "side_mm": side}

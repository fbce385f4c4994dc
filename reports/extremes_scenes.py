"""Scenes over the whole range of what a file may ask for, drawn with a seed.

Every scene is drawn by itself from ``(seed, number)``, so that one of them can be made again
without the others. Sizes, forces and moduli are uniform in their logarithm. What is awkward has
its own share: no pretension, probes and electrodes that all but touch the rim or each other,
needles, films fifty times stiffer one way than the other.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from pvdf_fem import Scene, SceneError

SEED = 2026
#: Of the draws that a scene file would refuse, as many are thrown away before giving up.
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

Tables = dict[str, Any]


def scene_of(number: int, seed: int = SEED) -> Scene:
    """The scene of that number; one that is too hot for its tension may wrinkle."""
    random = np.random.default_rng([seed, number])
    for _ in range(TRIES):
        try:
            return Scene().with_(**_draw(random))
        except SceneError:
            continue
    raise RuntimeError(f"no valid scene {number} of seed {seed} in {TRIES} draws")


def scenes(count: int, seed: int = SEED) -> list[Scene]:
    """The first `count` scenes."""
    return [scene_of(number, seed) for number in range(count)]


def _log(random: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(random.uniform(np.log(low), np.log(high))))


def _draw(random: np.random.Generator) -> Tables:
    film = _film(random)
    radius = film["film.radius_mm"]
    probe = _probe(random, radius)
    electrodes = _electrodes(random, radius, probe)
    kind = random.choice(["dead", "dead", "follower", "sliding", "stuck"])
    load: Tables = {"load.force_N": _log(random, *FORCE_N)}
    if kind in ("sliding", "stuck"):
        load |= {"load.kind": "rigid", "load.contact": str(kind)}
    else:
        load["load.kind"] = str(kind)
    return {**film, "probe": probe, "electrodes": electrodes, **load}


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
    if film["film.temperature_change_K"] > 0.0:
        film["film.compression"] = "tension-field"
    return film


def _temperature(random: np.random.Generator) -> float:
    kind = random.choice(["cold", "cold", "none", "rounding", "hot"])
    if kind == "cold":
        return -_log(random, 1e-3, COOLING_K)
    if kind == "hot":
        return _log(random, 1e-3, HEATING_K)
    return 0.0 if kind == "none" else -1e-12


def _probe(random: np.random.Generator, radius: float) -> Tables:
    shape = str(random.choice(["circle", "rectangle", "triangle", "polygon", "needle", "whole"]))
    if shape == "whole":
        return {"shape": "circle", "radius_mm": radius, "x_mm": 0.0, "y_mm": 0.0}
    size = _log(random, SMALLEST_PROBE_MM, 0.9 * radius)
    turn = float(random.choice([0.0, 30.0, 90.0, random.uniform(0.0, 360.0)]))
    choices: dict[str, Tables] = {
        "circle": {"shape": "circle", "radius_mm": size / 2},
        "rectangle": {
            "shape": "rectangle",
            "width_mm": size,
            "height_mm": size * float(random.uniform(0.2, 1.0)),
        },
        "triangle": {"shape": "triangle", "side_mm": size},
        "polygon": {"shape": "polygon", "vertices_mm": _star(random, size / 2)},
        "needle": {
            "shape": "rectangle",
            "width_mm": size,
            "height_mm": max(size / _log(random, 10.0, ASPECT), 1e-4),
        },
    }
    sizes = choices[shape]
    reach = 0.5 * size if shape in ("circle", "polygon") else 0.6 * size
    if shape == "rectangle":
        reach = 0.5 * float(np.hypot(sizes["width_mm"], sizes["height_mm"]))
    distance, angle = _distance(random, radius - reach), random.uniform(0.0, 2 * np.pi)
    x, y = distance * np.cos(angle), distance * np.sin(angle)
    return {**sizes, "x_mm": float(x), "y_mm": float(y), "rotation_deg": turn}


def _distance(random: np.random.Generator, room: float) -> float:
    """From the film's centre: at it, anywhere, or with a small gap to the rim."""
    where = random.choice(["centre", "anywhere", "anywhere", "rim"])
    if where == "centre":
        return 0.0
    if where == "anywhere":
        return room * float(np.sqrt(random.random()))
    return max(room - _log(random, *GAP_MM), 0.0)


def _star(random: np.random.Generator, size: float) -> list[list[float]]:
    count = int(random.integers(4, 9))
    angles = (np.arange(count) + random.uniform(-0.3, 0.3, count)) * 2 * np.pi / count
    radii = size * random.uniform(0.4, 1.0, count)
    return np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=-1).tolist()


def _electrodes(random: np.random.Generator, radius: float, probe: Tables) -> list[Tables]:
    largest = min(ELECTRODE_MM[1], 0.5 * radius)
    side = _log(random, ELECTRODE_MM[0], largest)
    kind = random.choice(["ring", "rim", "corner", "edge", "disc"])
    if kind == "rim":  # a corner or the arc on the rim
        reach = np.sqrt(radius**2 - side**2 / 4) - side / 2
        return [_square("A", float(reach), 0.0, side), _square("B", 0.0, float(reach), side)]
    if kind == "corner":
        return [_square("A", side / 2, side / 2, side), _square("B", -side / 2, -side / 2, side)]
    if kind == "disc":
        return [
            {
                "name": "A",
                "shape": "circle",
                "radius_mm": side / 2,
                "x_mm": radius - side / 2 - d,
                "y_mm": 0.0,
            }
            for d in (_log(random, *GAP_MM) if random.random() < 0.5 else radius / 2,)
        ]
    if kind == "edge":  # an edge within a hair's breadth of the probe's
        beside = probe["x_mm"] + probe.get("width_mm", 0.0) / 2 + side / 2 + NEAR_EDGE_MM
        return [_square("A", float(beside), probe["y_mm"], side)]
    ring = (radius - 0.75 * side) * float(random.uniform(0.3, 1.0))
    places = {"A": (ring, 0.0), "B": (0.0, ring), "C": (-ring, 0.0), "D": (0.0, -ring)}
    return [_square(name, x, y, side) for name, (x, y) in places.items()]


def _square(name: str, x: float, y: float, side: float) -> Tables:
    return {"name": name, "shape": "square", "x_mm": x, "y_mm": y, "side_mm": side}

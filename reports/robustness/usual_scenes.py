"""Scenes of a sensor's usual proportions, of every kind, drawn with a seed.

Every scene is drawn by itself from ``(seed, number)``. What makes errors hard to estimate has its
own share: corners of a probe inside electrodes and a little beside them, films three times stiffer
one way than the other, coefficients of opposite signs, electrodes of any shape.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from pvdf_fem import Scene, SceneError
from reports.robustness.scenes import log_uniform, outline_of, star

#: Kinds of scenes, by group.
KINDS = {
    "rigid": ("sliding", "stuck"),
    "other": ("dead", "follower", "bent", "wrinkling", "heated", "thesis-edge"),
}
#: Seed of the scenes that are drawn if no other is given.
SEED = 11
TOLERANCES = [3e-3, 1e-3, 3e-4]
SHAPES = ["triangle", "rectangle", "circle", "polygon"]

Tables = dict[str, Any]


def usual_scene(group: str, number: int, seed: int) -> Scene:
    """Draw the scene of a number and a group, a key of `KINDS`."""
    random = np.random.default_rng([seed, number])
    kinds = KINDS[group]
    kind = kinds[number % len(kinds)]
    while True:
        film = draw_film(random)
        probe = draw_probe(random, film["film.radius_mm"])
        load = {"load.force_N": log_uniform(random, 0.05, 5.0)}
        tolerance = {"numerics.tolerance": float(random.choice(TOLERANCES))}
        changes = {**film, **load, **tolerance, **_kind(random, kind, film)}
        odd = kind != "thesis-edge" and random.random() < 0.4
        electrodes = draw_odd_electrodes(random, probe) if odd else draw_squares(random, probe)
        try:
            return Scene().with_(**changes, probe=probe, electrodes=electrodes)
        except SceneError:
            continue


_NAMED: dict[str, Tables] = {
    "dead": {},
    "follower": {"load.kind": "follower"},
    "bent": {"film.bending": True},
    "thesis-edge": {"numerics.observable": "thesis-edge"},
}


def draw_film(random: np.random.Generator) -> Tables:
    modulus = log_uniform(random, 1.0, 6.0)
    film: Tables = {
        "film.radius_mm": float(random.uniform(30.0, 60.0)),
        "film.thickness_um": log_uniform(random, 10.0, 60.0),
        "film.youngs_modulus_GPa": modulus,
        "film.poisson_ratio": float(random.uniform(0.2, 0.4)),
        "film.temperature_change_K": -log_uniform(random, 0.3, 5.0),
    }
    if random.random() < 0.5:
        softer = modulus / log_uniform(random, 1.1, 3.0)
        film["film.youngs_modulus_GPa"] = [modulus, softer]
        film["film.d31_pC_N"] = float(random.uniform(10.0, 25.0))
        film["film.d32_pC_N"] = float(random.uniform(-5.0, 5.0))
    return film


def _kind(random: np.random.Generator, kind: str, film: Tables) -> Tables:
    if kind in ("sliding", "stuck"):
        return {"load.kind": "rigid", "load.contact": kind}
    if kind in _NAMED:
        return _NAMED[kind]
    heating = log_uniform(random, 0.1, 10.0) if kind == "heated" else 0.0
    return {"film.temperature_change_K": heating, "film.compression": "tension-field"}


def draw_probe(random: np.random.Generator, radius: float) -> Tables:
    shape = str(random.choice(SHAPES))
    size = log_uniform(random, 3.0, 0.5 * radius)
    sizes: dict[str, Tables] = {
        "triangle": {"side_mm": size},
        "rectangle": {"width_mm": size, "height_mm": size * float(random.uniform(0.3, 1.0))},
        "circle": {"radius_mm": 0.5 * size},
        "polygon": {"vertices_mm": star(random, 0.5 * size)},
    }
    distance, angle = 0.7 * radius * np.sqrt(random.random()), random.uniform(0.0, 2.0 * np.pi)
    return {
        "shape": shape,
        **sizes[shape],
        "x_mm": float(distance * np.cos(angle)),
        "y_mm": float(distance * np.sin(angle)),
        "rotation_deg": float(random.uniform(0.0, 360.0)),
    }


def draw_squares(random: np.random.Generator, probe: Tables) -> list[Tables]:
    """Three or four squares on a ring, of which one may be moved to a corner of the probe."""
    count, ring, side = int(random.integers(3, 5)), random.uniform(6.0, 18.0), random.uniform(1, 5)
    angles = np.arange(count) * 2.0 * np.pi / count
    places = ring * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    corners = 1e3 * outline_of(probe).corners
    if len(corners) and random.random() < 0.5:
        places[0] = random.permutation(corners)[0] + random.uniform(-0.7, 0.7, 2) * side
    return [
        {"name": name, "shape": "square", "x_mm": x, "y_mm": y, "side_mm": float(side)}
        for name, (x, y) in zip("ABCD", places.tolist(), strict=False)
    ]


def draw_odd_electrodes(random: np.random.Generator, probe: Tables) -> list[Tables]:
    """The places of `_squares` with other shapes, turned at random."""
    electrodes = []
    for square in draw_squares(random, probe):
        side = square.pop("side_mm")
        shapes: list[Tables] = [
            {"shape": "circle", "radius_mm": 0.5 * side},
            {"shape": "ellipse", "semi_axes_mm": [0.75 * side, 0.3 * side]},
            {"shape": "rectangle", "width_mm": 2.0 * side, "height_mm": 0.4 * side},
            {"shape": "polygon", "vertices_mm": star(random, 0.6 * side)},
        ]
        shape = shapes[int(random.integers(4))]
        electrodes.append({**square, **shape, "rotation_deg": float(random.uniform(0.0, 360.0))})
    return electrodes

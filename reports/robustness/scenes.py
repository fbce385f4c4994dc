"""Scenes over the whole range of what a file may ask for, drawn with a seed.

Every scene is drawn by itself from ``(seed, number)``, so that one of them can be made again
without the others. Sizes, forces and moduli are uniform in their logarithm. Awkward cases have
their own share: no pretension, probes and electrodes that all but touch the rim or each other,
needles, probes as large as the film, films fifty times stiffer one way than the other. The kinds
of probe and electrodes are drawn first, and sizes that do not fit on the film are drawn again, so
that no kind becomes rare because it is hard to place.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pvdf_fem import Scene, SceneError
from pvdf_fem.scene.outlines.circle import Circle
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.shapes import PROBES


@dataclass(frozen=True)
class Ranges:
    """Smallest and largest values of what is drawn.

    Attributes
    ----------
    thickness_um, modulus_GPa, radius_mm : (float, float)
        Thickness, moduli and radius of the film.
    cooling_K, heating_K : (float, float)
        Sizes of negative and positive changes of the film's temperature.
    orthotropy : (float, float)
        Ratio of the two moduli of an orthotropic film.
    force_N : (float, float)
        Force of the probe.
    probe_mm : float
        Smallest size of a probe; the largest one is 0.9 of the film's radius.
    aspect : (float, float)
        Length of a needle over its width.
    needle_mm : float
        Smallest width of a needle, a wavelength of light.
    electrode_mm : (float, float)
        Side of an electrode.
    gap_mm : (float, float)
        Distance from the rim of a shape that almost touches it.
    hair_mm : float
        Distance of the edges of a probe and an electrode that almost touch.
    """

    thickness_um: tuple[float, float] = (0.5, 1000.0)
    modulus_GPa: tuple[float, float] = (1e-3, 400.0)
    radius_mm: tuple[float, float] = (1.0, 1000.0)
    cooling_K: tuple[float, float] = (1e-3, 150.0)
    heating_K: tuple[float, float] = (1e-3, 50.0)
    orthotropy: tuple[float, float] = (1.0, 50.0)
    force_N: tuple[float, float] = (1e-9, 100.0)
    probe_mm: float = 0.01
    aspect: tuple[float, float] = (10.0, 1000.0)
    needle_mm: float = 1e-4
    electrode_mm: tuple[float, float] = (0.05, 30.0)
    gap_mm: tuple[float, float] = (0.01, 1.0)
    hair_mm: float = 1e-9


RANGES = Ranges()
#: Seed of the scenes that are drawn if no other is given.
SEED = 2026
SHAPES = ("circle", "rectangle", "triangle", "polygon", "needle", "whole")
ELECTRODES = ("ring", "rim", "corner", "edge", "disc")

Tables = dict[str, Any]


def scene_of(number: int, seed: int = SEED, tries: int = 200) -> Scene:
    """Draw the scene of a number; a heated film may wrinkle.

    After `tries` draws of sizes another kind of electrodes is taken.
    """
    random = np.random.default_rng([seed, number])
    film = _film(random)
    shape = str(random.choice(SHAPES))
    kinds = ["dead", "dead", "follower", "sliding", "stuck"]
    kind = str(random.choice(kinds[:3] if shape == "whole" else kinds))
    load: Tables = {"load.force_N": log_uniform(random, *RANGES.force_N), "load.kind": kind}
    if kind in ("sliding", "stuck"):
        load |= {"load.kind": "rigid", "load.contact": kind}
    radius = film["film.radius_mm"]
    scene = {**film, **load, "probe": _probe(random, shape, radius)}
    for name in random.permutation(ELECTRODES):
        for _ in range(tries):
            electrodes = _electrodes(random, str(name), radius, scene["probe"])
            try:
                return Scene().with_(**scene, electrodes=electrodes)
            except SceneError:
                continue
    raise RuntimeError(f"no electrodes fit on scene {number} of seed {seed}")


def scenes(count: int, seed: int = SEED) -> list[Scene]:
    """Draw the first `count` scenes of a seed."""
    return [scene_of(number, seed) for number in range(count)]


def log_uniform(random: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(random.uniform(np.log(low), np.log(high))))


def _film(random: np.random.Generator) -> Tables:
    modulus, ratio = log_uniform(random, *RANGES.modulus_GPa), float(random.uniform(0.0, 0.499))
    film: Tables = {
        "film.radius_mm": log_uniform(random, *RANGES.radius_mm),
        "film.thickness_um": log_uniform(random, *RANGES.thickness_um),
        "film.youngs_modulus_GPa": modulus,
        "film.poisson_ratio": ratio,
        "film.temperature_change_K": _temperature(random),
    }
    if random.random() < 0.25:
        softer = max(modulus / log_uniform(random, *RANGES.orthotropy), RANGES.modulus_GPa[0])
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
        return -log_uniform(random, *RANGES.cooling_K)
    if kind == "hot":
        return log_uniform(random, *RANGES.heating_K)
    return 0.0 if kind == "none" else -1e-12


def _probe(random: np.random.Generator, shape: str, radius: float) -> Tables:
    """Draw a probe at the film's centre, anywhere, or with a small gap to the rim."""
    if shape == "whole":
        return {"shape": "circle", "radius_mm": radius, "x_mm": 0.0, "y_mm": 0.0}
    probe = _sized(random, shape, log_uniform(random, RANGES.probe_mm, 0.9 * radius))
    probe["rotation_deg"] = float(random.choice([0.0, 30.0, 90.0, random.uniform(0.0, 360.0)]))
    where, angle = random.choice(["centre", "anywhere", "rim"]), random.uniform(0.0, 2 * np.pi)
    gap = min(log_uniform(random, *RANGES.gap_mm), 0.01 * radius)

    def at(distance: float) -> Tables:
        x, y = distance * np.cos(angle), distance * np.sin(angle)
        return {**probe, "x_mm": float(x), "y_mm": float(y)}

    if where == "centre":
        return at(0.0)
    # Bisect for the distance at which the probe, whose reach grows with it, is a gap off the rim.
    low, high = 0.0, radius
    while high - low > 1e-3 * gap:
        middle = 0.5 * (low + high)
        fits = 1e3 * outline_of(at(middle)).reach <= radius - gap
        low, high = (middle, high) if fits else (low, middle)
    return at(low * (float(np.sqrt(random.random())) if where == "anywhere" else 1.0))


def _sized(random: np.random.Generator, shape: str, size: float) -> Tables:
    if shape == "circle":
        return {"shape": "circle", "radius_mm": size / 2}
    if shape == "triangle":
        return {"shape": "triangle", "side_mm": size}
    if shape == "polygon":
        return {"shape": "polygon", "vertices_mm": star(random, size / 2)}
    slender = log_uniform(random, *RANGES.aspect) if shape == "needle" else random.uniform(1.0, 5.0)
    return {
        "shape": "rectangle",
        "width_mm": size,
        "height_mm": max(size / slender, RANGES.needle_mm),
    }


def star(random: np.random.Generator, size: float) -> list[list[float]]:
    count = int(random.integers(4, 9))
    angles = (np.arange(count) + random.uniform(-0.3, 0.3, count)) * 2 * np.pi / count
    radii = size * random.uniform(0.4, 1.0, count)
    return np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=-1).tolist()


def outline_of(shape: Tables) -> Outline:
    """The outline in m of a probe's table."""
    outline: Outline = PROBES[shape["shape"]](**shape).outline
    return outline


def _electrodes(
    random: np.random.Generator, kind: str, radius: float, probe: Tables
) -> list[Tables]:
    smallest, largest = RANGES.electrode_mm
    side = log_uniform(random, smallest, min(largest, 0.5 * radius))
    farthest = float(np.sqrt(radius**2 - side**2 / 4) - side / 2)
    if kind == "rim":  # each has two corners on the rim
        return [_square("A", farthest, 0.0, side), _square("B", 0.0, farthest, side)]
    if kind == "corner":  # a corner of each touches one of the other
        return [_square("A", side / 2, side / 2, side), _square("B", -side / 2, -side / 2, side)]
    if kind == "disc":  # it touches the rim, or is close to it
        gap = random.choice([0.0, log_uniform(random, *RANGES.gap_mm)])
        x = radius - side / 2 - float(gap)
        return [{"name": "A", "shape": "circle", "radius_mm": side / 2, "x_mm": x, "y_mm": 0.0}]
    if kind == "edge":
        return [_beside(random, probe, side)]
    ring = random.uniform(side, farthest)
    places = {"A": (ring, 0.0), "B": (0.0, ring), "C": (-ring, 0.0), "D": (0.0, -ring)}
    return [_square(name, x, y, side) for name, (x, y) in places.items()]


def _beside(random: np.random.Generator, probe: Tables, side: float) -> Tables:
    """An electrode with an edge within a hair's breadth of the probe's, on either side of it."""
    outline, hair = outline_of(probe), RANGES.hair_mm * float(random.choice([-1.0, 1.0]))
    if isinstance(outline, Circle):
        x, y = (1e3 * outline.centre).tolist()
        radius = 1e3 * outline.radius + hair
        return {"name": "A", "shape": "circle", "radius_mm": radius, "x_mm": x, "y_mm": y}
    corners = 1e3 * outline.corners
    corner = int(random.integers(len(corners)))
    a, b = corners[corner], corners[(corner + 1) % len(corners)]
    along = (b - a) / np.linalg.norm(b - a)
    outward = np.array([along[1], -along[0]]) * random.choice([-1.0, 1.0])
    x, y = (a + b) / 2 + outward * (side / 2 + hair)
    turned = float(np.degrees(np.arctan2(along[1], along[0])))
    return _square("A", float(x), float(y), side) | {"rotation_deg": turned}


def _square(name: str, x: float, y: float, side: float) -> Tables:
    return {"name": name, "shape": "square", "x_mm": float(x), "y_mm": float(y), "side_mm": side}

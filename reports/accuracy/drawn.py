"""Scenes of the sensor's proportions, drawn at random, for the errors that solves state."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from pvdf_fem import Scene, SceneError

#: Changes that make a kind of scene of a drawn one: each kind with the choices that it has.
KINDS: dict[str, tuple[dict[str, Any], ...]] = {
    "pressure": ({"load.kind": "dead"}, {"load.kind": "follower"}),
    "punch": ({"load.kind": "rigid"}, {"load.kind": "rigid", "load.contact": "stuck"}),
    "sphere": ({"load.kind": "contact"},),
    "plate": ({"load.kind": "dead", "film.bending": True},),
    "wrinkling": (
        {"load.kind": "dead", "film.compression": "tension-field", "film.temperature_change_K": 0},
    ),
}
TOLERANCES = (1e-2, 3e-3, 1e-3)
COMPARED = 10.0  #: Tolerance of a drawn scene over the tolerance of the finer one.
SEED = 11
MOST_DRAWS = 100  #: Until a scene without overlaps is found.


def drawn_scenes(kind: str, count: int, seed: int = SEED) -> Iterator[Scene]:
    """Scenes of a kind of `KINDS`; the number of a scene decides what is drawn for it."""
    choices = KINDS[kind]
    for number in range(count):
        random = np.random.default_rng([seed, list(KINDS).index(kind), number])
        changes = dict(choices[number % len(choices)])
        if kind == "sphere":
            changes |= {"probe.shape": "sphere", "probe.radius_mm": random.uniform(2.0, 20.0)}
        if kind != "pressure":
            changes["numerics.observable"] = "material"
        yield random_scene(random, **changes, **{"numerics.tolerance": _any(random, TOLERANCES)})


def finer(scene: Scene) -> Scene:
    """The scene that a drawn one is compared with."""
    return scene.with_(**{"numerics.tolerance": scene.numerics.tolerance / COMPARED})


def random_scene(rng: np.random.Generator, **changes: object) -> Scene:
    """Any probe, place, rotation, force, dead or follower, orthotropy, electrodes and observable.

    With `changes` by key.
    """
    for attempt in range(MOST_DRAWS):
        drawn = _random_changes(rng)
        if "probe.shape" in changes:  # with the sizes of another shape
            drawn = {key: value for key, value in drawn.items() if key not in SIZES}
        try:
            return Scene().with_(**(drawn | changes))
        except SceneError:  # outlines that overlap, or leave the film
            if attempt == MOST_DRAWS - 1:
                raise
    raise AssertionError


SIZES = {
    f"probe.{key}_mm" for key in ("side", "width", "height", "radius", "semi_axes", "vertices")
}


def _any(rng: np.random.Generator, values: tuple[float, ...]) -> float:
    return values[int(rng.integers(len(values)))]


def _random_changes(rng: np.random.Generator) -> dict[str, object]:
    distance, angle = 25.0 * np.sqrt(rng.uniform()), rng.uniform(0.0, 2.0 * np.pi)
    edges = rng.uniform() < 0.3
    changes = {
        **_random_probe(rng),
        "probe.x_mm": distance * np.cos(angle),
        "probe.y_mm": distance * np.sin(angle),
        "probe.rotation_deg": rng.uniform(0.0, 360.0),
        "load.force_N": float(np.exp(rng.uniform(np.log(0.1), np.log(5.0)))),
        "load.kind": str(rng.choice(["dead", "follower"])),
        "film.poisson_ratio": rng.uniform(0.1, 0.4),
        "film.temperature_change_K": -rng.uniform(0.2, 5.0),
        "film.d32_pC_N": rng.uniform(0.0, 12.0),
        "numerics.observable": "thesis-edge" if edges else "material",
    }
    if rng.uniform() < 0.4:
        changes["film.youngs_modulus_GPa"] = rng.uniform(1.5, 4.0, 2).tolist()
    if rng.uniform() < 0.5:
        changes["electrodes"] = [
            _random_electrode(rng, i, edges) for i in range(rng.integers(1, 5))
        ]
    return changes


def _random_probe(rng: np.random.Generator) -> dict[str, object]:
    a, b = rng.uniform(3.0, 10.0, 2).tolist()
    angles = np.linspace(0.0, 2.0 * np.pi, 6)[:5] + rng.uniform(0.0, 0.6, 5)
    corners = rng.uniform(3.0, 5.0, (5, 1)) * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    sizes = {
        "triangle": {"probe.side_mm": a},
        "rectangle": {"probe.width_mm": a, "probe.height_mm": b},
        "circle": {"probe.radius_mm": a / 2.0},
        "ellipse": {"probe.semi_axes_mm": [a / 2.0, b / 2.0]},
        "polygon": {"probe.vertices_mm": corners.tolist()},
    }
    shape = str(rng.choice(list(sizes)))
    return {"probe.shape": shape, **sizes[shape]}


def _random_electrode(rng: np.random.Generator, index: int, edges: bool) -> dict[str, object]:
    x, y = rng.uniform(-25.0, 25.0, 2).tolist()
    a, b = rng.uniform(1.0, 6.0, 2).tolist()
    sizes = {
        "rectangle": {"width_mm": a, "height_mm": b},
        "square": {"side_mm": a, "rotation_deg": rng.uniform(0.0, 90.0)},
        "circle": {"radius_mm": a / 2.0},
    }
    shape = "rectangle" if edges else str(rng.choice(list(sizes)))
    return {"name": "ABCD"[index], "x_mm": x, "y_mm": y, "shape": shape, **sizes[shape]}

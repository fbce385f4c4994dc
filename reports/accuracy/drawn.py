"""Random scenes with the proportions of the sensor, to test the stated errors of solves."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from pvdf_fem import Scene, SceneError

#: Changes of a random scene by the kind of scene; the scenes of a kind take them in turn.
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
REFINEMENT = 10.0  #: Tolerance of a random scene over the tolerance of its finer solve.
SEED = 11
MAX_ATTEMPTS = 100  #: Largest number of attempts to find a scene without overlaps.
#: Keys of the sizes of all shapes of probes.
SIZES = {
    f"probe.{key}_mm" for key in ("side", "width", "height", "radius", "semi_axes", "vertices")
}


def draw_scenes(kind: str, count: int, seed: int = SEED) -> Iterator[Scene]:
    """Draw random scenes of a kind.

    Parameters
    ----------
    kind : str
        A key of `KINDS`.
    count : int
        Number of scenes.
    seed : int
        Seed. A scene depends on the seed, the kind and its number only.

    Yields
    ------
    Scene
    """
    kind_changes = KINDS[kind]
    kind_number = list(KINDS).index(kind)
    for number in range(count):
        rng = np.random.default_rng([seed, kind_number, number])
        changes = dict(kind_changes[number % len(kind_changes)])
        if kind == "sphere":
            changes |= {"probe.shape": "sphere", "probe.radius_mm": rng.uniform(2.0, 20.0)}
        if kind != "pressure":
            changes["numerics.observable"] = "material"
        changes["numerics.tolerance"] = TOLERANCES[int(rng.integers(len(TOLERANCES)))]
        yield make_random_scene(rng, **changes)


def refine(scene: Scene) -> Scene:
    """Return the scene of the finer solve that a random scene is compared with."""
    return scene.with_(**{"numerics.tolerance": scene.numerics.tolerance / REFINEMENT})


def make_random_scene(rng: np.random.Generator, **changes: object) -> Scene:
    """Draw a scene with any probe, place, force, material, electrodes and observable.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of random numbers.
    **changes
        Values by dotted key that are not random.

    Returns
    -------
    Scene
        Under a dead pressure or a follower.
    """
    for attempt in range(MAX_ATTEMPTS):
        drawn = _draw_changes(rng)
        if "probe.shape" in changes:  # the sizes belong to another shape
            drawn = {key: value for key, value in drawn.items() if key not in SIZES}
        try:
            return Scene().with_(**(drawn | changes))
        except SceneError:  # outlines overlap, or leave the film
            if attempt == MAX_ATTEMPTS - 1:
                raise
    raise AssertionError


def _draw_changes(rng: np.random.Generator) -> dict[str, object]:
    """Draw the values of a scene by dotted key."""
    distance = 25.0 * np.sqrt(rng.uniform())
    angle = rng.uniform(0.0, 2.0 * np.pi)
    along_edges = rng.uniform() < 0.3
    changes = {
        **_draw_probe(rng),
        "probe.x_mm": distance * np.cos(angle),
        "probe.y_mm": distance * np.sin(angle),
        "probe.rotation_deg": rng.uniform(0.0, 360.0),
        "load.force_N": float(np.exp(rng.uniform(np.log(0.1), np.log(5.0)))),
        "load.kind": str(rng.choice(["dead", "follower"])),
        "film.poisson_ratio": rng.uniform(0.1, 0.4),
        "film.temperature_change_K": -rng.uniform(0.2, 5.0),
        "film.d32_pC_N": rng.uniform(0.0, 12.0),
        "numerics.observable": "thesis-edge" if along_edges else "material",
    }
    if rng.uniform() < 0.4:
        changes["film.youngs_modulus_GPa"] = rng.uniform(1.5, 4.0, 2).tolist()
    if rng.uniform() < 0.5:
        count = rng.integers(1, 5)
        changes["electrodes"] = [_draw_electrode(rng, i, along_edges) for i in range(count)]
    return changes


def _draw_probe(rng: np.random.Generator) -> dict[str, object]:
    """Draw the shape of a probe with its sizes."""
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


def _draw_electrode(rng: np.random.Generator, number: int, along_edges: bool) -> dict[str, object]:
    """Draw an electrode, a rectangle where its charge is averaged along its edges."""
    x, y = rng.uniform(-25.0, 25.0, 2).tolist()
    a, b = rng.uniform(1.0, 6.0, 2).tolist()
    sizes = {
        "rectangle": {"width_mm": a, "height_mm": b},
        "square": {"side_mm": a, "rotation_deg": rng.uniform(0.0, 90.0)},
        "circle": {"radius_mm": a / 2.0},
    }
    shape = "rectangle" if along_edges else str(rng.choice(list(sizes)))
    return {"name": "ABCD"[number], "x_mm": x, "y_mm": y, "shape": shape, **sizes[shape]}

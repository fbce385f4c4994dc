"""A sensor with known parameters, and readings of its touches, for the tests of calibrations."""

from __future__ import annotations

from functools import cache

import numpy as np

from pvdf_fem import Scene, solve
from pvdf_fem.scene.stage import Stage

FILM = {"film.pretension_N_m": 8.0}
#: A disc is solved faster than the triangle.
SCENE = Scene.parse('[probe]\nshape = "circle"\nradius_mm = 3.0\n').with_(**FILM)
NAMES = ("A", "B", "C", "D")
TRUE = {
    "film.pretension_N_m": 9.5,
    "gain.A": 1.07,
    "gain.B": 0.94,
    "gain.C": 1.03,
    "gain.D": 0.98,
    "stage.x_mm": 0.6,
    "stage.y_mm": -0.4,
    "stage.rotation_deg": 2.0,
}
UNKNOWN = ("film.pretension_N_m", "gains", "shift", "turn")


@cache
def _solved(count: int, place_sd: float, seed: int) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Columns of touches, and standard normal errors of their readings."""
    rng = np.random.default_rng(seed)
    reach, angle = 12.0 * rng.uniform(size=count) ** 0.5, rng.uniform(0.0, 2.0 * np.pi, count)
    places = np.stack([reach * np.cos(angle), reach * np.sin(angle)], axis=-1)
    rotations, forces = rng.uniform(0.0, 120.0, count), rng.uniform(0.3, 2.0, count)
    stage = Stage(**{key[6:]: value for key, value in TRUE.items() if key.startswith("stage.")})
    errors = place_sd * rng.standard_normal((count, 2))
    on_film, turned = stage.to_film(places + errors, rotations)
    rows = []
    for (x, y), rotation, force in zip(on_film, turned, forces, strict=True):
        probe = {"probe.x_mm": x, "probe.y_mm": y, "probe.rotation_deg": rotation}
        film = {"film.pretension_N_m": TRUE["film.pretension_N_m"], "load.force_N": force}
        changes = solve(SCENE.with_(**probe, **film, **{"numerics.tolerance": 1e-4}))
        rows.append([TRUE[f"gain.{n}"] * q for n, q in changes.charge_changes_pC.items()])
    columns = {"x_mm": places[:, 0], "y_mm": places[:, 1], "rotation_deg": rotations}
    columns |= {"force_N": forces, **dict(zip(NAMES, np.array(rows).T, strict=True))}
    return columns, rng.standard_normal((count, 4))


def made(count=12, sigma=0.0, place_sd=0.0, seed=1, **changes):
    """Columns of touches with readings of the changes in pC; some columns may be replaced."""
    columns, errors = _solved(count, place_sd, seed)
    noisy = {n: columns[n] * (1.0 + sigma * e) for n, e in zip(NAMES, errors.T, strict=True)}
    return {**columns, **noisy, **changes}

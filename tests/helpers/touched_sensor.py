"""A made-up sensor with known parameters, and readings of its touches, for tests of calibrations.

Forces of the electrodes depend on place, rotation, force and pretension about as those of solves,
and are known at once. `made_up` puts them in the place of solves.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np

from pvdf_fem import Scene
from pvdf_fem.calibration import model
from pvdf_fem.calibration.unknowns import value_of
from pvdf_fem.derivatives.parameters import COEFFICIENTS
from pvdf_fem.scene.outlines.outline import turn
from pvdf_fem.scene.outlines.polygon import triangle
from pvdf_fem.scene.stage import Stage
from pvdf_fem.solvers.status import Status

FILM = {"film.pretension_N_m": 8.0}
SCENE = Scene.parse('[probe]\nshape = "triangle"\nside_mm = 7.0\n').with_(**FILM)
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
PLACES_MM = np.array([turn([10.0, 0.0], 90.0 * k) for k in range(4)])


def rest(scene):
    """Forces (electrodes, 2) of the untouched film in N: they grow with its tension."""
    return np.full((4, 2), 0.5 * scene.film.pretension_N_m)


def forces(scene):
    """Forces X, Y (electrodes, 2) in N under the probe."""
    probe, tension = scene.single_probe, scene.film.pretension_N_m
    points = np.array([turn(point, probe.rotation_deg) for point in triangle(7.0)])
    apart = points + np.array([probe.x_mm, probe.y_mm]) - PLACES_MM[:, None]
    along = 1.0 / (1.0 + apart[..., 0] ** 2 / 81.0 + apart[..., 1] ** 2 / 49.0)
    across = 1.0 / (1.0 + apart[..., 0] ** 2 / 36.0 + apart[..., 1] ** 2 / 81.0)
    size = 60.0 * scene.load.force_N / (0.1 * tension + scene.load.force_N) ** 0.5
    return rest(scene) + size * np.stack([along.mean(axis=1), across.mean(axis=1)], axis=1)


@dataclass
class Solved:
    """What a calibration asks of a solution."""

    scene: Scene

    def __post_init__(self):
        self.status, self.reason = Status.CONVERGED, ""
        self.fields = SimpleNamespace(forces=SimpleNamespace(values=forces(self.scene)))
        self.charge_errors_pC = dict.fromkeys(NAMES, 0.0)
        self.charges_pC = dict.fromkeys(NAMES, 1.0)


def rates(solution, keys):
    """Derivatives (keys, electrodes, 2) of the forces."""

    def moved(key, step):
        value = value_of(solution.scene, key)
        return forces(solution.scene.with_(**{key: value + step}))

    return np.array([(moved(key, 1e-5) - moved(key, -1e-5)) / 2e-5 for key in keys])


def made_up(patch):
    """Let calibrations solve the made-up sensor."""
    patch.setattr(model, "goals_of", lambda scene: None)
    patch.setattr(model, "solve_goals", lambda scene, goals: Solved(scene))
    patch.setattr(model, "force_rates", rates)
    patch.setattr(model, "rest_forces", lambda scene, needed: SimpleNamespace(values=rest(scene)))


def drawn(count, place_sd, seed):
    """Places in the file and true ones, (count, 2), rotations and forces, and what draws more."""
    rng = np.random.default_rng(seed)
    reach, angle = 10.0 * rng.uniform(size=count) ** 0.5, rng.uniform(0.0, 2.0 * np.pi, count)
    places = np.stack([reach * np.cos(angle), reach * np.sin(angle)], axis=-1)
    rotations, forces_N = rng.uniform(0.0, 120.0, count), rng.uniform(0.3, 2.0, count)
    return places, places + place_sd * rng.standard_normal((count, 2)), rotations, forces_N, rng


def made(count=24, sigma=0.0, place_sd=0.0, seed=1, true=TRUE, **changes):
    """Columns of touches with readings of the changes in pC; some columns may be replaced."""
    places, moved, rotations, forces_N, rng = drawn(count, place_sd, seed)
    stage = Stage(**{key[6:]: value for key, value in true.items() if key.startswith("stage.")})
    on_film, turned = stage.to_film(moved, rotations)
    film = {key: value for key, value in true.items() if key.startswith("film.")}
    scene, rows = SCENE.with_(**film), []
    d = np.array([value_of(scene, key) for key in COEFFICIENTS])
    for (x, y), rotation, force in zip(on_film, turned, forces_N, strict=True):
        probe = {"probe.x_mm": x, "probe.y_mm": y, "probe.rotation_deg": rotation}
        touched = scene.with_(**probe, **{"load.force_N": force})
        rows.append((forces(touched) - rest(touched)) @ d)
    gains = np.array([true.get(f"gain.{name}", 1.0) for name in NAMES])
    readings = gains * np.array(rows) * (1.0 + sigma * rng.standard_normal((count, 4)))
    columns = {"x_mm": places[:, 0], "y_mm": places[:, 1], "rotation_deg": rotations}
    columns |= {"force_N": forces_N, **dict(zip(NAMES, readings.T, strict=True))}
    return {**columns, **changes}

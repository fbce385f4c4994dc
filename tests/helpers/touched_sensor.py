"""A made-up sensor with known parameters, and readings of its touches, for tests of calibrations.

`made_up` puts it in the place of solves.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from pvdf_fem import Scene
from pvdf_fem.inverse.calibration import reading_model
from pvdf_fem.inverse.calibration.parameters import get_parameter
from pvdf_fem.inverse.calibration.touch_table import TOUCH_KEYS
from pvdf_fem.scene.outlines.outline import rotate
from pvdf_fem.scene.outlines.polygon import make_triangle_corners
from pvdf_fem.scene.stage import Stage
from pvdf_fem.solver.nonlinear.status import Status
from pvdf_fem.solver.sensitivity.parameters import COEFFICIENTS

SCENE = Scene.parse('[probe]\nshape = "triangle"\nside_mm = 7.0\n').with_(
    **{"film.pretension_N_m": 8.0}
)
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
PLACES_MM = np.array([rotate([10.0, 0.0], 90.0 * k) for k in range(4)])
#: What forces of the electrodes depend on.
KEYS = (*TOUCH_KEYS, "film.pretension_N_m")


def forces(at):
    """Forces X, Y (electrodes, 2) in N under the probe at the values of `KEYS`. Those of the
    untouched film are half its tension."""
    x, y, rotation, force, tension = at
    apart = rotate(make_triangle_corners(7.0), rotation) + np.array([x, y]) - PLACES_MM[:, None]
    widths = np.array([[81.0, 49.0], [36.0, 81.0]])
    shares = 1.0 / (1.0 + np.square(apart) @ (1.0 / widths).T)
    return 0.5 * tension + 60.0 * force / (0.1 * tension + force) ** 0.5 * shares.mean(axis=1)


def solved(problem):
    """Return what a calibration uses of a solution."""
    scene = problem.scene
    at = np.array([get_parameter(scene, key) for key in KEYS])
    return SimpleNamespace(
        at=at,
        status=Status.CONVERGED,
        reason="",
        discrete=SimpleNamespace(stress_integrals=SimpleNamespace(values=forces(at))),
        charge_errors_pC=dict.fromkeys(NAMES, 0.0),
        charges_pC=dict.fromkeys(NAMES, 1.0),
    )


def rates(solution, keys):
    """Derivatives (keys, electrodes, 2) of the forces."""
    steps = [1e-5 * (np.array(KEYS) == key) for key in keys]
    ends = [(forces(solution.at + step), forces(solution.at - step)) for step in steps]
    return np.array([(ahead - back) / 2e-5 for ahead, back in ends])


def rest(problem, required):
    """Return the stress integrals of the unloaded film."""
    return SimpleNamespace(values=np.full((4, 2), 0.5 * problem.scene.film.pretension_N_m))


def made_up(patch):
    """Let calibrations solve the made-up sensor."""
    patch.setattr(reading_model, "solve_outputs", solved)
    patch.setattr(reading_model, "compute_integral_rates", rates)
    patch.setattr(reading_model, "compute_unloaded_integrals", rest)


def drawn(count, place_sd, seed):
    """Places in the file and true ones, (count, 2), rotations and forces, and what draws more."""
    rng = np.random.default_rng(seed)
    reach, angle = 10.0 * rng.uniform(size=count) ** 0.5, rng.uniform(0.0, 2.0 * np.pi, count)
    places = np.stack([reach * np.cos(angle), reach * np.sin(angle)], axis=-1)
    rotations, forces_N = rng.uniform(0.0, 120.0, count), rng.uniform(0.3, 2.0, count)
    return places, places + place_sd * rng.standard_normal((count, 2)), rotations, forces_N, rng


def made(count=24, sigma=0.0, place_sd=0.0, seed=1, true=TRUE):
    """Columns of touches with readings of the changes in pC."""
    places, moved, rotations, forces_N, rng = drawn(count, place_sd, seed)
    stage = Stage(**{key[6:]: value for key, value in true.items() if key.startswith("stage.")})
    on_film, turned = stage.to_film(moved, rotations)
    tension, d = true["film.pretension_N_m"], [get_parameter(SCENE, key) for key in COEFFICIENTS]
    touches = np.column_stack([on_film, turned, forces_N, np.full(count, tension)])
    charges = np.array([(forces(at) - 0.5 * tension) @ d for at in touches])
    gains = np.array([true.get(f"gain.{name}", 1.0) for name in NAMES])
    readings = gains * charges * (1.0 + sigma * rng.standard_normal((count, 4)))
    columns = {"x_mm": places[:, 0], "y_mm": places[:, 1], "rotation_deg": rotations}
    return {**columns, "force_N": forces_N, **dict(zip(NAMES, readings.T, strict=True))}

"""A made-up sensor with known parameters, and readings of its touches, for tests of calibrations.

`patch_solver` lets calibrations solve this sensor.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import ClassVar, NamedTuple

import numpy as np

from pvdf_fem import Scene
from pvdf_fem.inverse.calibration import reading_model
from pvdf_fem.inverse.calibration.parameters import get_parameter
from pvdf_fem.scene.outlines.outline import rotate
from pvdf_fem.scene.outlines.polygon import make_triangle_corners
from pvdf_fem.scene.stage import Stage
from pvdf_fem.solver.nonlinear.status import Status
from pvdf_fem.solver.sensitivity.parameters import COEFFICIENTS
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, TOUCH_SCENE_KEYS, Domain

SCENE = Scene.parse('[probe]\nshape = "triangle"\nside_mm = 7.0\n').with_(
    **{"film.pretension_N_m": 8.0}
)
NAMES = ("A", "B", "C", "D")
#: The true values of the sensor's parameters.
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
DOMAIN = Domain(14.0, (0.1, 5.0))  #: Domain of the response.
#: Arguments of the stress integrals.
KEYS = (*TOUCH_SCENE_KEYS, "film.pretension_N_m")


class Placements(NamedTuple):
    """Places, rotations and forces of touches."""

    written_mm: np.ndarray  #: Places as the file has them, (touches, 2).
    true_mm: np.ndarray  #: True places, (touches, 2).
    rotations_deg: np.ndarray
    forces_N: np.ndarray
    rng: np.random.Generator  #: Draws further numbers.


def compute_integrals(at):
    """Compute stress integrals X, Y in N, (..., electrodes, 2), at values (..., 5) of `KEYS`.

    Those of the unloaded film are half its tension.
    """
    at = np.asarray(at)
    x, y, rotation, force, tension = np.moveaxis(at[..., None, None], -3, 0)
    angle = np.radians(rotation)
    corners_x, corners_y = make_triangle_corners(7.0).T
    turned_x = np.cos(angle) * corners_x - np.sin(angle) * corners_y + x
    turned_y = np.sin(angle) * corners_x + np.cos(angle) * corners_y + y
    corners = np.stack([turned_x, turned_y], axis=-1)
    apart = corners - PLACES_MM[:, None]
    squared_widths = np.array([[81.0, 49.0], [36.0, 81.0]])
    shares = 1.0 / (1.0 + np.square(apart) @ (1.0 / squared_widths).T)
    size = 60.0 * force / (0.1 * tension + force) ** 0.5
    return 0.5 * tension + size * shares.mean(axis=-2)


def solve_outputs(problem):
    """Return the parts of a solution that a calibration reads."""
    scene = problem.scene
    at = np.array([get_parameter(scene, key) for key in KEYS])
    integrals = SimpleNamespace(values=compute_integrals(at))
    return SimpleNamespace(
        at=at,
        status=Status.CONVERGED,
        reason="",
        discrete=SimpleNamespace(stress_integrals=integrals),
        charge_errors_pC=dict.fromkeys(NAMES, 0.0),
        charges_pC=dict.fromkeys(NAMES, 1.0),
    )


def differentiate_stress_integrals(solution, keys):
    """Compute derivatives (keys, electrodes, 2) of the stress integrals by differences."""
    rates = []
    for key in keys:
        step = 1e-5 * (np.array(KEYS) == key)
        higher = compute_integrals(solution.at + step)
        lower = compute_integrals(solution.at - step)
        rates.append((higher - lower) / 2e-5)
    return np.array(rates)


def compute_unloaded_integrals(problem, required):
    """Return the stress integrals of the unloaded film."""
    return SimpleNamespace(values=np.full((4, 2), 0.5 * problem.scene.film.pretension_N_m))


def patch_solver(patch):
    """Let calibrations solve the made-up sensor."""
    patch.setattr(reading_model, "solve_outputs", solve_outputs)
    patch.setattr(reading_model, "differentiate_stress_integrals", differentiate_stress_integrals)
    patch.setattr(reading_model, "compute_unloaded_integrals", compute_unloaded_integrals)


def draw_placements(count, place_sd, seed):
    """Draw placements within 10 mm of the centre, with errors of the places in the file."""
    rng = np.random.default_rng(seed)
    reach_mm = 10.0 * rng.uniform(size=count) ** 0.5
    angle = rng.uniform(0.0, 2.0 * np.pi, count)
    written_mm = np.stack([reach_mm * np.cos(angle), reach_mm * np.sin(angle)], axis=-1)
    rotations_deg = rng.uniform(0.0, 120.0, count)
    forces_N = rng.uniform(0.3, 2.0, count)
    true_mm = written_mm + place_sd * rng.standard_normal((count, 2))
    return Placements(written_mm, true_mm, rotations_deg, forces_N, rng)


def make_columns(count=24, sigma=0.0, place_sd=0.0, seed=1, true=TRUE):
    """Make the columns of touches, with readings of the changes in pC."""
    drawn = draw_placements(count, place_sd, seed)
    stage = Stage(**{key[6:]: value for key, value in true.items() if key.startswith("stage.")})
    on_film_mm, on_film_deg = stage.to_film(drawn.true_mm, drawn.rotations_deg)
    tension = true["film.pretension_N_m"]
    coefficients = [get_parameter(SCENE, key) for key in COEFFICIENTS]
    tensions = np.full(count, tension)
    charges = []
    for at in np.column_stack([on_film_mm, on_film_deg, drawn.forces_N, tensions]):
        charges.append((compute_integrals(at) - 0.5 * tension) @ coefficients)
    gains = np.array([true.get(f"gain.{name}", 1.0) for name in NAMES])
    noise = 1.0 + sigma * drawn.rng.standard_normal((count, 4))
    readings = gains * np.array(charges) * noise
    columns = {
        "x_mm": drawn.written_mm[:, 0],
        "y_mm": drawn.written_mm[:, 1],
        "rotation_deg": drawn.rotations_deg,
        "force_N": drawn.forces_N,
    }
    return columns | dict(zip(NAMES, readings.T, strict=True))


@dataclass(frozen=True, eq=False)
class TouchedSensitivities:
    """Derivatives of the charges of the made-up sensor with respect to its pretension."""

    scene: Scene

    @property
    def keys(self):
        """The only key."""
        return ("film.pretension_N_m",)

    @property
    def unloaded_slopes(self):
        """Derivatives of the unloaded charges (electrodes, keys)."""
        return np.full((4, 1), 0.5 * sum(get_coefficients(self.scene)))

    def select(self, keys):
        """Return these derivatives."""
        return self

    def evaluate(self, touches, charges_pC, slopes):
        """Compute derivatives (n, electrodes, keys) of the changes, by differences."""
        step = 1e-5 * np.eye(5)[4]
        at = _append_tension(self.scene, touches)
        difference = compute_integrals(at + step) - compute_integrals(at - step)
        total = difference @ get_coefficients(self.scene) / 2e-5
        return total[:, :, None] - self.unloaded_slopes


@dataclass(frozen=True, eq=False)
class TouchedResponse:
    """The response of the made-up sensor with the pretension of a scene."""

    quantity_names: ClassVar = TOUCH_QUANTITIES
    is_fast: ClassVar = True
    names: ClassVar = NAMES
    scene: Scene
    domain: Domain = DOMAIN
    error_bound: float = 1e-5

    @property
    def unloaded_charges_pC(self):
        """Charges of the unloaded film and their errors."""
        tension = self.scene.film.pretension_N_m
        return (0.5 * tension * sum(get_coefficients(self.scene)),) * 4, (0.0,) * 4

    @property
    def sensitivities(self):
        """Derivatives with respect to the pretension."""
        return TouchedSensitivities(self.scene)

    def evaluate(self, touches):
        """Compute charges (n, electrodes) and derivatives (n, electrodes, 4), by differences."""
        coefficients = get_coefficients(self.scene)
        at = _append_tension(self.scene, touches)
        columns = []
        for step in 1e-6 * np.eye(5)[:4]:
            difference = compute_integrals(at + step) - compute_integrals(at - step)
            columns.append(difference @ coefficients / 2e-6)
        return compute_integrals(at) @ coefficients, np.stack(columns, axis=-1)


def _append_tension(scene, touches):
    """Return touches (n, 4) with the scene's pretension as fifth column."""
    tension = np.full((len(touches), 1), scene.film.pretension_N_m)
    return np.hstack([touches, tension])


def get_coefficients(scene):
    """Return d31 and d32 of a scene."""
    return np.array([get_parameter(scene, key) for key in COEFFICIENTS])

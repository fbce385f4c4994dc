"""Made-up sensors with known parameters, and touches of them with charges from full solves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pvdf_fem import Scene, solve
from pvdf_fem.arrays import Array

#: Largest distance of a touch from the stage's origin in mm.
REACH_MM = 12.0
#: Least and largest force in N.
LEAST_N, LARGEST_N = 0.3, 2.0
#: Standard deviations of a touch's place in mm, and of readings, relative.
PLACE_SD_MM, SIGMA = 0.3, 0.01
#: Tolerance of the solves that make readings.
TOLERANCE = 1e-5
#: How far true parameters are from the scene's, in both directions: shares.
GAIN, COEFFICIENT, PRETENSION = 0.1, 0.2, 0.3
#: Largest shift in mm and turn in degrees of the film.
SHIFT_MM, TURN_DEG = 1.0, 3.0
UNKNOWN = ("film.pretension_N_m", "film.d31_pC_N", "film.d32_pC_N", "gains", "shift", "turn")


@dataclass(frozen=True, eq=False)
class MadeUpSensor:
    """A sensor that differs from the scene it is thought to be."""

    #: As it is thought to be.
    scene: Scene
    #: As it is, with gains and stage.
    true: Scene
    #: True values by name of the parameter.
    values: dict[str, float]
    rng: np.random.Generator

    @classmethod
    def drawn(cls, scene: Scene, seed: int, number: int) -> MadeUpSensor:
        """The sensor of a number."""
        rng = np.random.default_rng([seed, number])
        tension = float(scene.film.thickness * scene.film.stress_at_rest[0])
        scene = scene.with_(**{"film.pretension_N_m": tension})
        film = {
            "film.pretension_N_m": tension * (1.0 + PRETENSION * rng.uniform(-1.0, 1.0)),
            "film.d31_pC_N": scene.film.d31_pC_N * (1.0 + COEFFICIENT * rng.uniform(-1.0, 1.0)),
            "film.d32_pC_N": scene.film.d32_pC_N * (1.0 + COEFFICIENT * rng.uniform(-1.0, 1.0)),
        }
        names = [electrode.name for electrode in scene.electrode_list]
        gains = {name: 1.0 + GAIN * rng.uniform(-1.0, 1.0) for name in names}
        shift, angle = SHIFT_MM * rng.uniform() ** 0.5, rng.uniform(0.0, 2.0 * np.pi)
        stage = {
            "stage.x_mm": shift * float(np.cos(angle)),
            "stage.y_mm": shift * float(np.sin(angle)),
            "stage.rotation_deg": TURN_DEG * rng.uniform(-1.0, 1.0),
        }
        true = scene.with_(**film, **stage, **{"readout.gain": gains})
        values = {**film, **{f"gain.{name}": gain for name, gain in gains.items()}, **stage}
        return cls(scene, true, values, rng)

    def touches(self, count: int, place_sd_mm: float = PLACE_SD_MM) -> dict[str, Array]:
        """Columns of touches, whose places have errors, with readings of changes in pC."""
        rng, names = self.rng, [electrode.name for electrode in self.scene.electrode_list]
        reach, angle = (
            REACH_MM * rng.uniform(size=count) ** 0.5,
            rng.uniform(0.0, 2.0 * np.pi, count),
        )
        places = np.stack([reach * np.cos(angle), reach * np.sin(angle)], axis=-1)
        rotations = rng.uniform(0.0, 120.0, count)
        forces = rng.uniform(LEAST_N, LARGEST_N, count)
        errors = place_sd_mm * rng.standard_normal((count, 2))
        noise = 1.0 + SIGMA * rng.standard_normal((count, len(names)))
        readings = noise * self.readings(places + errors, rotations, forces)
        return {
            "x_mm": places[:, 0],
            "y_mm": places[:, 1],
            "rotation_deg": rotations,
            "force_N": forces,
            **dict(zip(names, readings.T, strict=True)),
        }

    def readings(self, places: Array, rotations: Array, forces: Array) -> Array:
        """Changes of the charges times the gains in pC, (touches, electrodes)."""
        assert self.true.stage is not None
        on_film, turned = self.true.stage.to_film(places, rotations)
        rows = []
        for (x, y), rotation, force in zip(on_film, turned, forces, strict=True):
            probe = {"probe.x_mm": x, "probe.y_mm": y, "probe.rotation_deg": rotation}
            numerics = {"load.force_N": force, "numerics.tolerance": TOLERANCE}
            changes = solve(self.true.with_(**probe, **numerics)).charge_changes_pC
            rows.append([self.values[f"gain.{name}"] * q for name, q in changes.items()])
        return np.array(rows)

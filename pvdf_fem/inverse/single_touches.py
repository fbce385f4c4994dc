"""Charges of single touches of one probe under 1 N, at positions all over the film."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.interpolate import RBFInterpolator

from pvdf_fem.arrays import Array
from pvdf_fem.batch.batch import solve_scenes
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solver.nonlinear.status import NotConvergedError


class SingleTouches(NamedTuple):
    """Charges of touches of one probe under 1 N, rotated by the polar angle of its position."""

    positions_mm: Array  #: Positions x, y on the film; shape (n, 2).
    charges_pC: Array  #: Charges of all electrodes; shape (n, electrodes).


@lru_cache(maxsize=8)
def tabulate_single_touches(
    scene: Scene, reach_mm: float, solved_pitch_mm: float, fine_pitch_mm: float
) -> SingleTouches:
    """Solve single touches on rings, and interpolate their charges to a finer square raster.

    Positions whose solve does not converge are left out of the interpolation.

    Parameters
    ----------
    scene : Scene
        A scene with one probe under 1 N.
    reach_mm : float
        Maximum distance of the probe from the centre.
    solved_pitch_mm : float
        Spacing of the rings, and of the positions on a ring. The probe is rotated by the polar
        angle of its position, so that by symmetry many positions on a round film share a solve.
    fine_pitch_mm : float
        Spacing of the square raster.

    Returns
    -------
    SingleTouches
        Interpolated charges on the raster. The last few results are cached by the arguments.

    Raises
    ------
    NotConvergedError
        If fewer than three positions can be solved.
    """
    radii = []
    angles_deg = []
    for radius in np.linspace(0.0, reach_mm, round(reach_mm / solved_pitch_mm) + 1):
        count = max(1, round(2.0 * np.pi * radius / solved_pitch_mm))
        radii += [radius] * count
        angles_deg += [360.0 * index / count for index in range(count)]
    angles = np.radians(angles_deg)
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    positions = np.array(radii)[:, None] * directions
    scenes = []
    for (x_mm, y_mm), angle_deg in zip(positions.tolist(), angles_deg, strict=True):
        changes = {"probe.x_mm": x_mm, "probe.y_mm": y_mm, "probe.rotation_deg": angle_deg}
        scenes.append(scene.with_(**changes))
    records = solve_scenes(scenes, processes=1)
    solved = [index for index, record in enumerate(records) if record.converged]
    if len(solved) < 3:
        failed = next(record for record in records if not record.converged)
        raise NotConvergedError(f"{failed.status}: one touch alone: {failed.reason}")
    film = scene.film
    charges = []
    for index in solved:
        by_name = records[index].charges_pC(film.d31_pC_N, film.d32_pC_N, scene.numerics.observable)
        charges.append(list(by_name.values()))
    ticks = np.arange(-reach_mm, reach_mm + 0.5 * fine_pitch_mm, fine_pitch_mm)
    raster = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    raster = raster[np.hypot(raster[:, 0], raster[:, 1]) <= reach_mm]
    return SingleTouches(raster, RBFInterpolator(positions[solved], np.array(charges))(raster))

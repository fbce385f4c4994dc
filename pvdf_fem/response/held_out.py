"""Touches that are held out of a response's build: full solves with which it is compared."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.response.model import Domain, scene_of_touch
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.scene import Scene

if TYPE_CHECKING:
    from pvdf_fem.sweeps.store import Store

SAFETY = 5.0  #: Error bound over the largest error at these touches.
SHARE = 0.05  #: Tolerance of their full solves over that of the response.


def random_touches(domain: Domain, count: int, seed: int = 0) -> Array:
    """Touches (n, 4) all over a domain, evenly by place, rotation and logarithm of the force."""
    u = np.random.default_rng(seed).uniform(size=(count, 4))
    distance, angle = domain.reach_mm * np.sqrt(u[:, 0]), 2.0 * np.pi * u[:, 1]
    low, high = domain.force_N
    x, y, forces = distance * np.cos(angle), distance * np.sin(angle), low * (high / low) ** u[:, 3]
    return np.stack([x, y, 360.0 * u[:, 2], forces], axis=-1)


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Forces X, Y of electrodes in full solves of touches, and their estimated errors."""

    touches: Array
    #: In N, (n, electrodes, 2); errors have signs.
    forces: Array
    errors: Array

    @classmethod
    def solved(
        cls,
        scene: Scene,
        touches: Array,
        tolerance: float,
        processes: int,
        store: Store | None = None,
        progress: Callable[[int, int], None] | None = None,
    ) -> HeldOut:
        """Solve touches to a tolerance; those that have no solution are left out.

        Raises `NotConvergedError` when fewer than half of the touches have a solution.
        """
        from pvdf_fem.solvers.status import NotConvergedError
        from pvdf_fem.sweeps.sweep import silent, solve_all

        scenes = [scene_of_touch(scene, touch, tolerance) for touch in touches]
        records = solve_all(scenes, store, processes=processes, progress=progress or silent)
        solved = [i for i, record in enumerate(records) if record.converged]
        if 2 * len(solved) < len(records):
            failed = next(i for i in range(len(records)) if i not in solved)
            x, y, rotation, force = touches[failed]
            place = f"({x:.6g}, {y:.6g}) mm, {rotation:.6g} deg, {force:.6g} N"
            raise NotConvergedError(f"touch at {place}: {records[failed].reason}")
        forces = [records[i].forces["material"] for i in solved]
        errors = [records[i].force_errors["material"] for i in solved]
        return cls(touches[solved], np.array(forces), np.array(errors))

    def relative_errors(self, film: Film, charges_pC: Array) -> tuple[Array, float]:
        """Errors of charges (n, electrodes) of these touches over |d31 X| + |d32 Y|.

        The second value is the largest error that the full solves state of themselves.
        """
        from pvdf_fem.charges.forces import Forces  # with scikit-fem

        d = film.d31_pC_N, film.d32_pC_N
        sizes = (np.abs(self.forces) * np.abs(d)).sum(axis=-1)
        sizes[sizes == 0.0] = 1.0
        both = zip(self.forces, self.errors, strict=True)
        stated = np.array([Forces(*rows).charge_errors(d) for rows in both])
        apart = np.abs(charges_pC - (self.forces * d).sum(axis=-1))
        return apart / sizes, float((stated / sizes).max())

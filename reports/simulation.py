"""Solving many scenes on several processes, and what a report keeps of each."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from joblib import Parallel, delayed, parallel_config

from pvdf_fem import Scene, Solution, solve
from pvdf_fem.charge import electrode_forces
from pvdf_fem.newton import Status
from reports.thesis_mesh import edge_forces, solve_on_thesis_mesh

THESIS_EDGE = "thesis-edge"
MATERIAL = "material"

Forces = dict[str, tuple[float, float]]


@dataclass(frozen=True)
class Simulation:
    """A scene, and the mesh it is solved on: one refined to the tolerance, or the thesis's."""

    scene: Scene
    mesh: Literal["refined", "thesis"] = "refined"


@dataclass(frozen=True)
class Outcome:
    """How a simulation ended.

    `forces` holds X and Y in N by observable and electrode (see `pvdf_fem.charge`), so that the
    charges follow for every pair of piezoelectric coefficients; `errors` the estimates of their
    discretisation errors, for the scene's own observable.
    """

    status: str
    reason: str = ""
    forces: Mapping[str, Forces] = field(default_factory=dict)
    errors: Forces = field(default_factory=dict)
    seconds: float = 0.0

    @property
    def converged(self) -> bool:
        """Whether there are forces."""
        return self.status == Status.CONVERGED

    def charge_pC(
        self, electrode: str, observable: str = THESIS_EDGE, d31: float = 8.0, d32: float = 8.0
    ) -> float:
        """Charge in pC with coefficients in pC/N; NaN if the solve failed."""
        x, y = self.forces.get(observable, {}).get(electrode, (np.nan, np.nan))
        return d31 * x + d32 * y

    def error_pC(self, electrode: str, d31: float = 8.0, d32: float = 8.0) -> float:
        """Estimated error in pC of the scene's own observable; NaN if there is none."""
        x, y = self.errors.get(electrode, (np.nan, np.nan))
        return abs(d31 * x + d32 * y)


Outcomes = Mapping[Simulation, Outcome]


def simulate(simulation: Simulation) -> Outcome:
    """Solve one simulation; an exception becomes an outcome too, so that no other is lost."""
    start = time.perf_counter()
    try:
        outcome = _on_thesis_mesh if simulation.mesh == "thesis" else _refined
        return outcome(simulation.scene, start)
    except Exception as error:
        return Outcome("error", f"{type(error).__name__}: {error}")


def simulate_all(
    simulations: Iterable[Simulation], processes: int
) -> Iterator[tuple[Simulation, Outcome]]:
    """Simulations with their outcomes, in the order in which they end."""
    if processes == 1:
        yield from map(_labelled, simulations)
        return
    with parallel_config("loky", inner_max_num_threads=1):
        pool = Parallel(processes, return_as="generator_unordered", batch_size=1)
        yield from pool(delayed(_labelled)(simulation) for simulation in simulations)


def _labelled(simulation: Simulation) -> tuple[Simulation, Outcome]:
    return simulation, simulate(simulation)


def _refined(scene: Scene, start: float) -> Outcome:
    solution = solve(scene)
    if solution.status is not Status.CONVERGED:
        return Outcome(str(solution.status), solution.reason)
    fields = solution.fields
    other = scene.with_(**{"numerics.observable": MATERIAL})
    forces = {
        scene.numerics.observable: _by_name(scene, fields.forces),
        MATERIAL: _by_name(
            scene, electrode_forces(other, fields.equilibrium.membrane, fields.displacement)
        ),
    }
    errors = _by_name(scene, fields.force_errors)
    return Outcome(str(solution.status), "", forces, errors, time.perf_counter() - start)


def _on_thesis_mesh(scene: Scene, start: float) -> Outcome:
    solution: Solution = solve_on_thesis_mesh(scene)
    if solution.status is not Status.CONVERGED:
        return Outcome(str(solution.status), solution.reason)
    forces = {THESIS_EDGE: _by_name(scene, edge_forces(solution))}
    return Outcome(str(solution.status), "", forces, {}, time.perf_counter() - start)


def _by_name(scene: Scene, forces: np.ndarray) -> Forces:
    names = [electrode.name for electrode in scene.electrode_list]
    return {name: (x, y) for name, (x, y) in zip(names, forces.tolist(), strict=True)}

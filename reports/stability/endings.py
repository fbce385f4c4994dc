"""How scenes end: tasks that solve a scene, and say how far its charges are from known ones."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from pvdf_fem import Scene, SceneError, Solution, solve
from pvdf_fem.arrays import Array
from pvdf_fem.film.models import film_model
from pvdf_fem.reporting.task import Rows, Task
from pvdf_fem.solvers.status import Status
from pvdf_fem.solvers.wrinkling import load_strain
from reports.stability.references import one_dimension
from reports.stability.scenes import enlarged, extreme_scene

REFUSED = "refused"  #: By key, before any mesh is made.
CRASHED = "crashed"  #: By an exception: what must not happen.
#: Where the parts of d31 and d32 cancel, a tolerance counts in this share of the parts.
CANCELLED = 0.05
FINER = 10.0  #: Factor between the tolerances of a scene and of its finer solve.
LENGTH, MODULUS = 3.7, 0.21  #: Factors of the lengths and moduli of the enlarged scene.

Row = dict[str, Any]


def ended(scene: Scene) -> tuple[Row, Solution | None]:
    """How the solve of a scene ended; an exception is an ending too."""
    start = time.process_time()
    try:
        solution = solve(scene)
    except Exception as error:
        row = {"status": CRASHED, "reason": f"{type(error).__name__}: {error}"}
        return {**row, "seconds": time.process_time() - start}, None
    row = {"status": str(solution.status), "reason": solution.reason}
    row |= {"seconds": time.process_time() - start, "unknowns": solution.unknowns}
    return row, solution if solution.status is Status.CONVERGED else None


def charges_of(solution: Solution) -> Array:
    """Charges in pC."""
    return np.array([*solution.charges_pC.values()])


def compared(solution: Solution, known_pC: Array, name: str) -> Row:
    """Largest difference of a charge from a known one, over the tolerance, as `name`; and the error
    that the solve states of this charge."""
    film, charges = solution.scene.film, charges_of(solution)
    parts = 1e12 * np.abs(solution.fields.forces.values) @ np.abs([film.d31, film.d32])
    units = solution.scene.numerics.tolerance * np.maximum(np.abs(charges), CANCELLED * parts)
    differences = np.abs(charges - known_pC) / units
    if not np.isfinite(differences).all():
        return {}
    worst = int(np.argmax(differences))
    stated = [*solution.charge_errors_pC.values()][worst] / units[worst]
    return {name: float(differences[worst]), f"stated_{name}": float(stated)}


@dataclass(frozen=True)
class OnStrip(Task):
    """The scene with a value of a key, beside a reference."""

    scene: Scene
    key: str
    value: float
    reference: Literal["one-dimension", "finer"]

    def run(self) -> Rows:
        """A row: status, reason, seconds, error and stated error."""
        place = {"key": self.key, "value": self.value}
        try:
            scene = self.scene.with_(**{self.key: self.value})
        except SceneError as error:
            return [{**place, "status": REFUSED, "reason": error.problems[0], "seconds": 0.0}]
        row, solution = ended(scene)
        if solution is not None and self.reference == "finer":
            row |= _finer(solution)
        elif solution is not None:
            row |= compared(solution, one_dimension(scene), "error")
        return [{**place, **row}]


@dataclass(frozen=True)
class Extreme(Task):
    """A drawn scene, its finer solve, and the scene enlarged by a scale."""

    number: int
    seed: int
    tolerance: float

    def run(self) -> Rows:
        """A row: what was drawn, status, reason, seconds, errors and the difference by scale."""
        drawn = extreme_scene(self.number, self.seed)
        scene = drawn.with_(**{"numerics.tolerance": self.tolerance})
        row: Row = {
            "number": self.number,
            "load_strain": load_strain(scene),
            "rest_strain": float(scene.film.strain_at_rest[0]),
        }
        found, solution = ended(scene)
        if solution is not None:
            found |= _finer(solution) | _enlarged(solution)
        return [{**row, **found, "scene": scene.to_toml()}]


def _finer(solution: Solution) -> Row:
    """The difference from a finer solve, in which bending is decided as in the first."""
    scene = solution.scene
    changes = {"numerics.tolerance": scene.numerics.tolerance / FINER}
    row, better = ended(scene.with_(**changes, **{"film.bending": film_model(scene).bends}))
    if better is None:
        return {"finer": row["status"]}
    return {"finer": row["status"], **compared(solution, charges_of(better), "error")}


def _enlarged(solution: Solution) -> Row:
    """The difference from the scene enlarged by a scale, whose charges are in proportion."""
    row, other = ended(enlarged(solution.scene, LENGTH, MODULUS))
    if other is None:
        return {"enlarged": row["status"]}
    known = charges_of(other) / (MODULUS * LENGTH**2)
    return {"enlarged": row["status"], **compared(solution, known, "scaled")}


@dataclass(frozen=True)
class Law(Task):
    """The ratio of a quantity of two scenes, on the mesh of the first."""

    first: Scene
    second: Scene
    quantity: Literal["charge", "deflection"]

    def run(self) -> Rows:
        """A row with the ratio."""
        before = solve(self.first)
        after = solve(self.second, mesh=before.mesh)
        if self.quantity == "deflection":
            return [{"ratio": after.deflection_max_mm / before.deflection_max_mm}]
        return [{"ratio": float((charges_of(after) / charges_of(before))[0])}]

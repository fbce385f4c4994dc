"""How scenes end: tasks that solve a scene, and say how far its charges are from known ones."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from pvdf_fem import Scene, SceneError, Solution, solve
from pvdf_fem.arrays import Array
from pvdf_fem.problem.problem import Problem
from pvdf_fem.report.task import Rows, Task
from pvdf_fem.solver.nonlinear.status import Status
from pvdf_fem.solver.nonlinear.wrinkling import estimate_load_strain
from reports.accuracy.cases import known_charges
from reports.reference.laminated_disc import LaminatedDisc, Ply
from reports.stability.scenes import enlarged, extreme_scene

REFUSED = "refused"  #: By key, before any mesh is made.
CRASHED = "crashed"  #: By an exception: what must not happen.
#: Where the parts of d31 and d32 cancel, a tolerance counts in this share of the parts.
CANCELLED = 0.05
FINER = 10.0  #: Factor between the tolerances of a scene and of its finer solve.
ELEMENTS = 24  #: Of the plate in one dimension, between two of centre, edges and rim.
LENGTH, MODULUS = 3.7, 0.21  #: Factors of the lengths and moduli of the enlarged scene.

Row = dict[str, Any]


def ended(scene: Scene) -> tuple[Row, Solution | None]:
    """How the solve of a scene ended; an exception is an ending too."""
    start = time.process_time()
    try:
        solution = solve(scene)
    except Exception as error:
        row: Row = {"status": CRASHED, "reason": f"{type(error).__name__}: {error}"}
        return {**row, "seconds": time.process_time() - start}, None
    row = {"status": str(solution.status), "reason": solution.reason}
    row |= {"seconds": time.process_time() - start, "unknowns": solution.unknowns}
    return row, solution if solution.status is Status.CONVERGED else None


def charges_of(solution: Solution) -> Array:
    """Charges in pC."""
    return np.array([*solution.charges_pC.values()])


def compared(solution: Solution, known_pC: Array, name: str, doubts_pC: Array | float = 0.0) -> Row:
    """Largest difference of a charge from a known one, beyond the doubt of that, over the
    tolerance, as `name`; and the error that the solve states of this charge."""
    film, charges = solution.scene.film, charges_of(solution)
    parts = 1e12 * np.abs(solution.discrete.stress_integrals.values) @ np.abs([film.d31, film.d32])
    units = solution.scene.numerics.tolerance * np.maximum(np.abs(charges), CANCELLED * parts)
    differences = np.maximum(np.abs(charges - known_pC) - doubts_pC, 0.0) / units
    if not np.isfinite(differences).all():
        return {}
    worst = int(np.argmax(differences))
    stated = [*solution.charge_errors_pC.values()][worst] / units[worst]
    return {name: float(differences[worst]), f"stated_{name}": float(stated)}


def one_dimension(scene: Scene) -> Array:
    """Charges in pC by a problem in one dimension; NaN where that has no solution. The probe is a
    disc or a sphere at the centre; electrodes are as in `reports.accuracy.cases`, those of a plate
    are centred discs."""
    wrinkles = scene.film.prestrain[0] < 0.0  # what carries no compression does
    truth = "wrinkled" if wrinkles else "one_dimensional"
    try:
        if scene.film.bending is True:
            return _plate(scene)
        known = known_charges("sphere" if scene.load.kind == "contact" else truth, scene)
    except (ValueError, RuntimeError):
        return np.full(len(scene.electrode_list), np.nan)
    return np.array([*known.values()])


def _plate(scene: Scene) -> Array:
    """Charges in pC of centred discs on a plate, at small slopes."""
    film, (probe,) = scene.film, scene.loaded_probes
    rest = float(film.prestrain[0])
    ply = Ply(film.stiffness[:2, :2], film.thickness, 0.0, rest, film.radius)
    areas = [probe.outline.area, *(electrode.outline.area for electrode in scene.electrode_list)]
    edge, *radii = np.sqrt(np.array(areas) / np.pi)
    discs = np.array([[0.0, 0.0, radius] for radius in radii])
    found = LaminatedDisc((ply,), edge, scene.load.force_N, discs, ELEMENTS)
    return 1e12 * found.charges(film.d31, film.d32)


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
            "load_strain": estimate_load_strain(scene),
            "rest_strain": float(scene.film.prestrain[0]),
        }
        found, solution = ended(scene)
        if solution is not None:
            found |= _finer(solution) | _enlarged(solution)
        return [{**row, **found, "scene": scene.to_toml()}]


def _finer(solution: Solution) -> Row:
    """The difference from a finer solve, in which bending is decided as in the first."""
    scene = solution.scene
    changes = {"numerics.tolerance": scene.numerics.tolerance / FINER}
    row, better = ended(
        scene.with_(**changes, **{"film.bending": Problem.from_scene(scene).film.bends})
    )
    if better is None:
        return {"finer": row["status"]}
    doubts = np.array([*better.charge_errors_pC.values()])
    return {"finer": row["status"], **compared(solution, charges_of(better), "error", doubts)}


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

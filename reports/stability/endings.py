"""Outcomes of scenes: tasks that solve a scene and compare its charges with known ones."""

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
from reports.accuracy.cases import compute_known_charges
from reports.reference.laminated_disc import LaminatedDisc, Ply
from reports.stability.scenes import draw_extreme_scene, enlarge

REFUSED = "refused"  #: Status of values that a key refuses.
CRASHED = "crashed"  #: Status of a solve that raises an exception, which must not happen.
#: A tolerance is relative to at least this share of the parts of a charge due to d31 and d32.
CANCELLATION_FRACTION = 0.05
REFINEMENT = 10.0  #: Tolerance of a scene over the tolerance of its finer solve.
#: Number of elements of the one-dimensional plate between two of centre, edges and rim.
PLATE_ELEMENTS = 24
LENGTH_FACTOR = 3.7  #: Factor of the lengths of the enlarged scene.
MODULUS_FACTOR = 0.21  #: Factor of the moduli of the enlarged scene.

Row = dict[str, Any]


def solve_scene(scene: Scene) -> tuple[Row, Solution | None]:
    """Solve a scene and describe the outcome, be it an exception.

    Parameters
    ----------
    scene : Scene
        The scene.

    Returns
    -------
    row : dict
        Status, reason, processor seconds and unknowns.
    solution : Solution or None
        The solution if it is converged.
    """
    start = time.process_time()
    try:
        solution = solve(scene)
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
        return {
            "status": CRASHED,
            "reason": reason,
            "seconds": time.process_time() - start,
        }, None
    row = {
        "status": str(solution.status),
        "reason": solution.reason,
        "seconds": time.process_time() - start,
        "unknowns": solution.unknowns,
    }
    return row, solution if solution.status is Status.CONVERGED else None


def get_charges(solution: Solution) -> Array:
    """Return the charges (electrodes,) in pC."""
    return np.array(list(solution.charges_pC.values()))


def compare_charges(
    solution: Solution, known_pC: Array, name: str, doubts_pC: Array | float = 0.0
) -> Row:
    """Compare charges with known ones.

    Parameters
    ----------
    solution : Solution
        A converged solution.
    known_pC : array (electrodes,)
        Known charges in pC, NaN where there is none.
    name : str
        Name of the difference.
    doubts_pC : array (electrodes,) or float
        Errors of the known charges in pC, which are subtracted from the differences.

    Returns
    -------
    dict
        The largest difference in tolerances by `name`, and the stated error of this charge in
        tolerances by ``stated_`` and the name. Empty where a charge is not known.
    """
    film = solution.scene.film
    charges = get_charges(solution)
    parts = 1e12 * np.abs(solution.discrete.stress_integrals.values) @ np.abs([film.d31, film.d32])
    sizes = np.maximum(np.abs(charges), CANCELLATION_FRACTION * parts)
    tolerances_pC = solution.scene.numerics.tolerance * sizes
    differences = np.maximum(np.abs(charges - known_pC) - doubts_pC, 0.0) / tolerances_pC
    if not np.isfinite(differences).all():
        return {}
    worst = int(np.argmax(differences))
    errors = np.array(list(solution.charge_errors_pC.values()))
    stated = errors[worst] / tolerances_pC[worst]
    return {name: float(differences[worst]), f"stated_{name}": float(stated)}


def compute_one_dimensional_charges(scene: Scene) -> Array:
    """Compute charges by a one-dimensional problem.

    Parameters
    ----------
    scene : Scene
        With a disc or a sphere at the centre. Electrodes are as in `reports.accuracy.cases`, those
        of a plate centred discs.

    Returns
    -------
    array (electrodes,)
        In pC; NaN where the problem has no solution.
    """
    try:
        if scene.film.bending is True:
            return _compute_plate_charges(scene)
        truth = "one_dimensional"
        if scene.load.kind == "contact":
            truth = "sphere"
        elif scene.film.prestrain[0] < 0.0:  # a film without compression wrinkles
            truth = "wrinkled"
        charges = compute_known_charges(truth, scene)
    except (ValueError, RuntimeError):
        return np.full(len(scene.electrode_list), np.nan)
    return np.array(list(charges.values()))


def _compute_plate_charges(scene: Scene) -> Array:
    """Return the charges in pC of centred discs on a plate at small slopes."""
    film = scene.film
    [probe_load] = scene.loaded_probes
    prestrain = float(film.prestrain[0])
    ply = Ply(film.stiffness[:2, :2], film.thickness, 0.0, prestrain, film.radius)
    probe_radius = np.sqrt(probe_load.outline.area / np.pi)
    discs = []
    for electrode in scene.electrode_list:
        discs.append([0.0, 0.0, np.sqrt(electrode.outline.area / np.pi)])
    plate = LaminatedDisc((ply,), probe_radius, scene.load.force_N, np.array(discs), PLATE_ELEMENTS)
    return 1e12 * plate.charges(film.d31, film.d32)


@dataclass(frozen=True)
class RangeValue(Task):
    """A scene with a value of a key, compared with a reference."""

    scene: Scene
    key: str
    value: float
    reference: Literal["one-dimension", "finer"]

    def run(self) -> Rows:
        """Return a row with status, reason, seconds, error and stated error."""
        about = {"key": self.key, "value": self.value}
        try:
            scene = self.scene.with_(**{self.key: self.value})
        except SceneError as error:
            reason = error.problems[0]
            return [{**about, "status": REFUSED, "reason": reason, "seconds": 0.0}]
        row, solution = solve_scene(scene)
        if solution is not None:
            if self.reference == "finer":
                row |= _compare_with_finer(solution)
            else:
                known = compute_one_dimensional_charges(scene)
                row |= compare_charges(solution, known, "error")
        return [{**about, **row}]


@dataclass(frozen=True)
class ExtremeScene(Task):
    """A random extreme scene, compared with its finer solve and with the enlarged scene."""

    number: int
    seed: int
    tolerance: float

    def run(self) -> Rows:
        """Return a row with strains, status, reason, seconds and errors."""
        drawn = draw_extreme_scene(self.number, self.seed)
        scene = drawn.with_(**{"numerics.tolerance": self.tolerance})
        about: Row = {
            "number": self.number,
            "load_strain": estimate_load_strain(scene),
            "rest_strain": float(scene.film.prestrain[0]),
        }
        row, solution = solve_scene(scene)
        if solution is not None:
            row |= _compare_with_finer(solution)
            row |= _compare_with_enlarged(solution)
        return [{**about, **row, "scene": scene.to_toml()}]


def _compare_with_finer(solution: Solution) -> Row:
    """Return the difference from a finer solve, with bending as in the first one."""
    scene = solution.scene
    changes = {
        "numerics.tolerance": scene.numerics.tolerance / REFINEMENT,
        "film.bending": Problem.from_scene(scene).film.bends,
    }
    row, finer = solve_scene(scene.with_(**changes))
    if finer is None:
        return {"finer": row["status"]}
    doubts = np.array(list(finer.charge_errors_pC.values()))
    comparison = compare_charges(solution, get_charges(finer), "error", doubts)
    return {"finer": row["status"], **comparison}


def _compare_with_enlarged(solution: Solution) -> Row:
    """Return the difference from the enlarged scene, whose charges are in proportion."""
    row, enlarged = solve_scene(enlarge(solution.scene, LENGTH_FACTOR, MODULUS_FACTOR))
    if enlarged is None:
        return {"enlarged": row["status"]}
    known = get_charges(enlarged) / (MODULUS_FACTOR * LENGTH_FACTOR**2)
    return {"enlarged": row["status"], **compare_charges(solution, known, "scaled")}


@dataclass(frozen=True)
class RatioOfScenes(Task):
    """The ratio of a quantity of two scenes on the mesh of the first one."""

    first: Scene
    second: Scene
    quantity: Literal["charge", "deflection"]

    def run(self) -> Rows:
        """Return a row with the ratio of the second to the first."""
        before = solve(self.first)
        after = solve(self.second, mesh=before.mesh)
        if self.quantity == "deflection":
            return [{"ratio": after.deflection_max_mm / before.deflection_max_mm}]
        ratios = get_charges(after) / get_charges(before)
        return [{"ratio": float(ratios[0])}]

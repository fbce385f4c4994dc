"""Derivatives of every charge by the probe's place, the force and the film, with their errors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.arguments import Names, SceneLike, ValuesByName, as_scene, coerce
from pvdf_fem.scene.changes import get_number
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import format_error, suggest
from pvdf_fem.solver.adaptive import solve_problem
from pvdf_fem.solver.history import Stop
from pvdf_fem.solver.nonlinear.status import NotConvergedError, Status
from pvdf_fem.solver.sensitivity.adjoint import solve_adjoints
from pvdf_fem.solver.sensitivity.parameters import (
    PLACE_NAMES,
    explain_missing_derivative,
    list_parameters,
    map_probe_keys,
)
from pvdf_fem.solver.sensitivity.rates import compute_rate
from pvdf_fem.solver.solution import Solution
from pvdf_fem.summary import Summary, TabularResult, TextTable, format_with_error

TINY = np.finfo(float).tiny


class Gradients(TabularResult, ValuesByName[dict[str, float]]):
    """Derivatives of charges by key and electrode, in pC per unit of the key.

    Attributes
    ----------
    errors : dict
        Their estimated discretisation errors, absolute, by key and electrode.
    relative_errors : dict
        By key the largest error over the largest derivative, since that of one electrode may vanish
        by cancellation. Where all nearly do, over a thousandth of the largest charge per scale of
        the parameter: the probe's perimeter over 2 pi, a radian, or the parameter's value.
    solution : Solution
        Whose charges are differentiated.
    """

    errors: dict[str, dict[str, float]]
    relative_errors: dict[str, float]
    solution: Solution

    def columns(self) -> dict[str, list[Any]]:
        """By parameter: derivatives of electrode charges in pC per unit of the parameter, with
        errors."""
        found: dict[str, list[Any]] = {"parameter": [*self]}
        for name in self.solution.charges_pC:
            found[name] = [rates[name] for rates in self.values()]
            found[f"{name}_error"] = [errors[name] for errors in self.errors.values()]
        return found

    def summary(self) -> Summary:
        names = [*self.solution.charges_pC]
        heading = [title for name in names for title in (name, "±")]
        rows = tuple(
            (
                key,
                *(cell for n in names for cell in format_with_error(rates[n], self.errors[key][n])),
            )
            for key, rates in self.items()
        )
        about, table = f"pC per unit of {', '.join(self)}", TextTable(("by", *heading), rows)
        return Summary("derivatives of total charges", [about], tables=[table])


def gradients(
    solution: Solution | SceneLike,
    parameters: Sequence[str] | None = None,
    *,
    tolerance: float | None = None,
) -> Gradients:
    """Charge derivatives with respect to scene parameters, with estimated errors.

    Parameters
    ----------
    solution : Solution, Scene, or what `solve` takes for a scene
        A converged one, or a scene that is solved first.
    parameters : sequence of str, optional
        Keys of the scene file as in `Scene.with_`, by default all of `list_parameters` the scene.
    tolerance : float, optional
        Largest of the `Gradients.relative_errors` wanted. Where the solution's mesh leaves larger
        ones, the scene is solved again to smaller errors of its charges. By default the derivatives
        belong to the solution, whatever their errors.

    Returns
    -------
    Gradients
        A dict: for each key the derivatives by electrode, in pC per unit of the key, which is pC/mm
        for ``probe.x_mm``.

    Raises
    ------
    NotConvergedError
        When the solution is not converged, or no mesh meets the tolerance.
    ValueError
        For a key that is not among `list_parameters` the scene, and for a tolerance out of range or
        of a solution on a mesh that was given.

    Examples
    --------
    >>> rates = gradients(solve(Scene.example("triangle")))
    >>> rates["probe.x_mm"]["A"], rates.errors["probe.x_mm"]["A"]
    """
    problem = _resolve_problem(solution)
    known = list_parameters(problem)
    requested = known if parameters is None else coerce("parameters", parameters, Names)
    for key in requested:
        if key not in known:
            reason = f"{explain_missing_derivative(problem, key)}; {suggest(key, known)}"
            raise ValueError(format_error("parameters", key, reason))
    if tolerance is not None:
        tolerance = coerce("tolerance", tolerance, float, (1e-9, 1.0))
        if isinstance(solution, Solution) and solution.stop is Stop.GIVEN_MESH:
            reason = "would leave the mesh that was given; give the scene instead, or no tolerance"
            raise ValueError(f"tolerance = {tolerance:g}: {reason}")
    if not isinstance(solution, Solution):
        solution = solve_problem(problem)
    derivatives = _differentiate(solution, requested)
    if tolerance is None:
        return derivatives
    while max(derivatives.relative_errors.values(), default=0.0) > tolerance:
        finer = _solve_finer(derivatives, tolerance)
        derivatives = _differentiate(finer, requested)
    return derivatives


def _resolve_problem(solution: Solution | SceneLike) -> Problem:
    """Return the problem of a solution, or resolve a scene."""
    if isinstance(solution, Solution):
        return solution.problem
    return Problem.from_scene(as_scene(solution))


def _solve_finer(derivatives: Gradients, tolerance: float, least: float = 2e-8) -> Solution:
    """Solve to finer charges, not below `least`; errors of derivatives fall as theirs do."""
    errors = derivatives.relative_errors
    worst, key = max((error, key) for key, error in errors.items())
    problem = derivatives.solution.problem
    scene = problem.scene
    aim = 0.5 * tolerance / worst * scene.numerics.tolerance
    reason = "rounding allows no better mesh"
    if aim > least:
        # the tolerance must not choose anew whether the film bends or feels voltages
        choices = {
            "film.bending": problem.film.bends,
            "film.coupling": not problem.has_passive_electrodes,
            "numerics.tolerance": aim,
        }
        finer_problem = Problem.from_scene(scene.with_(choices), pressure=problem.pressure)
        finer = solve_problem(finer_problem)
        if finer.status is Status.CONVERGED:
            return finer
        reason = f"with charges to {aim:.1e}: {finer.reason}"
    raise NotConvergedError(
        f"{Status.TOLERANCE}: derivatives by {key} have errors of {worst:.1e}; raise"
        f" tolerance = {tolerance:g} ({reason})"
    )


def _differentiate(
    solution: Solution,
    requested: Sequence[str],
    *,
    least_share: float = 0.5,
    saturation: float = 1.5,
    negligible: float = 1e-3,
) -> Gradients:
    """Differentiate the solution's charges, with the changes at the next order as errors.

    All derivatives share the displacement's error, and a single error may vanish by chance. An
    error over its `unit` counts as at least `least_share` times the mean of its electrode, and
    times the overall mean. The true error is up to `saturation` times the change at the next
    order, which is least effective at corners. A derivative counts at least as the part
    `negligible` of its unit.
    """
    problem = solution.problem
    scene = problem.scene
    keys = list_parameters(problem)
    adjoint, rich_adjoint = solve_adjoints(solution)
    rates = np.array([compute_rate(adjoint, key) for key in keys])
    better_rates = np.array([compute_rate(rich_adjoint, key) for key in keys])
    errors = np.abs(better_rates - rates)

    d = np.abs([scene.film.d31, scene.film.d32])
    magnitudes = np.abs(adjoint.stress_integrals) @ d
    scales = np.array([[_find_scale(scene, key)] for key in keys])
    unit = magnitudes / scales
    relative = np.divide(errors, unit, out=np.zeros_like(errors), where=unit > 0.0)
    means = relative.sum(axis=0) / max(len(keys), 1)
    overall_mean = means @ magnitudes / max(magnitudes.sum(), TINY)
    floors = least_share * np.maximum(means, overall_mean)
    errors = saturation * problem.film.mesh_policy.saturation * np.maximum(errors, floors * unit)
    largest = np.maximum(np.abs(rates), negligible * unit).max(axis=1, initial=TINY)

    names = [electrode.name for electrode in scene.electrode_list]
    derivatives = Gradients()
    derivatives.errors = {}
    derivatives.relative_errors = {}
    derivatives.solution = solution
    for key in requested:
        row = keys.index(key)
        derivatives[key] = dict(zip(names, (1e12 * rates[row]).tolist(), strict=True))
        derivatives.errors[key] = dict(zip(names, (1e12 * errors[row]).tolist(), strict=True))
        derivatives.relative_errors[key] = float(errors[row].max() / largest[row])
    return derivatives


def _find_scale(scene: Scene, key: str) -> float:
    """Return a relevant change of a parameter, in the key's unit."""
    numbers = map_probe_keys(scene).get(key)
    if numbers and key.endswith(PLACE_NAMES):
        probe = numbers[0].probe.probe
        if key.endswith("rotation_deg"):
            return float(np.degrees(1.0)) if probe.period_deg else np.inf
        return 1e3 * probe.outline.perimeter / (2.0 * np.pi)
    if numbers and "_N" in key:
        return float(np.linalg.norm(numbers[0].probe.load.components)) or 1.0
    return abs(get_number(scene, key)) or 1.0

"""Gradients: derivatives of charges with respect to keys of probes, loads and film, with errors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pvdf_fem.arrays import Array
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
#: Relative errors refer to a derivative, or to this fraction of the charge divided by the scale of
#: the parameter if the derivative is smaller.
NEGLIGIBLE_FRACTION = 1e-3


class Gradients(TabularResult, ValuesByName[dict[str, float]]):
    """Derivatives of total charges: a dict by key of dicts by electrode, in pC per unit of the key.

    Attributes
    ----------
    errors : dict of dict of float
        Estimated absolute discretisation errors, by key and electrode, in the same units.
    relative_errors : dict of float
        For each key the largest error of any electrode divided by the largest derivative of any
        electrode. If all derivatives nearly vanish, the divisor is a thousandth of the largest
        charge divided by the scale of the parameter. This scale is the perimeter of the probe
        divided by 2 pi for a position, a radian for an angle, the magnitude of the force for its
        components, and otherwise the value of the parameter.
    solution : Solution
        The solution whose charges are differentiated, which may be on a finer mesh than the one
        that was given.
    """

    errors: dict[str, dict[str, float]]
    relative_errors: dict[str, float]
    solution: Solution

    def columns(self) -> dict[str, list[Any]]:
        """Return columns of a table with a row for each parameter.

        They are the parameters, and for each electrode the derivatives and their errors.
        """
        columns: dict[str, list[Any]] = {"parameter": list(self)}
        for name in self.solution.charges_pC:
            columns[name] = [derivatives[name] for derivatives in self.values()]
            columns[f"{name}_error"] = [errors[name] for errors in self.errors.values()]
        return columns

    def summary(self) -> Summary:
        """Return the content that `print` and notebooks show."""
        names = list(self.solution.charges_pC)
        heading = ["by"]
        for name in names:
            heading += [name, "±"]
        rows = []
        for key, derivatives in self.items():
            row = [key]
            for name in names:
                row += format_with_error(derivatives[name], self.errors[key][name])
            rows.append(tuple(row))
        units = f"pC per unit of {', '.join(self)}"
        table = TextTable(tuple(heading), tuple(rows))
        return Summary("derivatives of total charges", [units], tables=[table])


def gradients(
    solution: Solution | SceneLike,
    parameters: Sequence[str] | None = None,
    *,
    tolerance: float | None = None,
) -> Gradients:
    """Compute derivatives of total charges with respect to keys of a scene, with errors.

    Parameters
    ----------
    solution : Solution, or what `solve` takes for a scene
        A converged solution, or a scene, which is solved first.
    parameters : sequence of str, optional
        Keys of the scene file as in `Scene.with_`; by default all keys with derivatives.
    tolerance : float, optional
        Maximum of the `Gradients.relative_errors`. If they are larger, the scene is solved again,
        more accurately, until they are not. By default the given solution is differentiated,
        however large the errors are.

    Returns
    -------
    Gradients
        A dict with a dict of derivatives by electrode for each key, in pC per unit of the key, such
        as pC/mm for ``probe.x_mm``.

    Raises
    ------
    NotConvergedError
        If the solution has not converged, or if no mesh meets the tolerance.
    ValueError
        If charges have no derivative with respect to a key, if the tolerance is out of range, or if
        there is a tolerance but the solution is on a mesh that was given.

    Examples
    --------
    >>> derivatives = gradients(solve(Scene.example("triangle")))
    >>> derivatives["probe.x_mm"]["A"], derivatives.errors["probe.x_mm"]["A"]
    """
    problem = _resolve_problem(solution)
    requested = _validate_requested_keys(problem, parameters)
    if tolerance is not None:
        tolerance = coerce("tolerance", tolerance, float, (1e-9, 1.0))
        if isinstance(solution, Solution) and solution.stop is Stop.GIVEN_MESH:
            reason = "may require another mesh than the one given; give the scene, or no tolerance"
            raise ValueError(format_error("tolerance", tolerance, reason))
    if not isinstance(solution, Solution):
        solution = solve_problem(problem)
    derivatives = _compute_charge_gradients(solution, requested)
    if tolerance is None:
        return derivatives
    while max(derivatives.relative_errors.values(), default=0.0) > tolerance:
        finer = _solve_with_smaller_tolerance(derivatives, tolerance)
        derivatives = _compute_charge_gradients(finer, requested)
    return derivatives


def _validate_requested_keys(problem: Problem, parameters: Sequence[str] | None) -> Sequence[str]:
    """Return the requested keys, by default all keys with derivatives.

    A ValueError is raised for a requested key without a derivative.
    """
    differentiable = list_parameters(problem)
    if parameters is None:
        return differentiable
    requested = coerce("parameters", parameters, Names)
    for key in requested:
        if key not in differentiable:
            missing = explain_missing_derivative(problem, key)
            reason = f"{missing}; {suggest(key, differentiable)}"
            raise ValueError(format_error("parameters", key, reason))
    return requested


def _resolve_problem(solution: Solution | SceneLike) -> Problem:
    """Return the problem of a solution, or make that of a scene."""
    if isinstance(solution, Solution):
        return solution.problem
    return Problem.from_scene(as_scene(solution))


def _solve_with_smaller_tolerance(
    derivatives: Gradients, tolerance: float, *, min_charge_tolerance: float = 2e-8
) -> Solution:
    """Solve a scene again with a smaller tolerance of its charges.

    The tolerance is chosen as if the errors of the derivatives were proportional to it.

    Parameters
    ----------
    derivatives : Gradients
        Derivatives whose errors are too large, with the solution that they are from.
    tolerance : float
        Maximum relative error of the derivatives.
    min_charge_tolerance : float, optional
        Smallest tolerance of charges that round-off permits.

    Returns
    -------
    Solution
        A converged solution.

    Raises
    ------
    NotConvergedError
        If the new tolerance is below `min_charge_tolerance`, or if the solve does not reach it.
    """
    errors = derivatives.relative_errors
    worst, key = max((error, key) for key, error in errors.items())
    problem = derivatives.solution.problem
    scene = problem.scene
    charge_tolerance = 0.5 * tolerance / worst * scene.numerics.tolerance
    reason = "rounding allows no better mesh"
    if charge_tolerance > min_charge_tolerance:
        # with a smaller tolerance, the problem might include bending or coupling: fix both choices
        choices = {
            "film.bending": problem.film.bends,
            "film.coupling": not problem.has_passive_electrodes,
            "numerics.tolerance": charge_tolerance,
        }
        finer_problem = Problem.from_scene(scene.with_(choices), pressure=problem.pressure)
        finer = solve_problem(finer_problem)
        if finer.status is Status.CONVERGED:
            return finer
        reason = f"with charges to {charge_tolerance:.1e}: {finer.reason}"
    raise NotConvergedError(
        f"{Status.TOLERANCE}: derivatives with respect to {key} have errors of {worst:.1e}; raise"
        f" tolerance = {tolerance:g} ({reason})"
    )


def _compute_charge_gradients(solution: Solution, requested: Sequence[str]) -> Gradients:
    """Compute the derivatives of the charges of a solution, and their errors.

    Parameters
    ----------
    solution : Solution
        A converged solution.
    requested : sequence of str
        Keys of the result. All keys are differentiated, since errors depend on their mean.
    """
    problem = solution.problem
    scene = problem.scene
    keys = list_parameters(problem)
    adjoint, rich_adjoint = solve_adjoints(solution)
    rates = np.array([compute_rate(adjoint, key) for key in keys])
    better_rates = np.array([compute_rate(rich_adjoint, key) for key in keys])

    coefficients = np.abs([scene.film.d31, scene.film.d32])
    magnitudes = np.abs(adjoint.stress_integrals) @ coefficients
    scales = np.array([[_find_parameter_scale(scene, key)] for key in keys])
    units = magnitudes / scales
    changes = np.abs(better_rates - rates)
    # the next order has errors as well, so that an error may exceed the change
    saturation = problem.film.mesh_policy.saturation
    errors = saturation * _estimate_errors(changes, units, magnitudes=magnitudes)
    largest = np.maximum(np.abs(rates), NEGLIGIBLE_FRACTION * units).max(axis=1, initial=TINY)

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


def _estimate_errors(
    changes: Array,
    units: Array,
    *,
    magnitudes: Array,
    min_fraction: float = 0.5,
    saturation: float = 1.5,
) -> Array:
    """Estimate the errors of derivatives from their changes in elements of the next order.

    All derivatives have errors from the same displacement, and a single change may vanish by
    chance. A relative change is therefore at least a fraction of the mean over the keys for its
    electrode, and of the mean over all electrodes, weighted by their charges.

    Parameters
    ----------
    changes : ndarray, shape (keys, electrodes)
        Absolute changes in C per unit of the key.
    units : ndarray, shape (keys, electrodes)
        Magnitude of each charge divided by the scale of the parameter; relative changes are changes
        divided by these.
    magnitudes : ndarray, shape (electrodes,)
        |d31 X| + |d32 Y| of the charges in C.
    min_fraction : float, optional
        The minimum relative change, as a fraction of the larger mean.
    saturation : float, optional
        Factor from changes to errors: the error of the next order is not zero, at worst at corners.

    Returns
    -------
    ndarray, shape (keys, electrodes)
        Errors in C per unit of the key.
    """
    relative = np.divide(changes, units, out=np.zeros_like(changes), where=units > 0.0)
    means = relative.sum(axis=0) / max(len(changes), 1)
    overall_mean = means @ magnitudes / max(magnitudes.sum(), TINY)
    min_relative = min_fraction * np.maximum(means, overall_mean)
    return np.asarray(saturation * np.maximum(changes, min_relative * units))


def _find_parameter_scale(scene: Scene, key: str) -> float:
    """Return the scale of a parameter in the key's unit, as `Gradients` defines it.

    It is infinite for the angle of a disc, and 1 for a parameter that is zero.
    """
    keys_of_probes = map_probe_keys(scene)
    if key in keys_of_probes:
        loaded_probe = keys_of_probes[key][0].probe
        probe = loaded_probe.probe
        if key.endswith("rotation_deg"):
            return float(np.degrees(1.0)) if probe.period_deg else np.inf
        if key.endswith(PLACE_NAMES):
            return 1e3 * probe.outline.perimeter / (2.0 * np.pi)
        if "_N" in key:
            force = float(np.linalg.norm(loaded_probe.load.components))
            return force if force else 1.0
    value = abs(get_number(scene, key))
    return value if value else 1.0

"""Standard deviations of charges due to uncertain numbers of a scene, to first order.

The standard deviation of a charge Q is the square root of the sum of (∂Q/∂θ σ)² over the uncertain
numbers θ with standard deviations σ, which are assumed to be independent (JCGM 100:2008, 5.1.2).
Both numbers of a pair, such as two moduli, are assumed to be fully correlated.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.unloaded import compute_uniform_integrals
from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.arguments import SceneLike, as_scene
from pvdf_fem.scene.changes import get_number, normalize_key
from pvdf_fem.scene.readout import resolve_deviation
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import SceneError, format_error
from pvdf_fem.solver.adaptive import solve_outputs, solve_problem
from pvdf_fem.solver.estimate.next_order import FactorisedSolution, factorise_tangent
from pvdf_fem.solver.sensitivity.adjoint import Adjoint
from pvdf_fem.solver.sensitivity.parameters import (
    COEFFICIENTS,
    PRETENSION,
    expand_pair_key,
    explain_missing_derivative,
    list_parameters,
    prescribe_pretension,
)
from pvdf_fem.solver.sensitivity.rates import change_number, compute_rate
from pvdf_fem.solver.solution import Solution
from pvdf_fem.summary import Result, Summary, TextTable, format_charges, format_with_error

#: Relative step of the differences of the charges of a uniformly stressed, unloaded film.
STEP = 1e-4


@dataclass(frozen=True, eq=False, repr=False)
class Uncertainty(Result):
    """Standard deviations of charges, and the contributions of the uncertain numbers to them."""

    solution: Solution  #: The solution with the charges.
    #: Standard deviations of the uncertain numbers by key, in the unit of the key; of a pair their
    #: mean.
    deviations: dict[str, float]
    #: Standard deviation of each total charge in pC due to one number, by key and electrode.
    parts_pC: dict[str, dict[str, float]]
    #: Standard deviation in pC, due to one number, of the change of each charge under the load, by
    #: key and electrode.
    change_parts_pC: dict[str, dict[str, float]]

    @property
    def charges_pC(self) -> dict[str, float]:
        """Standard deviation of each total charge in pC, by electrode."""
        return _combine_uncertainty_parts(self.parts_pC)

    @property
    def charge_changes_pC(self) -> dict[str, float]:
        """Standard deviation in pC of the change of each charge due to the load, by electrode."""
        return _combine_uncertainty_parts(self.change_parts_pC)

    def shares(self) -> dict[str, dict[str, float]]:
        """Return the fraction of the variance of each total charge due to each number.

        Fractions are given by key and electrode; they are 0 for a charge without variance.
        """
        deviations = self.charges_pC
        shares: dict[str, dict[str, float]] = {}
        for key, parts in self.parts_pC.items():
            shares[key] = {}
            for name, deviation in deviations.items():
                shares[key][name] = (parts[name] / deviation) ** 2 if deviation else 0.0
        return shares

    def to_json(self) -> dict[str, Any]:
        """Return the values that `pvdf-fem solve --json` prints as ``uncertainty``."""
        return {
            "deviations": self.deviations,
            "charge_deviations_pC": self.charges_pC,
            "charge_change_deviations_pC": self.charge_changes_pC,
            "shares": self.shares(),
        }

    @property
    def table(self) -> TextTable:
        """Table of charges and changes with standard deviations, and `shares` in percent."""
        heading = ["charges, uncertain values", "total, pC", "± pC", "change by load, pC", "± pC"]
        charges = self.charges_pC
        changes = self.charge_changes_pC
        shares = self.shares()
        rows = []
        for name, charge in self.solution.charges_pC.items():
            change = self.solution.charge_changes_pC[name]
            row = [name]
            row += format_with_error(charge, charges[name])
            row += format_with_error(change, changes[name])
            row += [f"{100.0 * of_key[name]:.0f} %" for of_key in shares.values()]
            rows.append(tuple(row))
        return TextTable((*heading, *self.deviations), tuple(rows))

    def summary(self) -> Summary:
        """Return the content that `print` and notebooks show."""
        sentence = f"standard deviations of total charges, {format_charges(self.charges_pC)}"
        notes = []
        for key, deviation in self.deviations.items():
            notes.append(f"uncertain: {key} ± {deviation:.4g}")
        return Summary("uncertain", [sentence], tables=[self.table], notes=notes)


@dataclass(frozen=True)
class ResolvedUncertainty:
    """Uncertain numbers, resolved to keys with respect to which charges are differentiated."""

    #: The problem whose charges are differentiated. If the pretension of a cooled film is
    #: uncertain, the film has this pretension instead of its temperature change.
    problem: Problem
    #: Standard deviations by uncertain key, then by differentiable key: one, or two for a pair.
    deviations: dict[str, dict[str, float]]


def uncertainty(
    solution: Solution | SceneLike, uncertain: Mapping[str, float | str] | None = None
) -> Uncertainty:
    """Compute the standard deviations of the charges of a scene with uncertain numbers.

    Parameters
    ----------
    solution : Solution, Scene, or what `solve` takes for a scene
        A converged solution, or a scene, which is solved first.
    uncertain : mapping, optional
        Standard deviations by key, in the unit of the key or relative to the value, such as
        ``{"film.thickness_um": "5 %"}``; by default those in the scene. Keys are those of
        `gradients`, and keys of pairs. A cooled film may also have an uncertain
        ``film.pretension_N_m``, which is then held constant for the other keys.

    Returns
    -------
    Uncertainty
        Standard deviations of total charges and of their changes by the load.

    Raises
    ------
    SceneError
        If there are no uncertain numbers, or if charges have no derivative with respect to a key.
        This is checked before any solve.
    NotConvergedError
        If the solution, or the solve of the unloaded film, has not converged.

    Examples
    --------
    >>> found = uncertainty(Scene.example("triangle"), {"film.thickness_um": "5 %"})
    >>> found.charges_pC["A"]
    """
    scene = with_uncertain_numbers(solution, uncertain)
    pressure = solution.pressure if isinstance(solution, Solution) else None
    problem = Problem.from_scene(scene, pressure=pressure)
    resolved = resolve_uncertainty(problem)
    if not isinstance(solution, Solution):
        solution = solve_problem(problem)

    differentiated = resolved.problem
    equilibrium, q, factors = factorise_tangent(solution.discrete)
    at = FactorisedSolution(equilibrium.of_problem(differentiated), q, factors)
    adjoint = Adjoint.of_solution(at, differentiated.outputs)
    unloaded = _solve_unloaded_adjoint(differentiated)
    names = [electrode.name for electrode in scene.electrode_list]

    parts: dict[str, dict[str, float]] = {}
    change_parts: dict[str, dict[str, float]] = {}
    mean_deviations: dict[str, float] = {}
    for key, deviations in resolved.deviations.items():
        part = np.zeros(len(names))
        unloaded_part = np.zeros(len(names))
        for number, deviation in deviations.items():
            part += deviation * compute_rate(adjoint, number)
            unloaded_rate = _differentiate_unloaded_charges(differentiated, unloaded, number)
            unloaded_part += deviation * unloaded_rate
        parts[key] = _name_magnitudes_pC(names, part)
        change_parts[key] = _name_magnitudes_pC(names, part - unloaded_part)
        mean_deviations[key] = float(np.mean([*deviations.values()]))
    return Uncertainty(solution, mean_deviations, parts_pC=parts, change_parts_pC=change_parts)


def _name_magnitudes_pC(names: list[str], charges: Array) -> dict[str, float]:
    """Return the absolute values in pC of charges in C, by the name of the electrode."""
    magnitudes = np.abs(1e12 * charges)
    return dict(zip(names, magnitudes.tolist(), strict=True))


def with_uncertain_numbers(
    scene_like: Solution | SceneLike, uncertain: Mapping[str, float | str] | None
) -> Scene:
    """Return a scene with other uncertain numbers, or unchanged if `uncertain` is None."""
    scene = as_scene(scene_like)
    if uncertain is None:
        return scene
    return scene.with_(uncertain=None).with_(uncertain=uncertain)


def require_differentiable(problem: Problem) -> None:
    """Raise `SceneError` if charges have no derivative with respect to an uncertain key."""
    if problem.scene.uncertain:
        resolve_uncertainty(problem)


def resolve_uncertainty(problem: Problem) -> ResolvedUncertainty:
    """Find differentiable keys and absolute standard deviations of a scene's uncertain numbers.

    Parameters
    ----------
    problem : Problem
        The problem of a scene with uncertain numbers.

    Returns
    -------
    ResolvedUncertainty
        Standard deviations in the units of the keys, and the problem that has these keys.

    Raises
    ------
    SceneError
        If there are no uncertain numbers, or if charges have no derivative with respect to one.
    """
    uncertain = problem.scene.uncertain
    if not uncertain:
        raise SceneError(["uncertain: is required; give keys with their standard deviations"])
    values = {normalize_key(key): value for key, value in uncertain.items()}
    if PRETENSION in values:
        problem = problem.with_scene(_replace_cooling_by_pretension(problem.scene))
    known = list_parameters(problem)
    deviations: dict[str, dict[str, float]] = {}
    errors = []
    for key, value in values.items():
        deviations[key] = {}
        for number in expand_pair_key(key, known):
            number_value = get_number(problem.scene, number)
            deviations[key][number] = resolve_deviation(value, number_value)
        if not deviations[key]:
            reason = f"{explain_missing_derivative(problem, key)}; give some of {', '.join(known)}"
            errors.append(format_error(f"uncertain.{key}", value, reason))
    if errors:
        raise SceneError(errors)
    return ResolvedUncertainty(problem, deviations)


def _replace_cooling_by_pretension(scene: Scene) -> Scene:
    """Return a copy of the scene with a prescribed pretension instead of a cooling.

    `SceneError` is raised if a cooled film has patches or warms, since its pretension is then not
    uniform.
    """
    film = scene.film
    if film.pretension_N_m is None and (film.layers or film.warming_K):
        reason = (
            "a cooled film with patches or warming_K has no uniform pretension; give"
            " film.temperature_change_K instead"
        )
        raise SceneError([format_error(f"uncertain.{PRETENSION}", scene.uncertain, reason)])
    return prescribe_pretension(scene)


def _solve_unloaded_adjoint(problem: Problem) -> Adjoint | None:
    """Solve the unloaded film and its adjoint equations; None if it needs no solve."""
    if problem.unloaded is None:
        return None
    solution = solve_outputs(problem.unloaded)
    return Adjoint.of_solution(factorise_tangent(solution.discrete), problem.unloaded.outputs)


def _differentiate_unloaded_charges(problem: Problem, unloaded: Adjoint | None, key: str) -> Array:
    """Compute derivatives of the charges of the unloaded film with respect to one key.

    They are zero for all keys outside of [film]. If the unloaded film needed no solve (`unloaded`
    is None), they come from its closed-form charges: exactly for d31 and d32, and by central
    differences for other keys.

    Parameters
    ----------
    problem : Problem
        The problem of the loaded film.
    unloaded : Adjoint or None
        Adjoint solutions of the unloaded film; None if it needs no solve.
    key : str
        The key.

    Returns
    -------
    ndarray, shape (outputs,)
        Derivatives in C per unit of the key.
    """
    zeros = np.zeros(len(problem.outputs))
    if not key.startswith("film."):
        return zeros
    if unloaded is not None:
        return compute_rate(unloaded, key, with_heat=False)
    if key in COEFFICIENTS:
        integrals = compute_uniform_integrals(problem)
        assert integrals is not None
        # d31 and d32 of the scene are in pC/N
        return 1e-12 * integrals.values[:, COEFFICIENTS.index(key)]
    change = STEP * (abs(get_number(problem.scene, key)) or 1.0)
    d = (problem.scene.film.d31, problem.scene.film.d32)
    charges = []
    for sign in (1.0, -1.0):
        scene = change_number(problem.unloaded_scene, key, sign * change)
        integrals = compute_uniform_integrals(Problem.from_scene(scene))
        charges.append(zeros if integrals is None else integrals.charges(d))
    high, low = charges
    return (high - low) / (2.0 * change)


def _combine_uncertainty_parts(parts: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
    """Return the square root of the sum of squares over the keys, by electrode."""
    names = next(iter(parts.values()))
    deviations = {}
    for name in names:
        by_key = [of_key[name] for of_key in parts.values()]
        deviations[name] = float(np.linalg.norm(by_key))
    return deviations

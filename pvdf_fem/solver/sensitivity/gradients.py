"""Derivatives of every charge with respect to the probe's place, the force and the film,
with their errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pvdf_fem.film.models import resolve_film_model
from pvdf_fem.scene.arguments import Names, SceneLike, ValuesByName, as_scene, coerce
from pvdf_fem.scene.changes import get_number
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import format_error, suggest
from pvdf_fem.solver.adaptive import solve
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
    scene = as_scene(solution)
    pressure = solution.pressure if isinstance(solution, Solution) else None
    known = list_parameters(scene, pressure)
    wanted = known if parameters is None else coerce("parameters", parameters, Names)
    for key in wanted:
        if key not in known:
            reason = explain_missing_derivative(scene, key, pressure)
            reason = f"{reason}; {suggest(key, known)}"
            raise ValueError(format_error("parameters", key, reason))
    if tolerance is not None:
        tolerance = coerce("tolerance", tolerance, float, (1e-9, 1.0))
    if tolerance and isinstance(solution, Solution) and solution.stop is Stop.GIVEN_MESH:
        reason = "would leave the mesh that was given; give the scene instead, or no tolerance"
        raise ValueError(f"tolerance = {tolerance:g}: {reason}")
    found = _gradients_of(solution if isinstance(solution, Solution) else solve(scene), wanted)
    while tolerance and max(found.relative_errors.values(), default=0.0) > tolerance:
        found = _gradients_of(_finer(found, tolerance), wanted)
    return found


def _finer(found: Gradients, tolerance: float, least: float = 2e-8) -> Solution:
    """The solution to finer charges, not below `least`; errors of derivatives fall as theirs do."""
    worst, key = max((error, key) for key, error in found.relative_errors.items())
    scene, reason = found.solution.scene, "rounding allows no better mesh"
    aim = 0.5 * tolerance / worst * scene.numerics.tolerance
    if aim > least:
        # the tolerance must not choose anew whether the film bends or feels voltages
        model = resolve_film_model(scene)
        chosen = {"film.bending": model.bends, "film.coupling": bool(model.floating)}
        finer_scene = scene.with_(**chosen, **{"numerics.tolerance": aim})
        finer = solve(finer_scene, pressure=found.solution.pressure)
        if finer.status is Status.CONVERGED:
            return finer
        reason = f"with charges to {aim:.1e}: {finer.reason}"
    raise NotConvergedError(
        f"{Status.TOLERANCE}: derivatives by {key} have errors of {worst:.1e}; raise"
        f" tolerance = {tolerance:g} ({reason})"
    )


def _gradients_of(
    solution: Solution,
    wanted: Sequence[str],
    chance: float = 0.5,
    saturation: float = 1.5,
    negligible: float = 1e-3,
) -> Gradients:
    """Derivatives of the solution's charges, with changes at the next order as errors.

    The derivatives share the displacement's error, so a tiny error is chance: an error over its
    `unit` counts as at least `chance` times the mean of its electrode, and times the overall mean.
    The true error is up to `saturation` times the change at the next order, least effective at
    corners. A derivative counts at least as the part `negligible` of its unit.
    """
    scene, keys = solution.scene, list_parameters(solution.scene, solution.pressure)
    adjoint, rich = solve_adjoints(solution)
    rates, better = (np.array([compute_rate(of, key) for key in keys]) for of in (adjoint, rich))
    errors = np.abs(better - rates)
    sizes = np.abs(adjoint.forces) @ np.abs([scene.film.d31, scene.film.d32])
    unit = sizes / np.array([[_scale(scene, key)] for key in keys])
    relative = np.divide(errors, unit, out=np.zeros_like(errors), where=unit > 0.0)
    means = relative.sum(axis=0) / max(len(keys), 1)
    floors = chance * np.maximum(means, means @ sizes / max(sizes.sum(), TINY))
    errors = saturation * resolve_film_model(scene).saturation * np.maximum(errors, floors * unit)
    largest = np.maximum(np.abs(rates), negligible * unit).max(axis=1, initial=TINY)
    names = [electrode.name for electrode in scene.electrode_list]
    found = Gradients()
    found.errors, found.relative_errors, found.solution = {}, {}, solution
    for key in wanted:
        row = keys.index(key)
        for values, table in ((rates, found), (errors, found.errors)):
            table[key] = dict(zip(names, (1e12 * values[row]).tolist(), strict=True))
        found.relative_errors[key] = float(errors[row].max() / largest[row])
    return found


def _scale(scene: Scene, key: str) -> float:
    """A relevant change of a parameter, in the key's unit."""
    touches = map_probe_keys(scene).get(key)
    if touches and key.endswith(PLACE_NAMES):
        probe = touches[0][0].probe
        if key.endswith("rotation_deg"):
            return float(np.degrees(1.0)) if probe.period_deg else np.inf
        return 1e3 * probe.outline.perimeter / (2.0 * np.pi)
    if touches and "_N" in key:
        return float(np.linalg.norm(touches[0][0].load.components)) or 1.0
    return abs(get_number(scene, key)) or 1.0

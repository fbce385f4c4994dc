"""What uncertain numbers of a scene make of its charges, to first order by the adjoint.

The deviation of a charge Q is the root of the sum of (∂Q/∂θ σ)² over the uncertain numbers θ, which
are taken as independent (JCGM 100:2008, 5.1.2). Both numbers of a pair, such as two moduli, are off
by the same share.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from skfem import MeshTri2

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.outputs import make_outputs
from pvdf_fem.electrodes.unloaded import find_uniform_integrals, unload
from pvdf_fem.film.loads.load_spec import Pressure
from pvdf_fem.scene.arguments import SceneLike, as_scene
from pvdf_fem.scene.changes import get_number, normalize_key
from pvdf_fem.scene.readout import resolve_deviation
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import SceneError, format_error
from pvdf_fem.solver.adaptive import solve as solve_certain
from pvdf_fem.solver.first_sizes import ORDER
from pvdf_fem.solver.next_order import factorise_tangent
from pvdf_fem.solver.nonlinear.budget import Budget
from pvdf_fem.solver.nonlinear.status import NotConvergedError, Status
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


@dataclass(frozen=True, eq=False, repr=False)
class Uncertainty(Result):
    """Standard deviations of charges, and what each uncertain number has part in them."""

    solution: Solution
    deviations: dict[str, float]  #: Of the numbers, by key and in its unit.
    #: Change of each charge by one deviation of a number, in pC, by key and electrode.
    parts_pC: dict[str, dict[str, float]]
    #: The same for the changes of charge by the touch.
    change_parts_pC: dict[str, dict[str, float]]

    @property
    def charges_pC(self) -> dict[str, float]:
        """Standard deviation of each charge, in total."""
        return _joined(self.parts_pC)

    @property
    def charge_changes_pC(self) -> dict[str, float]:
        """Standard deviation of each change of a charge by the touch."""
        return _joined(self.change_parts_pC)

    def shares(self) -> dict[str, dict[str, float]]:
        """Share of each number in the variance of each charge, by key and electrode."""
        whole = self.charges_pC
        return {
            key: {name: (of[name] / whole[name]) ** 2 if whole[name] else 0.0 for name in whole}
            for key, of in self.parts_pC.items()
        }

    def to_json(self) -> dict[str, Any]:
        """What `pvdf-fem solve --json` has as ``uncertainty``."""
        return {
            "deviations": self.deviations,
            "charge_deviations_pC": self.charges_pC,
            "charge_change_deviations_pC": self.charge_changes_pC,
            "shares": self.shares(),
        }

    @property
    def table(self) -> TextTable:
        """Charges and changes with their deviations, and the shares in percent."""
        totals, changes = self.charges_pC, self.charge_changes_pC
        values, rows = self.solution.charge_changes_pC, []
        for name, total in self.solution.charges_pC.items():
            shares = (f"{100.0 * of[name]:.0f} %" for of in self.shares().values())
            cells = (
                *format_with_error(total, totals[name]),
                *format_with_error(values[name], changes[name]),
            )
            rows.append((name, *cells, *shares))
        columns = "total, pC", "± pC", "change by touch, pC", "± pC", *self.deviations
        return TextTable(("charges, uncertain values", *columns), tuple(rows))

    def summary(self) -> Summary:
        told = [f"uncertain: {key} ± {value:.4g}" for key, value in self.deviations.items()]
        found = f"standard deviations of total charges, {format_charges(self.charges_pC)}"
        return Summary("uncertain", [found], tables=[self.table], notes=told)


def uncertainty(
    solution: Solution | SceneLike, uncertain: Mapping[str, float | str] | None = None
) -> Uncertainty:
    """Standard deviations of the charges of a scene with uncertain numbers.

    Parameters
    ----------
    solution : Solution, Scene, or what `solve` takes for a scene
        A converged one, or a scene that is solved first.
    uncertain : mapping, optional
        Standard deviations by key, in the key's unit or as shares of the value, as
        ``{"film.thickness_um": "5 %"}``; by default the scene's `uncertain`. Keys are those of
        `list_parameters` the scene. A cooled film may have an uncertain ``film.pretension_N_m``;
        other numbers are then uncertain at this pretension.

    Raises
    ------
    SceneError
        For a key that charges have no derivative by, before any solve.
    NotConvergedError
        When the solution is not converged.

    Examples
    --------
    >>> found = uncertainty(Scene.example("triangle"), {"film.thickness_um": "5 %"})
    >>> found.charges_pC["A"]
    """
    scene = with_uncertain(solution, uncertain)
    at, sizes = _judged(scene, solution.pressure if isinstance(solution, Solution) else None)
    if not isinstance(solution, Solution):
        solution = solve_certain(scene)
    solved, q, factors = factorise_tangent(solution.discrete)
    adjoint = Adjoint.of(solved.with_(scene=at), make_outputs(at), q, factors)
    rest = _rest_adjoint(at)
    names = [electrode.name for electrode in at.electrode_list]
    total, change = dict[str, dict[str, float]](), dict[str, dict[str, float]]()
    for key, terms in sizes.items():
        rates = sum((size * compute_rate(adjoint, one) for one, size in terms.items()), np.zeros(1))
        calm = sum((size * _rest_rate(at, rest, one) for one, size in terms.items()), np.zeros(1))
        for found, values in ((total, rates), (change, rates - calm)):
            found[key] = dict(zip(names, np.abs(1e12 * values).tolist(), strict=True))
    deviations = {key: float(np.mean([*of.values()])) for key, of in sizes.items()}
    return Uncertainty(solution, deviations, total, change)


def with_uncertain(
    given: Solution | SceneLike, uncertain: Mapping[str, float | str] | None
) -> Scene:
    """A scene with these uncertain numbers, or with its own for None."""
    scene = as_scene(given)
    if uncertain is None:
        return scene
    return scene.with_(uncertain=None).with_(uncertain=uncertain)


def require_differentiable(scene: Scene, pressure: Pressure | None = None) -> None:
    """SceneError for uncertain keys that charges have no derivative by, under a pressure too."""
    if scene.uncertain:
        _judged(scene, pressure)


def _judged(scene: Scene, pressure: Pressure | None) -> tuple[Scene, dict[str, dict[str, float]]]:
    """The scene by whose keys charges are differentiated, and by uncertain key the deviations of
    these; both numbers of a pair deviate together."""
    given = {normalize_key(key): value for key, value in (scene.uncertain or {}).items()}
    if not given:
        raise SceneError(["uncertain = (nothing): give keys with their standard deviations"])
    at = _stretched(scene) if PRETENSION in given else scene
    known, sizes, problems = list_parameters(at, pressure), dict[str, dict[str, float]](), []
    for key, value in given.items():
        keys = expand_pair_key(key, known)
        if not keys:
            reason = (
                f"{explain_missing_derivative(at, key, pressure)}; give some of {', '.join(known)}"
            )
            problems.append(format_error(f"uncertain.{key}", value, reason))
        sizes[key] = {one: resolve_deviation(value, get_number(at, one)) for one in keys}
    if problems:
        raise SceneError(problems)
    return at, sizes


def _stretched(scene: Scene) -> Scene:
    """The scene whose cooled film has its pretension instead of its change of temperature."""
    film = scene.film
    if film.pretension_N_m is None and (film.patches or film.warming_K):
        reason = "is of a film that is cooled with patches or warms; give film.temperature_change_K"
        raise SceneError([format_error(f"uncertain.{PRETENSION}", scene.uncertain, reason)])
    return prescribe_pretension(scene)


def _rest_adjoint(scene: Scene) -> Adjoint | None:
    """The untouched film with the adjoint solutions of its charges; None where it is known."""
    film = unload(scene)
    if find_uniform_integrals(film) is not None:
        return None
    solved, q, factors = factorise_tangent(solve_certain(film).discrete)
    return Adjoint.of(solved, make_outputs(film), q, factors)


def _rest_rate(scene: Scene, rest: Adjoint | None, key: str, step: float = 1e-4) -> Array:
    """Derivative of the charges at rest, in C per unit of a key, (electrodes,)."""
    film = unload(scene)
    if not key.startswith("film."):
        return np.zeros(len(scene.electrode_list))
    if rest is not None:
        return compute_rate(rest, key, with_heat=False)
    if key in COEFFICIENTS:
        forces = find_uniform_integrals(film)
        assert forces is not None
        return 1e-12 * forces.values[:, COEFFICIENTS.index(key)]
    change = step * (abs(get_number(scene, key)) or 1.0)
    ends = [find_uniform_integrals(change_number(film, key, sign * change)) for sign in (1.0, -1.0)]
    d = scene.film.d31, scene.film.d32
    high, low = (np.zeros(len(scene.electrode_list)) if e is None else e.charges(d) for e in ends)
    return (high - low) / (2.0 * change)


def _joined(parts: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
    """The roots of the sums of squares, by electrode."""
    names = next(iter(parts.values()))
    return {name: float(np.linalg.norm([of[name] for of in parts.values()])) for name in names}


def solve(
    scene: SceneLike,
    *,
    mesh: MeshTri2 | str | Path | None = None,
    order: int = ORDER,
    budget: Budget | None = None,
    pressure: Pressure | None = None,
    uncertain: Mapping[str, float | str] | None = None,
) -> Solution:
    """Charges and fields of a scene, and its charges at rest: where these need a solve, it is made
    within the same budget.

    Parameters
    ----------
    scene : Scene, path of its file, dict of its tables, or a result of it
    mesh : MeshTri2 or path, optional
        Solve on this mesh of `mesh_scene`, or in a file that `read_mesh` reads, of the whole film,
        whatever the error, instead of meshing for ``scene.numerics.tolerance``.
    order : int, optional
        Polynomial order of the displacement, 1, 2 or 3.
    budget : Budget, optional
        What the solve may cost, by default what the scene's numerics say.
    pressure : callable, optional
        ``p(x_mm, y_mm)`` for arrays (n,) in the probe's own axes, in place of ``load.profile``: one
        value for each point, or one for all. It is scaled to the scene's force. It is no part of
        the scene: `Solution.pressure` keeps it, and `gradients` of the solution are under it.
    uncertain : mapping, optional
        Standard deviations as for `uncertainty`, ``{"film.thickness_um": "5 %"}``, in place of the
        scene's `uncertain`. With them the solution has the standard deviations of its charges,
        `Solution.uncertainty`.

    Returns
    -------
    Solution
        Its `status` tells whether there is a result; printed, it tells how the solve went.

    Raises
    ------
    MeshFileError, FileError
        For a mesh of another scene; for a file that cannot be read. Both are ValueErrors.
    SceneError
        For a pressure that cannot be used or has no single dead load, and for an uncertain key that
        charges have no derivative by; it is a ValueError, too.

    Examples
    --------
    >>> solution = solve(Scene.example("triangle"))
    >>> print(solution)
    >>> solution.charge_changes_pC["A"]
    """
    scene = with_uncertain(scene, uncertain)
    require_differentiable(scene, pressure)
    solution = solve_certain(scene, mesh=mesh, order=order, budget=budget, pressure=pressure)
    if not scene.uncertain or solution.status is not Status.CONVERGED:
        return solution
    try:
        return replace(solution, uncertainty=uncertainty(solution))
    except NotConvergedError as error:  # of the untouched film
        return replace(solution, warnings=(*solution.warnings, f"uncertain: {error}"))

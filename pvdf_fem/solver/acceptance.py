"""Acceptance of a converged solution as a result, and warnings beyond the limits of the model.

A solution is rejected if the forces do not balance, if a tip touches the rim, if the equilibrium
is unstable, or if wrinkles would change a charge much. It is accepted with a warning if the film
would wrinkle or yield, or if strains or slopes exceed the limits of the model.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse.linalg import SuperLU

from pvdf_fem.arrays import Array, Mask
from pvdf_fem.electrodes.stress_integrals import (
    CANCELLATION_FRACTION,
    StressIntegrals,
    compute_stress_integrals,
)
from pvdf_fem.film.membrane import compute_principal_values
from pvdf_fem.film.term import State
from pvdf_fem.problem.contact_result import select_tips
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solver.discrete_solution import DiscreteSolution
from pvdf_fem.solver.mesh_level import MeshLevel
from pvdf_fem.solver.nonlinear.factors import factorise, has_negative_determinant
from pvdf_fem.solver.nonlinear.stability import is_balanced, is_compressed, may_be_stable
from pvdf_fem.solver.nonlinear.status import Status

#: Strength of biaxially stretched PVDF film in Pa: data sheets give 160 to 220 MPa along either
#: direction.
STRENGTH = 180e6
#: Maximum slope at which the load is modelled well. The film's law is exact at any slope, but here
#: a pressure along z and one normal to the film differ by 1 - cos = 11 %, and the contact area of
#: the probe differs from its projection.
SLOPE_LIMIT = 0.5
#: A tip touches the clamped rim if its contact is closer than this fraction of the film's radius.
RIM_MARGIN = 0.01
#: Maximum relative change of a charge due to wrinkles for a membrane in compression to be accepted.
MAX_WRINKLING_CHANGE = 0.1


def find_rejection_status(
    discrete: DiscreteSolution, factors: SuperLU | None, change: float | None
) -> Status | None:
    """Return the status that rejects a converged solution, or None if it is accepted.

    Parameters
    ----------
    discrete : DiscreteSolution
        The converged solution.
    factors : SuperLU or None
        Factors of a tangent near the solution; None for the flat film, which is always accepted.
    change : float or None
        Largest relative change of a charge if the film could wrinkle; None if this was not
        estimated.

    Returns
    -------
    Status or None
        `Status.UNBALANCED`, `Status.RIM`, `Status.UNSTABLE` or None.
    """
    if factors is None:
        return None
    equilibrium = discrete.solved
    state = discrete.solved_state
    if not is_balanced(
        equilibrium, state, factors, allowed=equilibrium.model.mesh_policy.imbalance
    ):
        return Status.UNBALANCED
    if is_tip_at_rim(discrete):
        return Status.RIM
    if not equilibrium.conservative and has_negative_determinant(factors):
        return Status.UNSTABLE
    # without compression the energy is at a minimum
    if is_compressed(state) and not may_be_stable(equilibrium, factors):
        return Status.UNSTABLE
    if change is not None and change > MAX_WRINKLING_CHANGE:
        return Status.UNSTABLE
    return None


def is_tip_at_rim(discrete: DiscreteSolution) -> bool:
    """Return whether the contact of any tip extends to the clamped rim; False without tips."""
    solved = discrete.solved
    touching = [tip.find_touching_points(discrete.solved_state) for tip in select_tips(solved)]
    points = np.concatenate([np.empty((0, 2)), *touching])
    distances = -solved.film.outline.compute_signed_distances(points)
    return float(distances.min(initial=np.inf)) < RIM_MARGIN * solved.film.radius


def estimate_wrinkling_changes(level: MeshLevel) -> Array | None:
    """Estimate how wrinkles would change the stress integrals of a membrane in compression.

    A membrane in compression is at a saddle point of its energy: on a fine enough mesh it folds,
    and the signs of the pivots of its tangent depend on the mesh. The solution is therefore judged
    by the change to a tension field (a film that wrinkles). It is estimated by a single Newton step
    in the equations of the tension field; on 12 scenes this gave 0.4 to 0.9 of the full change.

    Parameters
    ----------
    level : MeshLevel
        The solve on the last mesh, converged or not.

    Returns
    -------
    ndarray, shape (outputs, 2), or None
        Stress integrals of the tension field minus those of the membrane, in N. None if the solve
        did not converge, if no stress is compressive, if the film model is a plate or a tension
        field, or if the law of the film is nonlinear, for which there is no tension field.
    """
    solved = level.equilibrium
    discrete = level.discrete
    carries_compression = solved.model.bends or solved.model.wrinkles
    if carries_compression or not solved.membrane.law.is_linear:
        return None
    if not level.result.converged or not is_compressed(discrete.solved_state):
        return None
    # `Scene.with_` would validate the scene, but in a sweep it may have no electrodes
    choices = {"bending": False, "compression": "tension-field"}
    film = solved.film.model_copy(update=choices)
    scene = solved.scene.model_copy(update={"film": film})
    wrinkling = solved.of_problem(level.problem.with_scene(scene))
    state = wrinkling.state(discrete.q)
    step = factorise(wrinkling.tangent(state)).solve(wrinkling.residual(state))
    integrals = compute_stress_integrals(
        level.problem.outputs,
        wrinkling.membrane,
        wrinkling.dofs(discrete.q - step),
        sector=solved.sector,
    )
    return integrals - discrete.stress_integrals.values


def list_warnings(equilibrium: Equilibrium, state: State, change: float | None) -> list[str]:
    """List warnings if a solution is beyond the limits of the model.

    Parameters
    ----------
    equilibrium : Equilibrium
        The equations that were solved.
    state : State
        Solution of `equilibrium`.
    change : float or None
        Largest relative change of a charge if the film could wrinkle, which warnings of compression
        mention; None if it was not estimated.

    Returns
    -------
    list of str
        Warnings of compression or wrinkles, with areas, and of stress, strain and slope, with
        maximum values and their positions. Empty if there are none.
    """
    smallest_stress, largest_stress = compute_principal_values(state.stress)
    effect = ""
    if change is not None:
        effect = f"; this would change a charge by up to {change:.1e} of it"
    warnings = []
    for area in equilibrium.model.find_compression(smallest_stress, largest_stress):
        warnings.append(area.text.format(_format_area(equilibrium, area.where)) + effect)
    stress = largest_stress.max()
    if stress > STRENGTH:
        warnings.append(
            f"strength: principal stress up to {1e-6 * stress:.4g} MPa"
            f" at {_format_position(equilibrium, largest_stress)},"
            f" above the film's {1e-6 * STRENGTH:.4g} MPa"
        )
    tensor_strain = state.strain * [1.0, 1.0, 0.5]  # from Voigt notation
    _, largest_strain = compute_principal_values(tensor_strain)
    law = equilibrium.membrane.law
    strain = largest_strain.max()
    if strain > law.strain_limit:
        warnings.append(
            f"strain: up to {strain:.3g} at {_format_position(equilibrium, largest_strain)},"
            f" where the film {law.beyond_limit} (above {law.strain_limit:g})"
        )
    slopes = np.hypot(state.deformation_gradient[..., 2, 0], state.deformation_gradient[..., 2, 1])
    slope = slopes.max()
    if slope > SLOPE_LIMIT:
        warnings.append(
            f"slope: up to {slope:.3g} at {_format_position(equilibrium, slopes)};"
            f" above {SLOPE_LIMIT:g} it matters how the probe's pressure follows the film"
        )
    return warnings


def list_cancellation_warnings(scene: Scene, integrals: StressIntegrals) -> list[str]:
    """List a warning for each charge whose parts d31 X and d32 Y cancel and leave a large error.

    A warning is given if a charge is less than the fraction `CANCELLATION_FRACTION` of
    |d31 X| + |d32 Y|, and if its error exceeds the tolerance relative to the charge.

    Parameters
    ----------
    scene : Scene
        The scene with the electrodes, d31, d32 and the tolerance.
    integrals : StressIntegrals
        Stress integrals X and Y of the electrodes, with errors, in the order of the scene.
    """
    coefficients = np.array([scene.film.d31, scene.film.d32])
    parts = coefficients * integrals.values
    charges = integrals.charges(coefficients)
    errors = integrals.charge_errors(coefficients)
    has_cancelled = np.abs(charges) < CANCELLATION_FRACTION * np.abs(parts).sum(axis=1)
    is_inaccurate = errors > scene.numerics.tolerance * np.abs(charges)
    warnings = []
    for i in np.flatnonzero(has_cancelled & is_inaccurate):
        by_d31, by_d32 = 1e12 * parts[i]
        warnings.append(
            f"charge {scene.electrode_list[i].name}: {1e12 * charges[i]:.4g} pC remains of the"
            f" parts {by_d31:.4g} and {by_d32:.4g} pC (by d31 and d32), which cancel; its error of"
            f" {1e12 * errors[i]:.2g} pC is within the tolerance only relative to"
            f" {CANCELLATION_FRACTION:g} of the sum of these parts"
        )
    return warnings


def _format_area(equilibrium: Equilibrium, is_inside: Mask) -> str:
    """Format the area around marked quadrature points, and its fraction of the film.

    `is_inside` is True at the marked points, shape (elements, points).
    """
    weights = equilibrium.space.weights * len(equilibrium.sector.signs)  # all reflections
    area = float((weights * is_inside).sum())
    return f"{1e6 * area:.3g} mm2 ({area / weights.sum():.2%} of the film)"


def _format_position(equilibrium: Equilibrium, values: Array) -> str:
    """Format the position of the largest value, in mm in the scene's axes.

    `values` are given at the quadrature points, shape (elements, points).
    """
    element, point = np.unravel_index(values.argmax(), values.shape)
    points = np.asarray(equilibrium.space.basis.global_coordinates())
    x, y = 1e3 * equilibrium.sector.frame.T @ points[:, element, point]
    return f"({x:.4g}, {y:.4g}) mm"

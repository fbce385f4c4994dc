"""Whether a solution is accepted as a result, and where it is beyond the limits of the model.

A solution is rejected when the forces do not balance, or when its tangent is not that of a minimum
of the energy. It is accepted with a warning where the film would wrinkle, yield or slope beyond the
limits of the model.
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
from pvdf_fem.solver.nonlinear.stability import is_balanced, is_compressed, is_stable
from pvdf_fem.solver.nonlinear.status import Status

#: Strength of biaxially stretched PVDF film in Pa: data sheets give 160 to 220 MPa along either
#: direction.
STRENGTH = 180e6
#: Slope up to which the load is modelled well. The film's law is exact at any slope. But at this
#: slope a pressure along z and one normal to the film differ by 1 - cos = 11 %, and the face of the
#: probe no longer covers its projection.
SLOPE_LIMIT = 0.5
#: Reach of a contact over the film's radius beyond which a tip meets the clamped rim.
RIM_REACH = 0.99
#: Relative change of a charge by wrinkles above which a membrane in compression is rejected.
MOST_CHANGE = 0.1


def find_rejection_status(
    discrete: DiscreteSolution, factors: SuperLU | None, change: float | None
) -> Status | None:
    """Return the status of a solution that is no stable equilibrium; None for an accepted one.

    Parameters
    ----------
    discrete : DiscreteSolution
        The solution.
    factors : SuperLU or None
        Factors of the last tangent; None for the flat film, which is always accepted.
    change : float or None
        Relative change of a charge by wrinkles in a membrane in compression.
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
    # without compression the minimum is the energy's only stationary point
    if is_compressed(state) and not is_stable(equilibrium, factors):
        return Status.UNSTABLE
    if change is not None and change > MOST_CHANGE:
        return Status.UNSTABLE
    return None


def is_tip_at_rim(discrete: DiscreteSolution) -> bool:
    """Return whether the contact of a tip extends to the clamped rim."""
    solved = discrete.solved
    reaches = [tip.compute_contact_radius(discrete.solved_state) for tip in select_tips(solved)]
    return max(reaches, default=0.0) > RIM_REACH * solved.film.radius


def estimate_wrinkling_changes(level: MeshLevel) -> Array | None:
    """Estimate what wrinkles would change in the stress integrals of a membrane.

    A membrane in compression is a saddle point of its energy: on a fine enough mesh it folds,
    however small the compressed part is, and the signs of its tangent depend on the mesh. The
    change by a tension field therefore decides whether the solution is a result. It comes from a
    single Newton step in the tension field's equations from the membrane's solution; on 12 scenes
    this step made 0.4 to 0.9 of the full change.

    Parameters
    ----------
    level : MeshLevel
        The solve on the last mesh.

    Returns
    -------
    ndarray, shape (outputs, 2), or None
        Stress integrals of the wrinkling film less those of the membrane in N. None for a film
        without compression, a film that may carry it, and a law without a tension field.
    """
    solved = level.equilibrium
    discrete = level.discrete
    carries_compression = solved.model.bends or solved.model.wrinkles
    if carries_compression or not solved.membrane.law.is_linear:
        return None
    if not level.result.converged or not is_compressed(discrete.solved_state):
        return None
    # a scene in a sweep may have no electrodes; `Scene.with_` refuses such a scene
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
    """Return warnings where a solution is beyond the limits of the model, with values and places.

    Parameters
    ----------
    equilibrium : Equilibrium
        The solved equations.
    state : State
        Their solution.
    change : float or None
        Relative change of a charge by wrinkles in a membrane in compression.

    Returns
    -------
    list of str
        Warnings of compression or wrinkles, strength, strain and slope.
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
            f" at {_format_place(equilibrium, largest_stress)},"
            f" above the film's {1e-6 * STRENGTH:.4g} MPa"
        )
    tensor_strain = state.strain * [1.0, 1.0, 0.5]
    _, largest_strain = compute_principal_values(tensor_strain)
    law = equilibrium.membrane.law
    strain = largest_strain.max()
    if strain > law.strain_limit:
        warnings.append(
            f"strain: up to {strain:.3g} at {_format_place(equilibrium, largest_strain)},"
            f" where the film {law.beyond_limit} (above {law.strain_limit:g})"
        )
    slopes = np.hypot(state.deformation_gradient[..., 2, 0], state.deformation_gradient[..., 2, 1])
    slope = slopes.max()
    if slope > SLOPE_LIMIT:
        warnings.append(
            f"slope: up to {slope:.3g} at {_format_place(equilibrium, slopes)};"
            f" above {SLOPE_LIMIT:g} it matters how the probe's pressure follows the film"
        )
    return warnings


def warn_of_cancelled_charges(scene: Scene, integrals: StressIntegrals) -> list[str]:
    """Return warnings of charges whose errors exceed the tolerance since their parts cancel.

    Parameters
    ----------
    scene : Scene
        The scene.
    integrals : StressIntegrals
        Stress integrals of its electrodes.
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
    """Format the area of quadrature points (elements, points), and its share of the film."""
    weights = equilibrium.space.weights * len(equilibrium.sector.signs)
    area = float((weights * is_inside).sum())
    return f"{1e6 * area:.3g} mm2 ({area / weights.sum():.2%} of the film)"


def _format_place(equilibrium: Equilibrium, values: Array) -> str:
    """Format the place where values at quadrature points (elements, points) are largest."""
    element, point = np.unravel_index(values.argmax(), values.shape)
    places = np.asarray(equilibrium.space.basis.global_coordinates())
    x, y = 1e3 * equilibrium.sector.frame.T @ places[:, element, point]
    return f"({x:.4g}, {y:.4g}) mm"

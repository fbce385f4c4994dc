"""Whether a solution may be called a result, and where the model ends that made it.

A solution is refused when the forces do not balance, or when its tangent is not that of a minimum
of the energy. It is a result with a warning where the film would wrinkle, yield or tilt beyond
what the model describes.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.sparse.linalg import SuperLU

from pvdf_fem.arrays import Array, Mask
from pvdf_fem.electrodes.stress_integrals import (
    CANCELLATION_SHARE,
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
from pvdf_fem.solver.nonlinear.newton import (
    factorise,
    has_negative_determinant,
    is_balanced,
    is_compressed,
    is_stable,
)
from pvdf_fem.solver.nonlinear.status import Status

#: Strength of biaxially stretched PVDF film in Pa: data sheets give 160 to 220 MPa along either
#: direction.
STRENGTH = 180e6
#: Slope up to which the load is modelled well. The film's law is exact at any slope; but here a
#: pressure along z and one normal to the film differ by 1 - cos = 11 %, and the probe's face no
#: longer covers its shadow.
SLOPE_LIMIT = 0.5


#: Reach of a contact over the film's radius from which a tip meets the clamped rim.
NEAR_RIM = 0.99
#: Relative change of a charge by wrinkles above which a membrane in compression is no result.
MOST_CHANGE = 0.1


def find_rejection_status(
    fields: DiscreteSolution, factors: SuperLU | None, change: float | None
) -> Status | None:
    """The status for a solution without equilibrium or stability; None for one that is.

    `change` is the relative change of a charge by wrinkles in a membrane.
    """
    if factors is None:  # the flat film
        return None
    equilibrium, state = fields.solved, fields.solved_state
    if not is_balanced(equilibrium, state, factors, equilibrium.model.mesh_policy.imbalance):
        return Status.UNBALANCED
    if is_tip_at_rim(fields):
        return Status.RIM
    if not equilibrium.conservative and has_negative_determinant(factors):
        return Status.UNSTABLE
    # without compression the energy has no other stationary point
    buckled = is_compressed(state) and not is_stable(equilibrium, factors)
    return Status.UNSTABLE if buckled or (change or 0.0) > MOST_CHANGE else None


def is_tip_at_rim(fields: DiscreteSolution) -> bool:
    """Whether a tip touches the film up to the rim."""
    solved = fields.solved
    reaches = [tip.reach(fields.solved_state) for tip in select_tips(solved)]
    reach = max(reaches, default=0.0)
    return reach > NEAR_RIM * solved.film.radius


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


def list_warnings(equilibrium: Equilibrium, state: State, change: float | None) -> Iterator[str]:
    """What to look at: compression or wrinkles, strength, strain, slope; with value and place.

    `change` is the relative change of a charge by wrinkles, if known.
    """
    told = "" if change is None else f"; this would change a charge by up to {change:.1e} of it"
    least, largest = compute_principal_values(state.stress)
    for remark, where in equilibrium.model.find_compression(least, largest):
        yield remark.format(_area(equilibrium, where)) + told
    if (stress := largest.max()) > STRENGTH:
        yield (
            f"strength: principal stress up to {1e-6 * stress:.4g} MPa"
            f" at {_place(equilibrium, largest)}, above the film's {1e-6 * STRENGTH:.4g} MPa"
        )
    stretch = compute_principal_values(state.strain * [1.0, 1.0, 0.5])[1]
    law = equilibrium.membrane.law
    if (strain := stretch.max()) > law.strain_limit:
        place = _place(equilibrium, stretch)
        limit = f"(above {law.strain_limit:g})"
        yield f"strain: up to {strain:.3g} at {place}, where the film {law.beyond_limit} {limit}"
    slope = np.hypot(state.deformation_gradient[..., 2, 0], state.deformation_gradient[..., 2, 1])
    if (steepest := slope.max()) > SLOPE_LIMIT:
        yield (
            f"slope: up to {steepest:.3g} at {_place(equilibrium, slope)}; above {SLOPE_LIMIT:g}"
            " it matters how the probe's pressure follows the film"
        )


def warn_of_cancelled_charges(scene: Scene, forces: StressIntegrals) -> Iterator[str]:
    """Charges much smaller than their parts: their errors exceed the tolerance."""
    d = np.array([scene.film.d31, scene.film.d32])
    parts, charges, errors = d * forces.values, forces.charges(d), forces.charge_errors(d)
    little = np.abs(charges) < CANCELLATION_SHARE * np.abs(parts).sum(axis=1)
    for i in np.flatnonzero(little & (errors > scene.numerics.tolerance * np.abs(charges))):
        first, second = 1e12 * parts[i]
        yield (
            f"charge {scene.electrode_list[i].name}: {1e12 * charges[i]:.4g} pC is what its parts"
            f" {first:.4g} and {second:.4g} pC (d31, d32) leave; its error of"
            f" {1e12 * errors[i]:.2g} pC meets the tolerance relative to"
            f" {CANCELLATION_SHARE:g} of them only"
        )


def _area(equilibrium: Equilibrium, where: Mask) -> str:
    weights = equilibrium.space.weights * len(equilibrium.sector.signs)
    area = float((weights * where).sum())
    return f"{1e6 * area:.3g} mm2 ({area / weights.sum():.2%} of the film)"


def _place(equilibrium: Equilibrium, values: Array) -> str:
    """Where values (elements, points) are largest, as text."""
    element, point = np.unravel_index(values.argmax(), values.shape)
    places = np.asarray(equilibrium.space.basis.global_coordinates())
    x, y = 1e3 * equilibrium.sector.frame.T @ places[:, element, point]
    return f"({x:.4g}, {y:.4g}) mm"

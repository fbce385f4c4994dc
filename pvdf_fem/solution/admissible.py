"""Whether a solution may be called a result, and where the model ends that made it.

A solution is refused when the forces do not balance, or when its tangent is not that of a minimum
of the energy. It is a result with a warning where the film would wrinkle, yield or tilt beyond
what the model describes.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.sparse.linalg import SuperLU

from pvdf_fem.arrays import Array
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.membrane import principal
from pvdf_fem.film.term import State
from pvdf_fem.solution.fields import Fields
from pvdf_fem.solvers.arc_length import beyond_limit
from pvdf_fem.solvers.newton import balanced, compressed, factorise, negative_pivots
from pvdf_fem.solvers.status import Status

#: Strength of biaxially stretched PVDF film in Pa: data sheets give 160 to 220 MPa along either
#: direction.
STRENGTH = 180e6
#: Principal stretch less 1 up to which St. Venant-Kirchhoff's law is that of a linear elastic
#: solid: at 5 % the 2nd Piola-Kirchhoff and the nominal stress differ by as much.
STRAIN_LIMIT = 0.05
#: Slope up to which the load is modelled well. The film's law is exact at any slope; but here a
#: pressure along z and one normal to the film differ by 1 - cos = 11 %, and the probe's face no
#: longer covers its shadow.
SLOPE_LIMIT = 0.5


def refusal(fields: Fields, factors: SuperLU | None) -> Status | None:
    """The status of a solution that is no equilibrium or no minimum; None for one that is."""
    if factors is None:  # the flat film
        return None
    equilibrium, state = fields.solved, fields.solved_state
    if not balanced(equilibrium, state, factors, equilibrium.model.imbalance):
        return Status.UNBALANCED
    if not equilibrium.conservative:
        return Status.UNSTABLE if beyond_limit(factors) else None
    # without compression the energy has no other stationary point
    if compressed(state) and negative_pivots(factors) > 0:
        return Status.UNSTABLE
    return None


def keeps_symmetry(fields: Fields) -> bool:
    """Whether a solution on a part of the film is a minimum of the energy of the whole film.

    Among displacements that are their own mirror images it is known to be one.
    """
    equilibrium, state = fields.solved, fields.solved_state
    if equilibrium.model.convex or not (equilibrium.conservative and compressed(state)):
        return True
    odd = (equilibrium.tangent(state, assembly) for assembly in equilibrium.odd_assemblies())
    return all(negative_pivots(factorise(tangent)) == 0 for tangent in odd)


def warnings(equilibrium: Equilibrium, state: State) -> Iterator[str]:
    """What to look at: compression or wrinkles, strength, strain, slope; with value and place."""
    least, largest = principal(state.stress)
    for remark, where in equilibrium.model.compression_remarks(least, largest):
        yield remark.format(_area(equilibrium, where))
    if (stress := largest.max()) > STRENGTH:
        yield (
            f"strength: principal stress up to {1e-6 * stress:.4g} MPa"
            f" at {_place(equilibrium, largest)}, above the film's {1e-6 * STRENGTH:.4g} MPa"
        )
    stretch = principal(state.strain * [1.0, 1.0, 0.5])[1]
    if (strain := stretch.max()) > STRAIN_LIMIT:
        yield (
            f"strain: up to {strain:.3g} at {_place(equilibrium, stretch)}, where the film is no"
            f" longer linear elastic (above {STRAIN_LIMIT:g})"
        )
    slope = np.hypot(state.deformation_gradient[..., 2, 0], state.deformation_gradient[..., 2, 1])
    if (steepest := slope.max()) > SLOPE_LIMIT:
        yield (
            f"slope: up to {steepest:.3g} at {_place(equilibrium, slope)}; above {SLOPE_LIMIT:g}"
            " it matters how the probe's pressure follows the film"
        )


def _area(equilibrium: Equilibrium, where: Array) -> str:
    weights = equilibrium.space.weights * len(equilibrium.part.signs)
    area = float((weights * where).sum())
    return f"{1e6 * area:.3g} mm2 ({area / weights.sum():.2%} of the film)"


def _place(equilibrium: Equilibrium, values: Array) -> str:
    """Where values (elements, points) are largest, as text."""
    element, point = np.unravel_index(values.argmax(), values.shape)
    places = np.asarray(equilibrium.space.basis.global_coordinates())
    x, y = 1e3 * equilibrium.part.frame.T @ places[:, element, point]
    return f"({x:.4g}, {y:.4g}) mm"

"""A solve as the page shows it: its result, and the film as an image."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from matplotlib.tri import Triangulation
from skfem import MeshTri

from pvdf_fem.arrays import Array
from pvdf_fem.film.space import shape_values
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solution.solution import Solution
from pvdf_fem.solution.solve import solve

TOLERANCE = 1e-2  #: Least relative error of charges that pictures are solved to.
PIXELS = 260  #: Pixels along the film's diameter.
#: A point between the rim and the straight sides there is taken to be in the triangle where this
#: share of its distance from the centre leads.
INWARD = 0.95


class Quantity(NamedTuple):
    """What the film may be coloured by: its label, Bokeh's colours, and its values at the dofs."""

    label: str
    palette: str
    at_dofs: Callable[[Solution], Array]


def _deflection(solution: Solution) -> Array:
    return np.asarray(1e3 * solution.displacement[:, 2])


def _stress(solution: Solution) -> Array:
    equilibrium, state = solution.fields.equilibrium, solution.fields.state
    places = np.moveaxis(np.asarray(solution.basis.global_coordinates()), 0, -1)
    stress = equilibrium.membrane.film_stress(state.strain, places)
    stress = stress if state.added is None else stress + state.added
    return np.asarray(1e-6 * solution.basis.project(stress[..., 0] + stress[..., 1]))


#: A further one is its function and its line here.
QUANTITIES = {
    "deflection": Quantity("deflection (mm)", "Blues256", _deflection),
    "stress": Quantity("S11 + S22 (MPa)", "Oranges256", _stress),
}


@dataclass(frozen=True, eq=False)
class Picture:
    """What `pvdf-fem solve --json` says of a scene, and its film."""

    result: dict[str, Any]
    #: Values at pixels over the square about the film, from the lowest y, (pixels, pixels); none of
    #: a solve without a result.
    image: Array | None


def picture_of(scene: Scene, quantity: str) -> Picture:
    """The picture of a scene by a solve to `TOLERANCE`, or to that of the scene if it is larger."""
    tolerance = max(TOLERANCE, scene.numerics.tolerance)
    solution = solve(scene.with_(**{"numerics.tolerance": tolerance}))
    result = solution.to_json()
    if "charges_pC" not in result:
        return Picture(result, None)
    return Picture(result, image_of(solution, QUANTITIES[quantity].at_dofs(solution)))


def image_of(solution: Solution, values: Array, pixels: int = PIXELS) -> Array:
    """The field with these values at the dofs, at pixels; beyond the rim it has the values there.
    Elements count as straight-sided."""
    mesh, basis, radius = solution.mesh, solution.basis, solution.scene.film.radius
    ticks = radius * ((np.arange(pixels) + 0.5) / pixels * 2.0 - 1.0)
    points = np.stack(np.meshgrid(ticks, ticks)).reshape(2, -1)
    points /= np.maximum(np.hypot(*points) / radius, 1.0)
    find = Triangulation(*mesh.p, mesh.t.T).get_trifinder()
    elements = find(*points)
    beyond = elements < 0
    elements[beyond] = find(*(INWARD * points[:, beyond]))
    straight = MeshTri(mesh.p, mesh.t).mapping()
    local = straight.invF(points[:, :, None], tind=elements)[:, :, 0]
    functions = shape_values(basis.elem, local)
    image = np.einsum("pf,fp->p", functions, values[basis.element_dofs[:, elements]])
    image = image.clip(values.min(), values.max())  # extrapolated at most a little, to the rim
    return image.reshape(pixels, pixels).astype(np.float32)

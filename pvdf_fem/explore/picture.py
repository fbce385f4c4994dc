"""A solve as the page shows it: its result, and the film as an image."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from matplotlib.tri import Triangulation

from pvdf_fem.arrays import Array
from pvdf_fem.charges.point_values import values_in_elements
from pvdf_fem.film.space import shape_values
from pvdf_fem.mesh.points import local_coordinates
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solution.solution import Solution
from pvdf_fem.solution.solve import solve
from pvdf_fem.solvers.status import Status

TOLERANCE = 1e-2  #: Least relative error of charges that pictures are solved to.
MOST_SECONDS = 5.0  #: Work of one core for a picture, unless the scene says how much.
ORDER = 2  #: Of the elements: to 1e-2, quadratic ones take a fifth less time than cubic ones.
PIXELS = 160  #: Pixels along the film's diameter.
#: A point between the rim and the straight sides there is taken to be in the triangle where this
#: share of its distance from the centre leads.
INWARD = 0.95


class Quantity(NamedTuple):
    """What the film may be coloured by."""

    label: str
    palette: str  #: Of Bokeh, from dark to light.
    at_dofs: Callable[[Solution], Array]  #: Values at the dofs of a solution's basis.


def _stress(solution: Solution) -> Array:
    """S11 + S22 in MPa, continuous."""
    fields, basis = solution.fields, solution.basis
    stress = values_in_elements(fields.equilibrium, fields.state, basis.X).stress_MPa
    return np.asarray(basis.project(stress[..., 0] + stress[..., 1]))


#: A further one is its line here.
QUANTITIES = {
    "deflection": Quantity("deflection (mm)", "Blues256", lambda s: 1e3 * s.displacement[:, 2]),
    "stress": Quantity("S11 + S22 (MPa)", "Purples256", _stress),
}


class Picture(NamedTuple):
    """What `pvdf-fem solve --json` says of a scene, and its film."""

    result: dict[str, Any]
    image: Array | None  #: Of `image_of`; none without a result.


def picture_of(scene: Scene, quantity: str) -> Picture:
    """The picture of a scene by a solve to `TOLERANCE`, or the scene's own where that is larger."""
    limits = {"numerics.tolerance": max(TOLERANCE, scene.numerics.tolerance)}
    limits["numerics.max_seconds"] = scene.numerics.max_seconds or MOST_SECONDS
    solution = solve(scene.with_(**limits), order=ORDER)
    converged = solution.status is Status.CONVERGED
    image = image_of(solution, QUANTITIES[quantity].at_dofs(solution)) if converged else None
    return Picture(solution.to_json(), image)


def image_of(solution: Solution, values: Array, pixels: int = PIXELS) -> Array:
    """The field with values at the dofs, at the pixels of the square about the film, the lowest y
    first, (pixels, pixels). It is that at the rim for a pixel beyond, and NaN farther out."""
    mesh, basis, radius = solution.mesh, solution.basis, solution.scene.film.radius
    ticks = radius * ((np.arange(pixels) + 0.5) / pixels * 2.0 - 1.0)
    square = np.stack(np.meshgrid(ticks, ticks))
    near = np.hypot(*square) < (1.0 + 4.0 / pixels) * radius
    points = square[:, near]
    points /= np.maximum(np.hypot(*points) / radius, 1.0)
    find = Triangulation(mesh.p[0], mesh.p[1], mesh.t.T).get_trifinder()
    elements: Any = find(*points)
    beyond = elements < 0
    elements[beyond] = find(*(INWARD * points[:, beyond]))
    local = local_coordinates(mesh, elements, points.T[:, None])[:, :, 0]
    nodal = values[basis.element_dofs[:, elements]]
    field = np.einsum("pf,fp->p", shape_values(basis.elem, local), nodal)
    image = np.full(near.shape, np.nan, dtype=np.float32)
    image[near] = field.clip(values.min(), values.max())  # at the rim it is extrapolated a little
    return image

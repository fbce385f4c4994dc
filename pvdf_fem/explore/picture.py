"""A solve for the page: its result, and the film as an image."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Callable
from functools import lru_cache
from io import BytesIO
from typing import Any, NamedTuple

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import to_hex
from matplotlib.image import imsave
from matplotlib.tri import Triangulation

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.point_values import evaluate_in_elements
from pvdf_fem.film.space import evaluate_shape_functions
from pvdf_fem.mesh.points import compute_local_coordinates
from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solver.adaptive import solve_problem
from pvdf_fem.solver.nonlinear.status import Status
from pvdf_fem.solver.solution import Solution

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
    palette: str  #: Of matplotlib, from light to dark.
    at_dofs: Callable[[Solution], Array]  #: Values at the dofs of a solution's basis.


def _stress(solution: Solution) -> Array:
    """S11 + S22 in MPa, continuous."""
    fields, basis = solution.discrete, solution.basis
    stress = evaluate_in_elements(fields.equilibrium, fields.state, basis.X).stress_MPa
    return np.asarray(basis.project(stress[..., 0] + stress[..., 1]))


#: A further one is its line here.
QUANTITIES = {
    "deflection": Quantity("deflection (mm)", "Blues", lambda s: 1e3 * s.displacement[:, 2]),
    "stress": Quantity("S11 + S22 (MPa)", "Purples", _stress),
}


class Picture(NamedTuple):
    """The JSON of `pvdf-fem solve --json` for a scene, and its film."""

    result: dict[str, Any]
    image: Array | None  #: Of `sample_image`; none without a result.


def solve_picture(text: str, quantity: str) -> Picture:
    """The picture of a scene file."""
    solution = solve_text(text)
    converged = solution.status is Status.CONVERGED
    image = sample_image(solution, QUANTITIES[quantity].at_dofs(solution)) if converged else None
    return Picture(solution.to_json(), image)


@lru_cache(maxsize=1)
def solve_text(text: str) -> Solution:
    """The solution of a scene file to `TOLERANCE`, or the scene's own where that is larger."""
    scene = Scene.parse(text)
    limits = {"numerics.tolerance": max(TOLERANCE, scene.numerics.tolerance)}
    limits["numerics.max_seconds"] = scene.numerics.max_seconds or MOST_SECONDS
    return solve_problem(Problem.from_scene(scene.with_(**limits)), order=ORDER)


def encode_image(image: Array, quantity: str) -> dict[str, Any]:
    """An image as a PNG in a URL, palest at zero and transparent where it is NaN, and its scale:
    label, least and largest value, and colours between them."""
    low, high = min(0.0, float(np.nanmin(image))), max(0.0, float(np.nanmax(image)))
    label, palette, _ = QUANTITIES[quantity]
    palette = f"{palette}_r" if -low > high else palette
    imsave(png := BytesIO(), image, vmin=low, vmax=high, cmap=palette, origin="lower", format="png")
    colours = [to_hex(colour) for colour in colormaps[palette](np.linspace(0.0, 1.0, 9))]
    scale = {"label": label, "low": f"{low:.3g}", "high": f"{high:.3g}", "colours": colours}
    return {"url": f"data:image/png;base64,{b64encode(png.getvalue()).decode()}", **scale}


def sample_image(solution: Solution, values: Array, pixels: int = PIXELS) -> Array:
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
    local = compute_local_coordinates(mesh, elements, points.T[:, None])[:, :, 0]
    nodal = values[basis.element_dofs[:, elements]]
    field = np.einsum("pf,fp->p", evaluate_shape_functions(basis.elem, local), nodal)
    image = np.full(near.shape, np.nan, dtype=np.float32)
    image[near] = field.clip(values.min(), values.max())  # at the rim it is extrapolated a little
    return image

"""Solves for the page, with their results and images of the film."""

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

from pvdf_fem.arrays import Array, Mask
from pvdf_fem.electrodes.point_values import evaluate_in_elements
from pvdf_fem.film.space import evaluate_shape_functions
from pvdf_fem.mesh.points import compute_local_coordinates, locate_points
from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solver.adaptive import solve_problem
from pvdf_fem.solver.nonlinear.status import Status
from pvdf_fem.solver.solution import Solution

TOLERANCE = 1e-2  #: Tolerance of the charges, unless that of the scene is larger.
MAX_SECONDS = 5.0  #: Maximum CPU time of a solve in seconds, unless the scene limits it.
ORDER = 2  #: Order of the elements; at this tolerance, order 2 takes a fifth less time than 3.
PIXELS = 160  #: Pixels along the film's diameter.


class Quantity(NamedTuple):
    """A field by which the film can be coloured."""

    label: str
    palette: str  #: Name of a colour map of matplotlib, from light to dark.
    at_dofs: Callable[[Solution], Array]  #: Returns the field at the dofs of a solution's basis.


def _compute_deflection(solution: Solution) -> Array:
    """Compute the deflection in mm at the dofs of a solution's basis."""
    return np.asarray(1e3 * solution.displacement[:, 2])


def _compute_stress(solution: Solution) -> Array:
    """Compute the stress S11 + S22 in MPa, projected to the dofs of a solution's basis."""
    discrete = solution.discrete
    points = solution.basis.X
    stress = evaluate_in_elements(discrete.equilibrium, discrete.state, points).stress_MPa
    return np.asarray(solution.basis.project(stress[..., 0] + stress[..., 1]))


#: Quantities by name. A new quantity only needs an entry here.
QUANTITIES = {
    "deflection": Quantity("deflection (mm)", "Blues", _compute_deflection),
    "stress": Quantity("S11 + S22 (MPa)", "Purples", _compute_stress),
}


class Picture(NamedTuple):
    """The JSON of ``pvdf-fem solve --json`` for a scene, and an image of its film."""

    result: dict[str, Any]
    image: Array | None  #: The image of `sample_image`, or None if the solve did not converge.


def solve_picture(text: str, quantity: str) -> Picture:
    """Solve the text of a scene file, and sample the field of a key of `QUANTITIES`."""
    solution = solve_text(text)
    image = None
    if solution.status is Status.CONVERGED:
        image = sample_image(solution, QUANTITIES[quantity].at_dofs(solution))
    return Picture(solution.to_json(), image)


@lru_cache(maxsize=1)
def solve_text(text: str) -> Solution:
    """Solve the text of a scene file with limits that keep the page responsive.

    The tolerance is at least `TOLERANCE`, the CPU time is limited to `MAX_SECONDS` unless the scene
    limits it, and the order of the elements is `ORDER`. The last solution is cached.
    """
    scene = Scene.parse(text)
    limits = {
        "numerics.tolerance": max(TOLERANCE, scene.numerics.tolerance),
        "numerics.max_seconds": scene.numerics.max_seconds or MAX_SECONDS,
    }
    return solve_problem(Problem.from_scene(scene.with_(**limits)), order=ORDER)


def encode_image(image: Array, quantity: str) -> dict[str, Any]:
    """Encode an image as a PNG with its colour scale.

    Parameters
    ----------
    image : ndarray, shape (pixels, pixels)
        Values of the quantity, with y increasing along the first axis. NaN is transparent.
    quantity : str
        A key of `QUANTITIES`.

    Returns
    -------
    dict
        `url` that contains the PNG; `label` of the quantity; `low` and `high`, the ends of the
        colour scale as texts; and `colours` from the low to the high end. The scale includes zero.
    """
    low = min(0.0, float(np.nanmin(image)))
    high = max(0.0, float(np.nanmax(image)))
    label, palette, _ = QUANTITIES[quantity]
    if -low > high:
        palette = f"{palette}_r"  # reversed: the darkest colour is at the value farthest from zero
    png = BytesIO()
    imsave(png, image, vmin=low, vmax=high, cmap=palette, origin="lower", format="png")
    colours = colormaps[palette](np.linspace(0.0, 1.0, 9))
    return {
        "url": f"data:image/png;base64,{b64encode(png.getvalue()).decode()}",
        "label": label,
        "low": f"{low:.3g}",
        "high": f"{high:.3g}",
        "colours": [to_hex(colour) for colour in colours],
    }


def sample_image(solution: Solution, values: Array, pixels: int = PIXELS) -> Array:
    """Sample a field at the pixels of a square image of the film.

    Parameters
    ----------
    solution : Solution
        The solution with mesh and basis.
    values : ndarray, shape (dofs,)
        The field at the dofs of the basis.
    pixels : int
        Number of pixels along a side of the square.

    Returns
    -------
    ndarray of float32, shape (pixels, pixels)
        The field, with y increasing along the first axis. It is extrapolated to pixels up to about
        two pixels outside the rim; other pixels outside have NaN.
    """
    mesh = solution.mesh
    basis = solution.basis
    film = solution.scene.film
    ticks = film.reach * ((np.arange(pixels) + 0.5) / pixels * 2.0 - 1.0)
    centres = np.stack(np.meshgrid(ticks, ticks))
    distances = film.outline.compute_signed_distances(centres.reshape(2, -1).T)
    is_near: Mask = distances.reshape(pixels, pixels) < 4.0 / pixels * film.reach
    points = centres[:, is_near]
    find_elements = Triangulation(mesh.p[0], mesh.p[1], mesh.t.T).get_trifinder()
    elements: Any = find_elements(*points)
    # points beyond the straight sides of this search get the nearest element at the rim
    is_missed = elements < 0
    elements[is_missed], _ = locate_points(mesh, points[:, is_missed])
    local = compute_local_coordinates(mesh, elements, points.T[:, None])[:, :, 0]
    values_at_dofs = values[basis.element_dofs[:, elements]]
    shape_functions = evaluate_shape_functions(basis.elem, local)
    field = np.einsum("pf,fp->p", shape_functions, values_at_dofs)
    image: Any = np.full((pixels, pixels), np.nan, dtype=np.float32)
    # an extrapolated field may exceed the values of the film
    image[is_near] = field.clip(values.min(), values.max())
    return image

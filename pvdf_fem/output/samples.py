"""The fields of a solution at the same local points of every element, for pictures and files."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from skfem import MeshTri1

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.film.membrane import strain_of
from pvdf_fem.film.space import shape_values
from pvdf_fem.solution.solution import Solution

MOST_TRIANGLES = 60_000  #: Elements are cut in four again while there are no more triangles.


@dataclass(frozen=True, eq=False)
class Samples:
    """Fields of the whole film at local points of its curved elements."""

    places: Array  #: On the film before it deforms, in m, (elements, points, 2).
    displacement: Array  #: In m, (elements, points, 3).
    stress: Array  #: Second Piola-Kirchhoff stress in Pa, S11, S22, S12, (elements, points, 3).

    @classmethod
    def of(cls, solution: Solution, local: Array) -> Samples:
        """The fields at local points (2, points). Raises `NotConvergedError`."""
        equilibrium, state = solution.fields.equilibrium, solution.fields.state
        space, mesh, count = equilibrium.space, solution.mesh, solution.mesh.nelements
        gradients = space.gradients_at(np.arange(count), np.repeat(local[:, None], count, axis=1))
        dofs = solution.displacement[space.nodes]
        strain = strain_of(np.matmul(dofs[:, None].swapaxes(2, 3), gradients))
        places = np.moveaxis(mesh.mapping().F(local), 0, -1)
        stress = equilibrium.membrane.film_stress(strain, places)
        if state.added is not None:
            stress = stress + state.added
        return cls(places, np.matmul(shape_values(space.basis.elem, local), dofs), stress)


def cut(solution: Solution) -> tuple[Array, Indices]:
    """Local points (2, points) that cut an element into small triangles, and the small triangles of
    all elements (n, 3), which share no points."""
    count = solution.mesh.nelements
    times = int(np.clip(np.log(MOST_TRIANGLES / count) / np.log(4.0), 1, 4))
    element = MeshTri1.init_refdom().refined(times)
    first = element.p.shape[1] * np.arange(count)
    return element.p, (element.t.T + first[:, None, None]).reshape(-1, 3)

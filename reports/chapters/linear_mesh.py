"""Charges with the thesis's discretisation: its mesh, its linear triangles and its edge averages.

The triangles have at most 1 mm, and 0.75 mm in the patches (section 2.1.3). Stresses are averaged
at each node over the elements around it, and integrated along the electrodes' edges through the
nodal values (section 2.1.6, App. 3). The difference from charges on adapted meshes is the part of
the thesis's deviation that its mesh explains.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from skfem import MeshTri2

from pvdf_fem.charges.observables import ThesisEdge
from pvdf_fem.mesh.gmsh_mesh import electrode_patch, mesh_scene, outlines
from pvdf_fem.mesh.size_field import Sizes
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solution.solution import Solution
from pvdf_fem.solution.solve import solve
from pvdf_fem.sweeps.records import record_of
from pvdf_fem.sweeps.store import Record, Store

#: Size in m of the elements in electrodes and probe.
PATCH_SIZE = 0.75e-3
#: Largest size of an element in m.
FILM_SIZE = 1.0e-3
#: Growth of the element size per distance from a patch's outline. At this value elements in the
#: middle of the 7 mm wide probe still have 0.9 mm.
GROWTH = 0.05


def solve_on_thesis_mesh(scene: Scene) -> Solution:
    """Solve with linear triangles of the thesis's sizes."""
    sizes = Sizes(dict.fromkeys(outlines(scene), PATCH_SIZE), GROWTH, FILM_SIZE)
    return solve(scene, mesh=mesh_scene(scene, sizes), order=1)


def charges_on_thesis_mesh(scenes: Iterable[Scene], path: Path) -> dict[Scene, dict[str, float]]:
    """Charges in pC by electrode, for each scene; empty for a scene without a solution.

    Scenes that are not in the store at `path` are solved and stored there.
    """
    charges: dict[Scene, dict[str, float]] = {}
    with Store(path, code=hashlib.sha256(Path(__file__).read_bytes()).hexdigest()) as store:
        for scene in dict.fromkeys(scenes):
            record = store.get(scene)
            if record is None:
                record = _record(solve_on_thesis_mesh(scene))
                store.put([(scene, record)])
            film, observable = scene.film, scene.numerics.observable
            charges[scene] = (
                record.charges_pC(film.d31_pC_N, film.d32_pC_N, observable)
                if record.converged
                else {}
            )
    return charges


def _record(solution: Solution) -> Record:
    record = record_of(solution)
    if not record.converged:
        return record
    forces: dict[str, list[list[float]]] = {
        solution.scene.numerics.observable: edge_forces(solution).tolist()
    }
    return replace(record, forces=forces, force_errors={})


def edge_forces(solution: Solution) -> NDArray[np.float64]:
    """Forces X and Y in N of each electrode, (electrodes, 2), from nodal stresses on its edges."""
    stress = nodal_stress(solution)
    patches = [
        solution.mesh.subdomains[electrode_patch(electrode.name)]
        for electrode in solution.scene.electrode_list
    ]
    areas = [electrode.outline.area for electrode in solution.scene.electrode_list]
    means = [edge_means(solution.mesh, patch, stress) for patch in patches]
    return np.array(means) * np.array(areas)[:, None]


def nodal_stress(solution: Solution) -> NDArray[np.float64]:
    """Cauchy stress xx and yy in Pa, (vertices, 2): means over the elements around each vertex."""
    membrane = solution.fields.equilibrium.membrane
    gradient = membrane.space.gradient(solution.fields.displacement)
    of_element = ThesisEdge().stress(membrane, gradient)[..., :2].mean(axis=1)
    vertices = solution.mesh.t
    total = np.zeros((vertices.max() + 1, 2))
    for corner in vertices:
        np.add.at(total, corner, of_element)
    return total / np.bincount(vertices.ravel())[:, None]


def edge_means(
    mesh: MeshTri2, patch: NDArray[np.int64], nodal: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Means of a nodal stress over the edges of a square patch, (2,).

    The first is that of xx over the left and right edges, the second that of yy over the others.

    Parameters
    ----------
    mesh : MeshTri2
    patch : (elements,)
        Elements of the patch.
    nodal : (vertices, 2)
        Values at the vertices, linear in between.
    """
    facets, count = np.unique(mesh.t2f[:, patch], return_counts=True)
    ends = mesh.facets[:, facets[count == 1]]
    steps = mesh.p[:, ends[1]] - mesh.p[:, ends[0]]
    upright = np.abs(steps[1]) > np.abs(steps[0])
    means = []
    for axis, chosen in enumerate((upright, ~upright)):
        values = nodal[ends[:, chosen], axis].mean(axis=0)
        lengths = np.linalg.norm(steps[:, chosen], axis=0)
        means.append((values * lengths).sum() / lengths.sum())
    return np.array(means)

"""Meshes in gmsh's format MSH, in the versions 4.1 and 2.2."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pvdf_fem.arrays import Indices
from pvdf_fem.mesh.subdomains import RIM
from pvdf_fem.view.files.mesh_format import (
    MESHIO_LINES,
    MESHIO_TRIANGLES,
    MeshFormat,
    add_third_coordinate,
    import_meshio,
)
from pvdf_fem.view.files.mesh_grid import MeshGrid

#: gmsh's numbers of the types of elements, by order.
GMSH_LINES = {1: 1, 2: 8}
GMSH_TRIANGLES = {1: 2, 2: 9}


class Msh22(MeshFormat):
    """MSH 2.2 in ASCII, the only version that FreeFEM 4.11 and NGSolve read.

    The groups are those of `Msh41`. Their names have no blanks, at which NGSolve ends a name:
    ``electrode_A``, ``electrode_A+probe``.
    """

    extension = ".msh"

    def write(self, grid: MeshGrid, path: Path, element: str | None) -> None:
        """Write the mesh by meshio."""
        combinations = grid.find_combinations()
        tags = np.zeros(len(grid.triangles), dtype=np.int32)
        names = {}
        for tag, combination in enumerate(combinations, start=1):
            tags[combination.elements] = tag
            name = combination.name.replace(" + ", "+").replace(" ", "_")
            names[name] = np.array([tag, 2])
        rim_tag = len(combinations) + 1
        names[RIM] = np.array([rim_tag, 1])
        rim_tags = np.full(len(grid.rim_lines), rim_tag, dtype=np.int32)
        cells = [
            (MESHIO_TRIANGLES[grid.order], grid.triangles),
            (MESHIO_LINES[grid.order], grid.rim_lines),
        ]
        data = {"gmsh:physical": [tags, rim_tags], "gmsh:geometrical": [tags, rim_tags]}
        points = add_third_coordinate(grid.points)
        mesh = import_meshio().Mesh(points, cells, cell_data=data, field_data=names)
        mesh.write(path, file_format="gmsh22", binary=False)


class Msh41(MeshFormat):
    """MSH 4.1 in ASCII.

    An element has one physical group, but a probe may press on an electrode. Combinations of
    patches are therefore groups: ``electrode A``, ``probe``, ``electrode A + probe``, ``film``
    outside of patches, and ``rim`` for the lines along the rim.

    The file is written here, since meshio's writer of this version loses physical groups.
    """

    extension = ".msh"

    def write(self, grid: MeshGrid, path: Path, element: str | None) -> None:
        """Write the mesh with a discrete curve for the rim and a surface for each group."""
        combinations = grid.find_combinations()
        surfaces = [combination.elements for combination in combinations]
        lines = ["$MeshFormat", "4.1 0 8", "$EndMeshFormat"]
        lines += ["$PhysicalNames", str(len(surfaces) + 1), f'1 1 "{RIM}"']
        for tag, combination in enumerate(combinations, start=1):
            lines.append(f'2 {tag} "{combination.name}"')
        lines.append("$EndPhysicalNames")
        lines += _format_entities(grid, surfaces)
        lines += _format_nodes(grid, surfaces)
        lines += _format_elements(grid, surfaces)
        path.write_text("\n".join(lines) + "\n", "utf-8")


def _format_entities(grid: MeshGrid, surfaces: list[Indices]) -> list[str]:
    """Format the section of the curve and the surfaces, with bounding boxes and groups.

    Each entity has the tag of its only physical group.
    """
    lines = ["$Entities", f"0 1 {len(surfaces)} 0"]
    lines.append(f"1 {_format_box(grid, grid.rim_nodes)} 1 1 0")
    for tag, elements in enumerate(surfaces, start=1):
        box = _format_box(grid, grid.triangles[elements].ravel())
        # gmsh asks for the boundary of a surface, which may be empty
        lines.append(f"{tag} {box} 1 {tag} 0")
    lines.append("$EndEntities")
    return lines


def _format_box(grid: MeshGrid, nodes: Indices) -> str:
    """Format the bounding box of some nodes: the least, then the largest x, y and z."""
    x_min, y_min = grid.points[nodes].min(axis=0)
    x_max, y_max = grid.points[nodes].max(axis=0)
    return f"{x_min:.16g} {y_min:.16g} 0 {x_max:.16g} {y_max:.16g} 0"


def _format_nodes(grid: MeshGrid, surfaces: list[Indices]) -> list[str]:
    """Format the section of the nodes; a node belongs to the rim or to its first surface."""
    count = len(grid.points)
    lines = ["$Nodes", f"{len(surfaces) + 1} {count} 1 {count}"]
    rim = grid.rim_nodes
    lines += _format_node_block(grid, rim, dimension=1, tag=1)
    is_written = np.zeros(count, dtype=bool)
    is_written[rim] = True
    for tag, elements in enumerate(surfaces, start=1):
        nodes = np.unique(grid.triangles[elements])
        nodes = nodes[~is_written[nodes]]
        is_written[nodes] = True
        lines += _format_node_block(grid, nodes, dimension=2, tag=tag)
    lines.append("$EndNodes")
    return lines


def _format_node_block(grid: MeshGrid, nodes: Indices, *, dimension: int, tag: int) -> list[str]:
    """Format the nodes of an entity: their numbers, then their coordinates.

    Parameters
    ----------
    grid : MeshGrid
        The mesh.
    nodes : ndarray of int
        Indices of the nodes.
    dimension : int
        1 for the curve of the rim, 2 for a surface.
    tag : int
        Number of the entity.

    Returns
    -------
    list of str
        Lines of the file.
    """
    lines = [f"{dimension} {tag} 0 {len(nodes)}"]
    lines += [str(node + 1) for node in nodes]
    lines += [f"{x:.16g} {y:.16g} 0" for x, y in grid.points[nodes]]
    return lines


def _format_elements(grid: MeshGrid, surfaces: list[Indices]) -> list[str]:
    """Format the section of the elements: triangles by surface, then the lines of the rim."""
    triangles = len(grid.triangles)
    count = triangles + len(grid.rim_lines)
    lines = ["$Elements", f"{len(surfaces) + 1} {count} 1 {count}"]
    for tag, elements in enumerate(surfaces, start=1):
        lines.append(f"2 {tag} {GMSH_TRIANGLES[grid.order]} {len(elements)}")
        rows = np.column_stack([elements, grid.triangles[elements]]) + 1
        lines += [" ".join(map(str, row)) for row in rows.tolist()]
    lines.append(f"1 1 {GMSH_LINES[grid.order]} {len(grid.rim_lines)}")
    numbers = np.arange(triangles, count)
    rows = np.column_stack([numbers, grid.rim_lines]) + 1
    lines += [" ".join(map(str, row)) for row in rows.tolist()]
    lines.append("$EndElements")
    return lines

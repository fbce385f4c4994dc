"""A script that reads a mesh file with gmsh, meshio or VTK, in a process of its own.

``python library_script.py LIBRARY FILE RESULT`` writes the arrays of a ``MeshContent`` to the file
RESULT in NumPy's format. If that fails, it prints a JSON object with the reason and ends with the
exit code 3. `library_process` runs this script, which imports nothing from this package.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

# VTK's numbers of cell types
_VTK_TRIANGLES = (5, 22, 69)  # linear, quadratic, Lagrange
_VTK_POINTS_AND_LINES = (0, 1, 2, 3, 4, 21, 35, 68, 75)
# meshio's names
_MESHIO_TRIANGLES = ("triangle", "triangle6", "VTK_LAGRANGE_TRIANGLE")
_MESHIO_POINTS_AND_LINES = ("vertex", "line", "polyline", "VTK_LAGRANGE_CURVE", "VTK_BEZIER_CURVE")


class Block(NamedTuple):
    """Elements of one type."""

    name: str  #: Name of the type in the library.
    nodes: NDArray[Any]  #: Indices of their nodes, shape (elements, nodes of an element).
    is_triangle: bool  #: Whether the nodes are vertices and midside nodes of triangles.


class Grid(NamedTuple):
    """Nodes, and the elements that are neither points nor lines."""

    points: NDArray[Any]
    blocks: list[Block]


def read_by_gmsh(path: str) -> Grid:
    """Read a mesh file with gmsh.

    Parameters
    ----------
    path : str
        The file.

    Returns
    -------
    Grid
    """
    import gmsh

    gmsh.initialize(readConfigFiles=False, interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("General.AbortOnError", 2)  # raise exceptions
    gmsh.option.setNumber("General.NumThreads", 1)
    gmsh.merge(path)
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    tags, first = np.unique(tags, return_index=True)
    blocks = []
    for dimension in (2, 3):
        types, _, node_tags = gmsh.model.mesh.getElements(dimension)
        for element_type, flat_tags in zip(types, node_tags, strict=True):
            properties = gmsh.model.mesh.getElementProperties(element_type)
            rows = np.searchsorted(tags, flat_tags)
            nodes = rows.reshape(-1, properties[3])
            is_triangle = properties[0] in ("Triangle 3", "Triangle 6")
            blocks.append(Block(properties[0], nodes, is_triangle))
    return Grid(coordinates.reshape(-1, 3)[first], blocks)


def read_by_meshio(path: str) -> Grid:
    """Read a mesh file with meshio.

    Parameters
    ----------
    path : str
        The file.

    Returns
    -------
    Grid
    """
    import meshio

    mesh = meshio.read(path)
    blocks = []
    for block in mesh.cells:
        is_line = block.type.startswith("line") or block.type in _MESHIO_POINTS_AND_LINES
        if not is_line:
            is_triangle = block.type in _MESHIO_TRIANGLES
            blocks.append(Block(block.type, np.asarray(block.data), is_triangle))
    return Grid(np.asarray(mesh.points), blocks)


def read_by_vtk(path: str) -> Grid:
    """Read a legacy or XML file of VTK with VTK.

    Parameters
    ----------
    path : str
        The file.

    Returns
    -------
    Grid
    """
    from vtkmodules.vtkCommonCore import vtkObject
    from vtkmodules.vtkCommonDataModel import vtkCellTypes
    from vtkmodules.vtkIOLegacy import vtkGenericDataObjectReader
    from vtkmodules.vtkIOXML import vtkXMLGenericDataObjectReader

    numpy_support: Any = import_module("vtkmodules.util.numpy_support")
    vtkObject.GlobalWarningDisplayOff()
    is_legacy = path.lower().endswith(".vtk")
    reader = vtkGenericDataObjectReader() if is_legacy else vtkXMLGenericDataObjectReader()
    reader.SetFileName(path)
    reader.Update()
    data = reader.GetOutputDataObject(0)
    if data is None or not hasattr(data, "GetCellType") or not data.GetNumberOfPoints():
        raise ValueError("no points and cells were found")
    nodes_of_type: dict[int, list[list[int]]] = {}
    for index in range(data.GetNumberOfCells()):
        ids = data.GetCell(index).GetPointIds()
        nodes = [ids.GetId(place) for place in range(ids.GetNumberOfIds())]
        nodes_of_type.setdefault(data.GetCellType(index), []).append(nodes)
    blocks = []
    for cell_type, cells in nodes_of_type.items():
        if cell_type not in _VTK_POINTS_AND_LINES:
            name = vtkCellTypes.GetClassNameFromTypeId(cell_type).removeprefix("vtk")
            is_triangle = cell_type in _VTK_TRIANGLES and len({len(nodes) for nodes in cells}) == 1
            rows = np.array(cells if is_triangle else [[]] * len(cells), dtype=np.int64)
            blocks.append(Block(name, rows, is_triangle))
    return Grid(numpy_support.vtk_to_numpy(data.GetPoints().GetData()), blocks)


READERS: dict[str, Callable[[str], Grid]] = {
    "gmsh": read_by_gmsh,
    "meshio": read_by_meshio,
    "vtk": read_by_vtk,
}


def save_grid(grid: Grid, result: str) -> None:
    """Save nodes, triangles and the numbers of other elements to a file in NumPy's format.

    Parameters
    ----------
    grid : Grid
        The nodes and elements.
    result : str
        File to write.
    """
    arrays: dict[str, list[NDArray[Any]]] = {"triangles": [], "triangles6": []}
    others: dict[str, int] = {}
    names = {3: "triangles", 6: "triangles6"}
    for block in grid.blocks:
        nodes_per_element = block.nodes.shape[1] if block.nodes.ndim == 2 else 0
        if block.is_triangle and nodes_per_element in names:
            arrays[names[nodes_per_element]].append(block.nodes)
        elif len(block.nodes):
            others[block.name] = others.get(block.name, 0) + len(block.nodes)
    points = np.asarray(grid.points, dtype=float)
    if points.ndim == 2 and points.shape[1] == 2:  # a file of the plane
        points = np.column_stack([points, np.zeros(len(points))])
    with open(result, "wb") as file:
        np.savez(
            file,
            points=points.reshape(-1, 3),
            triangles=np.concatenate([np.empty((0, 3), dtype=np.int64), *arrays["triangles"]]),
            triangles6=np.concatenate([np.empty((0, 6), dtype=np.int64), *arrays["triangles6"]]),
            other_names=np.array(list(others), dtype=str),
            other_counts=np.array(list(others.values()), dtype=np.int64),
        )


def main(library: str, path: str, result: str) -> int:
    """Read a file with a library, and write its content or print why that failed.

    Parameters
    ----------
    library : str
        A key of `READERS`.
    path : str
        File to read.
    result : str
        File to write.

    Returns
    -------
    int
        Exit code: 0, or 3 if the file could not be read.
    """
    failure = {"library": library}
    try:
        failure["version"] = version(library)
        save_grid(READERS[library](path), result)
    except (PackageNotFoundError, ModuleNotFoundError) as error:
        failure["missing"] = error.name or library
    except SystemExit:  # by meshio
        failure["reason"] = "it ends the interpreter"
    except Exception as error:
        failure["reason"] = f"{type(error).__name__}: {error}"
    else:
        return 0
    sys.stdout.write("\n" + json.dumps(failure))
    return 3


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))

"""Meshes in the input format of Abaqus and CalculiX: nodes, elements and named sets."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import ClassVar

from pvdf_fem.arrays import Indices
from pvdf_fem.mesh.subdomains import FILM, RIM
from pvdf_fem.view.files.mesh_format import MeshFormat
from pvdf_fem.view.files.mesh_grid import MeshGrid

#: Maximum number of characters of a set's name.
LABEL_LENGTH = 80
#: Maximum number of entries in a line of a set.
IDS_PER_LINE = 16


class Inp(MeshFormat):
    """Nodes, shell or membrane elements, the node set ``rim`` and an element set for each patch.

    Numbers have at most 20 characters: CalculiX 2.20 reads no more, and cuts the end in silence.
    """

    extension = ".inp"
    element_orders: ClassVar[dict[str, int]] = {
        "S6": 2,
        "M3D6": 2,
        "STRI65": 2,
        "CPS6": 2,
        "M3D3": 1,
        "S3": 1,
        "CPS3": 1,
    }

    def write(self, grid: MeshGrid, path: Path, element: str | None) -> None:
        """Write the mesh, with a comment for each set whose name differs from its patch's."""
        assert element is not None
        lines = ["** Mesh of a film in metres, at z = 0"]
        lines += format_grid(grid, element)
        path.write_text("\n".join(lines) + "\n", "ascii")


def format_grid(grid: MeshGrid, element: str) -> Iterator[str]:
    """Format nodes, elements and sets as lines of an input file.

    Parameters
    ----------
    grid : MeshGrid
        The mesh in m. Numbers of nodes and elements in the file start from 1.
    element : str
        Type of the elements, one of ``Inp.element_orders``.

    Yields
    ------
    str
        The lines: the node set ``nodes`` and the element set ``film`` have all nodes and elements.
    """
    yield "*NODE, NSET=nodes"
    for number, (x, y) in enumerate(grid.points, start=1):
        yield f"{number}, {format_number(x)}, {format_number(y)}, 0."
    yield f"*ELEMENT, TYPE={element}, ELSET={FILM}"
    for number, nodes in enumerate((grid.triangles + 1).tolist(), start=1):
        yield f"{number}, {', '.join(map(str, nodes))}"
    yield f"*NSET, NSET={RIM}"
    yield from format_ids(grid.rim_nodes)
    labels = make_labels(grid.patches)
    for name, elements in grid.patches.items():
        label = labels[name]
        if label != name:
            yield f"** {label}: {name.encode('ascii', 'backslashreplace').decode()}"
        yield f"*ELSET, ELSET={label}"
        yield from format_ids(elements)


def format_number(value: float) -> str:
    """Format a number with 13 significant digits and at most 20 characters.

    Parameters
    ----------
    value : float
        The number.

    Returns
    -------
    str
        Such as ``-1.234567890123e-05``.
    """
    return f"{value + 0.0:.12e}"  # adding zero turns -0.0 into 0.0


def format_ids(indices: Indices) -> Iterator[str]:
    """Format the numbers of nodes or elements as lines of a set.

    Parameters
    ----------
    indices : ndarray of int
        Indices of the nodes or elements. Their numbers are one larger.

    Yields
    ------
    str
        A line with up to `IDS_PER_LINE` numbers.
    """
    numbers = [str(index + 1) for index in indices]
    for start in range(0, len(numbers), IDS_PER_LINE):
        yield ", ".join(numbers[start : start + IDS_PER_LINE])


def make_labels(names: Iterable[str]) -> dict[str, str]:
    """Make names of sets that Abaqus and CalculiX accept from names of patches.

    Parameters
    ----------
    names : iterable of str
        Names of patches, such as ``electrode A``.

    Returns
    -------
    dict of str to str
        The labels by name: letters, digits, ``_`` and ``-`` in ASCII, with a letter first and at
        most `LABEL_LENGTH` characters. Both programs ignore the case of letters, so that labels
        also differ in other respects; a number at the end tells equal ones apart.
    """
    labels: dict[str, str] = {}
    used = {FILM, RIM, "nodes"}
    for name in names:
        decomposed = unicodedata.normalize("NFKD", name)
        without_accents = "".join(char for char in decomposed if not unicodedata.combining(char))
        label = re.sub(r"[^A-Za-z0-9_-]", "_", without_accents)
        label = label if label[:1].isalpha() else f"set_{label}"
        label = label[:LABEL_LENGTH]
        candidate = label
        number = 1
        while candidate.lower() in used:
            number += 1
            ending = f"_{number}"
            candidate = label[: LABEL_LENGTH - len(ending)] + ending
        used.add(candidate.lower())
        labels[name] = candidate
    return labels

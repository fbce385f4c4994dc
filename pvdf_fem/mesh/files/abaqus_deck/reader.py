"""Nodes and surface elements of an input deck of Abaqus or CalculiX.

gmsh 4.15 writes this format but cannot read it. meshio 5.3.5 ends the interpreter for most types of
triangles, among them CPS6, which gmsh writes, S6 and M3D3, for types in small letters, and for
numbers with a D; it does not move the instances of parts. So the few keywords that matter are read
here.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.mesh.files.abaqus_deck.elements import count_triangle_nodes, is_point_or_line
from pvdf_fem.mesh.files.abaqus_deck.keywords import (
    DataLine,
    KeywordBlock,
    read_keyword_blocks,
    split_fields,
)
from pvdf_fem.mesh.files.content import MeshContent, MeshFileError

# Larger numbers of nodes are not exact as floats.
_LARGEST_ID = 2**53
# Keywords that make or move nodes and elements in ways that are not read.
_UNSUPPORTED = {"NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY", "SYSTEM"}


@dataclass(eq=False)
class _Part:
    """Nodes and elements with their numbers in the deck."""

    nodes: dict[int, Array] = field(default_factory=dict)  #: Coordinates, shape (3,).
    #: Node numbers of the triangles, by the number of nodes of a triangle.
    triangles: dict[int, list[list[int]]] = field(default_factory=lambda: {3: [], 6: []})
    others: Counter[str] = field(default_factory=Counter)  #: Numbers of other elements by type.


@dataclass(frozen=True, eq=False)
class _Instance:
    """A part in the assembly: moved, then rotated."""

    part: str
    own: _Part  #: Nodes and elements that are defined in the instance itself.
    translation: Array
    axis_point: Array  #: A point on the axis of rotation.
    rotation_vector: Array  #: The axis, as long as the angle in radians.

    def transform(self, points: Array) -> Array:
        """Transform points of the part to the axes of the assembly.

        Parameters
        ----------
        points : ndarray, shape (nodes, 3)
            Points in the axes of the part.

        Returns
        -------
        ndarray, shape (nodes, 3)
        """
        from scipy.spatial.transform import Rotation  # slow to import, and seldom needed

        moved = points + self.translation - self.axis_point
        return Rotation.from_rotvec(self.rotation_vector).apply(moved) + self.axis_point


class _PlacedPart(NamedTuple):
    """A part with the coordinates of its nodes in the assembly."""

    points: Array  #: Shape (nodes, 3).
    triangles: dict[int, Indices]  #: Indices of nodes, by the number of nodes of a triangle.
    others: Counter[str]


class AbaqusReader:
    """A reader of input decks: ``*NODE``, ``*ELEMENT``, ``*INCLUDE``, parts and instances."""

    def read(self, path: Path) -> MeshContent:
        """Read a deck.

        Parameters
        ----------
        path : Path
            The deck.

        Returns
        -------
        MeshContent

        Raises
        ------
        MeshFileError
            If the deck is not valid, has no elements, or generates nodes by keywords.
        """
        deck = _Deck()
        for block in read_keyword_blocks(path):
            deck.add(block)
        content = _join(deck.place_parts())
        if not content.has_elements:
            advice = "write the elements of the film, such as S6 or CPS6"
            raise MeshFileError(f"has no surface elements under *ELEMENT; {advice}")
        return content


class _Deck:
    """The parts and instances of a deck, collected block by block."""

    def __init__(self) -> None:
        self.parts: dict[str, _Part] = {}
        self.instances: list[_Instance] = []
        self.loose = _Part()  # outside of parts
        self.current = self.loose

    def add(self, block: KeywordBlock) -> None:
        """Add a keyword block; keywords without nodes and elements are ignored.

        Parameters
        ----------
        block : KeywordBlock
            The block.

        Raises
        ------
        MeshFileError
            If the keyword is not supported, or a line of data cannot be used.
        """
        if block.name in _UNSUPPORTED or (block.name == "NODE" and "SYSTEM" in block.parameters):
            advice = "write all nodes and elements by number in Cartesian coordinates"
            raise MeshFileError(f"{block.place}: *{block.name}: is not supported here; {advice}")
        if block.name == "PART":
            name = block.parameters.get("NAME", "").upper()
            self.current = self.parts.setdefault(name, _Part())
        elif block.name == "INSTANCE":
            instance = _make_instance(block)
            self.instances.append(instance)
            self.current = instance.own
        elif block.name in ("ENDPART", "ENDINSTANCE", "ASSEMBLY"):
            self.current = self.loose
        elif block.name == "NODE":
            _add_nodes(self.current, block.lines)
        elif block.name == "ELEMENT":
            _add_elements(self.current, block)

    def place_parts(self) -> list[_PlacedPart]:
        """Return all parts, as often as there are instances of them, in the assembly's axes."""
        placed = [_place(self.loose)]
        for instance in self.instances:
            part = self.parts.get(instance.part)
            if part is None and not instance.own.nodes:
                raise MeshFileError(
                    f"*INSTANCE, PART={instance.part}: there is no such part; add *PART"
                )
            placed.extend(
                _place(source, instance) for source in (part, instance.own) if source is not None
            )
        if not self.instances:  # parts without an assembly
            placed.extend(_place(part) for part in self.parts.values())
        return placed


def _make_instance(block: KeywordBlock) -> _Instance:
    """Make an instance from its keyword, a line of its shift and one of its axis and angle."""
    rows = [_parse_numbers(line) for line in block.lines]
    shift = rows[0] if rows else []
    turn = rows[1] if len(rows) > 1 else [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]
    if len(shift) > 3 or len(turn) != 7:
        raise MeshFileError(
            f"{block.place}: *INSTANCE: expected a line of 3 numbers and one of 7 numbers"
            " below it: a shift, and two points of an axis with an angle in degrees; correct them"
        )
    start = np.array(turn[:3])
    axis = np.array(turn[3:6]) - start
    length = float(np.linalg.norm(axis))
    angle = np.radians(turn[6])
    return _Instance(
        part=block.parameters.get("PART", "").upper(),
        own=_Part(),
        translation=np.array([*shift, 0.0, 0.0, 0.0][:3]),
        axis_point=start,
        rotation_vector=angle * axis / length if length else 0.0 * axis,
    )


def _parse_numbers(line: DataLine) -> list[float]:
    """Parse the numbers of a data line, also with a D in the exponent; empty fields are zero."""
    numbers = []
    for text in split_fields(line.text.rstrip(",")):
        try:
            number = float(text.upper().replace("D", "E") or 0.0)
        except ValueError:
            number = np.nan
        if not np.isfinite(number):
            raise MeshFileError(f"{line.place}: {text[:40]!r} is not a number; correct it")
        numbers.append(number)
    return numbers


def _to_id(number: float, line: DataLine) -> int:
    """Return the number of a node as an integer; refuse one that no program can have written."""
    if number != np.floor(number) or abs(number) > _LARGEST_ID:
        raise MeshFileError(f"{line.place}: {number:g} is not the number of a node; correct it")
    return int(number)


def _add_nodes(part: _Part, lines: Iterable[DataLine]) -> None:
    """Add the nodes of data lines: a number and up to three coordinates."""
    for line in lines:
        number, *coordinates = _parse_numbers(line)
        part.nodes[_to_id(number, line)] = np.array([*coordinates, 0.0, 0.0, 0.0][:3])


def _add_elements(part: _Part, block: KeywordBlock) -> None:
    """Add the elements of a block: a number and the nodes, on one or more lines."""
    element_type = block.parameters.get("TYPE", "").upper()
    if not element_type:
        raise MeshFileError(f"{block.place}: *ELEMENT: has no type; add TYPE=, such as TYPE=S6")
    if is_point_or_line(element_type):
        return
    count = count_triangle_nodes(element_type)
    if not count:
        part.others[element_type] += len(block.lines)
        return
    row: list[float] = []
    for line in block.lines:
        row += _parse_numbers(line)
        if len(row) > count + 1:
            reason = f"has {len(row) - 1} nodes, but an element of type {element_type} has {count}"
            raise MeshFileError(f"{line.place}: {reason}; correct the type or the line")
        if len(row) == count + 1:
            part.triangles[count].append([_to_id(number, line) for number in row[1:]])
            row = []
    if row:
        raise MeshFileError(
            f"{block.place}: *ELEMENT, TYPE={element_type}: the last element has"
            f" {len(row) - 1} of {count} nodes; the file may be cut off"
        )


def _place(part: _Part, instance: _Instance | None = None) -> _PlacedPart:
    """Transform a part to the assembly's axes, and count its nodes from zero."""
    numbers = np.array(sorted(part.nodes), dtype=np.int64)
    points = np.array([part.nodes[number] for number in numbers.tolist()]).reshape(-1, 3)
    if instance is not None:
        points = instance.transform(points)
    triangles = {}
    for count, rows in part.triangles.items():
        nodes = np.array(rows, dtype=np.int64).reshape(-1, count)
        unknown = np.setdiff1d(nodes, numbers)
        if len(unknown):
            raise MeshFileError(
                f"has elements with the node {unknown[0]}, which is not defined; add it to *NODE"
            )
        triangles[count] = np.searchsorted(numbers, nodes)
    return _PlacedPart(points, triangles, part.others)


def _join(parts: list[_PlacedPart]) -> MeshContent:
    """Join parts to one mesh."""
    starts = np.cumsum([0, *(len(part.points) for part in parts)])
    nodes: dict[int, list[Indices]] = {3: [], 6: []}
    others: Counter[str] = Counter()
    for part, start in zip(parts, starts[:-1].tolist(), strict=True):
        others += part.others
        for count, triangles in part.triangles.items():
            nodes[count].append(triangles + start)
    return MeshContent(
        points=np.concatenate([part.points for part in parts]),
        triangles=np.concatenate(nodes[3]),
        triangles6=np.concatenate(nodes[6]),
        others=dict(others),
    )

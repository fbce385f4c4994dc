"""Displacements, stresses and strains that CalculiX prints into its ``.dat`` file."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.files import FileError, read_text

#: Maximum size of a file of results.
MAX_BYTES = 500_000_000
#: Heading of a table: quantity, columns, set, and time.
HEADING = re.compile(r"(displacements|stresses|strains) \(.*\) for set \S+ and time +(\S+)")
#: Numbers of columns of a row by quantity: node and components, or element, point and components.
COLUMN_COUNTS = {"displacements": 4, "stresses": 8, "strains": 8}


class _Table(NamedTuple):
    """A table of a file."""

    quantity: str
    time: float
    rows: list[list[float]]


@dataclass(frozen=True, eq=False)
class CalculixResults:
    """The results at the end of the last step.

    Parameters
    ----------
    path : Path
        The file, for error messages.
    displacements : dict of int to ndarray, shape (3,)
        Displacements in m by the number of the node.
    stresses : dict of int to ndarray, shape (6,)
        Mean Cauchy stresses xx, yy, zz, xy, xz, yz in Pa by the number of the element.
    thickness_strains : dict of int to float
        Mean Green-Lagrange strains across the film by the number of the element.
    """

    path: Path
    displacements: dict[int, Array]
    stresses: dict[int, Array]
    thickness_strains: dict[int, float]

    @classmethod
    def read(cls, path: Path) -> CalculixResults:
        """Read a ``.dat`` file.

        Parameters
        ----------
        path : Path
            The file that CalculiX wrote.

        Returns
        -------
        CalculixResults

        Raises
        ------
        FileError
            If the file cannot be read, or lacks one of the tables of a deck.
        """
        if path.suffix.lower() != ".dat":
            advice = "give the file .dat that CalculiX writes beside it"
            raise FileError(f"{path}: is not read; {advice}")
        text = read_text(path, MAX_BYTES, "the file .dat of CalculiX")
        tables = _parse_tables(text, path)
        last = max((table.time for table in tables), default=0.0)
        rows: dict[str, list[list[float]]] = {quantity: [] for quantity in COLUMN_COUNTS}
        for table in tables:
            if table.time == last:
                rows[table.quantity] += table.rows
        for quantity, found in rows.items():
            if not found:
                reason = f"has no table of {quantity}: the run did not finish, or had another deck"
                raise FileError(f"{path}: {reason}; run `ccx` again and read its messages")
        displacements = {int(node): np.array(u) for node, *u in rows["displacements"]}
        stresses = _average_by_element(rows["stresses"])
        strains = _average_by_element(rows["strains"])
        return cls(
            path,
            displacements=displacements,
            stresses=stresses,
            thickness_strains={element: float(strain[2]) for element, strain in strains.items()},
        )

    def select_displacements(self, nodes: Indices) -> Array:
        """Select the displacements of nodes.

        Parameters
        ----------
        nodes : ndarray of int, shape (n,)
            Indices of the nodes.

        Returns
        -------
        ndarray, shape (n, 3)
            In m.
        """
        return np.array([self._find(self.displacements, node, "node") for node in nodes])

    def select_stresses(self, elements: Indices) -> Array:
        """Select the Cauchy stresses of elements.

        Parameters
        ----------
        elements : ndarray of int, shape (n,)
            Indices of the elements.

        Returns
        -------
        ndarray, shape (n, 6)
            Components xx, yy, zz, xy, xz, yz in Pa.
        """
        return np.array([self._find(self.stresses, element, "element") for element in elements])

    def select_thickness_strains(self, elements: Indices) -> Array:
        """Select the Green-Lagrange strains of elements across the film.

        Parameters
        ----------
        elements : ndarray of int, shape (n,)
            Indices of the elements.

        Returns
        -------
        ndarray, shape (n,)
        """
        strains = self.thickness_strains
        return np.array([self._find(strains, element, "element") for element in elements])

    def _find(self, values: dict[int, Array] | dict[int, float], index: int, kind: str) -> object:
        """Return the value of a node or element, whose number is its index plus one.

        Parameters
        ----------
        values : dict
            Values by number.
        index : int
            Index of the node or element.
        kind : {"node", "element"}
            For the message.

        Raises
        ------
        FileError
            If the file has none.
        """
        try:
            return values[int(index) + 1]
        except KeyError:
            reason = f"has no result of {kind} {index + 1}, which the deck has"
            raise FileError(f"{self.path}: {reason}; give the deck of this run") from None


def _parse_tables(text: str, path: Path) -> list[_Table]:
    """Parse the tables of a file; lines of other tables are skipped.

    Raises
    ------
    FileError
        If a row has other numbers of columns, or something that is not a finite number.
    """
    tables: list[_Table] = []
    current: _Table | None = None
    for number, line in enumerate(text.splitlines(), start=1):
        heading = HEADING.match(line.strip())
        if heading:
            current = _Table(heading[1], float(heading[2]), [])
            tables.append(current)
        elif line.strip()[:1].isalpha():
            current = None  # a table that is not needed
        elif line.strip() and current is not None:
            current.rows.append(_parse_row(line, current.quantity, f"{path}, line {number}"))
    return tables


def _parse_row(line: str, quantity: str, place: str) -> list[float]:
    """Parse a row of a table; the name of an orientation at its end is left out.

    Parameters
    ----------
    line : str
        The row.
    quantity : str
        A key of `COLUMN_COUNTS`.
    place : str
        File and number of the line, for the message.

    Returns
    -------
    list of float
    """
    count = COLUMN_COUNTS[quantity]
    try:
        row = [float(word) for word in line.split()[:count]]
    except ValueError:
        row = []
    if len(row) != count or not np.isfinite(row).all():
        raise FileError(f"{place}: is not a row of {count} finite numbers; run `ccx` again")
    return row


def _average_by_element(rows: list[list[float]]) -> dict[int, Array]:
    """Average the rows of each element over its integration points."""
    table = np.array(rows)
    elements, numbers = np.unique(table[:, 0].astype(int), return_inverse=True)
    sums = np.zeros((len(elements), table.shape[1] - 2))
    np.add.at(sums, numbers, table[:, 2:])
    means = sums / np.bincount(numbers)[:, None]
    return dict(zip(elements.tolist(), means, strict=True))

"""The content of a mesh file, whatever its format, and the error of a file that is refused."""

from __future__ import annotations

from dataclasses import dataclass, field

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.files import FileError


class MeshFileError(FileError):
    """A mesh is unusable or does not fit the scene; each argument describes one error."""

    def __str__(self) -> str:
        """Return one line for each error."""
        return "\n".join(self.args)


@dataclass(frozen=True, eq=False)
class MeshContent:
    """Nodes and surface elements of a mesh file; its points, lines and groups are left out.

    Parameters
    ----------
    points : ndarray, shape (nodes, 3)
        All nodes of the file, in the file's unit.
    triangles : ndarray of int, shape (elements, 3)
        Indices of the nodes of each three-node triangle.
    triangles6 : ndarray of int, shape (elements, 6)
        Indices of the nodes of each six-node triangle: three vertices, then the midside nodes
        between the first and second, the second and third, and the third and first of them.
    others : dict of str to int
        Number of elements of every other type by its name in the format, such as quadrangles.
    """

    points: Array
    triangles: Indices
    triangles6: Indices
    others: dict[str, int] = field(default_factory=dict)

    @property
    def has_elements(self) -> bool:
        """Whether the file has an element that is neither a point nor a line."""
        return bool(len(self.triangles) or len(self.triangles6) or self.others)

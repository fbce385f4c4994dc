"""The unit and the place of a mesh, from the size and the centre of its film."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.mesh.files.content import MeshFileError
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.outlines.circle_fit import fit_circle

#: Units of mesh files in m.
UNITS_M = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "µm": 1e-6, "in": 25.4e-3}
#: Maximum difference of width and height of films that are not discs, and maximum distance of their
#: middles, as fractions. The vertices of a coarse mesh miss the extreme points of a curved rim: of
#: an ellipse with 16 sides by up to 4 %. The outlines are compared afterwards.
SIZE_SLACK = 0.2
SHIFT_SLACK = 0.05
# Units that need no note.
_USUAL_UNITS = ("m", "mm")


class Placement(NamedTuple):
    """How coordinates of a mesh file become coordinates of the scene."""

    unit_m: float  #: Size of the unit in m.
    centre: Array  #: Centre of the film in the unit of the file, shape (2,).
    notes: tuple[str, ...]  #: What is unusual.

    def apply(self, points: Array) -> Array:
        """Convert points of the file to the coordinates of the scene.

        Parameters
        ----------
        points : ndarray, shape (nodes, 2)
            Points in the unit of the file.

        Returns
        -------
        ndarray, shape (nodes, 2)
            In m about the film's centre.
        """
        return self.unit_m * (points - self.centre)


def find_placement(border: Array, film: Film, slack: float) -> Placement:
    """Find the unit and the centre of a mesh from the nodes on its boundary.

    A disc about the origin is not moved, even if its centre differs by a fraction of `slack`. Films
    of other shapes are never moved.

    Parameters
    ----------
    border : ndarray, shape (n, 2)
        Nodes on the boundary of the mesh, in an unknown unit.
    film : Film
        The film of the scene.
    slack : float
        Maximum relative difference of the radii of a disc.

    Returns
    -------
    Placement

    Raises
    ------
    MeshFileError
        If the film has another size in every unit, or another shape or place.
    """
    if film.is_disc:
        return _find_disc_placement(border, film.radius, slack=slack)
    return _find_box_placement(border, film)


def _find_box_placement(border: Array, film: Film) -> Placement:
    """Find the unit of a film that is not a disc by its width and height.

    The parameters and the result are those of `find_placement`.
    """
    left, low, right, high = film.bounds_mm
    expected = np.array([right - left, high - low]) / 1e3
    middle = np.array([left + right, low + high]) / 2e3
    size = np.ptp(border, axis=0)
    for name, unit in UNITS_M.items():
        if np.abs(size * unit / expected - 1.0).max() > SIZE_SLACK:
            continue
        shift = 0.5 * (border.min(axis=0) + border.max(axis=0)) - middle / unit
        if np.abs(shift * unit).max() > SHIFT_SLACK * expected.max():
            x, y = shift
            raise MeshFileError(
                f"has its film moved by ({x:.6g}, {y:.6g}) {name} from its place in the scene;"
                " move the mesh there"
            )
        return Placement(unit, np.zeros(2), _describe_unit(name))
    width, height = size
    raise MeshFileError(
        f"has a film of {width:.6g} x {height:.6g}, but that of the scene is a"
        f" {film.describe_outline()}; give it in one of the units {', '.join(UNITS_M)}, or change"
        " the sizes of [film]"
    )


def _find_disc_placement(border: Array, radius_m: float, slack: float) -> Placement:
    """Find the unit and the centre of a disc.

    Parameters
    ----------
    border : ndarray, shape (n, 2)
        Nodes on the boundary of the mesh, in an unknown unit.
    radius_m : float
        Radius of the film in m.
    slack : float
        Maximum relative difference of the radii.

    Returns
    -------
    Placement
    """
    reach = float(np.hypot(border[:, 0], border[:, 1]).max())
    unit = _find_unit(reach, radius_m, slack=slack)
    if unit is not None:
        return Placement(UNITS_M[unit], np.zeros(2), _describe_unit(unit))
    centre = fit_circle(border).centre
    radii = np.linalg.norm(border - centre, axis=1)
    largest = float(radii.max())
    unit = _find_unit(largest, radius_m, slack=slack)
    is_round = radii.min() >= (1.0 - slack) * largest
    x, y = centre
    if unit is None or not is_round:
        size = f"{largest:.6g}" if is_round else f"between {radii.min():.6g} and {largest:.6g}"
        raise MeshFileError(
            f"has a film with the radius {size} about ({_format(x, reach)}, {_format(y, reach)}),"
            f" but film.radius_mm = {1e3 * radius_m:g}; give the whole film in one of the units"
            f" {', '.join(UNITS_M)}, or change film.radius_mm"
        )
    moved = f"the film about ({x:.6g}, {y:.6g}) {unit} was moved to the origin"
    return Placement(UNITS_M[unit], centre, (*_describe_unit(unit), moved))


def _find_unit(reach: float, radius_m: float, slack: float) -> str | None:
    """Find the unit in which a length is the radius of the film.

    Parameters
    ----------
    reach : float
        The length in the unit of the file.
    radius_m : float
        The radius in m.
    slack : float
        Maximum relative difference.

    Returns
    -------
    str or None
        A key of `UNITS_M`; None if the length is not the radius in any of them.
    """
    for name, unit in UNITS_M.items():
        if abs(reach * unit / radius_m - 1.0) <= slack:
            return name
    return None


def _describe_unit(name: str) -> tuple[str, ...]:
    """Return a note on a unit, or nothing if it is a usual one."""
    return () if name in _USUAL_UNITS else (f"its unit was found to be {name}",)


def _format(coordinate: float, reach: float) -> str:
    """Format a coordinate of the centre, without round-off, for messages."""
    return f"{round(coordinate / reach, 9) * reach + 0.0:.6g}"

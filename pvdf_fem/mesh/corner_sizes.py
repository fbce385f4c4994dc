"""Element sizes at the re-entrant corners of a film, where the slope is singular."""

from __future__ import annotations

from pvdf_fem.mesh.size_field import PointSize
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.outlines.reentrant import find_reentrant_corners

#: Constant C of the error due to a re-entrant corner, see `choose_corner_sizes`; measured for the
#: lowest frequency of an L of three squares.
CORNER_ERROR = 0.08


def choose_corner_sizes(
    film: Film, tolerance: float, scale: float, largest: float
) -> tuple[PointSize, ...]:
    """Choose element sizes at the re-entrant corners of a film.

    Parameters
    ----------
    film : Film
        The film.
    tolerance : float
        Relative error of the film's energy due to all corners together.
    scale : float
        Length in m over which the solution varies, away from corners.
    largest : float
        Element size in m that is small enough elsewhere.

    Returns
    -------
    tuple of PointSize
        Sizes below `largest`; none for corners that need no smaller elements.

    Notes
    -----
    The deflection changes by r^α sin(α θ) over the length l, which is the shorter side at the
    corner or, if it is less, `scale`. Elements of the size h at the corner change the energy
    relatively by C (1 - α)² (l/a)² (h/l)^(2 α), where a is the hydraulic radius: the energy of the
    corner's elements, times the fraction of the area that is beside the corner. Without a
    singularity (α = 1) there is no such term.
    """
    corners = tuple(find_reentrant_corners(film.outline))
    sizes = []
    for corner in corners:
        alpha = corner.exponent
        length = min(corner.side, scale)
        strength = CORNER_ERROR * (1.0 - alpha) ** 2 * (length / film.radius) ** 2
        allowed = tolerance / len(corners)
        size = length * float(allowed / strength) ** (0.5 / alpha)
        if size < largest:
            x, y = corner.point.tolist()
            sizes.append(PointSize((x, y), size))
    return tuple(sizes)

"""Mirror symmetry of a scene: the part of the film that has to be solved.

Where a mirror image about a line through the film's centre brings film, probe and electrodes onto
themselves, the displacement is its own mirror image, and one half of the film has all of it; with
two such lines at right angles one quarter has. On a mirror line the film does not move across it.
A film that is equally stiff in all directions is turned to have its mirror lines along the axes; of
any other film only the axes are taken for mirror lines.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

from pvdf_fem.bending_effect import bending_joins
from pvdf_fem.film import Film
from pvdf_fem.outline import TOUCH, Circle, Outline, Polygon, overlaps
from pvdf_fem.scene import Scene

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Part:
    """A part of the film whose mirror images together are the film.

    Attributes
    ----------
    frame : (2, 2)
        Orthogonal matrix from the axes of the scene to those of the part.
    mirrored : tuple of int
        Coordinates, 0 or 1, whose signs the mirror images change: they are positive in the part.
    swaps : tuple of mapping
        For each image, the names of the electrodes onto which it brings each electrode.
    """

    frame: Array = field(default_factory=lambda: np.eye(2))
    mirrored: tuple[int, ...] = ()
    swaps: tuple[Mapping[str, str], ...] = ({},)

    @cached_property
    def signs(self) -> Array:
        """Signs by which an image multiplies the coordinates, (images, 2); the first are 1."""
        choices = [(1.0, -1.0) if axis in self.mirrored else (1.0,) for axis in (0, 1)]
        return np.array(list(product(*choices)))

    def covers(self, outline: Outline, radius: float) -> bool:
        """Whether an outline in the part's axes lies in the part of a film, at least partly."""
        low = [0.0 if axis in self.mirrored else -2.0 * radius for axis in (0, 1)]
        x, y, far = *low, 2.0 * radius
        return overlaps(outline, Polygon(np.array([[x, y], [far, y], [far, far], [x, far]])))


WHOLE = Part()


@lru_cache(maxsize=1024)
def isotropy(film: Film) -> str:
    """In which directions a film is equally stiff: ``axes``, ``square`` or ``isotropic``."""
    C = film.stiffness
    if not np.isclose(C[0, 0], C[1, 1], rtol=1e-12):
        return "axes"
    isotropic = np.isclose(2.0 * C[2, 2], C[0, 0] - C[0, 1], rtol=1e-12)
    return "isotropic" if isotropic else "square"


def part_of(scene: Scene) -> Part:
    """The smallest part of a scene's film that mirror images make the whole of.

    The whole film where a mirror image would not keep the scene to `TOUCH` of the film's radius;
    where nothing presses; and where bending acts, which is not posed on parts.
    """
    if scene.probe is None or scene.load.force == 0.0 or bending_joins(scene):
        return WHOLE
    probe, slack = scene.probe.outline, TOUCH * scene.film.radius
    electrodes = {electrode.name: electrode.outline for electrode in scene.electrode_list}
    isotropic = isotropy(scene.film) == "isotropic"
    for mirror in _mirrors([probe, *electrodes.values()] if isotropic else [], slack):
        swap = _swap(mirror, probe, electrodes, slack)
        if swap is None:
            continue
        across = _swap(-mirror, probe, electrodes, slack)
        frame, axis = _frame(mirror)
        if across is None:
            return Part(frame, (axis,), ({}, swap))
        both = {name: across[image] for name, image in swap.items()}
        return Part(frame, (0, 1), ({}, swap, across, both))
    return WHOLE


def _mirrors(outlines: Sequence[Outline], slack: float) -> Iterator[Array]:
    """Mirror images about the axes, and others that may bring each of the outlines onto itself.

    Those bring the point of the first outline that is farthest from the film's centre to another
    one as far away; if all of the first is at the centre, a point of the others.
    """
    yield np.diag([1.0, -1.0])
    yield np.diag([-1.0, 1.0])
    groups = [_points(outline) for outline in outlines]
    for points in (*groups[:1], np.concatenate(groups[1:]) if groups[1:] else np.empty((0, 2))):
        distance = np.linalg.norm(points, axis=1)
        if distance.max(initial=0.0) > slack:
            x, y = points[distance.argmax()]
            for u, v in points[distance > distance.max() - slack]:
                # the line is at half the sum of both points' angles
                double = np.array([x * u - y * v, x * v + y * u])
                c, s = double / np.linalg.norm(double)
                yield np.array([[c, s], [s, -c]])
            return


def _points(outline: Outline) -> Array:
    return outline.centre[None] if isinstance(outline, Circle) else outline.vertices


def _frame(mirror: Array) -> tuple[Array, int]:
    """The turn that brings the line of a mirror image to an axis, and the coordinate across it."""
    (cosine, sine), _ = mirror
    if sine == 0.0:
        return np.eye(2), 1 if cosine > 0.0 else 0
    # the line is at half the angle
    c, s = np.sqrt(0.5 * (1.0 + cosine)), np.copysign(np.sqrt(0.5 * (1.0 - cosine)), sine)
    return np.array([[c, s], [-s, c]]), 1


def _swap(
    mirror: Array, probe: Outline, electrodes: Mapping[str, Outline], slack: float
) -> dict[str, str] | None:
    """The electrodes' names by those of their images; None if something has no image."""
    if not _brings(mirror, probe, probe, slack):
        return None
    swap = {}
    for name, outline in electrodes.items():
        images = (b for b, other in electrodes.items() if _brings(mirror, outline, other, slack))
        image = next(images, None)
        if image is None:
            return None
        swap[name] = image
    return swap


def _brings(mirror: Array, a: Outline, b: Outline, slack: float) -> bool:
    """Whether a mirror image brings the outline `a` onto `b`."""
    if isinstance(a, Circle) or isinstance(b, Circle):
        if not (isinstance(a, Circle) and isinstance(b, Circle)):
            return False
        away = np.abs(mirror @ a.centre - b.centre).max()
        return bool(max(away, abs(a.radius - b.radius)) <= slack)
    if len(a.vertices) != len(b.vertices):
        return False
    image = a.vertices[::-1] @ mirror.T
    first = np.abs(b.vertices - image[0]).max(axis=1).argmin()
    return bool(np.abs(np.roll(b.vertices, -first, axis=0) - image).max() <= slack)

"""Mirror symmetry of a scene: the part of the film that has to be solved.

Where a mirror image about a line through the film's centre brings film, probe and electrodes onto
themselves, the displacement is its own mirror image, and one half of the film has all of it; with
two such lines at right angles one quarter has. On a mirror line the film does not move across it.
A film that is equally stiff in all directions is turned to have its mirror lines along the axes; of
any other film only the axes are taken for mirror lines.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import product

import numpy as np
import shapely
from numpy.typing import NDArray

from pvdf_fem.film.bending_effect import bending_joins
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.outline import TOUCH, Circle, Outline, Polygon, mapped, overlaps
from pvdf_fem.scene.scene import Scene

Array = NDArray[np.float64]

# Images of electrodes where the scene has none cost as many elements as the electrodes themselves.
# Under a disc anywhere that leaves 0.84 of the time at 1e-3, 0.78 at 1e-4 and 0.61 at 1e-5;
# tolerances up to this one are worth it.
FINE = 1e-4
# Gaps and overlaps of less than this part of the smallest electrode's size are narrow: too small
# elements between electrodes and images take more time than there is to win.
NARROW = 0.01
# Outlines that coincide have centroids that differ by less than so many times what corners may.
NEAR = 1e3


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
        For each image, the names of what it brings each electrode onto where that is another one:
        an electrode of the scene, or one of `images`.
    images : mapping
        Outlines, in the part's axes, of electrodes' images where the scene has no electrode, with
        the electrodes' names.
    """

    frame: Array = field(default_factory=lambda: np.eye(2))
    mirrored: tuple[int, ...] = ()
    swaps: tuple[Mapping[str, str], ...] = ({},)
    images: Mapping[str, tuple[str, Outline]] = field(default_factory=dict)

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

    The whole film where a mirror image would not keep film and probe to `TOUCH` of the film's
    radius; where nothing presses; and where bending acts, which is not posed on parts. Electrodes
    have to be each other's images too, or for a fine mesh their images to lie well apart.
    """
    if scene.probe is None or scene.load.force == 0.0 or bending_joins(scene):
        return WHOLE
    probe, slack = scene.probe.outline, TOUCH * scene.film.radius
    others = []
    for mirror in _mirrors(scene, probe, slack):
        if not _coincide(mapped(probe, mirror), probe, slack):
            continue
        frame, axis = _frame(mirror)
        quarter = _coincide(mapped(probe, -mirror), probe, slack)
        for mirrored in ((0, 1), (axis,)) if quarter else ((axis,),):
            part = _part(frame, mirrored, scene, slack)
            if not part.images:
                return part
            others.append(part)
    if scene.numerics.tolerance <= FINE:
        return next((part for part in others if _lie_apart(part, scene)), WHOLE)
    return WHOLE


def _part(frame: Array, mirrored: tuple[int, ...], scene: Scene, slack: float) -> Part:
    """A part with what its images bring each electrode onto."""
    places = {name: mapped(outline, frame) for name, outline in _electrodes(scene).items()}
    names, centres = list(places), np.reshape([o.centroid for o in places.values()], (-1, 2))
    swaps: list[dict[str, str]] = [{}]
    images = {}
    for number, signs in enumerate(Part(frame, mirrored).signs[1:], 1):
        swap = {}
        for name, outline in places.items():
            image = mapped(outline, np.diag(signs))
            near = np.flatnonzero(np.abs(centres - image.centroid).max(axis=1) <= NEAR * slack)
            onto = (names[i] for i in near if _coincide(image, places[names[i]], slack))
            swap[name] = next(onto, f"{name}/{number}")
            if swap[name] not in places:
                images[swap[name]] = name, image
        swaps.append(swap)
    return Part(frame, mirrored, tuple(swaps), images)


def _lie_apart(part: Part, scene: Scene) -> bool:
    """Whether the electrodes and their images leave no gaps and overlaps that are very narrow."""
    radius = scene.film.radius
    outlines = [mapped(outline, part.frame) for outline in _electrodes(scene).values()]
    outlines += [outline for _, outline in part.images.values()]
    inside = [outline for outline in outlines if part.covers(outline, radius)]
    lines = [outline.shape.exterior for outline in inside]
    for axis in part.mirrored:
        end = radius * np.eye(2)[1 - axis]
        lines.append(shapely.LineString([-end, end]))
    narrow = NARROW * min(np.sqrt(outline.area) for outline in inside)
    return bool(shapely.minimum_clearance(shapely.unary_union(lines)) > narrow)


def _electrodes(scene: Scene) -> dict[str, Outline]:
    return {electrode.name: electrode.outline for electrode in scene.electrode_list}


def _mirrors(scene: Scene, probe: Outline, slack: float) -> Iterator[Array]:
    """Mirror images that the film allows and that may bring a probe onto itself: matrices (2, 2).

    Those about the axes. Others bring the probe's farthest point from the film's centre to another
    one as far away, or, of a probe at the centre, a point of the electrodes.
    """
    yield np.diag([1.0, -1.0])
    yield np.diag([-1.0, 1.0])
    if isotropy(scene.film) != "isotropic":
        return
    points = _points([probe])
    if np.abs(points).max() <= slack:
        points = _points(_electrodes(scene).values())
    distance = np.linalg.norm(points, axis=1)
    if distance.max(initial=0.0) <= slack:
        return
    x, y = points[distance.argmax()]
    for u, v in points[distance > distance.max() - slack]:
        # the line is at half the sum of both points' angles
        c, s = np.array([x * u - y * v, x * v + y * u]) / np.hypot(x, y) / np.hypot(u, v)
        yield np.array([[c, s], [s, -c]])


def _points(outlines: Iterable[Outline]) -> Array:
    """Centres of discs and vertices of polygons, (n, 2)."""
    points = [o.centre[None] if isinstance(o, Circle) else o.vertices for o in outlines]
    return np.concatenate([np.empty((0, 2)), *points])


def _frame(mirror: Array) -> tuple[Array, int]:
    """The turn that brings the line of a mirror image to an axis, and the coordinate across it."""
    (cosine, sine), _ = mirror
    if sine == 0.0:
        return np.eye(2), 1 if cosine > 0.0 else 0
    # the line is at half the angle
    c, s = np.sqrt(0.5 * (1.0 + cosine)), np.copysign(np.sqrt(0.5 * (1.0 - cosine)), sine)
    return np.array([[c, s], [-s, c]]), 1


def _coincide(a: Outline, b: Outline, slack: float) -> bool:
    """Whether two outlines are the same, vertex by vertex."""
    if isinstance(a, Circle) or isinstance(b, Circle):
        if not (isinstance(a, Circle) and isinstance(b, Circle)):
            return False
        return bool(max(*np.abs(a.centre - b.centre), abs(a.radius - b.radius)) <= slack)
    if len(a.vertices) != len(b.vertices):
        return False
    first = np.abs(b.vertices - a.vertices[0]).max(axis=1).argmin()
    return bool(np.abs(np.roll(b.vertices, -first, axis=0) - a.vertices).max() <= slack)

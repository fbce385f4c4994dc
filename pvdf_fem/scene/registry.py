"""The shapes, loads, pressure profiles, material laws and observables that a scene may name.

To add one, write its class in a file of its own and add a line here. Classes other than shapes are
given as texts ``module:Class``, so that a scene is read without importing the solver.
"""

from __future__ import annotations

from typing import NamedTuple

from pvdf_fem.scene.shapes.circle import CircleShape
from pvdf_fem.scene.shapes.ellipse import EllipseShape
from pvdf_fem.scene.shapes.polygon import PolygonShape
from pvdf_fem.scene.shapes.polyline import PolylineShape
from pvdf_fem.scene.shapes.rectangle import RectangleShape
from pvdf_fem.scene.shapes.shape import Shape
from pvdf_fem.scene.shapes.sphere import SphereShape
from pvdf_fem.scene.shapes.square import SquareShape
from pvdf_fem.scene.shapes.triangle import TriangleShape

#: Shapes of electrodes, patches and probes, by the value of ``shape``.
FLAT_SHAPES: dict[str, type[Shape]] = {
    "circle": CircleShape,
    "ellipse": EllipseShape,
    "rectangle": RectangleShape,
    "square": SquareShape,
    "triangle": TriangleShape,
    "polygon": PolygonShape,
    "polyline": PolylineShape,
}
#: Shapes of probes.
PROBE_SHAPES: dict[str, type[Shape]] = {**FLAT_SHAPES, "sphere": SphereShape}

#: Class of each ``load.kind``.
LOAD_CLASSES = {
    "dead": "pvdf_fem.film.loads.probe_load:DeadPressure",
    "follower": "pvdf_fem.film.loads.probe_load:FollowerPressure",
    "rigid": "pvdf_fem.film.loads.punch:Punch",
    "contact": "pvdf_fem.film.loads.rigid_tip:RigidTip",
}

#: Classes of loads on the whole film, by the film's keys.
FILM_LOAD_CLASSES = {
    "pressure_Pa": "pvdf_fem.film.loads.film_load:FilmPressure",
    "gravity_m_s2": "pvdf_fem.film.loads.weight:Weight",
}
#: Classes of supports that hold the film from outside, by the keys of film and patches.
SUPPORT_CLASSES = {"backing_N_m3": "pvdf_fem.film.backing:Backing"}
#: Class of each ``film.law``.
LAW_CLASSES = {
    "hooke": "pvdf_fem.film.laws.law:Hooke",
    "neo-hookean": "pvdf_fem.film.laws.neo_hookean:NeoHookean",
}


class ProfileEntry(NamedTuple):
    """The class of a pressure profile, and the outlines for which it is valid."""

    path: str  #: ``module:Class``.
    needs_ellipse: bool = False  #: Whether the outline must be a circle or an ellipse.
    is_symmetric: bool = True  #: Whether the profile has the symmetries of the outline.


#: Named ``load.profile`` values.
PROFILE_ENTRIES = {
    "uniform": ProfileEntry("pvdf_fem.film.loads.profiles:Uniform"),
    "hertz": ProfileEntry("pvdf_fem.film.loads.profiles:Hertz", needs_ellipse=True),
    "gaussian": ProfileEntry("pvdf_fem.film.loads.profiles:Gaussian"),
}
#: Entry of all profiles that are read from a file.
TABLE_ENTRY = ProfileEntry("pvdf_fem.film.loads.profiles:TableProfile", is_symmetric=False)
#: Separates the path of a profile file from the SHA-256 digest of its content.
DIGEST_MARK = "#sha256="


class ObservableEntry(NamedTuple):
    """The class of an observable, and the electrodes for which it is valid."""

    path: str  #: ``module:Class``.
    needs_edges: bool = False  #: Whether electrodes must be rectangles along x and y.


#: Each ``numerics.observable``.
OBSERVABLE_ENTRIES = {
    "material": ObservableEntry("pvdf_fem.electrodes.observables:Material"),
    "thesis-edge": ObservableEntry("pvdf_fem.electrodes.observables:ThesisEdge", needs_edges=True),
}

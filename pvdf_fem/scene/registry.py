"""The loads and observables that a scene may name, and the classes that they stand for.

A further one is a class in a file of its own and its line here. Classes are given as
``module:Class``, since scenes are read without the modules that solve them.
"""

from __future__ import annotations

from typing import NamedTuple

#: Class of each ``load.kind``.
LOAD_CLASSES = {
    "dead": "pvdf_fem.film.loads:DeadPressure",
    "follower": "pvdf_fem.film.loads:FollowerPressure",
    "rigid": "pvdf_fem.film.loads:Punch",
}


class ObservableEntry(NamedTuple):
    """The class of an observable, and whether its electrodes have to be upright rectangles."""

    path: str
    needs_edges: bool = False


#: Each ``numerics.observable``.
OBSERVABLE_ENTRIES = {
    "material": ObservableEntry("pvdf_fem.charges.observables:Material"),
    "thesis-edge": ObservableEntry("pvdf_fem.charges.observables:ThesisEdge", needs_edges=True),
}

"""A solved film for maps, views in 3-D and files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from skfem import MeshTri2

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.point_values import PointValues, evaluate_in_elements
from pvdf_fem.film.term import State
from pvdf_fem.problem.contact_result import ContactResult
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class FilmData:
    """Fields of a solved film and its electrodes' charges."""

    equilibrium: Equilibrium  #: Equations of the whole film.
    state: State  #: Their solution.
    unknowns: int  #: Number of equations, of a part of the film where only a part was solved.
    #: charges_pC, charge_errors_pC: By electrode.
    charges_pC: dict[str, float]
    charge_errors_pC: dict[str, float]
    contacts: dict[str, ContactResult]  #: What tips do, by patch.
    included: Sequence[str]  #: What the model has beyond the membrane.
    #: Element shares in charge errors in C, (elements, electrodes).
    error_shares: Callable[[], Array]

    @property
    def scene(self) -> Scene:
        """The film's scene."""
        return self.equilibrium.scene

    @property
    def mesh(self) -> MeshTri2:
        """Mesh in m."""
        return self.equilibrium.space.mesh

    def in_elements(self, local: Array) -> PointValues:
        """Values at local points (2, points) in the elements, (elements, points)."""
        return evaluate_in_elements(self.equilibrium, self.state, local)

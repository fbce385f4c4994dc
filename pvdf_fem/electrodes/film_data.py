"""The data of a solution that maps, 3-D views and files show."""

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
    """Fields of a solved film and the charges of its electrodes."""

    equilibrium: Equilibrium  #: Equations of the whole film.
    state: State  #: Their solution.
    unknowns: int  #: Number of equations that were solved, perhaps of a sector of the film.
    charges_pC: dict[str, float]  #: Charges by electrode.
    charge_errors_pC: dict[str, float]  #: Their estimated errors.
    contacts: dict[str, ContactResult]  #: Contacts of indenter tips, by patch.
    included: Sequence[str]  #: Included effects beyond the membrane.
    #: Function that computes the contributions of the elements to the charge errors in C, shape
    #: (elements, electrodes).
    error_contributions: Callable[[], Array]

    @property
    def scene(self) -> Scene:
        """The scene that was solved."""
        return self.equilibrium.scene

    @property
    def mesh(self) -> MeshTri2:
        """The mesh in m."""
        return self.equilibrium.space.mesh

    def in_elements(self, local: Array) -> PointValues:
        """Evaluate the fields at the same local points of all elements.

        Parameters
        ----------
        local : ndarray, shape (2, points)
            Points in local coordinates of the reference triangle.

        Returns
        -------
        PointValues
            With the shape (elements, points).
        """
        return evaluate_in_elements(self.equilibrium, self.state, local)

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
    """A solution on the whole film, with the charges of the electrodes."""

    equilibrium: Equilibrium  #: Equations of the whole film.
    state: State  #: Solution of `equilibrium`.
    #: Number of unknowns that were solved for, which may cover only a symmetry sector of the film.
    unknowns: int
    charges_pC: dict[str, float]  #: Charge of each electrode by its name.
    charge_errors_pC: dict[str, float]  #: Estimated error of each charge by the electrode's name.
    rest_charges_pC: dict[str, float]  #: Charge of each electrode without load; may be NaN.
    contacts: dict[str, ContactResult]  #: Contact of each rigid tip, by the name of its subdomain.
    #: Descriptions of the effects beyond the plain membrane that the solution includes.
    included: Sequence[str]
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
            Values whose arrays begin with the axes (elements, points).
        """
        return evaluate_in_elements(self.equilibrium, self.state, local)

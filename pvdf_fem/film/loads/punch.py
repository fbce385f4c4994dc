"""Rigid flat punches.

Under a punch that stays horizontal the deflection is a single unknown; under a punch that tilts
freely it is a linear function with three unknowns. The film slides on the punch or sticks to it.
Under a sticking punch in a guide u = v = 0; with a tangential force u and v are an unknown each.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.film.loads.load_spec import LoadSpec
from pvdf_fem.film.loads.probe_load import DeadPressure
from pvdf_fem.film.space import Space
from pvdf_fem.film.term import NO_INDICES, CombinedMotion, Constraints, ElementForces, State
from pvdf_fem.mesh.symmetry import WHOLE_FILM, SymmetrySector


@dataclass(frozen=True)
class PunchTilt:
    """The tilt of a punch, and the moments by which its guide resists the tilt.

    Each pair has the values about the axes along x and along y through the punch's centroid.
    """

    tilt_deg: tuple[float, float]
    moments_N_mm: tuple[float, float]


class Punch(DeadPressure):
    """A rigid flat punch under a dead force.

    Parameters
    ----------
    spec : LoadSpec
        The probe and its load.
    space : Space
        The finite-element space of the solved sector.
    sector : SymmetrySector
        The solved sector of the film.
    """

    is_rigid = True
    edge_fraction = 1.0

    def __init__(self, spec: LoadSpec, space: Space, sector: SymmetrySector = WHOLE_FILM) -> None:
        super().__init__(spec, space, sector)
        self._nodes: Indices = np.unique(space.basis.element_dofs[:, self.patch])
        #: Vectors from the punch's centroid to its nodes in m, in the sector's axes, shape
        #: (nodes, 2).
        self._arms: Array = (
            space.basis.doflocs.T[self._nodes] - sector.frame @ spec.outline.centroid
        )
        self.constraints = self._make_constraints()

    def _make_constraints(self) -> Constraints:
        """Make the constraints on the dofs under the punch.

        The in-plane dofs u and v are zero for a sticking punch and free for a sliding one; under a
        tangential force all u are one unknown and all v another. The deflection w is one unknown,
        or a linear function if the punch tilts freely.
        """
        u, v, w = 3 * self._nodes, 3 * self._nodes + 1, 3 * self._nodes + 2
        load = self.spec.load
        fixed = NO_INDICES
        shared: list[Indices] = []
        motions: list[CombinedMotion] = []
        if load.tangential_N is not None:
            shared += [u, v]
        elif load.contact == "stuck":
            fixed = np.concatenate([u, v])
        if load.tilt == "free":
            scaled_arms = self._arms / np.sqrt(self.spec.outline.area)
            functions = np.column_stack([np.ones(len(w)), scaled_arms])
            motions.append(CombinedMotion(w, functions))
        else:
            shared.append(w)
        return Constraints(
            fixed_dofs=fixed,
            shared_dofs=tuple(shared),
            motions=tuple(motions),
            rigid_elements=self.patch,
        )

    def through_thickness_forces(self, state: State, residual: Array) -> ElementForces:
        """Return the forces that press on the film: the reactions along z under the punch.

        The reaction at a node is distributed equally to the elements of the patch that share it.
        """
        node_count = self.space.basis.N
        nodes = self.space.nodes[self.patch]
        element_counts = np.maximum(np.bincount(nodes.ravel(), minlength=node_count), 1)
        # without the load's own forces, the residual is what the punch transmits to the film
        reactions = (residual + self.forces(state))[2::3][:node_count]
        reactions_per_element = reactions / element_counts
        return ElementForces(self.patch, reactions_per_element[nodes].sum(axis=1))

    def compute_tilt(self, state: State, residual: Array) -> PunchTilt:
        """Compute the tilt of the punch and the moments of its guide.

        Parameters
        ----------
        state : State
            The state of the whole film, not of a sector.
        residual : ndarray, shape (dofs,)
            The residual of all terms at this state in N, which contains the reactions.
        """
        w = 3 * self._nodes + 2
        columns = np.column_stack([np.ones(len(w)), self._arms])
        # a rotation about x tilts the punch along y; one about y tilts it along x, in the negative
        # sense
        _, slope_x, slope_y = np.linalg.lstsq(columns, state.dofs[w], rcond=None)[0]
        tilt_x, tilt_y = np.degrees(np.arctan([slope_y, -slope_x])).tolist()
        reactions = (residual + self.forces(state))[w]
        sum_x, sum_y = (1e3 * (reactions @ self._arms)).tolist()  # of arm times reaction, in N mm
        return PunchTilt((tilt_x, tilt_y), (sum_y, -sum_x))

"""Results about the contact between a tip and the film."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.film.loads.contact_edge import POORER_DEGREE, locate_contact_edge
from pvdf_fem.film.loads.rigid_tip import RigidTip
from pvdf_fem.film.term import State
from pvdf_fem.problem.equilibrium import Equilibrium


@dataclass(frozen=True, eq=False)
class ContactResult:
    """A tip in contact with the film.

    Areas are those of touching film, pressures act on the deformed film. The tip's guide bears the
    lateral force, and the moments about axes through the tip's lowest point.
    """

    depth_mm: float  #: Of the tip's lowest point.
    force_N: float  #: Along z, on the film.
    lateral_N: Array  #: The film's force on the tip along x and y, shape (2,).
    moments_N_mm: Array  #: About axes along x and y, shape (2,).
    area_mm2: float  #: Before the film deforms.
    area_error_mm2: float  #: Estimated.
    projected_area_mm2: float  #: Deformed, seen along z.
    #: Points on the undeformed film along the contact's edge, (n, 2).
    edge_mm: Array = field(repr=False)
    mean_pressure_MPa: float  #: The force over the projected area.
    least_pressure_MPa: float
    largest_pressure_MPa: float
    overlap_mm: float  #: Largest overlap of film and tip at a quadrature point, by the penalty.

    def to_json(self) -> dict[str, Any]:
        """Return the values for JSON, without the points of the edge."""
        table = {**vars(self)}
        table.pop("edge_mm")
        return {key: np.asarray(value).tolist() for key, value in table.items()}

    @classmethod
    def from_state(cls, tip: RigidTip, state: State, thickness: float) -> Self:
        """Compute the contact of a tip.

        Parameters
        ----------
        tip : RigidTip
            The tip.
        state : State
            The state of the whole film.
        thickness : float
            The film's thickness in m.
        """
        overlap = tip.overlap(state)
        weights = tip.space.weights
        # forces on the film at the quadrature points, and their arms from the lowest point
        forces = -overlap.rates * tip.tractions(state)[..., None]
        fx, fy, fz = np.moveaxis(forces, -1, 0)
        places = tip.compute_deformed_points(state.dofs)
        arm_x, arm_y = np.moveaxis(places[..., :2] - tip.spec.outline.centroid, -1, 0)
        arm_z = places[..., 2] - overlap.depth
        moments = np.array([(arm_y * fz - arm_z * fy).sum(), (arm_z * fx - arm_x * fz).sum()])
        force = float(fz.sum())

        edge = locate_contact_edge(tip, state)
        area = tip.tip.fit_outline(edge).area
        poorer_edge = locate_contact_edge(tip, state, POORER_DEGREE)
        poorer_area = tip.tip.fit_outline(poorer_edge).area
        # quadrature points cover the contact only roughly: its area corrects their sum
        touching_weights = weights * overlap.is_touching
        correction = area / float(touching_weights.sum())
        area_ratio = np.linalg.det(state.deformation_gradient[..., :2, :])
        projected_area = correction * float((touching_weights * area_ratio).sum())

        pressure = tip.compute_pressure(state, thickness)
        return cls(
            depth_mm=1e3 * overlap.depth,
            force_N=force,
            lateral_N=-np.array([fx.sum(), fy.sum()]),
            moments_N_mm=-1e3 * moments,
            area_mm2=1e6 * area,
            area_error_mm2=1e6 * abs(poorer_area - area),
            projected_area_mm2=1e6 * projected_area,
            edge_mm=1e3 * edge,
            mean_pressure_MPa=1e-6 * force / projected_area,
            least_pressure_MPa=1e-6 * float(pressure[overlap.is_touching].min()),
            largest_pressure_MPa=1e-6 * float(pressure.max()),
            overlap_mm=1e3 * float(overlap.value.max()),
        )


def select_tips(equilibrium: Equilibrium) -> list[RigidTip]:
    """Return the tips that press on a film."""
    return [term for term in equilibrium.terms if isinstance(term, RigidTip)]


def compute_contact_results(equilibrium: Equilibrium, state: State) -> dict[str, ContactResult]:
    """Compute the contacts of all tips, by the names of their patches."""
    thickness = equilibrium.film.thickness
    return {
        tip.spec.patch: ContactResult.from_state(tip, state, thickness)
        for tip in select_tips(equilibrium)
    }


def compute_contact_pressure(equilibrium: Equilibrium, state: State) -> Array:
    """Compute the pressure of tips on the deformed film.

    Returns
    -------
    ndarray, shape (elements, points)
        Pressure in Pa at the quadrature points; 0 where no tip touches.
    """
    total = np.zeros(equilibrium.space.weights.shape)
    for tip in select_tips(equilibrium):
        total += tip.compute_pressure(state, equilibrium.film.thickness)
    return total

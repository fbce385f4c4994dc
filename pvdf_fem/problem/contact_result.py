"""Contact between a tip and the film."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.film.loads.contact_edge import DEGREES, locate_contact_edge
from pvdf_fem.film.loads.rigid_tip import RigidTip
from pvdf_fem.film.term import State
from pvdf_fem.problem.equilibrium import Equilibrium


@dataclass(frozen=True, eq=False)
class ContactResult:
    """A tip in contact with the film. Areas are areas of touching film, pressures act on the
    deformed film; the guide bears what is lateral and the moments about axes through the lowest
    point."""

    depth_mm: float  #: Of the tip's lowest point.
    force_N: float  #: Along z, on the film.
    lateral_N: Array  #: The film's force on the tip along x and y, (2,).
    moments_N_mm: Array  #: About axes along x and y, (2,).
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
        """Its values but for the points of its edge."""
        table = {**vars(self)}
        table.pop("edge_mm")
        return {key: np.asarray(value).tolist() for key, value in table.items()}

    @classmethod
    def of(cls, equilibrium: Equilibrium, tip: RigidTip, state: State) -> Self:
        """The touchdown of a tip."""
        overlap, weights = tip.overlap(state), tip.space.weights
        forces = -overlap.rates * tip.tractions(state)[..., None]
        fx, fy, fz = forces.sum(axis=(0, 1))
        places = tip.compute_places(state.dofs)
        arms = places[..., :2] - tip.spec.outline.centroid
        risen = places[..., 2] - overlap.depth
        moments = [
            (arms[..., 1] * forces[..., 2] - risen * forces[..., 1]).sum(),
            (risen * forces[..., 0] - arms[..., 0] * forces[..., 2]).sum(),
        ]
        pressure = tip.compute_pressure(state, equilibrium.film.thickness)
        touching = overlap.is_touching
        projected = weights * touching * np.linalg.det(state.deformation_gradient[..., :2, :])
        edge, poorer = (locate_contact_edge(tip, state, degree) for degree in DEGREES)
        area = tip.tip.fit_outline(edge).area
        # the points that touch cover the area only roughly
        share = area / float((weights * touching).sum())
        seen = share * float(projected.sum())
        return cls(
            1e3 * overlap.depth,
            float(fz),
            -np.array([fx, fy]),
            -1e3 * np.array(moments),
            1e6 * area,
            1e6 * abs(tip.tip.fit_outline(poorer).area - area),
            1e6 * seen,
            1e3 * edge,
            1e-6 * float(fz) / seen,
            1e-6 * float(pressure[touching].min()),
            1e-6 * float(pressure.max()),
            1e3 * float(overlap.value.max()),
        )


def select_tips(equilibrium: Equilibrium) -> list[RigidTip]:
    """The tips on which a film rests."""
    return [term for term in equilibrium.terms if isinstance(term, RigidTip)]


def compute_contact_results(equilibrium: Equilibrium, state: State) -> dict[str, ContactResult]:
    """Contacts by the names of the tips' patches."""
    tips = select_tips(equilibrium)
    return {tip.spec.patch: ContactResult.of(equilibrium, tip, state) for tip in tips}


def compute_contact_pressure(equilibrium: Equilibrium, state: State) -> Array:
    """Pressure of tips on the deformed film in Pa at the quadrature points, 0 where none touches,
    (elements, points)."""
    tips, thickness = select_tips(equilibrium), equilibrium.film.thickness
    pressures = (tip.compute_pressure(state, thickness) for tip in tips)
    return sum(pressures, np.zeros(equilibrium.space.weights.shape))

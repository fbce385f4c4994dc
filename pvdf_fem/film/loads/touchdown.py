"""What a tip and the film do to each other where they touch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.loads.contact import Contact
from pvdf_fem.film.loads.contact_edge import Edge
from pvdf_fem.film.term import State


@dataclass(frozen=True, eq=False)
class Touchdown:
    """A tip in contact with the film. Areas are of the film that touches, pressures on the deformed
    film; the guide bears what is lateral and the moments about axes through the lowest point."""

    depth_mm: float  #: Of the tip's lowest point.
    force_N: float  #: Along z, on the film.
    lateral_N: Array  #: The film's force on the tip along x and y, (2,).
    moments_N_mm: Array  #: About axes along x and y, (2,).
    area_mm2: float  #: Before the film deforms.
    deformed_area_mm2: float
    projected_area_mm2: float  #: Deformed, seen along z.
    #: Points of the film, before it deforms, along the contact's edge, (n, 2).
    edge_mm: Array = field(repr=False)
    mean_pressure_MPa: float
    least_pressure_MPa: float
    largest_pressure_MPa: float
    #: How far a node lies in the tip: how well the discrete contact is complementary.
    penetration_mm: float
    #: How far the film reaches into the tip between nodes, at the worst quadrature point.
    overlap_mm: float

    def to_json(self) -> dict[str, Any]:
        """Its values but for the points of its edge."""
        table = {**vars(self)}
        table.pop("edge_mm")
        return {key: np.asarray(value).tolist() for key, value in table.items()}

    @classmethod
    def of(cls, equilibrium: Equilibrium, contact: Contact, edge: Edge, state: State) -> Self:
        """The touchdown on the tip of a contact in equilibrium."""
        x = state.dofs.reshape(-1, 3)[contact.nodes]
        depth, forces = contact.depth_of(state.dofs), equilibrium.film_forces(state)
        fx, fy, fz = forces.reshape(-1, 3)[contact.nodes].T
        arms = contact.places + x[:, :2] - contact.touch.outline.centroid
        rise = x[:, 2] - depth
        moments = [arms[:, 1] @ fz - rise @ fy, rise @ fx - arms[:, 0] @ fz]
        weights, (_, pressure) = (
            contact.space.weights[contact.patch],
            contact.traction(state, equilibrium.film.thickness),
        )
        F = state.deformation_gradient[contact.patch]
        deformed = weights * np.linalg.norm(np.cross(F[..., 0], F[..., 1]), axis=-1)
        projected = weights * np.linalg.det(F[..., :2, :])
        # the edge on the mesh is not quite where it should be
        area = 1e6 * edge.fitted.area / float(weights.sum())
        return cls(
            1e3 * depth,
            float(fz.sum()),
            -np.array([fx.sum(), fy.sum()]),
            -1e3 * np.array(moments),
            1e6 * edge.fitted.area,
            area * float(deformed.sum()),
            area * float(projected.sum()),
            1e3 * np.array(edge.fitted.shape.exterior.coords),
            1e-6 * float((pressure * deformed).sum() / deformed.sum()),
            1e-6 * float(pressure.min()),
            1e-6 * float(pressure.max()),
            1e3 * contact.penetration(state),
            1e3 * contact.overlap(state),
        )


def tips_of(equilibrium: Equilibrium) -> list[Contact]:
    """The tips on which a film rests."""
    return [term for term in equilibrium.terms if isinstance(term, Contact)]


def edges_of(equilibrium: Equilibrium, state: State) -> tuple[Edge, ...]:
    """The edges of the contacts with tips."""
    forces, membrane = equilibrium.film_forces(state), equilibrium.membrane
    return tuple(contact.edge(membrane, state, forces) for contact in tips_of(equilibrium))


def overlap_at(equilibrium: Equilibrium, x: Array, edges: Sequence[Edge]) -> float:
    """Largest overlap of film and a tip where their contact ends, over the tip's depth."""
    pairs = zip(tips_of(equilibrium), edges, strict=True)
    return max(edge.penetration / contact.depth_of(x) for contact, edge in pairs)

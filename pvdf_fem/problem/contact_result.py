"""Results of the contact between a rigid tip and the film."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.film.loads.contact_edge import POORER_DEGREE, locate_contact_edge
from pvdf_fem.film.loads.rigid_tip import Overlap, RigidTip
from pvdf_fem.film.term import State
from pvdf_fem.problem.equilibrium import Equilibrium


@dataclass(frozen=True, eq=False)
class ContactResult:
    """Forces, areas and pressures of a rigid tip in contact with the film.

    Areas are those of the part of the film that the tip touches; pressures are per area of the
    deformed film. Moments are about the tip's lowest point. The guide of the tip bears the lateral
    force and the moments.
    """

    depth_mm: float  #: Depth of the tip's lowest point.
    force_N: float  #: Force of the tip on the film along z.
    lateral_N: Array  #: Force of the film on the tip along x and y, shape (2,).
    moments_N_mm: Array  #: Moments of the film on the tip about axes along x and y, shape (2,).
    area_mm2: float  #: Contact area on the undeformed film.
    area_error_mm2: float  #: Estimated error of `area_mm2`.
    projected_area_mm2: float  #: Contact area on the deformed film, projected along z.
    #: Points on the undeformed film along the contact's edge, shape (n, 2).
    edge_mm: Array = field(repr=False)
    mean_pressure_MPa: float  #: `force_N` divided by `projected_area_mm2`.
    least_pressure_MPa: float  #: Minimum at the touching quadrature points.
    largest_pressure_MPa: float  #: Maximum at the touching quadrature points.
    overlap_mm: float  #: Maximum overlap of film and tip, which the penalty allows.

    def to_json(self) -> dict[str, Any]:
        """Return the values as numbers and lists for JSON, without the points of the edge."""
        table = {**vars(self)}
        table.pop("edge_mm")
        return {key: np.asarray(value).tolist() for key, value in table.items()}

    @classmethod
    def from_state(cls, tip: RigidTip, state: State, thickness: float) -> Self:
        """Compute the forces, areas and pressures of a tip from the state of the film.

        Parameters
        ----------
        tip : RigidTip
            The tip, which must touch the film in this state.
        state : State
            The state of the whole film, not of a sector.
        thickness : float
            The film's thickness in m.
        """
        overlap = tip.overlap(state)
        weights = tip.space.weights
        # forces on the film at the quadrature points, and their lever arms about the lowest point
        forces = -overlap.rates * tip.tractions(state)[..., None]
        fx, fy, fz = np.moveaxis(forces, -1, 0)
        points = tip.compute_deformed_points(state.dofs)
        arm_x, arm_y = np.moveaxis(points[..., :2] - tip.spec.outline.centroid, -1, 0)
        arm_z = points[..., 2] - overlap.depth
        moments = np.array([(arm_y * fz - arm_z * fy).sum(), (arm_z * fx - arm_x * fz).sum()])
        force = float(fz.sum())

        edge = locate_contact_edge(tip, state)
        area = tip.tip.fit_outline(edge).area
        poorer_edge = locate_contact_edge(tip, state, POORER_DEGREE)
        poorer_area = tip.tip.fit_outline(poorer_edge).area
        # the touching quadrature points represent the contact roughly: scale their sum to its area
        touching_weights = weights * overlap.is_touching
        correction = area / float(touching_weights.sum())
        area_ratio = np.linalg.det(state.deformation_gradient[..., :2, :])
        projected_area = correction * float((touching_weights * area_ratio).sum())

        pressure = _compute_pressure_of_state(tip, state, thickness)
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
    """Select the rigid tips among the terms of an equilibrium."""
    return [term for term in equilibrium.terms if isinstance(term, RigidTip)]


def compute_contact_results(equilibrium: Equilibrium, state: State) -> dict[str, ContactResult]:
    """Compute the contact results of all rigid tips, by the names of their subdomains.

    All tips must touch the film, and `equilibrium` must be on the whole film.
    """
    thickness = equilibrium.film.thickness
    return {
        tip.spec.patch: ContactResult.from_state(tip, state, thickness)
        for tip in select_tips(equilibrium)
    }


def compute_contact_pressure(equilibrium: Equilibrium, state: State) -> Array:
    """Compute the pressure of all rigid tips per area of the deformed film.

    Returns
    -------
    ndarray, shape (elements, points)
        Pressure in Pa at the quadrature points; 0 where no tip touches.
    """
    total = np.zeros(equilibrium.space.weights.shape)
    for tip in select_tips(equilibrium):
        total += _compute_pressure_of_state(tip, state, equilibrium.film.thickness)
    return total


def _compute_pressure_of_state(tip: RigidTip, state: State, thickness: float) -> Array:
    """Compute the pressure of a tip at the quadrature points in Pa, shape (elements, points)."""
    return compute_tip_pressure(
        tip.overlap(state),
        state.deformation_gradient,
        stress=state.stress,
        thickness=thickness,
    )


def compute_tip_pressure(
    overlap: Overlap, deformation_gradient: Array, *, stress: Array, thickness: float
) -> Array:
    """Compute the pressure of a tip on the deformed film.

    Parameters
    ----------
    overlap : Overlap
        The overlap of film and tip at n rows of points.
    deformation_gradient : ndarray, shape (n, points, 3, 2)
        Deformation gradient F there.
    stress : ndarray, shape (n, points, 3)
        Stress of all plies in Pa there, as in `State.stress`.
    thickness : float
        The film's thickness in m.

    Returns
    -------
    ndarray, shape (n, points)
        Pressure per deformed area in Pa; 0 where the film does not touch.

    Notes
    -----
    The film on the tip has the tip's curvature. Equilibrium normal to the tip's surface gives the
    pressure per undeformed area p = h S : Fᵀ H F / √(1 + slope²), with the thickness h, the stress
    S, the in-plane rows of F, and Hessian H and slope of the tip's height. It is smoother than the
    tractions of the penalty.
    """
    F = deformation_gradient
    curvature = np.einsum("epia,epij,epjb->epab", F[..., :2, :], overlap.hessian, F[..., :2, :])
    S11, S22, S12 = np.moveaxis(stress, -1, 0)
    across = S11 * curvature[..., 0, 0] + S22 * curvature[..., 1, 1]
    across += 2.0 * S12 * curvature[..., 0, 1]
    steepness = np.sqrt((overlap.rates**2).sum(axis=-1))
    area_ratio = np.linalg.norm(np.cross(F[..., 0], F[..., 1]), axis=-1)
    pressure = thickness * across / steepness / area_ratio
    return np.where(overlap.is_touching, pressure, 0.0)

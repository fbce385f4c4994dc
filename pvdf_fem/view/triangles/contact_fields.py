"""The contact with rigid tips at the corners of triangles."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.film.loads.rigid_tip import RigidTip
from pvdf_fem.film.membrane import IDENTITY
from pvdf_fem.problem.contact_result import compute_tip_pressure, select_tips
from pvdf_fem.view.triangles.film_fields import CornerFields


class ContactFields(NamedTuple):
    """The contact with all rigid tips."""

    pressure: Array  #: Pressure per deformed area in Pa at the rows of `CornerFields`, shape (n,).
    #: Force along z per undeformed area in Pa in each triangle, shape (triangles,). Its integral
    #: is the force of the tips.
    traction: Array


def compute_contact_fields(fields: CornerFields) -> ContactFields:
    """Compute the contact pressure at the corners of triangles, and the mean tractions in them.

    Parameters
    ----------
    fields : CornerFields
        The corners of the triangles, and the solution.

    Returns
    -------
    ContactFields
        Zero where no tip touches.

    Notes
    -----
    The edge of a contact crosses triangles, which blurs the traction there. The tractions of each
    tip are therefore scaled so that their integral is the tip's force.
    """
    equilibrium = fields.film.equilibrium
    total_pressure = np.zeros(len(fields.points))
    total_traction = np.zeros(len(fields.rows))
    for tip in select_tips(equilibrium):
        is_touched = np.asarray(tip.overlap(fields.film.state).is_touching.any(axis=1))
        rows = np.flatnonzero(is_touched[fields.elements])
        gradient = _evaluate_deformation_gradient(fields, rows)
        pressure = np.zeros(len(fields.points))
        pressure[rows] = _compute_pressure(fields, tip, rows, gradient)
        traction = pressure.copy()
        traction[rows] *= np.linalg.det(gradient[:, :2])
        mean = fields.average_in_triangles(traction)
        force = fields.film.contacts[tip.spec.patch].force_N
        integral = float((fields.tessellation.areas * mean).sum())
        total_pressure += pressure
        total_traction += mean * (force / integral if integral > 0.0 else 0.0)
    return ContactFields(total_pressure, total_traction)


def _compute_pressure(fields: CornerFields, tip: RigidTip, rows: Indices, gradient: Array) -> Array:
    """Compute the pressure of a tip at some rows of `CornerFields`.

    Parameters
    ----------
    fields : CornerFields
        The corners and the solution.
    tip : RigidTip
        The tip.
    rows : ndarray of int, shape (n,)
        The rows.
    gradient : ndarray, shape (n, 3, 2)
        The deformation gradient there.

    Returns
    -------
    ndarray, shape (n,)
        Pressure per deformed area in Pa.
    """
    values = fields.values
    points = 1e-3 * values.displacement_mm[rows]
    points[:, 0] += 1e-3 * values.x_mm[rows]
    points[:, 1] += 1e-3 * values.y_mm[rows]
    pressure = compute_tip_pressure(
        tip.overlap_at(points[:, None], fields.film.state.dofs),
        gradient[:, None],
        stress=_extrapolate_stress(fields, rows)[:, None],
        thickness=fields.film.scene.film.thickness,
    )
    return pressure[:, 0]


def _evaluate_deformation_gradient(fields: CornerFields, rows: Indices) -> Array:
    """Evaluate the deformation gradient at some rows of `CornerFields`, shape (n, 3, 2)."""
    space = fields.film.equilibrium.space
    elements = fields.elements[rows]
    nodal = fields.film.state.dofs.reshape(-1, 3)[space.nodes[elements]]
    local = fields.local[rows].T[:, :, None]
    shape_gradients = space.evaluate_gradients(elements, local)[:, 0]
    return np.asarray(np.matmul(nodal.swapaxes(1, 2), shape_gradients) + IDENTITY)


def _extrapolate_stress(fields: CornerFields, rows: Indices) -> Array:
    """Extrapolate the stress of all plies from the quadrature points of the elements.

    Parameters
    ----------
    fields : CornerFields
        The corners and the solution.
    rows : ndarray of int, shape (n,)
        Rows of the fields.

    Returns
    -------
    ndarray, shape (n, 3)
        In Pa: in each element the quadratic function nearest to the stress at these points.
    """
    state = fields.film.state
    quadrature_points = fields.film.equilibrium.space.basis.X
    fit = np.linalg.pinv(_evaluate_quadratics(quadrature_points.T))
    coefficients = np.matmul(fit, state.stress[fields.elements[rows]])
    quadratics = _evaluate_quadratics(fields.local[rows])
    return np.asarray(np.matmul(quadratics[:, None], coefficients)[:, 0])


def _evaluate_quadratics(local: Array) -> Array:
    """Evaluate 1, x, y, x², x y and y² at local coordinates, shape (n, 2); return shape (n, 6)."""
    x, y = local.T
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)

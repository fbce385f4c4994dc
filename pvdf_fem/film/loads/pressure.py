"""Loads by probes: a class for every `load.kind`.

All press on the probe's patch Omega_p with the total force F, which ``dead`` and a stuck ``rigid``
may have in any direction:

- ``dead``: a traction along F per reference area, F/A_p or spread by a profile;
- ``follower``: a pressure F/A_p normal to the deformed film, per deformed area (ANSYS's SFA);
- ``rigid``: a flat punch. Where the punch stays horizontal, the deflection is a single unknown over
the patch; where the punch tilts freely, a linear function with three unknowns. It slides or sticks.
A guide holds a sticking punch, u = v = 0 below, or a sideways push leaves u and v an unknown for
both.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from pvdf_fem.arrays import Array, Indices, Selection
from pvdf_fem.film.loads.load_spec import LoadSpec
from pvdf_fem.film.loads.profiles import make_profile
from pvdf_fem.film.space import Space
from pvdf_fem.film.term import Load, State
from pvdf_fem.mesh.symmetry import WHOLE_FILM, SymmetrySector

UP: Array = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class PunchTilt:
    """A punch: angles, and the guide's moments on it, about axes x and y through its centroid."""

    tilt_deg: tuple[float, float]
    moments_N_mm: tuple[float, float]


class DeadPressure(Load):
    """A traction in a direction on a probe's reference area, in the axes of a part.

    The `patch` (n,) has no elements where a mirror image of the probe, another probe, has them.
    `components` (3,) are the total force in N. `rigid` says whether the film stays flat under the
    probe; tractions are then singular along its edge.
    """

    rigid = False
    #: Whether the place of the probe is the place of its patch in the mesh.
    on_patch = True
    #: Approximate part of the force along the patch's edge.
    edge_share = 0.0

    def __init__(self, touch: LoadSpec, space: Space, part: SymmetrySector = WHOLE_FILM) -> None:
        self.spec, self.space, self.part = touch, space, part
        self.patch: Indices = space.mesh.subdomains[touch.patch]
        self.rigid_patch = self.patch[: len(self.patch) * self.rigid]
        self.components = np.array(touch.load.components)
        self.components[:2] = part.frame @ self.components[:2]

    def with_components(self, components: Array) -> Self:
        """The same load with another force in N, (3,)."""
        other = copy(self)
        other.__dict__.pop("_dead_forces", None)
        other.components = components
        return other

    def scaled(self, factor: float) -> Self:
        """The same load times a factor."""
        return self.with_components(factor * self.components)

    @property
    def force(self) -> float:
        """Size of the total force in N."""
        return float(np.linalg.norm(self.components))

    def area(self, weights: Array) -> float:
        """Integral over the whole patch from values (patch elements, points) on the part.

        The images are the patch itself or patches of further probes.
        """
        covered = float(self.space.weights[self.patch].sum()) * len(self.part.signs)
        others = max(round(covered / self.spec.outline.area), 1) if self.part.mirror_axes else 1
        return float(weights.sum()) * len(self.part.signs) / others

    @property
    def pressure(self) -> float:
        """Mean size of the traction in Pa."""
        return self.force / self.area(self.space.weights[self.patch]) if len(self.patch) else 0.0

    def direction(self, deformation_gradient: Array) -> Array:
        """Traction per reference area over the pressure, (..., 3)."""
        size = self.force
        unit = self.components / size if size else UP
        return np.broadcast_to(unit, deformation_gradient.shape[:-1])

    def forces(self, state: State) -> Array:
        """External forces in N, (dofs,)."""
        return self._dead_forces

    @cached_property
    def _dead_forces(self) -> Array:
        if not len(self.patch):
            return np.zeros(self.space.dof_count)
        values, weights = self._spread
        shares = np.matmul(values.swapaxes(1, 2), weights[..., None]) / self.area(weights)
        return self.space.sum(shares * self.components, self.patch)

    @property
    def _spread(self) -> tuple[Array, Array]:
        """Values of the functions, and weights times profile, at points of the patch's elements."""
        profile = make_profile(self.spec)
        if profile.order is None:
            values, weights = self.space.values[self.patch], self.space.weights[self.patch]
        else:
            places, values, weights = self.space.rule(self.patch, profile.order)
            weights = weights * profile(places @ self.part.frame)
            if len(weights) and not weights.any():
                raise profile.refused("is zero wherever the probe presses; change it")
        return values, weights

    def pressed(self, state: State, film_forces: Array) -> tuple[Selection, Array]:
        _, weights = self._spread
        return self.patch, self.components[2] / self.area(weights) * weights.sum(axis=1)

    def compute_tilt(self, state: State, film_forces: Array) -> PunchTilt | None:
        """How a punch leans, from the residual on the whole film, (dofs,); None of what
        is no punch."""
        return None


class FollowerPressure(DeadPressure):
    """A pressure that stays normal to the deformed film."""

    conservative = False

    def with_frozen_loads(self) -> DeadPressure:
        """The dead pressure of the same size."""
        return DeadPressure(self.spec, self.space, self.part).with_components(self.components)

    def direction(self, deformation_gradient: Array) -> Array:
        """Traction per reference area over the pressure, (..., 3)."""
        return _normal(deformation_gradient)

    def forces(self, state: State) -> Array:
        """External forces in N, (dofs,)."""
        return compute_normal_forces(self.space, self.patch, self.pressure, state)

    def element_tangent(self, state: State) -> tuple[Selection, Array] | None:
        if not len(self.patch):
            return None
        return self.patch, -compute_normal_stiffness(self.space, self.patch, self.pressure, state)


class Punch(DeadPressure):
    """A rigid flat punch under a dead force; the film below moves up by a common deflection.

    Motions are constraints on the dofs: they add no equation, and the tangent stays symmetric.
    """

    rigid = True
    edge_share = 1.0

    def __init__(self, touch: LoadSpec, space: Space, part: SymmetrySector = WHOLE_FILM) -> None:
        super().__init__(touch, space, part)
        dofs = 3 * np.unique(space.basis.element_dofs[:, self.patch])
        self.shared_dofs = (dofs + 2,)
        self._nodes: Indices = dofs // 3
        self._lever = space.basis.doflocs.T[self._nodes] - part.frame @ touch.outline.centroid
        if touch.load.tangential_N is not None:
            self.shared_dofs = dofs, dofs + 1, dofs + 2
        elif touch.load.contact == "stuck":
            self.fixed_dofs = np.concatenate([dofs, dofs + 1])
        if touch.load.tilt == "free":
            scaled = self._lever / np.sqrt(touch.outline.area)
            *others, raised = self.shared_dofs
            self.shared_dofs = tuple(others)
            self.modes = ((raised, np.column_stack([np.ones(len(dofs)), scaled])),)

    def pressed(self, state: State, film_forces: Array) -> tuple[Selection, Array]:
        """The nodes' forces, which the elements about a node share equally."""
        nodes = self.space.nodes[self.patch]
        sharing = np.maximum(np.bincount(nodes.ravel(), minlength=self.space.basis.N), 1)
        along_z = (film_forces + self._dead_forces)[2::3][: self.space.basis.N] / sharing
        return self.patch, along_z[nodes].sum(axis=1)

    def compute_tilt(self, state: State, film_forces: Array) -> PunchTilt:
        raised = 3 * self._nodes + 2
        columns = np.column_stack([np.ones(len(raised)), self._lever])
        _, along_x, along_y = np.linalg.lstsq(columns, state.dofs[raised], rcond=None)[0]
        turn_x, turn_y = np.degrees(np.arctan([along_y, -along_x])).tolist()
        Mx, My = ((film_forces + self.forces(state))[raised] @ self._lever * 1e3).tolist()[::-1]
        return PunchTilt((turn_x, turn_y), (Mx, -My))


def compute_normal_forces(
    space: Space, elements: Selection, pressure: float, state: State
) -> Array:
    """Forces in N, (dofs,), of a pressure in Pa normal to the deformed film."""
    values, weights = space.values[elements], space.weights[elements]
    normals = _normal(state.deformation_gradient[elements])
    traction = pressure * weights[..., None] * normals
    return space.sum(np.matmul(values.swapaxes(1, 2), traction), elements)


def compute_normal_stiffness(
    space: Space, elements: Selection, pressure: float, state: State
) -> Array:
    """Derivative of `compute_normal_forces` in N/m, (elements, element dofs, element dofs)."""
    F = state.deformation_gradient[elements]
    values, gradients = space.values[elements], space.gradients[elements]
    # d(F1 x F2) = F1 x dF2 - F2 x dF1, with dFi = gradients_i du
    turned = [np.cross(F[..., i][..., None, :], np.eye(3)).swapaxes(-1, -2) for i in (0, 1)]
    normal = np.einsum("epij,epb->epibj", turned[0], gradients[..., 1]) - np.einsum(
        "epij,epb->epibj", turned[1], gradients[..., 0]
    )
    weights = pressure * space.weights[elements]
    stiffness = np.einsum("epa,epibj->eaibj", values * weights[..., None], normal)
    dofs = 3 * values.shape[-1]
    return stiffness.reshape(len(values), dofs, dofs)


def _normal(deformation_gradient: Array) -> Array:
    """The film's normal, with the ratio of deformed to reference area as length, (..., 3)."""
    return np.cross(deformation_gradient[..., 0], deformation_gradient[..., 1])

"""An elastic backing below the film: independent springs without mass (Winkler's foundation).

The backing is on the side of positive z, into which a probe with a positive force presses. It acts
on the film with the traction -k w along z per undeformed area, with the deflection w and the
stiffness k, and stores the energy k w²/2 per area. A one-sided backing acts only where it is
pressed: the film lifts off where w is negative. Its energy is convex and has a continuous first
derivative.

A homogeneous layer of the thickness t that is bonded to a rigid base, with Young's modulus E and
Poisson's ratio ν, has about k = E (1 - ν)/((1 + ν) (1 - 2 ν) t), its modulus without lateral strain
divided by t, if the loaded area is much wider than t.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cached_property

import numpy as np

from pvdf_fem.arrays import Array, Mask, Selection
from pvdf_fem.film.effects import EffectNote, format_two_digits
from pvdf_fem.film.space import Space
from pvdf_fem.film.term import ElementForces, ElementMatrices, State, Support
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.placed.patch import Patch
from pvdf_fem.scene.placed.support_keys import find_support_keys
from pvdf_fem.scene.scene import Scene

#: Component of the displacement that the backing resists.
DEFLECTION = 2


class Backing(Support):
    """The energy k w²/2 per undeformed area of a backing below some elements of the film.

    Parameters
    ----------
    table : Film or Patch
        The table with ``backing_N_m3``, the stiffness k, and ``backing_one_sided``.
    space : Space
        The finite-element space.
    elements : slice or ndarray, shape (n,)
        Numbers of the elements above the backing.
    """

    def __init__(self, table: Film | Patch, space: Space, elements: Selection) -> None:
        self.space = space
        self.elements = elements
        #: Pressure per deflection in N/m³.
        self.stiffness: float = table.backing_N_m3 or 0.0
        #: Whether the film may lift off.
        self.is_one_sided: bool = table.backing_one_sided

    @cached_property
    def _weights(self) -> Array:
        """Quadrature weights times the stiffness k in N/m, shape (n, points)."""
        return self.stiffness * self.space.weights[self.elements]

    def compute_deflection(self, x: Array) -> Array:
        """Compute the deflection w in m at the quadrature points above the backing.

        Parameters
        ----------
        x : ndarray, shape (dofs,)
            Dofs of the displacement in m.

        Returns
        -------
        ndarray, shape (n, points)
        """
        nodal = x[DEFLECTION::3][self.space.nodes[self.elements]]
        return np.matmul(self.space.values[self.elements], nodal[..., None])[..., 0]

    def _mark_pressed(self, deflection: Array) -> Mask:
        """Return where the backing acts, shape (n, points): everywhere if it is not one-sided."""
        if self.is_one_sided:
            return deflection >= 0.0
        return np.ones(deflection.shape, dtype=bool)

    def compute_pressing_forces(self, x: Array) -> Array:
        """Compute k w times the quadrature weights in N; 0 where the film has lifted off.

        Returns
        -------
        ndarray, shape (n, points)
        """
        deflection = self.compute_deflection(x)
        return self._weights * deflection * self._mark_pressed(deflection)

    def energy(self, state: State) -> float:
        """Return the energy in J."""
        pressing = self.compute_pressing_forces(state.dofs)
        return 0.5 * float((pressing * self.compute_deflection(state.dofs)).sum())

    def residual(self, state: State) -> Array:
        """Return the derivative of the energy with respect to the dofs in N.

        Returns
        -------
        ndarray, shape (dofs,)
        """
        forces = self._integrate(self.compute_pressing_forces(state.dofs))
        return self.space.sum_at_dofs(forces, self.elements)

    def _integrate(self, weighted: Array) -> Array:
        """Integrate a pressure along z, times quadrature weights, to forces of the elements.

        Parameters
        ----------
        weighted : ndarray, shape (n, points)
            In N.

        Returns
        -------
        ndarray, shape (n, element dofs)
        """
        values = self.space.values[self.elements]
        forces = np.zeros((len(values), values.shape[-1], 3))
        forces[..., DEFLECTION] = np.matmul(values.swapaxes(1, 2), weighted[..., None])[..., 0]
        return forces.reshape(-1, self.space.element_dofs.shape[1])

    def element_tangent(self, state: State) -> ElementMatrices:
        """Return the derivative of `residual` with respect to the dofs, by element, in N/m."""
        if not self.is_one_sided:
            return ElementMatrices(self.elements, self._linear_matrices)
        pressed = self._mark_pressed(self.compute_deflection(state.dofs))
        return ElementMatrices(self.elements, self._make_matrices(self._weights * pressed))

    @cached_property
    def _linear_matrices(self) -> Array:
        """Element matrices of a backing that is not one-sided, which do not depend on the state."""
        return self._make_matrices(self._weights)

    def _make_matrices(self, weights: Array) -> Array:
        """Make the element matrices of a stiffness times quadrature weights in N/m.

        Returns
        -------
        ndarray, shape (n, element dofs, element dofs)
        """
        values = self.space.values[self.elements]
        scalar = np.matmul(values.swapaxes(1, 2) * weights[:, None], values)
        count, functions, _ = scalar.shape
        blocks = np.zeros((count, functions, 3, functions, 3))
        blocks[:, :, DEFLECTION, :, DEFLECTION] = scalar
        return blocks.reshape(count, 3 * functions, 3 * functions)

    # The products below form no element matrices and so take less time than `element_tangent`.

    def element_action(self, state: State, x: Array) -> Array:
        """Multiply the element tangents by the dofs `x`; return forces in N."""
        pressed = self._mark_pressed(self.compute_deflection(state.dofs))
        actions = np.zeros(self.space.element_dofs.shape)
        weighted = self._weights * pressed * self.compute_deflection(x)
        actions[self.elements] = self._integrate(weighted)
        return actions

    def diagonal(self, state: State) -> Array:
        """Return the diagonal of the tangent in N/m, shape (dofs,)."""
        pressed = self._mark_pressed(self.compute_deflection(state.dofs))
        values = self.space.values[self.elements]
        weights = self._weights * pressed
        diagonals = np.zeros((len(values), values.shape[-1], 3))
        diagonals[..., DEFLECTION] = np.einsum("epa,ep->ea", values**2, weights)
        element_dofs = self.space.element_dofs.shape[1]
        return self.space.sum_at_dofs(diagonals.reshape(-1, element_dofs), self.elements)

    def energy_along(self, state: State, x: Array) -> Array:
        """Return the energy as a polynomial in s along the line ``state.dofs + s * x``.

        Returns
        -------
        ndarray, shape (5,)
            Coefficients in J of 1, s, ..., s⁴. They are exact if the film neither touches nor lifts
            off along the line; otherwise the energy at s = 0 and 1 and the slope at 0 are exact.
        """
        energy = self.energy(state)
        pressing = self.compute_pressing_forces(state.dofs)
        slope = float((pressing * self.compute_deflection(x)).sum())
        end = state.dofs + x
        end_pressing = self.compute_pressing_forces(end)
        end_energy = 0.5 * float((end_pressing * self.compute_deflection(end)).sum())
        return np.array([energy, slope, end_energy - energy - slope, 0.0, 0.0])

    def through_thickness_forces(self, state: State, residual: Array) -> ElementForces:
        """Return the forces with which the backing presses on the film: k w, integrated."""
        return ElementForces(self.elements, self.compute_pressing_forces(state.dofs).sum(axis=1))


def find_largest_stiffness(film: Film) -> float:
    """Return an upper bound of the stiffness k of a film's backings in N/m³; 0 without any.

    It is the sum of all backings, as if they were all below one point.
    """
    return sum(found.value for found in find_support_keys(film) if found.name == "backing_N_m3")


def describe_backing(scene: Scene) -> Iterator[EffectNote]:
    """Yield a note for each backing, with the length within which it evens out the deflection.

    Notes
    -----
    Beside a load the deflection of a film with the tension N decays within the length sqrt(N/k).
    """
    film = scene.film
    tension = film.thickness * float(film.prestress[:2].mean())
    for found in find_support_keys(film):
        text = f"backing ({found.key} = {found.value:g}): "
        text += "the film may lift off it" if found.table.backing_one_sided else "bonded to it"
        if tension > 0.0:
            length_mm = 1e3 * math.sqrt(tension / found.value)
            length = format_two_digits(length_mm)
            text += f"; the deflection of the unloaded film decays within {length} mm of a load"
        yield EffectNote(True, text)

"""Electromechanical coupling: how the voltages of electrodes stiffen the film.

A charge amplifier keeps its electrode at zero voltage. Any other electrode shares its charge with
the capacitance C_L of its wires, which is zero if it is open. The Green-Lagrange strain E relative
to the unloaded film causes the charge q and the voltage V::

    q = ∫ e : E dA,    e = d : C,    V = q/(C + C_L),    C = ε_S A/h,    ε_S = ε_T - d : C : d

with the piezoelectric coefficients d, the plane-stress stiffness C of the film in the products with
d (elsewhere C is the electrode's capacitance), the electrode's area A, the film's thickness h, and
the permittivity ε_T at constant stress, ``film.permittivity``. The voltage adds e V/h to the stress
S and q²/(2 (C + C_L)) to the film's energy. A channel reads the charge ∫ d : S dA of the total
stress S, with and without coupling; it equals V times (ε_T A/h + C_L).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.film.effects import EffectNote, format_two_digits
from pvdf_fem.film.loads.contact_estimate import estimate_pressed_area
from pvdf_fem.film.membrane import IDENTITY, compute_strain, compute_strain_rate
from pvdf_fem.film.point_load import estimate_load_fraction
from pvdf_fem.film.space import Space
from pvdf_fem.film.term import ElementStress, State, Term
from pvdf_fem.mesh.subdomains import make_subdomain_name
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.readout import Readout
from pvdf_fem.scene.scene import LoadedProbe, Scene
from pvdf_fem.scene.scene_file import quote


@dataclass(frozen=True, eq=False)
class FloatingElectrode:
    """An electrode that no amplifier keeps at zero voltage."""

    name: str
    outline: Outline
    film: Film
    load: float  #: Capacitance C_L of the electrode's wires in F.

    @cached_property
    def e(self) -> Array:
        """Piezoelectric stress coefficients e = d : C in C/m², shape (3,)."""
        return self.film.stiffness @ [self.film.d31, self.film.d32, 0.0]

    @cached_property
    def capacitance(self) -> float:
        """Capacitance C + C_L of electrode and wires in F.

        A permittivity ε_S that is not positive, from a d too large for ε_T, counts as nearly zero.
        """
        permittivity = max(self.film.clamped_permittivity, np.finfo(float).tiny)
        return permittivity * self.outline.area / self.film.thickness + self.load

    @cached_property
    def coupling_matrix(self) -> Array:
        """Matrix from the stress integrals due to strain to those due to the voltage.

        The stress integrals are X = ∫ S11 dA and Y = ∫ S22 dA over the electrode. Those due to
        strain are changes from the unloaded film, whose voltage is zero. The shape is (2, 2).
        """
        factor = self.outline.area / self.film.thickness / self.capacitance
        return factor * np.outer(self.e[:2], [self.film.d31, self.film.d32])

    def with_voltage(self, integrals: Array) -> Array:
        """Add the stress due to the electrode's own voltage to the stress integrals X and Y.

        Parameters
        ----------
        integrals : ndarray, shape (2,)
            X and Y of the stress due to strain, including the prestress, in N.

        Returns
        -------
        ndarray, shape (2,)
            X and Y of the total stress in N.
        """
        unloaded = self.film.prestress[:2] * self.outline.area
        return np.asarray(integrals + self.coupling_matrix @ (integrals - unloaded))

    def estimate_effect(self, scene: Scene, probe: LoadedProbe, own_fraction: float = 0.4) -> float:
        """Estimate the relative change of the electrode's charge due to its own voltage.

        Parameters
        ----------
        scene : Scene
            The scene, for its film and for the contact with a curved tip.
        probe : LoadedProbe
            The probe that presses; other probes are ignored.
        own_fraction : float
            Fraction of a stress imposed on a small part of a film that remains there: (1 - ν)/2, or
            (1 + ν)/4 for a shear (Eshelby). For a Poisson's ratio ν >= 0.2 neither exceeds 0.4.

        Returns
        -------
        float
            Change of the charge divided by the charge.
        """
        area = self.outline.area
        pressed_area, force = estimate_pressed_area(scene, probe)
        radius = math.sqrt(area / math.pi)
        pressed_radius = math.sqrt(pressed_area.area / math.pi)
        distance = math.dist(self.outline.centroid, pressed_area.centroid)
        # for an electrode under the probe, the tension at half the electrode's radius is about the
        # mean over the electrode
        r = max(distance - radius, pressed_radius, 0.5 * radius)
        covered = area / self.film.outline.area
        remaining = own_fraction + (1.0 - own_fraction) * covered
        return (
            float(np.trace(self.coupling_matrix))
            * remaining
            * estimate_load_fraction(self.film, force, r)
        )


class Coupling(Term):
    """The energy q²/(2 (C + C_L)) of a floating electrode.

    Parameters
    ----------
    electrode : FloatingElectrode
        Electrode whose charge acts on the film through its voltage.
    space : Space
        The finite-element space on a mesh that follows the electrode's outline.
    """

    def __init__(self, electrode: FloatingElectrode, space: Space) -> None:
        self.electrode = electrode
        self.space = space
        #: Numbers of the electrode's elements, shape (n,).
        self.elements: Indices = space.mesh.subdomains[make_subdomain_name(electrode.name)]
        self._weighted_e = space.weights[self.elements, :, None] * electrode.e

    def charge(self, strain: Array) -> float:
        """Return the charge q in C that a strain causes on the electrode.

        Parameters
        ----------
        strain : ndarray, shape (elements, points, 3)
            Green-Lagrange strain in all elements of the film.
        """
        return float((strain[self.elements] * self._weighted_e).sum())

    def voltage(self, state: State) -> float:
        """Return the electrode's voltage in V."""
        return self.charge(state.strain) / self.electrode.capacitance

    def energy(self, state: State) -> float:
        """Return the energy in J."""
        return 0.5 * self.voltage(state) * self.charge(state.strain)

    def charge_gradient(self, state: State) -> Array:
        """Return the derivative of the charge q with respect to the dofs.

        Returns
        -------
        ndarray, shape (dofs,)
            Integrals of e : sym(Fᵀ grad v) over the electrode for every function v, in C/m.
        """
        flux = state.deformation_gradient[self.elements] * self._weighted_e[:, :, None, :2]
        parts = np.matmul(self.space.gradients[self.elements], flux.swapaxes(2, 3))
        return self.space.sum_at_dofs(parts.sum(axis=1), self.elements)

    def residual(self, state: State) -> Array:
        """Return the gradient of the coupling energy with respect to the dofs, in N.

        Returns
        -------
        ndarray, shape (dofs,)
        """
        return self.voltage(state) * self.charge_gradient(state)

    def added_stress(self, state: State) -> ElementStress:
        """Return the stress e V/h that the voltage adds in the electrode's elements."""
        field = self.voltage(state) / self.electrode.film.thickness
        return ElementStress(self.elements, field * self.electrode.e)

    def tangent_column(self, state: State) -> Array:
        """Return the column c of the part c cᵀ of the tangent: dq/dx divided by √(C + C_L).

        Returns
        -------
        ndarray, shape (dofs,)
            In √(N/m).
        """
        return self.charge_gradient(state) / np.sqrt(self.electrode.capacitance)

    def action(self, state: State, x: Array) -> Array:
        """Return the tangent c cᵀ, without the geometric stiffness, times the dofs `x`, in N.

        Returns
        -------
        ndarray, shape (dofs,)
        """
        column = self.tangent_column(state)
        return column * (column @ x)

    def energy_along(self, state: State, x: Array) -> Array:
        """Return the energy as a polynomial in s along the line ``state.dofs + s * x``.

        Returns
        -------
        ndarray, shape (5,)
            Coefficients in J of 1, s, ..., s⁴. They are exact: q is quadratic in s.
        """
        step = self.space.displacement_gradient(x)
        first = compute_strain_rate(state.deformation_gradient, step)
        second = compute_strain(step) - compute_strain_rate(IDENTITY, step)
        charge = [self.charge(strain) for strain in (state.strain, first, second)]
        return np.convolve(charge, charge) / (2.0 * self.electrode.capacitance)


def find_floating_electrodes(scene: Scene) -> tuple[FloatingElectrode, ...]:
    """Find the electrodes that are read as voltages, not held at zero by a charge amplifier."""
    readout = scene.readout or Readout()
    floating = []
    for electrode in scene.electrode_list:
        if readout.get_value("kind", electrode.name) == "voltage":
            cable_pF = readout.get_value("cable_capacitance_pF", electrode.name)
            floating.append(
                FloatingElectrode(
                    electrode.name, electrode.outline, film=scene.film, load=cable_pF / 1e12
                )
            )
    return tuple(floating)


def find_coupled_electrodes(scene: Scene) -> tuple[FloatingElectrode, ...]:
    """Find the floating electrodes whose voltages act on the film.

    With ``film.coupling = "auto"`` coupling is included if its estimated effect exceeds the
    tolerance of the charges.
    """
    choice = scene.film.coupling
    if choice == "auto":
        is_coupled = estimate_coupling_effect(scene) > scene.numerics.tolerance
    else:
        is_coupled = choice
    return find_floating_electrodes(scene) if is_coupled else ()


def estimate_coupling_effect(scene: Scene) -> float:
    """Estimate the largest relative change of any charge due to coupling.

    All pairs of a floating electrode and a loaded probe are considered.
    """
    largest = 0.0
    for electrode in find_floating_electrodes(scene):
        for probe in scene.loaded_probes:
            largest = max(largest, electrode.estimate_effect(scene, probe))
    return largest


def describe_coupling(scene: Scene) -> Iterator[EffectNote]:
    """Yield one note about the effect of coupling, or none without floating electrodes."""
    floating = find_floating_electrodes(scene)
    if not floating:
        return
    names = ", ".join(electrode.name for electrode in floating)
    percent = format_two_digits(100.0 * estimate_coupling_effect(scene))
    size = f"could change a charge by up to {percent} %"
    reason = f"no charge amplifier keeps {names} at zero voltage, which stiffens the film"
    text = f"coupling (film.coupling = {quote(scene.film.coupling)}): {size}; {reason}"
    is_included = bool(find_coupled_electrodes(scene))
    if not is_included:
        text += "; to include it, set film.coupling = true"
    yield EffectNote(is_included, text)

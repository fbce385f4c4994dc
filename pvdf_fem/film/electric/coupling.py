"""Electromechanical coupling: how the voltages of electrodes stiffen the film.

A charge amplifier keeps its electrode at no voltage. Any other electrode shares its charge with
what it is wired to: on a capacitance C_L, zero where it is open, the strain E since the film at
rest makes::

    q = ∫ e : E dA,    e = d : C,    V = q/(C + C_L),    C = ε_S A/h,    ε_S = ε_T - d : C : d

with the permittivity ε_T at constant stress, ``film.permittivity``. It adds e V/h to the stress S
and q²/(2 (C + C_L)) to the film's energy. A channel reads the charge ∫ d : S dA by the whole
stress, with and without coupling: V times (ε_T A/h + C_L).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.film.effects import format_two_digits
from pvdf_fem.film.loads.contact_estimate import estimate_pressed_area
from pvdf_fem.film.membrane import IDENTITY, compute_strain, compute_strain_rate
from pvdf_fem.film.point_load import estimate_load_share
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
    """An electrode that no amplifier keeps at zero voltage, wired to `load` in F."""

    name: str
    outline: Outline
    film: Film
    load: float

    @cached_property
    def e(self) -> Array:
        """Stress over field in C/m², (3,)."""
        return self.film.stiffness @ [self.film.d31, self.film.d32, 0.0]

    @cached_property
    def capacitance(self) -> float:
        """C + C_L in F."""
        clamped = max(self.film.clamped_permittivity, np.finfo(float).tiny)
        return clamped * self.outline.area / self.film.thickness + self.load

    @cached_property
    def share(self) -> Array:
        """Forces X, Y that the voltage adds over those since the film at rest, (2, 2)."""
        over = self.outline.area / self.film.thickness / self.capacitance
        return over * np.outer(self.e[:2], [self.film.d31, self.film.d32])

    def with_voltage(self, forces: Array) -> Array:
        """Forces X, Y in N, (2,), by the whole stress, from the forces by the strain's stress."""
        rest = self.film.prestress[:2] * self.outline.area
        return np.asarray(forces + self.share @ (forces - rest))

    def effect(self, scene: Scene, touch: LoadedProbe, own: float = 0.4) -> float:
        """Approximate relative change of a touch's charge by coupling. A small
        part of a film keeps about `own` of its own stress: (1 - ν)/2, of a shear (1 + ν)/4
        (Eshelby)."""
        film, area = self.film, self.outline.area
        probe, force = estimate_pressed_area(scene, touch)
        radius, pressed = np.sqrt([area / np.pi, probe.area / np.pi])
        # an electrode under the probe has its mean tension at about half its radius
        r = max(math.dist(self.outline.centroid, probe.centroid) - radius, pressed, 0.5 * radius)
        kept = own + (1.0 - own) * area / (np.pi * film.radius**2)
        return float(np.trace(self.share)) * kept * estimate_load_share(film, force, r)


class Coupling(Term):
    """The energy q²/(2 (C + C_L)) of an electrode."""

    def __init__(self, electrode: FloatingElectrode, space: Space) -> None:
        self.electrode, self.space = electrode, space
        self.elements: Indices = space.mesh.subdomains[make_subdomain_name(electrode.name)]
        self._moduli = space.weights[self.elements, :, None] * electrode.e

    def charge(self, strain: Array) -> float:
        """q in C of the whole film's strain."""
        return float((strain[self.elements] * self._moduli).sum())

    def voltage(self, state: State) -> float:
        """V in V."""
        return self.charge(state.strain) / self.electrode.capacitance

    def energy(self, state: State) -> float:
        return 0.5 * self.voltage(state) * self.charge(state.strain)

    def slope(self, state: State) -> Array:
        """Derivative of q by the dofs in C/m, (dofs,): integrals of e : sym(Fᵀ grad v)."""
        flux = state.deformation_gradient[self.elements] * self._moduli[:, :, None, :2]
        parts = np.matmul(self.space.gradients[self.elements], flux.swapaxes(2, 3))
        return self.space.sum(parts.sum(axis=1), self.elements)

    def residual(self, state: State) -> Array:
        return self.voltage(state) * self.slope(state)

    def added_stress(self, state: State) -> ElementStress:
        film = self.electrode.film
        return ElementStress(self.elements, self.voltage(state) / film.thickness * self.electrode.e)

    def tangent_column(self, state: State) -> Array:
        return self.slope(state) / np.sqrt(self.electrode.capacitance)

    def action(self, state: State, x: Array) -> Array:
        column = self.tangent_column(state)
        return column * (column @ x)

    def energy_along(self, state: State, x: Array) -> Array:
        step = self.space.gradient(x)
        first = compute_strain_rate(state.deformation_gradient, step)
        second = compute_strain(step) - compute_strain_rate(IDENTITY, step)
        charges = [self.charge(strain) for strain in (state.strain, first, second)]
        return np.convolve(charges, charges) / (2.0 * self.electrode.capacitance)


def find_floating_electrodes(scene: Scene) -> tuple[FloatingElectrode, ...]:
    """Electrodes that no charge amplifier keeps at zero voltage."""
    readout, film = scene.readout or Readout(), scene.film
    return tuple(
        FloatingElectrode(
            e.name, e.outline, film, readout.of("cable_capacitance_pF", e.name) / 1e12
        )
        for e in scene.electrode_list
        if readout.of("kind", e.name) == "voltage"
    )


def find_coupled_electrodes(scene: Scene) -> tuple[FloatingElectrode, ...]:
    """The floating electrodes coupled to the film; ``film.coupling = "auto"`` is resolved here."""
    coupling = scene.film.coupling
    joins = (
        estimate_coupling_effect(scene) > scene.numerics.tolerance
        if coupling == "auto"
        else coupling
    )
    return find_floating_electrodes(scene) if joins else ()


def estimate_coupling_effect(scene: Scene) -> float:
    """About the largest relative change of a charge by coupling."""
    touches = scene.loaded_probes
    return max(
        (e.effect(scene, t) for e in find_floating_electrodes(scene) for t in touches), default=0.0
    )


def describe_coupling(scene: Scene) -> Iterator[tuple[bool, str]]:
    """Whether coupling is included, and its size; nothing without floating electrodes."""
    if names := ", ".join(electrode.name for electrode in find_floating_electrodes(scene)):
        change = format_two_digits(100.0 * estimate_coupling_effect(scene))
        size = f"could change a charge by up to {change} %"
        why = f"no charge amplifier keeps {names} at zero voltage, which stiffens the film"
        text = f"coupling (film.coupling = {quote(scene.film.coupling)}): {size}; {why}"
        joins = bool(find_coupled_electrodes(scene))
        yield joins, text if joins else f"{text}; to include it give film.coupling = true"

"""Electromechanical coupling: how the voltages of electrodes stiffen the film.

A charge amplifier keeps its electrode at no voltage. Any other electrode shares its charge with
what it is wired to: on a capacitance C_L, zero where it is open, the strain E since the film at
rest makes::

    q = ∫ e : E dA,    e = d : C,    V = -q/(C + C_L),    C = ε_S A/h,    ε_S = ε_T - d : C : d

with the permittivity ε_T at constant stress, ``film.permittivity``. Under it the stress is
S = C : (E + E0) - e V/h, so that the film's energy gains q²/(2 (C + C_L)). The charge ∫ d : S dA of
that stress is what a channel reads, as it is without coupling: -V times (ε_T A/h + C_L).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.film.loads.contact import guessed_force, guessed_width
from pvdf_fem.film.membrane import IDENTITY, strain_of, strain_rate
from pvdf_fem.film.point_load import cube_at, tension_at
from pvdf_fem.film.space import Space
from pvdf_fem.film.term import State, Term
from pvdf_fem.mesh.gmsh_mesh import electrode_patch
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.scene import LoadedProbe, Scene
from pvdf_fem.scene.scene_file import quote

#: What is left of a stress of its own in a small part of a film that holds it: (1 - ν)/2 and, for a
#: shear, (1 + ν)/4 in a disc (Eshelby).
RELAXED = 0.4


@dataclass(frozen=True, eq=False)
class Floating:
    """An electrode of a film that no amplifier keeps at zero voltage, wired to `load` in F."""

    film: Film
    name: str
    outline: Outline
    load: float

    @property
    def stress_coefficients(self) -> Array:
        """e in C/m², (3,): components 11, 22, 12."""
        return self.film.stiffness @ [self.film.d31, self.film.d32, 0.0]

    @cached_property
    def capacitance(self) -> float:
        """C + C_L in F."""
        clamped = max(self.film.clamped_permittivity, np.finfo(float).tiny)
        return clamped * self.outline.area / self.film.thickness + self.load

    @cached_property
    def share(self) -> Array:
        """Forces X, Y in N that the voltage adds over those since the film at rest, (2, 2)."""
        d, e = (self.film.d31, self.film.d32), self.stress_coefficients[:2]
        return np.outer(e, d) * self.outline.area / self.film.thickness / self.capacitance

    @property
    def gain(self) -> float:
        """What the voltage adds to a charge that strain makes, over that charge."""
        return float(np.trace(self.share))

    def with_voltage(self, forces: Array) -> Array:
        """Forces X, Y of the whole stress, (2,), of those of the strain."""
        rest = self.film.stress_at_rest[:2] * self.outline.area
        return np.asarray(forces + self.share @ (forces - rest))


class Coupling(Term):
    """The energy q²/(2 (C + C_L)) of an electrode."""

    def __init__(self, electrode: Floating, space: Space) -> None:
        self.electrode, self.space = electrode, space
        self.elements: Indices = space.mesh.subdomains[electrode_patch(electrode.name)]
        self._moduli = space.weights[self.elements, :, None] * electrode.stress_coefficients

    def charge(self, strain: Array) -> float:
        """q in C of the strain (elements, points, 3) of the whole film."""
        return float((strain[self.elements] * self._moduli).sum())

    def voltage(self, state: State) -> float:
        """-V in V, which has the sign of the charge."""
        return self.charge(state.strain) / self.electrode.capacitance

    def energy(self, state: State) -> float:
        return 0.5 * self.voltage(state) * self.charge(state.strain)

    def residual(self, state: State) -> Array:
        return self.voltage(state) * self._slope(state)

    def added_stress(self, state: State) -> tuple[Indices, Array]:
        stress = self.voltage(state) / self.electrode.film.thickness
        return self.elements, stress * self.electrode.stress_coefficients

    def _slope(self, state: State) -> Array:
        """Derivative of q by the dofs in C/m, (dofs,)."""
        return self.space.sum(self._element_slope(state.deformation_gradient), self.elements)

    def _element_slope(self, F: Array) -> Array:
        """Integrals of e : sym(Fᵀ grad v), (elements of the electrode, dofs of one)."""
        flux = F[self.elements] * self._moduli[:, :, None, :2]
        parts = np.matmul(self.space.gradients[self.elements], flux.swapaxes(2, 3))
        return parts.sum(axis=1).reshape(len(self.elements), -1)

    def tangent_column(self, state: State) -> Array:
        return self._slope(state) / np.sqrt(self.electrode.capacitance)

    def element_action(self, state: State, x: Array) -> Array:
        forces = np.zeros(self.space.element_dofs.shape)
        slope = self._element_slope(state.deformation_gradient)
        change = float((slope * x[self.space.element_dofs[self.elements]]).sum())
        forces[self.elements] = change / self.electrode.capacitance * slope
        return forces

    def along(self, state: State, x: Array) -> Array:
        step = self.space.gradient(x)
        first = strain_rate(state.deformation_gradient, step)
        second = strain_of(step) - strain_rate(IDENTITY, step)
        charges = [self.charge(strain) for strain in (state.strain, first, second)]
        return np.convolve(charges, charges) / (2.0 * self.electrode.capacitance)


def floating(scene: Scene) -> tuple[Floating, ...]:
    """The electrodes of a scene that no charge amplifier keeps at zero voltage."""
    readout, film = scene.readout, scene.film
    if readout is None:
        return ()
    return tuple(
        Floating(film, e.name, e.outline, readout.of("cable_capacitance_pF", e.name) / 1e12)
        for e in scene.electrode_list
        if readout.of("kind", e.name) == "voltage"
    )


def coupled(scene: Scene) -> tuple[Floating, ...]:
    """Those whose coupling is part of the model; ``film.coupling = "auto"`` is resolved here."""
    coupling = scene.film.coupling
    joins = coupling_effect(scene) > scene.numerics.tolerance if coupling == "auto" else coupling
    return floating(scene) if joins else ()


def coupling_effect(scene: Scene) -> float:
    """About the largest part of a charge that coupling changes: of that which the load makes it is
    the electrode's gain, of which the film about a small electrode takes two thirds away."""
    film = np.pi * scene.film.radius**2
    changes = (
        e.gain * (RELAXED + (1.0 - RELAXED) * e.outline.area / film) * _part_by_load(e, touch)
        for e in floating(scene)
        for touch in scene.loaded_probes
    )
    return max(changes, default=0.0)


def _part_by_load(electrode: Floating, touch: LoadedProbe) -> float:
    """Part of an electrode's tension that a touch makes, (N - N0)/N, as for bending."""
    film, outline = electrode.film, electrode.outline
    tip = touch.load.kind == "contact"
    probe = touch.tip.grown(guessed_width(touch, film)) if tip else touch.outline
    force = math.hypot(*touch.load.components[:2], guessed_force(touch.load, film))
    own, pressed = (math.sqrt(x.area / math.pi) for x in (outline, probe))
    # half its radius is about where an electrode that the probe presses has its mean
    r = max(math.dist(outline.centroid, probe.centroid) - own, pressed, 0.5 * own)
    return min(cube_at(film, force, r) / tension_at(film, force, r) ** 3, 1.0) if force else 0.0


def coupling_remark(scene: Scene) -> tuple[bool, str] | None:
    """Whether coupling is included, and a text with its size; None without floating electrodes."""
    if not (names := ", ".join(electrode.name for electrode in floating(scene))):
        return None
    return bool(coupled(scene)), (
        f"coupling (film.coupling = {quote(scene.film.coupling)}): could change a charge by up to"
        f" {coupling_effect(scene):.1e} of it; no charge amplifier keeps {names} at zero voltage"
    )

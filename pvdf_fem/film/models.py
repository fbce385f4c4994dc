"""Membrane, plate or tension field: the model of a scene's film.

Only `resolve_film_model` chooses between them. Everything that depends on the choice is in the
`FilmModel` that it returns.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from pvdf_fem.arrays import Array, Mask
from pvdf_fem.film.bending.effect import BendingEffect, estimate_bending_effect
from pvdf_fem.film.bending.layers import BendingLayers
from pvdf_fem.film.bending.plate import Plate
from pvdf_fem.film.effects import EffectNote, format_two_digits
from pvdf_fem.film.laws.laminate import LAWS
from pvdf_fem.film.laws.law import Law
from pvdf_fem.film.laws.tension_field import TensionField
from pvdf_fem.film.loads.load_classes import find_rigid_elements, has_rigid_probe
from pvdf_fem.film.loads.uneven_strain import UnevenStrain
from pvdf_fem.film.membrane import Membrane
from pvdf_fem.film.space import Space
from pvdf_fem.film.term import State, Term
from pvdf_fem.mesh.symmetry import WHOLE_FILM, SymmetrySector
from pvdf_fem.scene.placed.support_keys import find_support_keys
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import quote

#: Stresses below this fraction of the largest stress are round-off.
ROUND_OFF = 1e-9
#: Minimum relative change of a charge due to neglected bending that causes a warning.
CONSIDERABLE_CHANGE = 1e-2


@dataclass(frozen=True)
class Kinematics:
    """The kind of film: whether it bends, and whether it carries compression."""

    name: str
    #: Whether the film has bending stiffness, so that meshes resolve its bending layers.
    bends: bool = False
    #: Whether the film wrinkles or goes slack instead of carrying compression.
    wrinkles: bool = False
    lowest_order: int = 1  #: Minimum polynomial order of the displacement.


#: A film without bending stiffness that carries compression where the equilibrium needs it.
MEMBRANE = Kinematics("membrane")
PLATE = Kinematics("plate", bends=True, lowest_order=2)
TENSION_FIELD = Kinematics("tension field", wrinkles=True)


@dataclass(frozen=True)
class MeshPolicy:
    """Settings of meshing, solving and estimating errors, which depend on the kinematics."""

    #: Minimum Jacobian in an element, as a fraction of the element's mean.
    min_jacobian_ratio: float = 0.14
    #: Factor on the element sizes of the first mesh.
    size_factor: float = 1.0
    #: Default number of unknowns of the finest mesh, at the usual tolerance.
    max_unknowns: int = 60_000
    #: Time of a Newton iteration, divided by that of a membrane with equally many unknowns.
    iteration_cost: float = 1.0
    #: Whether the diagonal of the tangent is a good preconditioner for the correction in elements
    #: of the next order.
    has_smooth_correction: bool = True
    #: Error, divided by the change from this order to the next on the same mesh.
    saturation: float = 1.0
    #: Maximum residual of a solution in the energy norm, from round-off and the last Newton step.
    imbalance: float = 1e-6


@dataclass(frozen=True)
class Capabilities:
    """Properties of a film's solutions that other methods rely on."""

    #: Whether a symmetric film may be solved on a sector instead of as a whole.
    uses_symmetry: bool = True
    #: Whether the deformation depends on force and thickness by their ratio only.
    scales_with_force_over_thickness: bool = True
    #: Whether charges are differentiable with respect to thickness, pretension or cooling, and the
    #: elastic constants.
    has_film_derivatives: bool = True


class CompressedArea(NamedTuple):
    """A part of the film with compression, wrinkles or no tension."""

    text: str  #: A note with a placeholder ``{}`` for the area.
    where: Mask  #: At the quadrature points, shape (elements, points).


@dataclass(frozen=True, eq=False)
class FilmModel:
    """The model of a scene's film.

    Attributes
    ----------
    scene : Scene
        The scene, whose film is modelled.
    kinematics : Kinematics
        `MEMBRANE`, `PLATE` or `TENSION_FIELD`.
    mesh_policy : MeshPolicy
        Numbers for meshing, solving and estimating errors.
    capabilities : Capabilities
        Properties of the solutions that other methods rely on.
    """

    scene: Scene
    kinematics: Kinematics
    mesh_policy: MeshPolicy
    capabilities: Capabilities

    @property
    def bends(self) -> bool:
        """Whether the film has bending stiffness."""
        return self.kinematics.bends

    @property
    def wrinkles(self) -> bool:
        """Whether the film wrinkles or goes slack instead of carrying compression."""
        return self.kinematics.wrinkles

    @cached_property
    def bending_effect(self) -> BendingEffect:
        """Estimate of the effect of bending, whether the model includes it or not."""
        return estimate_bending_effect(self.scene)

    @property
    def law(self) -> Law:
        """The material law of the film: that of ``film.law``, or the tension field."""
        film = self.scene.film
        return TensionField(film.stiffness) if self.wrinkles else LAWS[film.law](film.stiffness)

    def make_membrane(self, space: Space, sector: SymmetrySector = WHOLE_FILM) -> Membrane:
        """Make the membrane term on a finite-element space of the whole film or a sector."""
        added = UnevenStrain.from_scene(self.scene)
        return Membrane(space, self.scene.film, self.law, added, sector.frame)

    def make_bending_terms(self, space: Space, terms: list[Term]) -> list[Term]:
        """Return a list with the plate term if the film bends, otherwise an empty list.

        Parameters
        ----------
        space : Space
            The finite-element space.
        terms : list of Term
            All other terms. Elements that these keep flat and horizontal do not bend.
        """
        if not self.bends:
            return []
        plate = Plate(
            space,
            self.scene.film,
            rigid_elements=find_rigid_elements(terms, horizontal_only=True),
            rim_tension=self.bending_effect.rim_tension,
            punch_tension=self.bending_effect.probe_tension,
        )
        return [plate]

    def make_bending_layers(
        self, terms: list[Term], expansion: sp.csr_matrix, state: State
    ) -> BendingLayers | None:
        """Make the object that estimates the error due to bending layers narrower than elements.

        Parameters
        ----------
        terms : list of Term
            The terms of the equations that are solved.
        expansion : sparse matrix, shape (dofs, unknowns)
            Matrix that maps unknowns to dofs.
        state : State
            Solution of these equations, whose error is estimated.

        Returns
        -------
        BendingLayers or None
            None if no term is a `Plate`.
        """
        plates = [term for term in terms if isinstance(term, Plate)]
        return BendingLayers.from_state(plates[0], expansion, state) if plates else None

    @property
    def bending_note(self) -> EffectNote:
        """Note that bending is included or neglected, with an estimate of its effect."""
        text = f"bending (film.bending = {quote(self.scene.film.bending)}): {self.bending_effect}"
        if not self.bends:
            text += f"; to include it, use {self._bending_advice}"
        return EffectNote(self.bends, text)

    @property
    def warnings(self) -> tuple[str, ...]:
        """A warning if bending is neglected and its estimated effect is large; otherwise empty.

        The effect is large above both the tolerance and `CONSIDERABLE_CHANGE`. No solve is needed.
        """
        change = self.bending_effect.change
        if self.bends or change <= max(self.scene.numerics.tolerance, CONSIDERABLE_CHANGE):
            return ()
        percent = format_two_digits(100.0 * change)
        text = f"bending: neglected; it could change a charge by up to {percent} %"
        return (f"{text}; to include it, use {self._bending_advice}",)

    @property
    def _bending_advice(self) -> str:
        """The keys of the scene to change so that bending is included."""
        if self.wrinkles:
            return 'film.compression = "refuse" with film.bending = "auto" or true'
        if self.scene.film.layers:
            return "thinner film.patches, or both_sides = true"
        if self.scene.tips:
            return 'another load.kind than "contact"'
        return "film.bending = true"

    def find_compression(self, smallest: Array, largest: Array) -> Iterator[CompressedArea]:
        """Yield the compressed part of a film, or the wrinkled and slack parts of a tension field.

        Parameters
        ----------
        smallest, largest : ndarray, shape (elements, points)
            Smaller and larger principal stress in Pa.

        Yields
        ------
        CompressedArea
            One for each part that is not empty; stresses up to `ROUND_OFF` count as zero.
        """
        limit = ROUND_OFF * np.abs(largest).max()
        if self.wrinkles:
            is_slack = largest <= limit
            is_wrinkled = (smallest <= limit) & ~is_slack
            areas = [
                CompressedArea("tension field: wrinkled on {}", is_wrinkled),
                CompressedArea("tension field: slack on {}", is_slack),
            ]
        else:
            stress = f"down to {1e-6 * smallest.min():.3g} MPa on {{}}"
            text = f"compression: {stress}, where a real film wrinkles"
            areas = [CompressedArea(text, smallest < -limit)]
        for area in areas:
            if area.where.any():
                yield area


def resolve_film_model(scene: Scene) -> FilmModel:
    """Choose the model of a scene's film: membrane, plate or tension field.

    With ``film.bending = "auto"`` a film without tips is a plate if the estimated effect of bending
    exceeds the tolerance of the charges.
    """
    kinematics = _choose_kinematics(scene)
    # a support resists the deflection, whatever the thickness of the film
    has_support = any(find_support_keys(scene.film))
    # the next order still has half of the error from the singular edge of a rigid probe
    edge_saturation = 2.0 if has_rigid_probe(scene) else 1.0
    if kinematics is PLATE:
        policy = MeshPolicy(
            min_jacobian_ratio=0.2,
            iteration_cost=1.6,
            has_smooth_correction=False,
            saturation=1.2,  # measured: 0.85 to 1.1
        )
        capabilities = Capabilities(
            uses_symmetry=False,
            scales_with_force_over_thickness=False,
            has_film_derivatives=False,
        )
    elif kinematics is TENSION_FIELD:
        policy = MeshPolicy(
            size_factor=1.7,  # only later meshes can follow kinks in the stress
            max_unknowns=30_000,
            iteration_cost=1.5,
            has_smooth_correction=False,
            # the next order removes 0.55 to 0.8 of the error of kinks (measured)
            saturation=max(1.6, edge_saturation),
            # Newton steps shrink only linearly, and round-off in a stiff film ends them early
            imbalance=max(1e-6, 0.1 * scene.numerics.tolerance),
        )
        capabilities = Capabilities(
            scales_with_force_over_thickness=not has_support,
            has_film_derivatives=False,
        )
    else:
        policy = MeshPolicy(saturation=edge_saturation)
        capabilities = Capabilities(scales_with_force_over_thickness=not has_support)
    return FilmModel(scene, kinematics, mesh_policy=policy, capabilities=capabilities)


def _choose_kinematics(scene: Scene) -> Kinematics:
    """Choose between membrane, plate and tension field by the keys of the scene's film.

    ``film.compression = "tension-field"`` takes precedence over ``film.bending``. With
    ``film.bending = "auto"`` a film under a tip is a membrane; any other film is a plate if the
    estimated effect of bending exceeds the tolerance.
    """
    film = scene.film
    if film.compression == "tension-field":
        return TENSION_FIELD
    if film.bending == "auto":
        if scene.tips:
            return MEMBRANE
        change = estimate_bending_effect(scene).change
        return PLATE if change > scene.numerics.tolerance else MEMBRANE
    return PLATE if film.bending else MEMBRANE

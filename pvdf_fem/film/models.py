"""Membrane, plate or tension field: what a film is taken for, chosen once per scene.

Everything that depends on this choice asks the scene's `FilmModel`; `resolve_film_model` is the
only place that decides.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache

import numpy as np
import scipy.sparse as sp

from pvdf_fem.arrays import Array
from pvdf_fem.film.bending.effect import BendingEffect, estimate_bending_effect
from pvdf_fem.film.bending.layers import BendingLayers
from pvdf_fem.film.bending.plate import Plate
from pvdf_fem.film.effects import format_two_digits
from pvdf_fem.film.laws.laminate import LAWS
from pvdf_fem.film.laws.law import Law
from pvdf_fem.film.laws.tension_field import TensionField
from pvdf_fem.film.loads.load_classes import find_rigid_elements, has_rigid_probe
from pvdf_fem.film.loads.uneven_strain import UnevenStrain
from pvdf_fem.film.membrane import Membrane
from pvdf_fem.film.space import Space
from pvdf_fem.film.term import State, Term
from pvdf_fem.mesh.symmetry import WHOLE_FILM, SymmetrySector
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import quote


class FilmModel:
    """What a scene's film is taken for; by default a membrane that carries compression where
    necessary."""

    #: Lowest polynomial order of a displacement.
    lowest_order = 1
    #: Elements of a mesh are compressed to no less than this part of their mean Jacobian.
    least_jacobian = 0.14
    #: Whether a part of a symmetric film may be solved for the whole.
    solved_on_parts = True
    #: Whether the film wrinkles instead of carrying compression.
    wrinkles = False
    #: Whether bending is part of the model, and meshes resolve its layers.
    bends = False
    #: Whether the next order's correction is nearly diagonal in the nodal basis.
    smooth = True
    #: Default number of unknowns for the finest mesh, at the usual tolerance.
    most_unknowns = 60_000
    #: Time of a Newton iteration over the time for a membrane with equally many unknowns.
    iteration_cost = 1.0
    #: Factor on the element sizes of the first mesh.
    size_factor = 1.0
    #: Whether the deformation depends on force and thickness by their ratio only.
    force_over_thickness = True
    #: Whether charges can be differentiated by thickness, pretension or cooling, and moduli.
    film_is_differentiable = True
    #: Relative change of a charge by bending from which leaving bending out deserves a warning.
    considerable = 1e-2
    #: What a solution may lack of balance, in the energy norm: rounding and Newton's last step.
    imbalance: float = 1e-6

    def __init__(self, scene: Scene) -> None:
        self.scene = scene

    @property
    def effect(self) -> BendingEffect:
        """What bending would change in the scene."""
        return estimate_bending_effect(self.scene)

    @property
    def film_law(self) -> Law:
        """The law of the film."""
        return LAWS[self.scene.film.law](self.scene.film.stiffness)

    def membrane(self, space: Space, part: SymmetrySector = WHOLE_FILM) -> Membrane:
        """The membrane term."""
        added = UnevenStrain.from_scene(self.scene)
        return Membrane(space, self.scene.film, self.film_law, added, part.frame)

    def bending_terms(self, space: Space, terms: list[Term]) -> list[Term]:
        """Make the terms that bending adds to the film's other terms."""
        return []

    @property
    def saturation(self) -> float:
        """The error over what a space of the next order on the same mesh takes away.

        Half the error from the singular edge of a rigid probe remains.
        """
        return 2.0 if has_rigid_probe(self.scene) else 1.0

    def layers(
        self, terms: list[Term], expansion: sp.csr_matrix, state: State
    ) -> BendingLayers | None:
        """Bending layers that the elements do not resolve, where the film bends."""
        return None

    @property
    def remark(self) -> tuple[bool, str]:
        """Whether bending is included, and a text with the estimate of its effect."""
        text = f"bending (film.bending = {quote(self.scene.film.bending)}): {self.effect}"
        return self.bends, text if self.bends else f"{text}; to include it give {self._remedy}"

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings before any solve."""
        change = self.effect.change
        if change <= max(self.scene.numerics.tolerance, self.considerable):
            return ()
        percent = format_two_digits(100.0 * change)
        text = f"bending: left out, it could change a charge by up to {percent} %"
        return (f"{text}; give {self._remedy}",)

    @property
    def _remedy(self) -> str:
        if self.scene.film.patches:
            return "thinner film.patches, or both_sides = true"
        return 'another load.kind than "contact"' if self.scene.tips else "film.bending = true"

    def compression_remarks(self, smallest: Array, largest: Array) -> Iterator[tuple[str, Array]]:
        """Texts with a place for an area, and where that is, from the principal stresses."""
        compressed = smallest < -ROUNDING * np.abs(largest).max()
        if compressed.any():
            yield (
                f"compression: down to {1e-6 * smallest.min():.3g} MPa on {{}},"
                " where a real film wrinkles",
                compressed,
            )


#: Stresses below this part of the largest stress are rounding.
ROUNDING = 1e-9


class PlateModel(FilmModel):
    """A film that bends: membrane and plate."""

    lowest_order = 2
    iteration_cost = 1.6
    least_jacobian = 0.2
    solved_on_parts = False
    bends = True
    smooth = False
    force_over_thickness = False
    film_is_differentiable = False

    def bending_terms(self, space: Space, terms: list[Term]) -> list[Term]:
        """Make the plate."""
        effect = self.effect
        flat = find_rigid_elements(terms, horizontal_only=True)
        film = self.scene.film
        return [Plate(space, film, flat, effect.rim_tension, effect.probe_tension)]

    @property
    def saturation(self) -> float:
        """The error over what the next order takes away, measured: 0.85 to 1.1."""
        return 1.2

    def layers(self, terms: list[Term], expansion: sp.csr_matrix, state: State) -> BendingLayers:
        """Bending layers that the elements do not resolve."""
        plate = next(term for term in terms if isinstance(term, Plate))
        return BendingLayers.from_state(plate, expansion, state)

    @property
    def warnings(self) -> tuple[str, ...]:
        """None before a solve."""
        return ()


class TensionFieldModel(FilmModel):
    """A film wrinkles or goes slack instead of carrying compression."""

    wrinkles = True
    smooth = False
    most_unknowns = 30_000
    iteration_cost = 1.5
    # only the next mesh can follow kinks in the stress, and the first mesh is coarser
    size_factor = 1.7
    film_is_differentiable = False

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        # steps shrink only linearly, and rounding in a stiff film ends them early
        self.imbalance = max(self.imbalance, 0.1 * scene.numerics.tolerance)

    @property
    def film_law(self) -> Law:
        """The tension field's."""
        return TensionField(self.scene.film.stiffness)

    @property
    def saturation(self) -> float:
        """The next order takes away 0.55 to 0.8 of the error of kinks (measured)."""
        return max(1.6, super().saturation)

    @property
    def _remedy(self) -> str:
        return 'film.compression = "refuse" with film.bending = "auto" or true'

    def compression_remarks(self, smallest: Array, largest: Array) -> Iterator[tuple[str, Array]]:
        """Where the film has wrinkled or gone slack."""
        limit = ROUNDING * np.abs(largest).max()
        wrinkled, slack = (smallest <= limit) & (largest > limit), largest <= limit
        for word, where in (("wrinkled", wrinkled), ("slack", slack)):
            if where.any():
                yield f"tension field: {word} on {{}}", where


@lru_cache(maxsize=64)
def resolve_film_model(scene: Scene) -> FilmModel:
    """The film model of a scene; ``film.bending = "auto"`` is resolved here."""
    film = scene.film
    if film.compression == "tension-field":
        return TensionFieldModel(scene)
    bends = film.bending
    if bends == "auto":
        bends = not scene.tips and estimate_bending_effect(scene).change > scene.numerics.tolerance
    return PlateModel(scene) if bends else FilmModel(scene)

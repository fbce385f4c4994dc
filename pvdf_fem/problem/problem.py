"""The problem that a scene describes, resolved once: film model, loads, outputs and symmetry."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.film.electric.coupling import FloatingElectrode, find_coupled_electrodes
from pvdf_fem.film.loads.load_spec import (
    LoadSpec,
    Pressure,
    make_load_specs,
    require_usable_pressure,
)
from pvdf_fem.film.loads.profiles import make_profile, pin_profile_files
from pvdf_fem.film.models import FilmModel, resolve_film_model
from pvdf_fem.mesh.symmetry import WHOLE_FILM, SymmetrySector, find_symmetry_sector
from pvdf_fem.problem.outputs import Output, make_outputs
from pvdf_fem.scene.load import Load
from pvdf_fem.scene.scene import Scene

#: Tables of a scene that the unloaded film does not have.
LOADED_TABLES = ("probe", "readout", "stage", "air", "model", "uncertain")


@dataclass(frozen=True, eq=False)
class Problem:
    """A scene resolved to what is solved.

    Every choice that a scene leaves open is made here and nowhere else: whether the film is a
    membrane, a plate or a tension field, which voltages act on it, what presses, which charges are
    wanted, and which sector of a symmetric film represents the whole. The choices are made when
    they are first asked for, and kept.

    Attributes
    ----------
    scene : Scene
        The scene, with the digests of the pressure profiles that it reads from files.
    film : FilmModel
        Membrane, plate or tension field.
    pressure : callable, optional
        Pressure in Python on the single probe, in place of ``load.profile``.
    requested_outputs : tuple of Output, optional
        Outputs in place of the scene's electrodes.
    """

    scene: Scene
    film: FilmModel
    pressure: Pressure | None = None
    requested_outputs: tuple[Output, ...] | None = None

    @classmethod
    def from_scene(
        cls,
        scene: Scene,
        *,
        pressure: Pressure | None = None,
        outputs: Sequence[Output] | None = None,
    ) -> Problem:
        """Resolve a scene.

        Parameters
        ----------
        scene : Scene
            A valid scene.
        pressure : callable, optional
            ``p(x_mm, y_mm)`` in place of the load's profile, see `pvdf_fem.solve`.
        outputs : sequence of Output, optional
            Charges to compute in place of those of the scene's electrodes.

        Returns
        -------
        Problem

        Raises
        ------
        SceneError
            For a pressure that the scene has no single dead load for, and for a profile file that
            cannot be read.
        """
        require_usable_pressure(scene, pressure)
        (scene,) = pin_profile_files([scene])
        requested = None if outputs is None else tuple(outputs)
        film = resolve_film_model(scene)
        return cls(scene, film, pressure=pressure, requested_outputs=requested)

    def with_scene(self, scene: Scene) -> Problem:
        """Resolve another scene with this problem's pressure and requested outputs."""
        return replace(self, scene=scene, film=resolve_film_model(scene))

    @cached_property
    def loads(self) -> tuple[LoadSpec, ...]:
        """The loaded probes with their profiles, contact estimates and auxiliary nodes."""
        return make_load_specs(self.scene, self.pressure)

    @cached_property
    def floating_electrodes(self) -> tuple[FloatingElectrode, ...]:
        """Electrodes whose voltages act on the film."""
        return find_coupled_electrodes(self.scene)

    @property
    def has_passive_electrodes(self) -> bool:
        """Whether electrodes, d31 and d32 only read the stress, and do not change it."""
        return not self.floating_electrodes

    @cached_property
    def outputs(self) -> tuple[Output, ...]:
        """The quantities of interest: charges of electrodes, by default those of the scene."""
        if self.requested_outputs is not None:
            return self.requested_outputs
        return make_outputs(self.scene, self.floating_electrodes)

    @cached_property
    def sector(self) -> SymmetrySector:
        """The sector of a symmetric film whose reflections make the whole; else the whole film."""
        leaning = any(load.load.tilt == "free" for load in self.scene.loaded_probes)
        if self.scene.tips or leaning or self.pressure is not None:
            return WHOLE_FILM
        if not (self.film.capabilities.uses_symmetry and self.has_passive_electrodes):
            return WHOLE_FILM
        return find_symmetry_sector(self.scene)

    @cached_property
    def unloaded_scene(self) -> Scene:
        """The scene of the film before it is loaded, warms or carries voltages.

        It bends if the loaded film does.
        """
        choices = {"bending": self.film.bends, "coupling": False}
        film = self.scene.film.reference_state.model_copy(update=choices)
        tables = dict.fromkeys(LOADED_TABLES)
        return self.scene.model_copy(update={**tables, "film": film, "load": Load()})

    @cached_property
    def _unloaded(self) -> Problem:
        if self.unloaded_scene == self.scene:
            return self
        return Problem(self.unloaded_scene, resolve_film_model(self.unloaded_scene))

    @cached_property
    def unloaded_stress(self) -> Array | None:
        """Uniform stress S11, S22 in Pa of the unloaded film, (2,); None if it must be solved for.

        A flat film has a uniform stress. A film that moves in its plane or bears its weight is not
        flat, only a bending film can carry compression, and a tension field carries none.
        """
        unloaded = self._unloaded
        film, model = unloaded.scene.film, unloaded.film
        law = model.law
        stress = law.stress(np.zeros((1, 3)), law.compute_prestrain(film))[0, :2]
        carried = model.wrinkles or bool(stress.min() >= 0.0)
        return stress if film.is_flat_unloaded and carried else None

    @property
    def unloaded(self) -> Problem | None:
        """The problem of the unloaded film, where its charges need a solve; None elsewhere."""
        return self._unloaded if self.unloaded_stress is None else None

    @property
    def unloaded_outputs(self) -> tuple[Output, ...]:
        """The outputs of the unloaded film."""
        return self._unloaded.outputs

    def check_profiles(self) -> None:
        """Evaluate every pressure profile once, so that a useless one is refused before meshing.

        Raises
        ------
        SceneError
            For a profile that is not finite, or is zero on its whole probe.
        """
        for load in self.loads:
            make_profile(load).mean(load.outline.equal_area_polygon)

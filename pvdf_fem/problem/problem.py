"""The problem that a scene describes, resolved once: film model, loads, outputs and symmetry."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.film.backing import describe_backing
from pvdf_fem.film.coupling import (
    FloatingElectrode,
    describe_coupling,
    find_coupled_electrodes,
)
from pvdf_fem.film.effects import Charges, EffectNote
from pvdf_fem.film.loads.load_spec import (
    LoadSpec,
    Pressure,
    format_function_name,
    make_load_specs,
    require_usable_pressure,
)
from pvdf_fem.film.loads.profiles import make_profile, pin_profile_files
from pvdf_fem.film.loads.uneven_strain import describe_heat_effects
from pvdf_fem.film.loads.weight import describe_weight
from pvdf_fem.film.models import FilmModel, resolve_film_model
from pvdf_fem.mesh.symmetry import WHOLE_FILM, SymmetrySector
from pvdf_fem.problem.effects import Effects
from pvdf_fem.problem.outputs import Output, make_outputs
from pvdf_fem.problem.symmetry import find_symmetry_sector
from pvdf_fem.problem.thickness_effect import describe_thickness_effect
from pvdf_fem.scene.arguments import SceneLike, as_scene
from pvdf_fem.scene.load import Load
from pvdf_fem.scene.scene import Scene
from pvdf_fem.summary import Result, Summary

#: Choices of a problem that are made when they are first needed.
LATER_CHOICES = ("outputs", "sector", "checked_loads")
#: Tables of a scene that the unloaded film does not have.
LOADED_TABLES = ("probe", "readout", "stage", "air", "model", "uncertain")


@dataclass(frozen=True, eq=False, repr=False)
class Problem(Result):
    """A scene resolved to what is solved.

    Every choice that a scene leaves open is made here and nowhere else: whether the film is a
    membrane, a plate or a tension field, which voltages act on it, which loads press, which charges
    are computed, and which sector of a symmetric film represents the whole. All choices but the
    first are made when they are first needed, or by `resolve`, and cached.

    Attributes
    ----------
    scene : Scene
        The scene, with the digests of the pressure profiles that it reads from files.
    film : FilmModel
        The model of the film: membrane, plate or tension field.
    pressure : callable, optional
        Pressure in Python on the single probe, in place of ``load.profile``.
    requested_outputs : tuple of Output, optional
        Outputs in place of the scene's electrodes.

    Examples
    --------
    >>> problem = Problem.from_scene(Scene.example("triangle"))
    >>> print(problem)
    >>> problem.film_model_name, problem.to_json()["neglected"]
    """

    scene: Scene
    film: FilmModel
    pressure: Pressure | None = None
    requested_outputs: tuple[Output, ...] | None = None

    @classmethod
    def from_scene(
        cls,
        scene: SceneLike,
        *,
        pressure: Pressure | None = None,
        outputs: Sequence[Output] | None = None,
    ) -> Problem:
        """Make the problem of a scene: choose the film model, and read the pressure profiles.

        Parameters
        ----------
        scene : Scene, path of its file, dict of its tables, or a result of it
            The scene to solve.
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
            If a pressure is given and the scene is not loaded by a single dead probe, or if a
            profile file cannot be read.
        """
        scene = as_scene(scene)
        require_usable_pressure(scene, pressure)
        (pinned,) = pin_profile_files([scene])
        requested = None if outputs is None else tuple(outputs)
        film = resolve_film_model(pinned)
        return cls(pinned, film, pressure=pressure, requested_outputs=requested)

    def with_scene(self, scene: Scene) -> Problem:
        """Return the problem of another scene with this one's pressure and requested outputs.

        The pressure profiles in files of the scene are not read again.
        """
        return replace(self, scene=scene, film=resolve_film_model(scene))

    def resolve(self) -> None:
        """Make all choices now, so that errors are reported before anything is meshed.

        Raises
        ------
        SceneError
            For a pressure profile that is negative or not finite under its probe, or whose file
            cannot be read.
        """
        for choice in LATER_CHOICES:
            getattr(self, choice)

    @cached_property
    def loads(self) -> tuple[LoadSpec, ...]:
        """The loaded probes with their profiles, contact estimates and auxiliary nodes."""
        return make_load_specs(self.scene, self.pressure)

    @cached_property
    def checked_loads(self) -> tuple[LoadSpec, ...]:
        """The loads, after every pressure profile was evaluated under its probe; see `resolve`."""
        for load in self.loads:
            make_profile(load).mean(load.outline.equal_area_polygon)
        return self.loads

    @cached_property
    def floating_electrodes(self) -> tuple[FloatingElectrode, ...]:
        """Electrodes whose voltages act on the film; empty if this coupling is neglected."""
        return find_coupled_electrodes(self.scene)

    @property
    def has_passive_electrodes(self) -> bool:
        """Whether no electrode has a voltage that acts on the film and so changes the stress."""
        return not self.floating_electrodes

    @cached_property
    def outputs(self) -> tuple[Output, ...]:
        """The quantities of interest: charges of electrodes, by default those of the scene."""
        if self.requested_outputs is not None:
            return self.requested_outputs
        return make_outputs(self.scene, self.floating_electrodes)

    @cached_property
    def sector(self) -> SymmetrySector:
        """The symmetry sector that is solved in place of the whole film.

        It is the whole film if there is no symmetry, or if symmetry is not used: under a rigid tip,
        a probe that tilts freely or a pressure in Python, if electrodes act on the film, and for
        film models that exclude it.
        """
        may_tilt = any(load.load.tilt == "free" for load in self.scene.loaded_probes)
        if self.scene.tips or may_tilt or self.pressure is not None:
            return WHOLE_FILM
        if not (self.film.capabilities.uses_symmetry and self.has_passive_electrodes):
            return WHOLE_FILM
        return find_symmetry_sector(self.scene)

    @cached_property
    def unloaded_scene(self) -> Scene:
        """The scene of the film before it is loaded, warms or carries voltages.

        Its film is a plate if that of the loaded scene is.
        """
        choices = {"bending": self.film.bends, "coupling": False}
        film = self.scene.film.reference_state.model_copy(update=choices)
        tables = dict.fromkeys(LOADED_TABLES)
        return self.scene.model_copy(update={**tables, "film": film, "load": Load()})

    @cached_property
    def _unloaded(self) -> Problem:
        """The problem of the unloaded film; this problem itself if nothing loads the film."""
        if self.unloaded_scene == self.scene:
            return self
        return Problem(self.unloaded_scene, resolve_film_model(self.unloaded_scene))

    @cached_property
    def unloaded_stress(self) -> Array | None:
        """Uniform stress S11, S22 of the unloaded film in Pa; None if it must be solved for.

        A flat film has a uniform stress. A film that moves in its plane or bears its weight is not
        flat, only a bending film can carry compression, and a tension field carries none.
        """
        unloaded = self._unloaded
        film = unloaded.scene.film
        model = unloaded.film
        law = model.law
        stress = law.stress(np.zeros((1, 3)), law.compute_prestrain(film))[0, :2]
        carried = model.wrinkles or bool(stress.min() >= 0.0)
        return stress if film.is_flat_unloaded and carried else None

    @property
    def unloaded(self) -> Problem | None:
        """The problem of the unloaded film; None if its stress is uniform and needs no solve."""
        return self._unloaded if self.unloaded_stress is None else None

    @property
    def unloaded_outputs(self) -> tuple[Output, ...]:
        """Outputs of the problem of the unloaded film: electrodes without voltages."""
        return self._unloaded.outputs

    def describe_effects(self, charges_pC: Charges = None) -> Effects:
        """Describe the effects beyond the plain membrane, with estimates of their sizes.

        Parameters
        ----------
        charges_pC : mapping, optional
            Charge in pC by name of electrode, with which added charges are compared.

        Returns
        -------
        Effects
        """
        notes: list[EffectNote] = []
        if self.pressure is not None:
            name = format_function_name(self.pressure)
            text = f"pressure: the function {name} in place of load.profile"
            notes.append(EffectNote(True, text))
        notes.append(self.film.bending_note)
        notes += describe_backing(self.scene)
        notes += describe_coupling(self.scene)
        notes += describe_thickness_effect(
            self.scene, self.loads, self.floating_electrodes, charges_pC=charges_pC
        )
        notes += describe_heat_effects(self.scene, charges_pC)
        notes += describe_weight(self.scene)
        return Effects.sort(notes)

    def summary(self) -> Summary:
        """Summarize the choices, effects and warnings of the problem without meshing or solving."""
        film = self.scene.film
        choices = {
            "film": f"{film.describe_outline()}, {film.thickness_um:g} µm thick",
            "film model": self.film_model_name,
            "solved on": self._describe_sector(),
            "loads": self._describe_loads(),
            "outputs": self._describe_outputs(),
            "voltages on the film": self._describe_voltages(),
            "unloaded film": self._describe_unloaded_film(),
            "tolerance": f"{self.scene.numerics.tolerance:g} of every charge",
        }
        sentences = ["what is solved, and why"]
        sentences += [f"{name + ':':<22}{text}" for name, text in choices.items()]
        effects = self.describe_effects()
        notes = [f"included: {text}" for text in effects.included]
        notes += [f"neglected: {text}" for text in effects.neglected]
        notes += [f"warning: {text}" for text in (*self.scene.warnings, *self.film.warnings)]
        return Summary("problem", sentences, notes=notes)

    def _headline(self) -> str:
        """Return film model, loads and outputs in one line."""
        return f"{self.film_model_name}, {self._describe_loads()}, {self._describe_outputs()}"

    def to_json(self) -> dict[str, Any]:
        """Return the choices, effects and warnings as plain values.

        ``outputs`` are the names of the scene's electrodes, even if other outputs are requested.
        """
        effects = self.describe_effects()
        return {
            "film_model": self.film_model_name,
            "mirror_lines": len(self.sector.mirror_axes),
            "loads": [load.load.kind for load in self.loads],
            "outputs": [electrode.name for electrode in self.scene.electrode_list],
            "observable": self.scene.numerics.observable,
            "floating_electrodes": [electrode.name for electrode in self.floating_electrodes],
            "solves_unloaded_film": self.unloaded is not None,
            "tolerance": self.scene.numerics.tolerance,
            "included": list(effects.included),
            "neglected": list(effects.neglected),
            "warnings": [*self.scene.warnings, *self.film.warnings],
        }

    @property
    def film_model_name(self) -> str:
        """Name of the film model: ``membrane``, ``plate`` or ``tension field``."""
        if self.film.wrinkles:
            return "tension field"
        return "plate" if self.film.bends else "membrane"

    def _describe_sector(self) -> str:
        """Say how much of the film is meshed, and how many mirror lines it has."""
        lines = len(self.sector.mirror_axes)
        if lines == 0:
            return "the whole film"
        fraction = {1: "half", 2: "a quarter"}[lines]
        return f"{fraction} of the film: {lines} mirror line{'s' if lines > 1 else ''}"

    def _describe_loads(self) -> str:
        """Name the shape, position, kind and size of each load; ``none`` without a load."""
        texts = []
        for load in self.loads:
            table = load.load
            size = f"{table.force_N:g} N"
            if table.depth_mm is not None:
                size = f"{table.depth_mm:g} mm deep"
            position = f"({load.probe.x_mm:g}, {load.probe.y_mm:g}) mm"
            texts.append(f"{load.probe.shape} at {position}, {table.kind}, {size}")
        if self.scene.film.distributed_force:
            texts.append("loads on the whole film")
        return "; ".join(texts) or "none"

    def _describe_outputs(self) -> str:
        """Name the electrodes whose charges are computed, or the number of requested charges."""
        observable = self.scene.numerics.observable
        if self.requested_outputs is not None:
            return f"{len(self.outputs)} requested charges by {observable}"
        names = ", ".join(electrode.name for electrode in self.scene.electrode_list)
        return f"charges of {names} by {observable}"

    def _describe_voltages(self) -> str:
        """Name the electrodes whose voltages act on the film; say so if there are none."""
        if self.has_passive_electrodes:
            return "none: electrodes only read the stress"
        return ", ".join(electrode.name for electrode in self.floating_electrodes)

    def _describe_unloaded_film(self) -> str:
        """Say whether the charges of the unloaded film need a solve."""
        if self.unloaded is None:
            return "uniform stress, which needs no solve"
        return "a solve of its own, since it is not flat or its stress is not uniform"

"""A scene: film, air, electrodes, probe, load and numerics, validated and frozen.

A scene comes from a TOML file or is built from the models of its tables. Keys carry the usual units
(mm, µm, GPa, pC/N); properties without a unit in their name are SI, and nothing else in the package
converts lengths or moduli. Defaults are the thesis's values: `Scene()` is the four-electrode
biaxial sensor without a probe.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Self

from pydantic import ValidationError, model_validator
from pydantic_core import PydanticCustomError

from pvdf_fem.scene.air import Air
from pvdf_fem.scene.changes import Replaced, apply_changes
from pvdf_fem.scene.drawings.expansion import expand_drawing, read_scene_tables
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.instrument.calibration import CalibratedParameters
from pvdf_fem.scene.instrument.response_domain import ResponseDomain
from pvdf_fem.scene.keys import Affects, Key, Section
from pvdf_fem.scene.load import FORCE_KEYS, Load, LoadOverrides
from pvdf_fem.scene.materials.film_notes import find_material_notes
from pvdf_fem.scene.numerics import Numerics
from pvdf_fem.scene.placed.electrode import Electrode, Electrodes, Layout
from pvdf_fem.scene.placed.loaded_probe import LoadedProbe
from pvdf_fem.scene.placed.probe import Probe, Probes
from pvdf_fem.scene.readout import Readout, Uncertain
from pvdf_fem.scene.scene_file import (
    SceneError,
    flatten,
    format_error,
    format_toml,
    get_example_text,
    parse_toml,
    quote,
    read_examples,
)
from pvdf_fem.scene.stage import Stage
from pvdf_fem.scene.validation.errors import MAX_ERRORS, REASONS, describe_scene_errors
from pvdf_fem.scene.validation.incompatible_keys import SceneTables, find_incompatible_keys
from pvdf_fem.scene.validation.placement import find_placement_errors, key_electrodes
from pvdf_fem.scene.validation.unusual_values import find_unusual_values
from pvdf_fem.summary import Result, Summary, TextTable

__all__ = [
    "Air",
    "Electrode",
    "Film",
    "Layout",
    "Load",
    "LoadedProbe",
    "Numerics",
    "Probe",
    "Readout",
    "Replaced",
    "ResponseDomain",
    "Scene",
    "SceneError",
    "Stage",
]


class Scene(Result, Section):
    """A film with electrodes, optional probes, a load, readout and stage.

    Invalid tables raise `SceneError`, which lists all errors by key. Valid values that are probably
    mistakes are listed in `warnings`.

    Examples
    --------
    >>> scene = Scene(film={"thickness_um": 12.0}, probe={"shape": "circle", "radius_mm": 3.0})
    >>> scene = scene.with_(**{"probe.x_mm": 4.0, "load.force_N": 0.5})
    >>> scene.to_toml()
    """

    film: Film = Film.model_validate({})
    """The film and its material."""
    electrodes: Annotated[Electrodes, Key(affects=Affects.READING)] = Layout.model_validate({})
    """The electrodes: a layout, or a list of arbitrary ones."""
    probe: Probes | None = None
    """The probe that presses on the film, or a list of several; by default there is none."""
    load: Load = Load()
    """The load of the probe; listed probes may override its keys."""
    numerics: Numerics = Numerics()
    """The accuracy of a solve."""
    readout: Annotated[Readout | None, Key(affects=Affects.INSTRUMENT)] = None
    """The amplifiers that read the electrodes."""
    stage: Annotated[Stage | None, Key(affects=Affects.INSTRUMENT)] = None
    """The position of the film on the stage that moves the probe."""
    air: Annotated[Air | None, Key(affects=Affects.DYNAMICS)] = None
    """The air on both sides of the film, for vibrations."""
    model: Annotated[ResponseDomain | None, Key(affects=Affects.INSTRUMENT)] = None
    """The domain of the response (the charges as a function of the touch)."""
    calibration: Annotated[CalibratedParameters | None, Key(affects=Affects.INSTRUMENT)] = None
    """The uncertainty of calibrated values, which is in the deviations of located touches."""
    uncertain: Annotated[
        Uncertain | None,
        Key(affects=Affects.INSTRUMENT, example={"film.thickness_um": "5 %"}),
    ] = None
    """Standard deviations of numbers of the scene, by key: ``{ "film.thickness_um" = "5 %" }``."""

    if not TYPE_CHECKING:  # type checkers derive the parameters from the fields

        def __init__(self, /, *positional: Any, **tables: Any) -> None:
            """Validate the tables of a scene; the `SceneError` lists all errors."""
            if positional:
                raise SceneError([format_error("Scene", positional[0], REASONS["nameless"])])
            tables, problems = expand_drawing(tables)
            try:
                super().__init__(**tables)
            except ValidationError as error:
                problems += describe_scene_errors(error, tables, type(self))
            if problems:
                raise SceneError(problems)

    @model_validator(mode="after")
    def _reject_incompatible_tables(self) -> Self:
        """Refuse tables that are valid by themselves, but incompatible with each other."""
        problems = list(islice(self._find_combination_errors(), MAX_ERRORS + 1))
        if problems:
            context = {"text": "\n".join(problems), "problems": problems}
            raise PydanticCustomError("misplaced", "{text}", context)
        return self

    def _find_combination_errors(self) -> Iterator[str]:
        """Yield messages on placement, incompatible keys and readouts of unknown electrodes."""
        yield from find_placement_errors(
            film_shape=self.film.geometry,
            electrodes=key_electrodes(self.electrodes),
            probes=self._probes,
            load=self.load,
            observable=self.numerics.observable,
        )
        tables = SceneTables(self.film, self.air, self.numerics.observable, self.load, self._probes)
        yield from find_incompatible_keys(tables)
        names = [electrode.name for electrode in self.electrode_list]
        if self.readout is not None:
            yield from self.readout.find_channel_errors(names)
        if self.calibration is not None:
            yield from self.calibration.find_key_errors(self.film, names)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings: loads without effect, probably wrong units, and doubts about the material."""
        warnings = []
        has_idle_load = self.probe is None and self.load != Load()
        if has_idle_load:
            warnings.append("load: has no effect without a probe; add [probe]")
        given_keys = [f"load.{key}" for key in self.load.model_dump(exclude_defaults=True)]
        for key in self.find_unused_load_keys(given_keys):
            reason = "has no effect, since all probes override it; remove it here or from a probe"
            warnings.append(f"{key}: {reason}")
        tables: dict[str, Section] = {"film": self.film}
        if not has_idle_load:
            tables["load"] = self.load
        for number, patch in enumerate(self.film.patches or ()):
            tables[f"film.patches[{number}]"] = patch
        for name, table in tables.items():
            warnings += find_unusual_values(name, table)
        return (*warnings, *find_material_notes(self.film))

    @property
    def _probes(self) -> dict[str, Probe]:
        """The probes by their keys."""
        if isinstance(self.probe, tuple):
            return {f"probe[{number}]": probe for number, probe in enumerate(self.probe)}
        return {} if self.probe is None else {"probe": self.probe}

    @property
    def warm_probes(self) -> dict[str, Probe]:
        """The probes with another temperature than the film's, by ``probe[0].temperature_K``."""
        probes = self._probes.items()
        return {f"{key}.temperature_K": probe for key, probe in probes if probe.temperature_K}

    @property
    def electrode_list(self) -> tuple[Electrode, ...]:
        """The electrodes of the list, or those of which the layout consists."""
        electrodes = self.electrodes
        return electrodes if isinstance(electrodes, tuple) else electrodes.electrodes

    @property
    def loaded_probes(self) -> tuple[LoadedProbe, ...]:
        """The probes with their loads, in the order of the scene."""
        if self.probe is None:
            return ()
        if not isinstance(self.probe, tuple):
            return (LoadedProbe("probe", "probe", probe=self.probe, load=self.load),)
        return tuple(
            LoadedProbe(
                key=f"probe[{number}]",
                patch=f"probe {number + 1}",
                probe=probe,
                load=probe.resolve_load(self.load),
            )
            for number, probe in enumerate(self.probe)
        )

    @property
    def tips(self) -> tuple[LoadedProbe, ...]:
        """The loaded probes that are rigid tips."""
        return tuple(probe for probe in self.loaded_probes if probe.load.kind == "contact")

    def with_loaded_probes(self, loaded_probes: Sequence[LoadedProbe]) -> Scene:
        """Return a copy of the scene with other probes and loads.

        Parameters
        ----------
        loaded_probes : sequence of LoadedProbe
            The new probes with their loads, which are not validated. There may be none, any number
            if the scene has a list of probes, and one otherwise. Loads of listed probes are stored
            as overrides, and the scene's load becomes the default.

        Returns
        -------
        Scene
        """
        if not loaded_probes:
            return self.model_copy(update={"probe": None})
        if not isinstance(self.probe, tuple):
            (loaded,) = loaded_probes
            return self.model_copy(update={"probe": loaded.probe, "load": loaded.load})
        probes = []
        for loaded in loaded_probes:
            overrides = LoadOverrides.model_construct(**loaded.load.model_dump())
            changes = {**dict.fromkeys(FORCE_KEYS), "load": overrides}
            probes.append(loaded.probe.model_copy(update=changes))
        return self.model_copy(update={"probe": tuple(probes), "load": Load()})

    def find_unused_load_keys(self, keys: Iterable[str]) -> list[str]:
        """Select those keys of the scene's load that no listed probe takes from it.

        Parameters
        ----------
        keys : iterable of str
            Dotted keys of the scene, such as ``load.force_N``; keys of other tables are ignored.

        Returns
        -------
        list of str
            The selected keys; empty for a scene without a list of probes.
        """
        if not isinstance(self.probe, tuple):
            return []
        unused = []
        for key in keys:
            name = key.removeprefix("load.")
            is_inherited = any(probe.inherits_load_key(name) for probe in self.probe)
            if key.startswith("load.") and not is_inherited:
                unused.append(key)
        return unused

    def require_no_tips(self, purpose: str) -> None:
        """Raise `SceneError` if the scene has rigid tips, whose contact area is computed.

        Parameters
        ----------
        purpose : str
            What cannot compute the contact of a tip, for the message: ``"a response"``.
        """
        if self.tips:
            reason = f"is incompatible with {purpose}, which does not compute contact areas"
            advice = "choose another kind"
            raise SceneError([format_error("load.kind", "contact", f"{reason}; {advice}")])

    def require_plain_charges(self, purpose: str, *supported: str) -> None:
        """Raise `SceneError` if charges depend on more than d31, d32 and the stress.

        Further contributions come from ``coupling``, ``d33_pC_N`` and ``warming_K`` of the film,
        and from ``temperature_K`` of probes.

        Parameters
        ----------
        purpose : str
            What neglects them, for the message: ``"a response"``.
        *supported : str
            Names of those among these keys that are not neglected, such as ``d33_pC_N``.
        """
        names = ("coupling", "d33_pC_N", "warming_K")
        values = {f"film.{name}": getattr(self.film, name) for name in names}
        for key, probe in self.warm_probes.items():
            values[key] = probe.temperature_K
        problems = []
        for key, value in values.items():
            name = key.rpartition(".")[-1]
            if value and name not in supported:
                reason = f"is incompatible with {purpose}; remove it"
                problems.append(format_error(key, value, reason))
        if problems:
            raise SceneError(problems)

    @property
    def single_probe(self) -> Probe | None:
        """The probe, or None if there is none; raises `SceneError` for a list of probes."""
        if isinstance(self.probe, tuple):
            shapes = [probe.shape for probe in self.probe]
            reason = "must be a single probe, not a list [[probe]]; give a table [probe]"
            raise SceneError([format_error("probe", shapes, reason)])
        return self.probe

    @classmethod
    def from_file(cls, path: Path | str) -> Scene:
        """Make a scene from a scene file.

        Parameters
        ----------
        path : Path or str
            Path of a TOML file in UTF-8.

        Returns
        -------
        Scene

        Raises
        ------
        SceneError
            If the file cannot be read or has errors; the exception lists all of them.
        """
        return cls._from_tables(read_scene_tables(path), str(path))

    @classmethod
    def parse(cls, text: str, source: str = "<text>") -> Scene:
        """Make a scene from the text of a scene file.

        Parameters
        ----------
        text : str
            TOML with the tables of a scene.
        source : str
            Name of the text in error messages.

        Returns
        -------
        Scene

        Raises
        ------
        SceneError
            If the text has errors; the exception lists all of them.
        """
        return cls._from_tables(parse_toml(text, source), source)

    @classmethod
    def example(cls, name: str) -> Scene:
        """Make one of the scenes that come with the package as examples.

        Parameters
        ----------
        name : str
            Name of the example, such as ``"triangle"``.

        Returns
        -------
        Scene

        Raises
        ------
        SceneError
            If there is no such example; the message suggests names.
        """
        scenes = {}
        for example, text in read_examples().items():
            is_sweep_or_report = "[[axes]]" in text or "[[section]]" in text
            if not is_sweep_or_report:
                scenes[example] = text
        return cls.parse(get_example_text(name, scenes), name)

    def with_(self, tables: Mapping[str, Any] | None = None, /, **changes: Any) -> Scene:
        """Return a copy of the scene with changed values.

        Parameters
        ----------
        tables : mapping, optional
            Changes as a dict, in the same form as the keywords.
        **changes
            Values by dotted key, as in ``**{"load.force_N": 2.0, "electrodes[0].x_mm": 8}``, or
            tables, as in ``film={"thickness_um": 12}``. Tables are merged: keys that are not given
            keep their values. Any other value replaces the old one: a list, None, an object such
            as `Film(...)`, or a table wrapped in `Replaced`.

        Returns
        -------
        Scene

        Raises
        ------
        SceneError
            If the new scene has errors; the exception lists all of them.

        Notes
        -----
        Keys that do not go with a new value are removed: sizes of the old shape, values of the old
        material, keys that a new layout does not have or that require the old kind or profile of a
        load. Setting ``film.pretension_N_m`` removes ``film.temperature_change_K``, and setting
        ``load.depth_mm`` removes ``load.force_N``, and vice versa; setting both is an error.
        """
        own = self.to_json()
        problems = apply_changes(own, tables, changes)
        return self._from_tables(own, "", problems)

    def to_toml(self) -> str:
        """Return the tables of `to_json` as the text of a scene file, which `Scene.parse` reads."""
        return format_toml(self.to_json())

    def to_json(self) -> dict[str, Any]:
        """Return all tables in types that JSON and TOML can hold, without keys that are None."""
        return self.model_dump(mode="json", exclude_none=True)

    def summary(self) -> Summary:
        """Summarize film, electrodes and probes, with the keys of `to_json` and the warnings."""
        names = ", ".join(electrode.name for electrode in self.electrode_list)
        probes = " and ".join(probe.shape for probe in self._probes.values()) or "no probe"
        values = flatten(self.to_json(), lists=True).items()
        table = TextTable(("key", "value"), tuple((key, quote(value)) for key, value in values))
        sentence = f"electrodes {names}, {probes}"
        return Summary(
            self.film.describe_outline(), [sentence], tables=[table], notes=self.warnings
        )

    @classmethod
    def _from_tables(
        cls, tables: dict[str, Any], source: str, problems: Sequence[str] = ()
    ) -> Scene:
        """Make a scene from its tables; report errors of validation together with earlier ones.

        Parameters
        ----------
        tables : dict
            Tables by name, from a scene file or from a changed scene.
        source : str
            Path or name of the text, for the message of the error; may be empty.
        problems : sequence of str
            Errors that were found before the validation.

        Raises
        ------
        SceneError
            If there are `problems` or the tables have errors. It lists both.
        """
        try:
            scene = cls(**tables)
        except SceneError as error:
            raise SceneError([*problems, *error.problems], source) from None
        if problems:
            raise SceneError(problems, source)
        return scene

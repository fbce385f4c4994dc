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

from pvdf_fem.scene.changes import Replaced, apply_changes
from pvdf_fem.scene.film import Air, Film
from pvdf_fem.scene.keys import Affects, Key, Section
from pvdf_fem.scene.load import FORCE_KEYS, Load, LoadOverrides
from pvdf_fem.scene.placed.electrode import Electrode, Electrodes, Layout
from pvdf_fem.scene.placed.loaded_probe import LoadedProbe
from pvdf_fem.scene.placed.probe import Probe, Probes
from pvdf_fem.scene.readout import Readout, Uncertain
from pvdf_fem.scene.registry import OBSERVABLE_ENTRIES
from pvdf_fem.scene.response_domain import ResponseDomain
from pvdf_fem.scene.scene_file import (
    SceneError,
    flatten,
    format_error,
    format_toml,
    get_example_text,
    parse_toml,
    quote,
    read_examples,
    read_scene_text,
)
from pvdf_fem.scene.stage import Stage
from pvdf_fem.scene.validation.errors import MAX_ERRORS, REASONS, describe_scene_errors
from pvdf_fem.scene.validation.incompatible_keys import SceneTables, find_incompatible_keys
from pvdf_fem.scene.validation.placement import find_placement_errors
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


class Numerics(Section):
    """The wanted error in every charge, the definition of charge, and limits of a solve."""

    tolerance: Annotated[float, Key("", (2e-8, 0.49))] = 1e-3
    """Wanted error of every charge, relative to the charge. Where its two parts, from d31 S11 and
    d32 S22, cancel to less than 5 % of them, it is relative to 5 % of them, with a warning."""
    observable: Annotated[str, Key(affects=Affects.READING, words=OBSERVABLE_ENTRIES)] = "material"
    """Definition of a charge. material: the integral of d31 S11 + d32 S22 over the electrode.
    thesis-edge: the mean stress on opposite edges times the area."""
    max_unknowns: Annotated[int | None, Key("unknowns", (100, 10_000_000), example=60000)] = None
    """Largest number of unknowns of a refined mesh; by default 60000, 30000 if the film wrinkles,
    and more for tolerances below 1e-3."""
    max_seconds: Annotated[float | None, Key("s", (0.1, 1e6), example=20.0)] = None
    """Work allowed for a solve in seconds of one core, counted by unknowns and iterations so that a
    result does not depend on the machine's load; by default 20, and more for tolerances below
    1e-3."""


class Scene(Result, Section):
    """A film with electrodes, optional probes, a load, readout and stage.

    Listed probes may have their own loads. Errors raise `SceneError`, listed under the keys of the
    scene file; valid values that were probably meant otherwise are among the `warnings`.

    Examples
    --------
    >>> scene = Scene(film={"thickness_um": 12.0}, probe={"shape": "circle", "radius_mm": 3.0})
    >>> scene = scene.with_(**{"probe.x_mm": 4.0, "load.force_N": 0.5})
    >>> scene.to_toml()
    """

    film: Film = Film()
    """The film and its material."""
    electrodes: Annotated[Electrodes, Key(affects=Affects.READING)] = Layout.model_validate({})
    """The electrodes: a layout, or a list of any."""
    probe: Probes | None = None
    """The probe that presses on the film, or a list of several; none where it is not given."""
    load: Load = Load()
    """The force of the probe."""
    numerics: Numerics = Numerics()
    """The accuracy of a solve."""
    readout: Annotated[Readout | None, Key(affects=Affects.INSTRUMENT)] = None
    """The amplifiers that read the electrodes."""
    stage: Annotated[Stage | None, Key(affects=Affects.INSTRUMENT)] = None
    """The film on the stage that positions the probe."""
    air: Annotated[Air | None, Key(affects=Affects.DYNAMICS)] = None
    """The air on both sides of the film, for vibrations."""
    model: Annotated[ResponseDomain | None, Key(affects=Affects.INSTRUMENT)] = None
    """The domain of the response, the charges as a function of the touch."""
    uncertain: Annotated[
        Uncertain | None,
        Key(affects=Affects.INSTRUMENT, example={"film.thickness_um": "5 %"}),
    ] = None
    """Standard deviations of numbers of the scene, by key: ``{ "film.thickness_um" = "5 %" }``."""

    if not TYPE_CHECKING:  # type checkers have the keys from the fields

        def __init__(self, /, *positional: Any, **tables: Any) -> None:
            """Validate the tables of a scene; all errors are reported at once."""
            if positional:
                raise SceneError([format_error("Scene", positional[0], REASONS["nameless"])])
            try:
                super().__init__(**tables)
            except ValidationError as error:
                raise SceneError(describe_scene_errors(error, tables, type(self))) from None

    @model_validator(mode="after")
    def _reject_combinations(self) -> Self:
        """Refuse tables that are valid by themselves, but not together."""
        problems = list(islice(self._find_combination_errors(), MAX_ERRORS + 1))
        if problems:
            context = {"text": "\n".join(problems), "problems": problems}
            raise PydanticCustomError("misplaced", "{text}", context)
        return self

    def _find_combination_errors(self) -> Iterator[str]:
        electrodes = self.electrodes
        observable = self.numerics.observable
        probes = self._probes
        if isinstance(electrodes, tuple):
            keyed_electrodes: Layout | dict[str, Electrode] = {
                f"electrodes[{number}]": electrode for number, electrode in enumerate(electrodes)
            }
        else:
            keyed_electrodes = electrodes
        yield from find_placement_errors(
            radius_mm=self.film.radius_mm,
            electrodes=keyed_electrodes,
            probes=probes,
            load=self.load,
            observable=observable,
        )
        tables = SceneTables(self.film, observable, load=self.load, probes=probes)
        yield from find_incompatible_keys(tables)
        if self.readout is not None:
            names = [electrode.name for electrode in self.electrode_list]
            yield from self.readout.find_channel_errors(names)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings of a valid scene: loads that press on nothing, and unusual values."""
        warnings = []
        has_idle_load = self.probe is None and self.load != Load()
        if has_idle_load:
            warnings.append("load: nothing presses, since there is no probe; add [probe]")
        given_keys = [f"load.{key}" for key in self.load.model_dump(exclude_defaults=True)]
        for key in self.find_unused_load_keys(given_keys):
            warnings.append(
                f"{key}: has no effect, since each probe has its own; remove one of the two"
            )
        tables: dict[str, Section] = {"film": self.film}
        if not has_idle_load:
            tables["load"] = self.load
        for number, patch in enumerate(self.film.patches or ()):
            tables[f"film.patches[{number}]"] = patch
        for name, table in tables.items():
            warnings += find_unusual_values(name, table)
        return tuple(warnings)

    @property
    def _probes(self) -> dict[str, Probe]:
        """The probes by their keys."""
        if isinstance(self.probe, tuple):
            return {f"probe[{number}]": probe for number, probe in enumerate(self.probe)}
        return {} if self.probe is None else {"probe": self.probe}

    @property
    def warm_probes(self) -> dict[str, Probe]:
        """The warm probes by the keys of their temperatures."""
        probes = self._probes.items()
        return {f"{key}.temperature_K": probe for key, probe in probes if probe.temperature_K}

    @property
    def electrode_list(self) -> tuple[Electrode, ...]:
        """The electrodes, of a layout those that it stands for."""
        electrodes = self.electrodes
        return electrodes if isinstance(electrodes, tuple) else electrodes.electrodes

    @property
    def loaded_probes(self) -> tuple[LoadedProbe, ...]:
        """The probes with their loads: patches ``probe``, or of a list ``probe 1``, ``probe 2``."""
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
        """Return the scene with other probes and loads.

        Parameters
        ----------
        loaded_probes : sequence of LoadedProbe
            Some of the scene's `loaded_probes`, or others. Their values are not validated.

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
        """Find keys of the scene's load that have no effect on any of the listed probes.

        Parameters
        ----------
        keys : iterable of str
            Keys of the scene; those of other tables than ``load`` are left out.

        Returns
        -------
        list of str
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
        """Raise `SceneError` for a scene with tips, whose contacts a purpose cannot find.

        Parameters
        ----------
        purpose : str
            Words for the message, such as ``"a response"``.
        """
        if self.tips:
            reason = f"is incompatible with {purpose}, which does not find where a tip touches"
            advice = "choose another kind"
            raise SceneError([format_error("load.kind", "contact", f"{reason}; {advice}")])

    def require_plain_charges(self, purpose: str, *supported: str) -> None:
        """Raise `SceneError` where stress at zero voltage and constant temperature is not enough.

        Plain charges are d31 and d32 times this stress.

        Parameters
        ----------
        purpose : str
            Words for the message, such as ``"a response"``.
        *supported : str
            Names of keys that the purpose takes into account, such as ``"coupling"``.
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
        """The probe, or None without one; raises `SceneError` for a list of probes."""
        if isinstance(self.probe, tuple):
            shapes = [probe.shape for probe in self.probe]
            reason = "is a list [[probe]], and this requires a single probe; give a table [probe]"
            raise SceneError([format_error("probe", shapes, reason)])
        return self.probe

    @classmethod
    def from_file(cls, path: Path | str) -> Scene:
        """Read a scene file.

        Parameters
        ----------
        path : path or str
            A TOML file in UTF-8.

        Returns
        -------
        Scene

        Raises
        ------
        SceneError
            Listing all errors of the file under its path.
        """
        return cls.parse(read_scene_text(path), str(path))

    @classmethod
    def parse(cls, text: str, source: str = "<text>") -> Scene:
        """Parse the text of a scene file.

        Parameters
        ----------
        text : str
            TOML.
        source : str
            Name of the text in a `SceneError`.

        Returns
        -------
        Scene

        Raises
        ------
        SceneError
            Listing all errors.
        """
        return cls._from_tables(parse_toml(text, source), source)

    @classmethod
    def example(cls, name: str) -> Scene:
        """Read a scene that comes with the package.

        Parameters
        ----------
        name : str
            Such as ``"triangle"``.

        Returns
        -------
        Scene

        Raises
        ------
        SceneError
            For an unknown name, with the known ones.
        """
        scenes = {}
        for example, text in read_examples().items():
            is_sweep_or_report = "[[axes]]" in text or "[[section]]" in text
            if not is_sweep_or_report:
                scenes[example] = text
        return cls.parse(get_example_text(name, scenes), name)

    def with_(self, tables: Mapping[str, Any] | None = None, /, **changes: Any) -> Scene:
        """Return another scene with some values changed.

        Parameters
        ----------
        tables : mapping, optional
            Changes as a dict instead of keywords.
        **changes
            Values by dotted key, ``{"load.force_N": 2.0, "electrodes.0.x_mm": 8}``, or tables,
            ``film={"thickness_um": 12}``, which are merged: keys that a table does not have stay. A
            section's model, a `Replaced` table, a list and None replace the old value.

            A new shape removes the old shape's sizes, a new layout the keys that it does not have,
            and a new kind or profile of a load the keys that need the old value.
            ``film.pretension_N_m`` replaces ``film.temperature_change_K``, ``load.depth_mm``
            replaces ``load.force_N``, and vice versa; both of them together are refused.

        Returns
        -------
        Scene

        Raises
        ------
        SceneError
            Listing all errors, as for a file.
        """
        own = self.to_json()
        problems = apply_changes(own, tables, changes)
        return self._from_tables(own, "", problems)

    def to_toml(self) -> str:
        """Return the scene as a scene file with every key; parsing it gives an equal scene."""
        return format_toml(self.to_json())

    def to_json(self) -> dict[str, Any]:
        """Return the tables of the scene file with every key."""
        return self.model_dump(mode="json", exclude_none=True)

    def summary(self) -> Summary:
        """Summarize film, electrodes and probes, all keys, and warnings."""
        names = ", ".join(electrode.name for electrode in self.electrode_list)
        probes = " and ".join(probe.shape for probe in self._probes.values()) or "no probe"
        values = flatten(self.to_json(), lists=True)
        rows = tuple((key, quote(value)) for key, value in values.items())
        table = TextTable(("key", "value"), rows)
        film = f"film of {self.film.radius_mm:g} mm"
        sentence = f"electrodes {names}, {probes}"
        return Summary(film, [sentence], tables=[table], notes=self.warnings)

    @classmethod
    def _from_tables(
        cls, tables: dict[str, Any], source: str, problems: Sequence[str] = ()
    ) -> Scene:
        """Make a scene from its tables, or raise `SceneError` with further problems."""
        try:
            scene = cls(**tables)
        except SceneError as error:
            raise SceneError([*problems, *error.problems], source) from None
        if problems:
            raise SceneError(problems, source)
        return scene

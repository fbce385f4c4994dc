"""What is simulated: film, air, electrodes, probe, load and numerics, validated and frozen.

A scene comes from a TOML file or is built from the models of its parts. Keys carry the usual units
(mm, µm, GPa, pC/N); properties without a unit in their name are SI, and nothing else in the package
converts lengths or moduli. Defaults are the thesis's values: `Scene()` is the four-electrode
biaxial sensor without a probe.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Self

from pydantic import ValidationError, model_validator
from pydantic_core import PydanticCustomError

from pvdf_fem.scene.changes import Replaced, apply_changes
from pvdf_fem.scene.film import Air, Film
from pvdf_fem.scene.keys import Affects, Key, Section
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.outlines.tip import Tip, make_tip
from pvdf_fem.scene.placement import find_incompatible_keys, find_placement_errors
from pvdf_fem.scene.readout import Readout, Uncertain
from pvdf_fem.scene.registry import FORCE_KEYS, OBSERVABLE_ENTRIES, Load, LoadOverrides
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
from pvdf_fem.scene.shapes import LAYOUTS, Electrode, Electrodes, Layout, Probe, Probes
from pvdf_fem.scene.stage import ResponseDomain, Stage
from pvdf_fem.scene.validation_errors import MAX_ERRORS, REASONS, describe_scene_errors
from pvdf_fem.summary import Result, Summary, TextTable

__all__ = [
    "Air",
    "Electrode",
    "Film",
    "Layout",
    "Load",
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
    """Error wanted in every charge, relative to the charge. Where its parts, d31 S11 and d32 S22,
    cancel to less than 5 % of them, relative to 5 % of them; a warning says so."""
    observable: Annotated[str, Key(affects=Affects.READING, words=OBSERVABLE_ENTRIES)] = "material"
    """material: d31 S11 + d32 S22 over the electrode. thesis-edge: mean stress on opposite edges
    times the area."""
    max_unknowns: Annotated[int | None, Key("unknowns", (100, 10_000_000), example=60000)] = None
    """Largest number of unknowns of a refined mesh; by default 60000, 30000 if the film wrinkles,
    and more for tolerances below 1e-3."""
    max_seconds: Annotated[float | None, Key("s", (0.1, 1e6), example=20.0)] = None
    """Work allowed for a solve in seconds of one core, counted by unknowns and iterations so that a
    result does not depend on the machine's load; by default 20, and more for tolerances below
    1e-3."""


@dataclass(frozen=True)
class LoadedProbe:
    """A scene's probe with its load, key, and patch name in a mesh."""

    key: str
    patch: str
    probe: Probe
    load: Load

    @property
    def outline(self) -> Outline:
        """The probe's outline in m."""
        return self.probe.outline

    @property
    def tip(self) -> Tip:
        """The rigid tip that it is; ValueError of a probe that is none."""
        return make_tip(self.probe)


class Scene(Result, Section):
    """A film with electrodes, optional probes, a load, readout and stage.

    Listed probes may have their own loads. Mistakes raise `SceneError`, listed under the keys of
    the scene file; valid values that were probably meant otherwise are among the `warnings`.

    Examples
    --------
    >>> scene = Scene(film={"thickness_um": 12.0}, probe={"shape": "circle", "radius_mm": 3.0})
    >>> scene = scene.with_(**{"probe.x_mm": 4.0, "load.force_N": 0.5})
    >>> scene.to_toml()
    """

    film: Film = Film()
    """The film and its material."""
    electrodes: Annotated[Electrodes, Key(affects=Affects.READING)] = LAYOUTS["square"]()
    """The electrodes: a layout, or a list of any."""
    probe: Probes | None = None
    """What presses on the film, or a list of several; nothing does where it is not given."""
    load: Load = Load()
    """The force of the probe."""
    numerics: Numerics = Numerics()
    """The accuracy of a solve."""
    readout: Annotated[Readout | None, Key(affects=Affects.INSTRUMENT)] = None
    """What reads the electrodes."""
    stage: Annotated[Stage | None, Key(affects=Affects.INSTRUMENT)] = None
    """The film on the stage that positions the probe."""
    air: Annotated[Air | None, Key(affects=Affects.DYNAMICS)] = None
    """The air on both sides of the film, for vibrations."""
    model: Annotated[ResponseDomain | None, Key(affects=Affects.INSTRUMENT)] = None
    """The model of the charges by the touch."""
    uncertain: Annotated[
        Uncertain | None,
        Key(affects=Affects.INSTRUMENT, example={"film.thickness_um": "5 %"}),
    ] = None
    """Standard deviations of numbers of the scene, by key: ``{ "film.thickness_um" = "5 %" }``."""

    if not TYPE_CHECKING:  # type checkers have the keys from the fields

        def __init__(self, /, *given: Any, **tables: Any) -> None:
            if given:
                raise SceneError([format_error("Scene", given[0], REASONS["nameless"])])
            try:
                super().__init__(**tables)
            except ValidationError as error:
                raise SceneError(describe_scene_errors(error, tables, type(self))) from None

    @model_validator(mode="after")
    def _shapes_have_their_places(self) -> Self:
        electrodes, observable = self.electrodes, self.numerics.observable
        complaints = find_placement_errors(
            self.film.radius_mm,
            {f"electrodes[{i}]": electrode for i, electrode in enumerate(electrodes)}
            if isinstance(electrodes, tuple)
            else electrodes,
            self._probes,
            self.load,
            observable,
        )
        complaints = chain(
            complaints, find_incompatible_keys(self.film, observable, self._probes, self.load)
        )
        if self.readout is not None:
            names = [electrode.name for electrode in self.electrode_list]
            complaints = chain(complaints, self.readout.find_channel_errors(names))
        if problems := list(islice(complaints, MAX_ERRORS + 1)):
            context = {"text": "\n".join(problems), "problems": problems}
            raise PydanticCustomError("misplaced", "{text}", context)
        return self

    @property
    def warnings(self) -> tuple[str, ...]:
        """Doubtful but valid parts of a scene: a load on nothing, and values in wrong units."""
        found, tables = [], {"film": self.film, "load": self.load}
        tables |= {f"film.patches[{i}]": patch for i, patch in enumerate(self.film.patches or ())}
        if self.probe is None and self.load != Load():
            found.append("load: nothing presses, since there is no probe; add [probe]")
            del tables["load"]
        for key in self.find_unused_load_keys(
            f"load.{k}" for k in self.load.model_dump(exclude_defaults=True)
        ):
            found.append(f"{key}: no probe has it, since each says its own; remove one of the two")
        for name, table in tables.items():
            for key in type(table).model_fields:
                value, said = getattr(table, key), table.key_of(key)
                if isinstance(value, float) and (meant := said.ask_likely_unit(value)):
                    told = format_error(f"{name}.{key}", value, f"is in {said.unit}")
                    found.append(f"{told}; {meant}")
        return tuple(found)

    @property
    def _probes(self) -> dict[str, Probe]:
        """The probes by their keys."""
        if isinstance(self.probe, tuple):
            return {f"probe[{i}]": probe for i, probe in enumerate(self.probe)}
        return {"probe": self.probe} if self.probe else {}

    @property
    def warm_probes(self) -> dict[str, Probe]:
        """The warm probes by the keys of their temperatures."""
        return {f"{key}.temperature_K": p for key, p in self._probes.items() if p.temperature_K}

    @property
    def electrode_list(self) -> tuple[Electrode, ...]:
        """The electrodes, those of a layout resolved."""
        electrodes = self.electrodes
        return electrodes if isinstance(electrodes, tuple) else electrodes.electrodes

    @property
    def loaded_probes(self) -> tuple[LoadedProbe, ...]:
        """The probes with their loads: patches ``probe``, or of a list ``probe 1``, ``probe 2``."""
        if not isinstance(self.probe, tuple):
            return (LoadedProbe("probe", "probe", self.probe, self.load),) if self.probe else ()
        return tuple(
            LoadedProbe(f"probe[{i}]", f"probe {i + 1}", probe, probe.resolve_load(self.load))
            for i, probe in enumerate(self.probe)
        )

    @property
    def tips(self) -> tuple[LoadedProbe, ...]:
        """The loaded probes that are rigid tips."""
        return tuple(touch for touch in self.loaded_probes if touch.load.kind == "contact")

    def with_loaded_probes(self, touches: Sequence[LoadedProbe]) -> Scene:
        """The scene with other `loaded_probes`, or with some of them; their values go unchecked."""
        if not touches:
            return self.model_copy(update={"probe": None})
        if not isinstance(self.probe, tuple):
            (touch,) = touches
            return self.model_copy(update={"probe": touch.probe, "load": touch.load})
        own = [LoadOverrides.model_construct(**touch.load.model_dump()) for touch in touches]
        probes = tuple(
            touch.probe.model_copy(update={**dict.fromkeys(FORCE_KEYS), "load": load})
            for touch, load in zip(touches, own, strict=True)
        )
        return self.model_copy(update={"probe": probes, "load": Load()})

    def find_unused_load_keys(self, keys: Iterable[str]) -> list[str]:
        """The load's keys, among `keys`, without effect on the listed probes."""
        probes = self.probe if isinstance(self.probe, tuple) else ()
        of_load = {key: key.removeprefix("load.") for key in keys if key.startswith("load.")}
        return [
            k
            for k in of_load
            if probes and not any(p.inherits_load_key(of_load[k]) for p in probes)
        ]

    def require_no_tips(self, what: str) -> None:
        """SceneError for a scene with tips: `what` cannot find contacts."""
        if self.tips:
            reason = f"is not for {what}, which does not find where a tip touches; give another"
            raise SceneError([format_error("load.kind", "contact", reason)])

    def require_plain_charges(self, what: str, *known: str) -> None:
        """SceneError where charges are more than d31 and d32 times the stress at zero voltage and
        constant temperature, by keys not `known` to `what`."""
        keys = ("coupling", "d33_pC_N", "warming_K")
        given = {f"film.{key}": getattr(self.film, key) for key in keys}
        given |= {key: probe.temperature_K for key, probe in self.warm_probes.items()}
        unknown = {k: v for k, v in given.items() if v and k.rpartition(".")[2] not in known}
        if unknown:
            reason = f"is not for {what}; remove it"
            raise SceneError([format_error(key, value, reason) for key, value in unknown.items()])

    @property
    def single_probe(self) -> Probe | None:
        """The probe where only one will do; SceneError for a list."""
        if isinstance(self.probe, tuple):
            reason = "is a list [[probe]], and this serves one probe only; give a table [probe]"
            raise SceneError([format_error("probe", [probe.shape for probe in self.probe], reason)])
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
        """Scene from the text of a scene file; `source` names it in a `SceneError`."""
        return cls._from_tables(parse_toml(text, source), source)

    @classmethod
    def example(cls, name: str) -> Scene:
        """A scene that comes with the package: ``"triangle"``; SceneError tells the names."""
        others = "[[axes]]", "[[section]]"  # sweeps and reports
        scenes = {
            k: text for k, text in read_examples().items() if not any(o in text for o in others)
        }
        return cls.parse(get_example_text(name, scenes), name)

    def with_(self, tables: Mapping[str, Any] | None = None, /, **changes: Any) -> Scene:
        """Another scene, with some values changed.

        Parameters
        ----------
        tables : mapping, optional
            Changes as a dict instead of keywords.
        **changes
            Values by dotted key, ``{"load.force_N": 2.0, "electrodes.0.x_mm": 8}``, or tables,
            ``film={"thickness_um": 12}``, which are merged: keys that a table does not have stay. A
            section's model, a `Replaced` table, a list and None replace the old value.

            A new shape leaves the old shape's sizes behind, a new layout its unknown keys, and a
            new kind or profile of a load the keys that need the old value. ``film.pretension_N_m``
            replaces ``film.temperature_change_K``, ``load.depth_mm`` replaces ``load.force_N``, and
            vice versa; both of them together are refused.

        Raises
        ------
        SceneError
            Listing all mistakes, as for a file.
        """
        own = self.to_json()
        return self._from_tables(own, "", apply_changes(own, tables, changes))

    def to_toml(self) -> str:
        """The scene as a scene file with every key; parsing it gives an equal scene."""
        return format_toml(self.to_json())

    def to_json(self) -> dict[str, Any]:
        """The tables of the scene file with every key."""
        return self.model_dump(mode="json", exclude_none=True)

    def summary(self) -> Summary:
        """Film, electrodes and probes, all keys, and doubts."""
        names = ", ".join(electrode.name for electrode in self.electrode_list)
        probes = " and ".join(probe.shape for probe in self._probes.values()) or "no probe"
        rows = ((key, quote(value)) for key, value in flatten(self.to_json(), lists=True).items())
        table = TextTable(("key", "value"), tuple(rows))
        film = f"film of {self.film.radius_mm:g} mm"
        sentence = f"electrodes {names}, {probes}"
        return Summary(film, [sentence], tables=[table], notes=self.warnings)

    @classmethod
    def _from_tables(
        cls, tables: dict[str, Any], source: str, problems: Sequence[str] = ()
    ) -> Scene:
        try:
            scene = cls(**tables)
        except SceneError as error:
            raise SceneError([*problems, *error.problems], source) from None
        if problems:
            raise SceneError(problems, source)
        return scene

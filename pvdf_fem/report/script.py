"""Report scripts: TOML files that define a report. They are validated before any solve."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from pydantic import ValidationError

from pvdf_fem.batch.batch import plan_scenes
from pvdf_fem.files import FileError, read_text
from pvdf_fem.report.data import DataSource, Readings, read_data
from pvdf_fem.report.kind import Inputs, Kind, prefix_errors
from pvdf_fem.report.registry import FIGURES, TABLES
from pvdf_fem.report.script_keys import Other, Script, ScriptSection, Table
from pvdf_fem.report.task import Task
from pvdf_fem.scene.keys import Section
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import MAX_BYTES, SceneError, format_error, parse_toml, suggest
from pvdf_fem.scene.validation.errors import MAX_ERRORS, describe_errors, join_key

MAX_PREVIEWS = 3  #: Maximum number of previews at the top of the page.
Kinds = Mapping[str, type[Kind]]
Model = TypeVar("Model", bound=Section)


@dataclass(frozen=True)
class Item:
    """A figure or table of a report.

    Parameters
    ----------
    section : int
        Index of its section, from 0.
    where : str
        Its key in the script, such as ``section[0].figure[1]``.
    name : str
        Unique name, from which file names are made.
    kind : Kind
        The item's keys.
    full : Kind
        The item's keys with the values of `full` applied.
    """

    section: int
    where: str
    name: str
    kind: Kind
    full: Kind


class Requirements(NamedTuple):
    """The scenes and tasks to compute for an item."""

    item: Item
    scenes: list[Scene]
    tasks: Sequence[Task]


@dataclass(frozen=True)
class ReportPlan:
    """A validated report script.

    Parameters
    ----------
    script : Script
        Title, introduction, and the unparsed tables of the script.
    scene : Scene
        The report's scene, which figures and tables may change.
    data : mapping of str to Readings
        The tables ``[data.NAME]`` by name.
    sections : tuple of ScriptSection
        Sections in the order of the page.
    items : tuple of Item
        Figures and tables of all sections.
    others : tuple of Other
        Lines about other reports.
    files : tuple of Path
        Files that were read, the script first. A report does not overwrite these.
    """

    script: Script
    scene: Scene
    data: Mapping[str, Readings]
    sections: tuple[ScriptSection, ...]
    items: tuple[Item, ...]
    others: tuple[Other, ...]
    files: tuple[Path, ...]

    def collect_requirements(
        self, quick: bool = False, full: bool = False
    ) -> tuple[Inputs, list[Requirements]]:
        """Collect the scenes and tasks of all items.

        Parameters
        ----------
        quick : bool
            Whether the report is a preview, with few scenes and a coarse tolerance.
        full : bool
            Whether the values of `full` are applied in each item.

        Returns
        -------
        inputs : Inputs
            The scene and the data that all items share.
        requirements : list of Requirements
            Scenes and tasks of each item. Items with previews at the top of the page come first.

        Raises
        ------
        SceneError
            If items are invalid or scenes cannot be solved. The exception lists the errors.
        """
        inputs = Inputs(self.scene, self.data, quick)
        requirements = []
        problems: list[str] = []
        for item in self._order_items():
            if full:
                item = replace(item, kind=item.full)
            try:
                scenes = item.kind.list_scenes(inputs)
                tasks = item.kind.list_tasks(inputs)
                requirements.append(Requirements(item, scenes, tasks))
            except SceneError as error:
                problems += [f"{item.where}.{problem}" for problem in error.problems]
        if problems:
            raise SceneError(problems[:MAX_ERRORS], str(self.files[0]))
        all_scenes = []
        for needed in requirements:
            all_scenes += needed.scenes
        plan_scenes(all_scenes)  # raises an error for scenes that cannot be solved
        return inputs, requirements

    @property
    def summary(self) -> list[Item]:
        """Items with previews at the top of the page, at most `MAX_PREVIEWS`.

        Items with `summary` come first, then the first item of each rank, then the other items.
        """
        chosen = [item for item in self.items if item.kind.summary]
        ranked = sorted(self.items, key=lambda item: item.kind.rank)
        seen_ranks = set()
        for item in ranked:
            if item.kind.rank not in seen_ranks:
                seen_ranks.add(item.kind.rank)
                chosen.append(item)
        chosen += ranked
        distinct = [item for i, item in enumerate(chosen) if item not in chosen[:i]]
        return distinct[:MAX_PREVIEWS]

    def _order_items(self) -> list[Item]:
        """Return the items with previews, then the others, each in the order of the script."""
        previewed = self.summary
        first = [item for item in self.items if item in previewed]
        others = [item for item in self.items if item not in previewed]
        return [*first, *others]


def load_script(path: Path, kinds: Kinds) -> ReportPlan:
    """Read and validate a report script.

    Parameters
    ----------
    path : Path
        A TOML file.
    kinds : mapping of str to type[Kind]
        Additional kinds of figures by name.

    Returns
    -------
    ReportPlan

    Raises
    ------
    SceneError
        If the script, its scene or its data are invalid. The exception lists the errors.
    """
    try:
        table = parse_toml(read_text(path, MAX_BYTES, "a report script"), str(path))
    except FileError as error:
        raise SceneError([str(error)], str(path)) from None
    reader = _ScriptReader({"figure": {**FIGURES, **kinds}, "table": TABLES}, [path])
    script = reader.validate(Script, table, where="")
    scene = reader.read_scene(table)
    sections = reader.validate_list(ScriptSection, table, "section")
    data = {} if scene is None else reader.read_data(table, scene)
    items = reader.read_items(table)
    others = reader.validate_list(Other, table, "other")
    if reader.problems or script is None or scene is None:
        raise SceneError(list(dict.fromkeys(reader.problems))[:MAX_ERRORS], str(path))
    plan = ReportPlan(
        script,
        scene,
        data=data,
        sections=sections,
        items=items,
        others=others,
        files=tuple(reader.files),
    )
    plan.collect_requirements()
    return plan


@dataclass
class _ScriptReader:
    """A reader of the tables of a script that collects all validation errors.

    Parameters
    ----------
    kinds : mapping of str to mapping of str to type[Kind]
        Kinds by form, ``figure`` or ``table``, and by name.
    files : list of Path
        Files that were read, the script first. The methods append to it.
    problems : list of str
        Error messages. The methods append to it.
    """

    kinds: Mapping[str, Kinds]
    files: list[Path]
    problems: list[str] = field(default_factory=list)

    def validate(self, model: type[Model], table: Any, where: str) -> Model | None:
        """Validate a table of the script by a pydantic model.

        Parameters
        ----------
        model : type
            The model, a subclass of `Section`.
        table : object
            The table to validate.
        where : str
            Key of the table in the script, for error messages.

        Returns
        -------
        Section or None
            None if the table is invalid; the errors are then added to `problems`.
        """
        try:
            return model.model_validate(table)
        except ValidationError as error:
            self.problems += describe_errors(error, where, model)
            return None

    def validate_list(self, model: type[Model], table: Table, name: str) -> tuple[Model, ...]:
        """Validate the tables in a list, and return the valid ones.

        Parameters
        ----------
        model : type
            The model, a subclass of `Section`.
        table : dict
            The table that has the list.
        name : str
            Key of the list in the table.
        """
        models = []
        for number, entry in _enumerate_tables(table, name):
            valid = self.validate(model, entry, f"{name}[{number}]")
            if valid is not None:
                models.append(valid)
        return tuple(models)

    def read_scene(self, table: Table) -> Scene | None:
        """Read the report's scene; return None if it is invalid."""
        scene = table.get("scene")
        example = table.get("example")
        try:
            if (scene is None) == (example is None):
                reason = "give one of `scene`, a path or a table [scene], and `example`"
                raise SceneError([format_error("scene", scene or "(nothing)", reason)])
            with prefix_errors("scene" if example is None else "example"):
                if isinstance(example, str):
                    return Scene.example(example)
                if isinstance(scene, str):
                    self.files.append(self.files[0].parent / scene)
                    return Scene.from_file(self.files[-1])
                if isinstance(scene, dict):
                    return Scene().with_(**scene)
                return None  # the validation of `Script` reports other types
        except SceneError as error:
            self.problems += error.problems
            return None

    def read_data(self, table: Table, scene: Scene) -> dict[str, Readings]:
        """Read the tables ``[data.NAME]``, and return the valid ones by name."""
        data: dict[str, Readings] = {}
        tables = table.get("data")
        if not isinstance(tables, dict):
            return data
        folder = self.files[0].parent
        for name, entry in tables.items():
            source = self.validate(DataSource, entry, join_key("data", [name]))
            if source is None:
                continue
            try:
                data[name] = read_data(name, source, scene, folder)
            except SceneError as error:
                self.problems += error.problems
                continue
            if source.file is not None:
                self.files.append(folder / source.file)
        return data

    def read_items(self, table: Table) -> tuple[Item, ...]:
        """Read the figures and tables of all sections, and return the valid ones."""
        items = []
        where_by_name: dict[str, str] = {}  # keys in the script by name of the item
        for number, section in _enumerate_tables(table, "section"):
            for form, kinds in self.kinds.items():
                for index, entry in _enumerate_tables(section, form):
                    where = f"section[{number}].{form}[{index}]"
                    kind = self._read_kind(kinds, entry, where)
                    if kind is not None:
                        full = self._read_full_item(kind, entry, where)
                        name = self._choose_name(kind, where, where_by_name)
                        items.append(Item(number, where, name=name, kind=kind, full=full))
        return tuple(items)

    def _read_kind(self, kinds: Kinds, table: Table, where: str) -> Kind | None:
        """Validate a figure or table by the class of its kind; return None if it is invalid.

        Parameters
        ----------
        kinds : mapping of str to type[Kind]
            Kinds that are allowed at this key, by name.
        table : dict
            The table in the script.
        where : str
            Key of the table in the script, for error messages.
        """
        name = table.get("kind", "(nothing)")
        if isinstance(name, str) and name in kinds:
            return self.validate(kinds[name], table, where)
        reason = f"is not a kind of this table; {suggest(name, list(kinds))}"
        self.problems.append(format_error(f"{where}.kind", name, reason))
        return None

    def _read_full_item(self, kind: Kind, table: Table, where: str) -> Kind:
        """Return an item's keys with the values of `full` applied.

        If these values are invalid, the keys are returned unchanged.

        Parameters
        ----------
        kind : Kind
            The validated keys.
        table : dict
            The table in the script.
        where : str
            Key of the table in the script, for error messages.
        """
        for key in kind.full.keys() & {"kind", "name", "full"}:
            reason = "cannot be changed for --full; remove it"
            self.problems.append(format_error(f"{where}.full.{key}", kind.full[key], reason))
        full = self.validate(type(kind), {**table, **kind.full}, f"{where}.full")
        return kind if full is None else full

    def _choose_name(self, kind: Kind, where: str, where_by_name: dict[str, str]) -> str:
        """Choose a unique name of an item, and add it to `where_by_name`.

        Parameters
        ----------
        kind : Kind
            The item's keys. Without a key `name`, the name is made from `Kind.stem`.
        where : str
            Key of the item in the script.
        where_by_name : dict of str to str
            Keys in the script by name of the earlier items. This item is added.
        """
        name = kind.name
        if name is None:
            name = kind.stem
            number = 2
            while name in where_by_name:
                name = f"{kind.stem}-{number}"
                number += 1
        elif name in where_by_name:
            reason = f"is the name of {where_by_name[name]}; choose another"
            self.problems.append(format_error(f"{where}.name", name, reason))
        where_by_name[name] = where
        return name


def _enumerate_tables(table: Table, name: str) -> Iterator[tuple[int, Table]]:
    """Yield the tables of a list with their indices.

    Other entries are skipped, since the validation of `Script` or `ScriptSection` reports them.
    """
    entries = table.get(name)
    if not isinstance(entries, list):
        return
    for number, entry in enumerate(entries):
        if isinstance(entry, dict):
            yield number, entry

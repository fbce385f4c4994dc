"""Report scripts: TOML files that say what a report shows, checked before any solve."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeVar

from pydantic import AfterValidator, Field, ValidationError

from pvdf_fem.batch.batch import plan_scenes
from pvdf_fem.files import FileError, read_text
from pvdf_fem.report.data import DataSource, Readings, read_data
from pvdf_fem.report.kind import Inputs, Kind, prefix_errors
from pvdf_fem.report.registry import FIGURES, TABLES
from pvdf_fem.report.task import Task
from pvdf_fem.scene.keys import Section, make_validation_error
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import MAX_BYTES, SceneError, format_error, parse_toml, suggest
from pvdf_fem.scene.validation.errors import MAX_ERRORS, describe_errors, join_key

MAX_WORDS = 120  #: Largest number of words in a text.
PICTURES = 3  #: Number of pictures on the first screen.
Kinds = Mapping[str, type[Kind]]
Model = TypeVar("Model", bound=Section)
Table = dict[str, Any]


def _check_length(text: str) -> str:
    """Return a text; raise a validation error for one that is too long."""
    count = len(text.split())
    if count > MAX_WORDS:
        raise make_validation_error(f"has {count} words, more than {MAX_WORDS}; shorten it")
    return text


Title = Annotated[str, Field(min_length=1, max_length=100)]
Text = Annotated[str, AfterValidator(_check_length)]


class ScriptSection(Section):
    """A section of the page: a `title`, a sentence or two in `text`, figures and tables.

    Consecutive sections with the same `part` stand under its heading.
    """

    title: Title
    text: Text = ""
    part: str = ""
    figure: tuple[Table, ...] = ()
    table: tuple[Table, ...] = ()


class Other(Section):
    """A line about another report: its `title`, its `page`, relative to this page, and `how`.

    The line quotes the verdict of the other page. While that page does not exist, the line says
    `how` to make it.
    """

    title: Title
    page: Annotated[str, Field(min_length=1)]
    how: Text


class Script(Section):
    """A report script: `title`, a `text` at its head, the scene, data, sections, other reports.

    `scene` is the path of a scene file, relative to the script, or a table of keys. Instead,
    `example` names an example of the package.
    """

    title: Title
    text: Text = ""
    scene: str | Table | None = Field(None, union_mode="left_to_right")
    example: str | None = None
    data: dict[str, Table] = Field(default_factory=dict)
    section: Annotated[tuple[Table, ...], Field(min_length=1)]
    other: tuple[Table, ...] = ()


@dataclass(frozen=True)
class Item:
    """A figure or table of a report.

    Parameters
    ----------
    section : int
        Number of its section, from 0.
    where : str
        Its key in the script, as ``section[0].figure[1]``.
    name : str
        Name of its files.
    kind : Kind
        Its keys.
    full : Kind
        Its keys with the values of `full`.
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
        The keys at its head.
    scene : Scene
        The report's scene.
    data : mapping of str to Readings
        The tables ``[data.NAME]`` by name.
    sections : tuple of ScriptSection
        Sections in their order.
    items : tuple of Item
        Figures and tables of all sections.
    others : tuple of Other
        Lines about other reports.
    files : tuple of Path
        Files that were read, the script first.
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
            For a preview, of few scenes to a coarse tolerance.
        full : bool
            With the values of `full` in each item.

        Returns
        -------
        inputs : Inputs
            What the items share.
        requirements : list of Requirements
            Those of the first screen first.

        Raises
        ------
        SceneError
            With all mistakes of all items.
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
        plan_scenes(all_scenes)  # refuses scenes that cannot be solved
        return inputs, requirements

    @property
    def summary(self) -> list[Item]:
        """Items of the first screen, at most `PICTURES`.

        First the items with `summary`, then the first item of each rank, then the other items.
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
        return distinct[:PICTURES]

    def _order_items(self) -> list[Item]:
        """Return the items of the first screen and then the others, in the script's order."""
        first = self.summary
        return [item for item in self.items if item in first] + [
            item for item in self.items if item not in first
        ]


def load_script(path: Path, kinds: Kinds) -> ReportPlan:
    """Read and check a report script.

    Parameters
    ----------
    path : Path
        A TOML file.
    kinds : mapping of str to Kind classes
        Kinds of figures besides the package's, by name.

    Returns
    -------
    ReportPlan

    Raises
    ------
    SceneError
        With all mistakes of the script, its scene and its data.
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
    """A reader of the tables of a script, which collects all mistakes.

    Parameters
    ----------
    kinds : mapping
        Kinds by form, ``figure`` or ``table``, and by name.
    files : list of Path
        Files that were read, the script first.
    problems : list of str
        Mistakes so far.
    """

    kinds: Mapping[str, Kinds]
    files: list[Path]
    problems: list[str] = field(default_factory=list)

    def validate(self, model: type[Model], table: Any, where: str) -> Model | None:
        """Return the model of a table at a key of the script, None for one with mistakes."""
        try:
            return model.model_validate(table)
        except ValidationError as error:
            self.problems += describe_errors(error, where, model)
            return None

    def validate_list(self, model: type[Model], table: Table, name: str) -> tuple[Model, ...]:
        """Return the models of the valid tables in a list."""
        models = []
        for number, entry in _enumerate_tables(table, name):
            valid = self.validate(model, entry, f"{name}[{number}]")
            if valid is not None:
                models.append(valid)
        return tuple(models)

    def read_scene(self, table: Table) -> Scene | None:
        """Return the scene of a script, None for one with mistakes."""
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
                return None  # the model of the script reports other types
        except SceneError as error:
            self.problems += error.problems
            return None

    def read_data(self, table: Table, scene: Scene) -> dict[str, Readings]:
        """Return the valid tables ``[data.NAME]`` of a script by name."""
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
        """Return the valid figures and tables of every section, with unique names."""
        items = []
        places: dict[str, str] = {}  # keys in the script by name of the item
        for number, section in _enumerate_tables(table, "section"):
            for form, kinds in self.kinds.items():
                for index, entry in _enumerate_tables(section, form):
                    where = f"section[{number}].{form}[{index}]"
                    kind = self._read_kind(kinds, entry, where)
                    if kind is not None:
                        full = self._read_full(kind, entry, where)
                        name = self._choose_name(kind, where, places)
                        items.append(Item(number, where, name=name, kind=kind, full=full))
        return tuple(items)

    def _read_kind(self, kinds: Kinds, table: Table, where: str) -> Kind | None:
        """Return the keys of a figure or table by the class of its kind, None with mistakes.

        Parameters
        ----------
        kinds : mapping of str to Kind classes
            Kinds that are allowed there.
        table : dict
            The keys.
        where : str
            Key of the table in the script.
        """
        name = table.get("kind", "(nothing)")
        if isinstance(name, str) and name in kinds:
            return self.validate(kinds[name], table, where)
        reason = f"is no kind of this table; {suggest(name, list(kinds))}"
        self.problems.append(format_error(f"{where}.kind", name, reason))
        return None

    def _read_full(self, kind: Kind, table: Table, where: str) -> Kind:
        """Return the keys with the values of `full`, or the keys alone where these are mistakes.

        Parameters
        ----------
        kind : Kind
            The keys.
        table : dict
            The keys as in the script.
        where : str
            Key of the table in the script.
        """
        for key in kind.full.keys() & {"kind", "name", "full"}:
            reason = "is the same in every form of a report; leave it out"
            self.problems.append(format_error(f"{where}.full.{key}", kind.full[key], reason))
        full = self.validate(type(kind), {**table, **kind.full}, f"{where}.full")
        return kind if full is None else full

    def _choose_name(self, kind: Kind, where: str, places: dict[str, str]) -> str:
        """Return the name of an item's files, and add it to the places by name.

        Parameters
        ----------
        kind : Kind
            Its keys, which may have the name.
        where : str
            Key of the item in the script.
        places : dict
            Keys of earlier items by their names.
        """
        name = kind.name
        if name is None:
            name = kind.stem
            number = 2
            while name in places:
                name = f"{kind.stem}-{number}"
                number += 1
        elif name in places:
            reason = f"is the name of {places[name]}; choose another"
            self.problems.append(format_error(f"{where}.name", name, reason))
        places[name] = where
        return name


def _enumerate_tables(table: Table, name: str) -> Iterator[tuple[int, Table]]:
    """Yield the tables of a list with their numbers; the list's model reports other entries."""
    entries = table.get(name)
    if not isinstance(entries, list):
        return
    for number, entry in enumerate(entries):
        if isinstance(entry, dict):
            yield number, entry

"""Report scripts: TOML files that say what a report shows, checked before anything is solved."""

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
from pvdf_fem.scene.scene_file import MOST_BYTES, SceneError, format_error, parse_toml, suggest
from pvdf_fem.scene.validation.errors import MAX_ERRORS, describe_errors, join_key

MOST_WORDS = 120  #: Of a section.
PICTURES = 3  #: Of the first screen.
Kinds = Mapping[str, type[Kind]]
Model = TypeVar("Model", bound=Section)


def _is_short(text: str) -> str:
    if (count := len(text.split())) > MOST_WORDS:
        raise make_validation_error(f"has {count} words, more than {MOST_WORDS}; say less")
    return text


Title = Annotated[str, Field(min_length=1, max_length=100)]
Text = Annotated[str, AfterValidator(_is_short)]
Table = dict[str, Any]


class ScriptSection(Section):
    """A section on the page: `title`, a sentence or two in `text`, figures and tables.

    Sections with one `part` stand under its heading.
    """

    title: Title
    text: Text = ""
    part: str = ""
    figure: tuple[Table, ...] = ()
    table: tuple[Table, ...] = ()


class Other(Section):
    """A line about another report: `title`, its `page`, seen from this page, and `how` to make it.

    The line has the verdict of the other page, or says how to make the page.
    """

    title: Title
    page: Annotated[str, Field(min_length=1)]
    how: Text


class Script(Section):
    """A report script: `title`, a `text` at its head, the scene, data, sections, other reports.

    The scene is a file's path, seen from the script, a table of keys, or by `example` an example
    from the package.
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
    """A figure or table of a report."""

    section: int
    where: str  #: Its key in the script: ``section[0].figure[1]``.
    name: str  #: Of its files.
    kind: Kind
    full: Kind  #: With the values of its `full`.


class Requirements(NamedTuple):
    """What is to be computed for an item."""

    item: Item
    scenes: list[Scene]
    tasks: Sequence[Task]


@dataclass(frozen=True)
class ReportPlan:
    """A validated report script: its scene, data, sections and items."""

    script: Script
    scene: Scene
    data: Mapping[str, Readings]
    sections: tuple[ScriptSection, ...]
    items: tuple[Item, ...]
    others: tuple[Other, ...]
    files: tuple[Path, ...]  #: What was read.

    def needs(self, quick: bool = False, full: bool = False) -> tuple[Inputs, list[Requirements]]:
        """Needs of the report's items, in preview or full form; the items of the
        first screen are first. Raises `SceneError` with all mistakes."""
        inputs, needed, problems = Inputs(self.scene, self.data, quick), [], list[str]()
        for item in sorted(self.items, key=lambda item: item not in self.summary):
            asked = replace(item, kind=item.full) if full else item
            try:
                scenes, tasks = asked.kind.scenes(inputs), asked.kind.tasks(inputs)
                needed.append(Requirements(asked, scenes, tasks))
            except SceneError as error:
                problems += [f"{item.where}.{told}" for told in error.problems]
        if not problems:
            plan_scenes([scene for need in needed for scene in need.scenes])
            return inputs, needed
        raise SceneError(problems[:MAX_ERRORS], str(self.files[0]))

    @property
    def summary(self) -> list[Item]:
        """Up to `PICTURES` items: first with `summary`, then the first per rank, then the rest."""
        asked = [item for item in self.items if item.kind.summary]
        ranked = sorted(self.items, key=lambda item: item.kind.rank)
        first = {item.kind.rank: item for item in reversed(ranked)}
        found = [*asked, *(item for item in ranked if first[item.kind.rank] is item), *ranked]
        return [item for i, item in enumerate(found) if item not in found[:i]][:PICTURES]


def load_script(path: Path, kinds: Kinds) -> ReportPlan:
    """The plan of a script; `SceneError` with all its mistakes. `kinds` are further ones."""
    try:
        table = parse_toml(read_text(path, MOST_BYTES, "a report script"), str(path))
    except FileError as error:
        raise SceneError([str(error)], str(path)) from None
    reader = _Reader({"figure": {**FIGURES, **kinds}, "table": TABLES}, [path])
    script, scene = reader.valid(Script, table, ""), reader.scene(table)
    sections = reader.all_valid(ScriptSection, table, "section")
    data = {} if scene is None else reader.data(table, scene)
    items, others = reader.items(table), reader.all_valid(Other, table, "other")
    if reader.problems or script is None or scene is None:
        raise SceneError(list(dict.fromkeys(reader.problems))[:MAX_ERRORS], str(path))
    plan = ReportPlan(script, scene, data, sections, items, others, tuple(reader.files))
    plan.needs()
    return plan


@dataclass
class _Reader:
    """Reads the valid tables of a script; mistakes join `problems`."""

    known: Mapping[str, Kinds]  #: Kinds by form, figure or table.
    files: list[Path]  #: What was read, the script first.
    problems: list[str] = field(default_factory=list)

    def valid(self, model: type[Model], table: Any, where: str) -> Model | None:
        """The model for the table at a key, or None."""
        try:
            return model.model_validate(table)
        except ValidationError as error:
            self.problems += describe_errors(error, where, model)
            return None

    def all_valid(self, model: type[Model], table: Table, name: str) -> tuple[Model, ...]:
        """The models of a list of tables."""
        found = (self.valid(model, of, f"{name}[{i}]") for i, of in _tables(table, name))
        return tuple(one for one in found if one is not None)

    def scene(self, table: Table) -> Scene | None:
        """The scene of a script; its file joins the files that are read."""
        given, example = table.get("scene"), table.get("example")
        try:
            if (given is None) == (example is None):
                reason = "give one of `scene`, a path or a table [scene], and `example`"
                raise SceneError([format_error("scene", given or "(nothing)", reason)])
            with prefix_errors("scene" if example is None else "example"):
                if isinstance(example, str):
                    return Scene.example(example)
                if isinstance(given, str):
                    self.files.append(self.files[0].parent / given)
                    return Scene.from_file(self.files[-1])
                return Scene().with_(**given) if isinstance(given, dict) else None
        except SceneError as error:
            self.problems += error.problems
            return None

    def data(self, table: Table, scene: Scene) -> dict[str, Readings]:
        """The data that can be read."""
        found, tables = dict[str, Readings](), table.get("data")
        folder = self.files[0].parent
        for name, of in tables.items() if isinstance(tables, dict) else ():
            source = self.valid(DataSource, of, join_key("data", [name]))
            try:
                if source is not None:
                    found[name] = read_data(name, source, scene, folder)
                    self.files += [folder / source.file] if source.file else []
            except SceneError as error:
                self.problems += error.problems
        return found

    def items(self, table: Table) -> tuple[Item, ...]:
        """Figures and tables from every section, with unique names."""
        items, names = list[Item](), dict[str, str]()
        for number, section in _tables(table, "section"):
            for form, known in self.known.items():
                for index, of in _tables(section, form):
                    where = f"section[{number}].{form}[{index}]"
                    if (kind := self._kind(known, of, where)) is None:
                        continue
                    for key in kind.full.keys() & {"kind", "name", "full"}:
                        reason = "is the same in every form of a report; leave it out"
                        self.problems.append(
                            format_error(f"{where}.full.{key}", kind.full[key], reason)
                        )
                    full = self.valid(type(kind), {**of, **kind.full}, f"{where}.full")
                    name = self._name(kind, where, names)
                    items.append(Item(number, where, name, kind, full or kind))
        return tuple(items)

    def _kind(self, known: Kinds, table: Table, where: str) -> Kind | None:
        word = table.get("kind", "(nothing)")
        if isinstance(word, str) and word in known:
            return self.valid(known[word], table, where)
        reason = f"is no kind there; {suggest(word, list(known))}"
        self.problems.append(format_error(f"{where}.kind", word, reason))
        return None

    def _name(self, kind: Kind, where: str, names: dict[str, str]) -> str:
        """The name for an item's files, added to `names`."""
        numbered = (f"{kind.stem}-{n}" for n in range(2, len(names) + 3))
        unused = (name for name in (kind.stem, *numbered) if name not in names)
        name = kind.name or next(unused)
        if name in names:
            reason = f"is the name of {names[name]}; choose another"
            self.problems.append(format_error(f"{where}.name", name, reason))
        names[name] = where
        return name


def _tables(table: Table, name: str) -> Iterator[tuple[int, Table]]:
    """The tables of a list with their numbers; whatever is no table is told by its owner."""
    given = table.get(name)
    for number, of in enumerate(given if isinstance(given, list) else ()):
        if isinstance(of, dict):
            yield number, of

"""Report scripts: TOML files that say what a report shows, checked before anything is solved."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Union

from pydantic import AfterValidator, Field, ValidationError, create_model
from pydantic_core import ErrorDetails

from pvdf_fem.files import FileError, read_text
from pvdf_fem.reporting.data import DataSource, Readings, read_data
from pvdf_fem.reporting.kind import Inputs, Kind, blamed
from pvdf_fem.reporting.registry import FIGURES, TABLES
from pvdf_fem.reporting.task import Task
from pvdf_fem.scene.mistakes import MOST_MISTAKES, REASONS
from pvdf_fem.scene.quantity import Section, refusal
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import MOST_BYTES, SceneError, choose, parse_toml, problem
from pvdf_fem.sweeps.sweep import planned

MOST_WORDS = 120  #: Of a section.
PICTURES = 3  #: Of the first screen.
Kinds = Mapping[str, type[Kind]]


def _is_short(text: str) -> str:
    if (count := len(text.split())) > MOST_WORDS:
        raise refusal(f"has {count} words, more than {MOST_WORDS}; say less")
    return text


Title = Annotated[str, Field(min_length=1, max_length=100)]
Text = Annotated[str, AfterValidator(_is_short)]


class ScriptSection(Section):
    """A section of the page: `title`, one or two sentences of `text`, and its figures and tables.

    Sections with one `part` stand under its heading.
    """

    title: Title
    text: Text = ""
    part: str = ""
    figure: tuple[Any, ...] = ()
    table: tuple[Any, ...] = ()


class Other(Section):
    """A line about another report: `title`, its `page`, seen from this page, and `how` to make it.

    The line has the verdict of the other page, or says how to make the page.
    """

    title: Title
    page: Annotated[str, Field(min_length=1)]
    how: Text


class Script(Section):
    """A report script: `title`, a `text` at its head, the scene, data, sections, other reports.

    The scene is the path of a file, seen from the script, a table of its keys, or by `example` one
    that comes with the package.
    """

    title: Title
    text: Text = ""
    scene: str | dict[str, Any] | None = Field(None, union_mode="left_to_right")
    example: str | None = None
    data: dict[str, DataSource] = Field(default_factory=dict)
    section: tuple[ScriptSection, ...]
    other: tuple[Other, ...] = ()


@dataclass(frozen=True)
class Item:
    """A figure or table of a report."""

    section: int
    where: str  #: Its key in the script: ``section[0].figure[1]``.
    name: str  #: Of its files.
    kind: Kind


class Need(NamedTuple):
    """What is to be computed for an item."""

    item: Item
    scenes: list[Scene]
    tasks: Sequence[Task]


@dataclass(frozen=True)
class Plan:
    """A script that is valid: what it shows, of which scene and data."""

    script: Script
    scene: Scene
    data: Mapping[str, Readings]
    items: tuple[Item, ...]
    files: tuple[Path, ...]  #: What was read.

    def needs(self, quick: bool = False, full: bool = False) -> tuple[Inputs, list[Need]]:
        """What the items of the report need, in its preview or its full form; the items of the
        first screen are first. Raises `SceneError` with all mistakes."""
        inputs, needed, problems = Inputs(self.scene, self.data, quick), [], list[str]()
        for item in sorted(self.items, key=lambda item: item not in self.summary):
            asked = replace(item, kind=item.kind.at_full()) if full else item
            try:
                scenes, tasks = asked.kind.scenes(inputs), asked.kind.tasks(inputs)
                needed.append(Need(asked, scenes, tasks))
            except SceneError as error:
                problems += [f"{item.where}.{told}" for told in error.problems]
        if not problems:
            planned([scene for need in needed for scene in need.scenes])
            return inputs, needed
        raise SceneError(problems[:MOST_MISTAKES], str(self.files[0]))

    @property
    def summary(self) -> list[Item]:
        """The items of the first screen: those that ask for it, then one of each kind."""
        asked = [item for item in self.items if item.kind.summary]
        ranked = sorted(self.items, key=lambda item: item.kind.rank)
        first = {item.kind.rank: item for item in reversed(ranked)}
        found = [*asked, *(item for item in ranked if first[item.kind.rank] is item), *ranked]
        return [item for i, item in enumerate(found) if item not in found[:i]][:PICTURES]


def load(path: Path, kinds: Kinds) -> Plan:
    """The plan of a script; `SceneError` with all its mistakes. `kinds` are further ones."""
    source, files, problems = str(path), [path], list[str]()
    try:
        text = read_text(path, MOST_BYTES, "a report script")
    except FileError as error:
        raise SceneError([str(error)], source) from None
    table, script, scene = parse_toml(text, source), None, None
    known = {**FIGURES, **TABLES, **kinds}
    try:
        script = _model(kinds).model_validate(table)
    except ValidationError as error:
        problems += [_told(details, known) for details in error.errors(include_url=False)]
    try:
        scene = _scene(table, path, files)
    except SceneError as error:
        problems += error.problems
    data = {} if scene is None else _data(table, scene, path, files, problems)
    items = [] if script is None else _items(script, known, problems)
    if problems or script is None or scene is None:
        raise SceneError(list(dict.fromkeys(problems))[:MOST_MISTAKES], source)
    plan = Plan(script, scene, data, tuple(items), tuple(files))
    plan.needs()
    return plan


def _model(kinds: Kinds) -> type[Script]:
    """The model of scripts whose figures and tables are of known kinds."""

    def any_of(known: Kinds) -> Any:
        one: Any = Annotated[Union.__getitem__(tuple(known.values())), Field(discriminator="kind")]
        return tuple.__class_getitem__((one, ...)), ()

    forms: dict[str, Any] = {"figure": any_of({**FIGURES, **kinds}), "table": any_of(TABLES)}
    section = create_model("ReportSection", __base__=ScriptSection, **forms)
    sections: Any = Annotated[tuple.__class_getitem__((section, ...)), Field(min_length=1)]
    return create_model("ReportScript", __base__=Script, section=(sections, ...))


def _scene(table: Mapping[str, Any], path: Path, files: list[Path]) -> Scene:
    """The scene of a script; its file joins the files that are read."""
    given, example = table.get("scene"), table.get("example")
    if (given is None) == (example is None):
        reason = "give one of `scene`, a path or a table [scene], and `example`"
        raise SceneError([problem("scene", "(nothing)" if given is None else given, reason)])
    with blamed("scene" if example is None else "example"):
        if isinstance(example, str):
            return Scene.example(example)
        if isinstance(given, str):
            files.append(path.parent / given)
            return Scene.load(files[-1])
        return Scene().with_(**given) if isinstance(given, Mapping) else Scene()


def _data(
    table: Mapping[str, Any], scene: Scene, path: Path, files: list[Path], problems: list[str]
) -> dict[str, Readings]:
    """The data that can be read; what is wrong with the others joins the problems."""
    tables, found = table.get("data"), {}
    for name, source in tables.items() if isinstance(tables, Mapping) else ():
        try:
            model = DataSource.model_validate(source)
            found[name] = read_data(name, model, scene, path.parent)
            files += [path.parent / model.file] if model.file else []
        except ValidationError:
            continue  # told already
        except SceneError as error:
            problems += error.problems
    return found


def _items(script: Script, kinds: Kinds, problems: list[str]) -> list[Item]:
    """The figures and tables of all sections; names that two of them have, and mistakes in `full`,
    join the problems."""
    items, names = list[Item](), dict[str, str]()
    for number, section in enumerate(script.section):
        for form in ("figure", "table"):
            for index, kind in enumerate(getattr(section, form)):
                where = f"section[{number}].{form}[{index}]"
                numbered = (f"{kind.stem}-{n}" for n in range(2, len(names) + 3))
                unused = (name for name in (kind.stem, *numbered) if name not in names)
                name = kind.name or next(unused)
                if name in names:
                    reason = f"is the name of {names[name]}; choose another"
                    problems.append(problem(f"{where}.name", name, reason))
                names[name] = where
                items.append(Item(number, where, name, kind))
                try:
                    kind.at_full()
                except ValidationError as error:
                    for details in error.errors():
                        details["loc"] = ("section", number, form, index, "full", *details["loc"])
                        problems.append(_told(details, kinds))
    return items


def _told(details: ErrorDetails, kinds: Kinds) -> str:
    """A mistake of a script by its key, in the words of scenes."""
    steps, owner = list[Any](), _owner(details["loc"], kinds)
    for step in details["loc"]:
        is_tag = step in kinds and len(steps) == 4  # section, number, figure, number
        if not is_tag and not str(step).startswith("<"):
            steps.append(step)
    key = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in steps)[1:]
    kind, context = details["type"], details.get("ctx", {})
    reason = REASONS.get(kind, f"{details['msg'][:120]}; change it")
    if kind in ("missing", "union_tag_not_found"):
        key += ".kind" if kind == "union_tag_not_found" else ""
        return f"{key} = (nothing): is required; add it"
    if kind == "scene":
        reason = context["reason"]
    elif kind == "union_tag_invalid":
        word, known = context["tag"], context["expected_tags"].replace("'", "").split(", ")
        return problem(f"{key}.kind", word, f"is no kind there; {choose(word, known)}")
    elif kind == "extra_forbidden":
        known = list(owner.model_fields) if owner else []
        reason = f"is no key there; {choose(steps[-1], known) if known else 'remove it'}"
    return problem(key[:160], details["input"], reason)


def _owner(loc: Sequence[Any], kinds: Kinds) -> type[Section] | None:
    """The model of the table that has the key at `loc`, of which the last step is the key."""
    tables = {"data": DataSource, "section": ScriptSection, "other": Other}
    by_depth: dict[int, Any] = {1: Script, 3: tables.get(loc[0])}
    if len(loc) == 6 and loc[4] in kinds:
        return kinds[loc[4]]
    return by_depth.get(len(loc))

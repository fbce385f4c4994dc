"""Report scripts: TOML files that say what a report shows, checked before anything is solved."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import AfterValidator, BaseModel, Field, ValidationError
from pydantic_core import ErrorDetails

from pvdf_fem.files import FileError, read_text
from pvdf_fem.reporting.data import DataSource, Readings, read_data
from pvdf_fem.reporting.kind import Inputs, Kind, blamed
from pvdf_fem.reporting.registry import FIGURES, TABLES
from pvdf_fem.scene.mistakes import MOST_MISTAKES, REASONS
from pvdf_fem.scene.quantity import Section, refusal
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import (
    MOST_BYTES,
    SceneError,
    choose,
    parse_toml,
    problem,
)
from pvdf_fem.sweeps.sweep import planned

MOST_WORDS = 120  #: Of a section.
Model = TypeVar("Model", bound=BaseModel)


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
    figure: tuple[dict[str, Any], ...] = ()
    table: tuple[dict[str, Any], ...] = ()


class Script(Section):
    """A report script: `title`, a `text` at its head, the scene, data and sections.

    The scene is the path of a file, seen from the script, a table of its keys, or by `example` one
    that comes with the package.
    """

    title: Title
    text: Text = ""
    scene: Any = None
    example: str | None = None
    data: dict[str, DataSource] = {}
    section: Annotated[tuple[ScriptSection, ...], Field(min_length=1)]


@dataclass(frozen=True)
class Item:
    """A figure or table of a report."""

    section: int
    where: str  #: Its key in the script: ``section[0].figure[1]``.
    name: str  #: Of its files.
    kind: Kind


@dataclass(frozen=True)
class Plan:
    """A script that is valid: what it shows, of which scene and data."""

    script: Script
    scene: Scene
    data: Mapping[str, Readings]
    items: tuple[Item, ...]
    files: tuple[Path, ...]  #: What was read.

    def needs(self, quick: bool = False) -> tuple[Inputs, list[tuple[Item, list[Scene]]]]:
        """The items of the report, or of its preview, with their scenes; the first screen's first.
        Raises `SceneError` with all mistakes."""
        inputs = Inputs(self.scene, self.data, quick)
        needed, problems = [], list[str]()
        for item in self.items:
            shown = item if not quick else Item(**{**vars(item), "kind": item.kind.quicker()})
            try:
                needed.append((shown, shown.kind.scenes(inputs)))
            except SceneError as error:
                problems += [f"{item.where}.{told}" for told in error.problems]
        if not problems:
            try:
                planned([scene for _, scenes in needed for scene in scenes])
            except SceneError as error:
                problems += error.problems
        if problems:
            raise SceneError(problems[:MOST_MISTAKES], str(self.files[0]))
        first = {id(item) for item in summary([item for item, _ in needed])}
        return inputs, sorted(needed, key=lambda pair: id(pair[0]) not in first)


def summary(items: Sequence[Item]) -> list[Item]:
    """The three items of the first screen: those that ask for it, else one of each kind."""
    asked = [item for item in items if item.kind.summary]
    ranked = sorted(items, key=lambda item: item.kind.rank)
    of_kind = {type(item.kind): item for item in reversed(ranked)}
    one_each = sorted(of_kind.values(), key=lambda item: item.kind.rank)
    return list({id(i): i for i in (*asked, *one_each, *ranked)}.values())[: max(3, len(asked))]


def load(path: Path, kinds: Mapping[str, type[Kind]]) -> Plan:
    """The plan of a script; `SceneError` with all its mistakes. `kinds` are further ones."""
    source = str(path)
    try:
        text = read_text(path, MOST_BYTES, "a report script")
    except FileError as error:
        raise SceneError([str(error)], source) from None
    table = parse_toml(text, source)
    problems: list[str] = []
    script = read(Script, table, "", problems)
    files, scene = [path], None
    try:
        scene = _scene(table, path, files)
    except SceneError as error:
        problems += error.problems
    items = list(_items(table, kinds, problems))
    data = {} if scene is None else _data(table, scene, path, files, problems)
    if problems or script is None or scene is None:
        raise SceneError(list(dict.fromkeys(problems))[:MOST_MISTAKES], source)
    plan = Plan(script, scene, data, tuple(items), tuple(files))
    plan.needs()
    return plan


def _scene(table: Mapping[str, Any], path: Path, files: list[Path]) -> Scene:
    given, example = table.get("scene"), table.get("example")
    if (given is None) == (example is None):
        reason = "give one of `scene`, a path or a table [scene], and `example`"
        raise SceneError([problem("scene", "(nothing)" if given is None else given, reason)])
    if isinstance(example, str):
        with blamed("example"):
            return Scene.example(example)
    if isinstance(given, str):
        files.append(path.parent / given)
        with blamed("scene"):
            return Scene.load(files[-1])
    if isinstance(given, Mapping):
        with blamed("scene"):
            return Scene().with_(**given)
    key, value = ("scene", given) if example is None else ("example", example)
    raise SceneError([problem(key, value, "must be text or a table; put it in quotes")])


def _data(
    table: Mapping[str, Any], scene: Scene, path: Path, files: list[Path], problems: list[str]
) -> dict[str, Readings]:
    """The data that can be read; what is wrong with the others joins the problems."""
    tables, found = table.get("data"), {}
    for name, source in tables.items() if isinstance(tables, Mapping) else ():
        try:
            model = DataSource.model_validate(source)
        except ValidationError:
            continue  # told already
        try:
            found[name] = read_data(name, model, scene, path.parent)
            if model.file is not None:
                files.append(path.parent / model.file)
        except SceneError as error:
            problems += error.problems
    return found


def _items(
    table: Mapping[str, Any], kinds: Mapping[str, type[Kind]], problems: list[str]
) -> Iterator[Item]:
    """The figures and tables of all sections; mistakes join the problems."""
    sections, names = table.get("section"), dict[str, str]()
    for number, section in enumerate(sections if isinstance(sections, list) else ()):
        for form, known in (("figure", FIGURES), ("table", TABLES)):
            entries = section.get(form) if isinstance(section, Mapping) else None
            for index, entry in enumerate(entries if isinstance(entries, list) else ()):
                where = f"section[{number}].{form}[{index}]"
                kind = _kind(where, entry, {**known, **kinds}, problems)
                if kind is None:
                    continue
                name = kind.name or _unused(kind.stem, names)
                if name in names:
                    reason = f"is the name of {names[name]}; choose another"
                    problems.append(problem(f"{where}.name", name, reason))
                names[name] = where
                yield Item(number, where, name, kind)


def _unused(stem: str, names: Mapping[str, str]) -> str:
    numbered = (f"{stem}-{number}" for number in range(2, len(names) + 3))
    return next(name for name in (stem, *numbered) if name not in names)


def _kind(
    where: str, entry: Any, known: Mapping[str, type[Kind]], problems: list[str]
) -> Kind | None:
    """A figure or table; None if it has mistakes, which join the problems."""
    if not isinstance(entry, Mapping):
        return None  # told already
    name = entry.get("kind")
    if not isinstance(name, str) or name not in known:
        reason = f"is no kind there; {choose(name, list(known))}"
        problems.append(problem(f"{where}.kind", "(nothing)" if name is None else name, reason))
        return None
    return read(known[name], entry, where, problems)


def read(
    model: type[Model], table: Mapping[str, Any], where: str, problems: list[str]
) -> Model | None:
    """The model of a table; None if it has mistakes, which join the problems."""
    try:
        return model.model_validate(table)
    except ValidationError as error:
        details = error.errors(include_url=False)
        problems += [_told(where, entry, model) for entry in details]
        return None


def _told(where: str, details: ErrorDetails, model: type[BaseModel]) -> str:
    """A mistake by its key, in the words of scenes."""
    loc = [step for step in details["loc"] if not str(step).startswith("<")]
    steps = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in loc)
    key, kind = f"{where}{steps}".removeprefix("."), details["type"]
    reason = REASONS.get(kind, f"{details['msg'][:120]}; change it")
    if kind == "missing":
        return f"{key} = (nothing): {reason}"
    if kind == "scene":
        reason = details["ctx"]["reason"]
    elif kind == "extra_forbidden":
        known = list(_owner(model, loc[:-1]).model_fields)
        reason = f"is no key there; {choose(loc[-1], known)}"
    return problem(key[:160], details["input"], reason)


def _owner(model: Any, steps: Sequence[Any]) -> Any:
    """The model that has the keys at the end of some steps."""
    parts = {("data",): DataSource, ("section",): ScriptSection}
    names = tuple(step for step in steps if not isinstance(step, int))
    if model is Script and names[:1] in parts:
        return parts[names[:1]]
    if names:
        field: Any = model.model_fields[names[0]].annotation
        found = [arg for arg in getattr(field, "__args__", ()) if hasattr(arg, "model_fields")]
        return found[0] if found else model
    return model

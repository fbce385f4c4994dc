"""Reference pages of the guide, from the code: scene files, commands, and the public names."""

from __future__ import annotations

import ast
import inspect
import json
import re
import types
from collections.abc import Iterable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import pvdf_fem
from pvdf_fem.cli.main import _parser as parser
from pvdf_fem.reporting.data import DataSource
from pvdf_fem.reporting.kind import Kind
from pvdf_fem.reporting.registry import FIGURES
from pvdf_fem.reporting.registry import TABLES as REPORT_TABLES
from pvdf_fem.reporting.script import Other, Script, ScriptSection
from pvdf_fem.scene.film import Air, Film
from pvdf_fem.scene.outlines.shape import HEAT
from pvdf_fem.scene.quantity import Section
from pvdf_fem.scene.readout import Readout
from pvdf_fem.scene.registry import Load
from pvdf_fem.scene.scene import Numerics, Scene
from pvdf_fem.scene.scene_file import example_text, examples
from pvdf_fem.scene.shapes import ELECTRODES, PATCHES, PROBES, RINGS, Layout, Pressing
from pvdf_fem.scene.stage import Stage, WantedModel

#: Tables of a scene file and their models; shapes of one kind stand side by side.
TABLES: Mapping[str, tuple[type[Section], ...]] = {
    "[film]": (Film,),
    "[[film.patches]]": tuple(PATCHES.values()),
    "[electrodes]": (Layout,),
    '[electrodes] with layout = "ring"': tuple(RINGS.values()),
    "[[electrodes]]": tuple(ELECTRODES.values()),
    "[probe]": tuple(PROBES.values()),
    "[[probe]], besides the keys of [probe]": (Pressing,),
    "[load]": (Load,),
    "[numerics]": (Numerics,),
    "[readout]": (Readout,),
    "[stage]": (Stage,),
    "[air]": (Air,),
    "[model]": (WantedModel,),
}
#: What public names return or take, by headings of the page.
RESULTS: Mapping[str, tuple[str, ...]] = {
    "What results hold": (
        "charges.point_values.PointValues",
        "film.loads.touchdown.Touchdown",
        "film.loads.pressure.Leaning",
        "solvers.status.Status",
        "solution.history.MeshRecord",
        "derivatives.gradients.Gradients",
        "dynamics.modes.Modes",
        "dynamics.forced.FrequencyResponse",
        "dynamics.forced.Transient",
        "calibration.calibration.Calibration",
        "touch.location.Location",
        "touch.touch.Touch",
        "touch.locate_many.Touches",
        "tracking.rows.Row",
        "reporting.report.Made",
        "reporting.kind.Content",
    ),
    "What they take": (
        "dynamics.forced.half_sine",
        "dynamics.forced.step",
        "response.build.ResponseOptions",
        "response.model.Domain",
        "touch.locate.LocateOptions",
        "sweeps.store.Store",
        "reporting.kind.Kind",
        "reporting.task.Task",
        "readout.channel.Channel",
    ),
}


def write_references(folder: Path) -> None:
    """Write all pages to a folder; a page that has not changed keeps its time."""
    folder.mkdir(exist_ok=True)
    pages = {"scene": scene_page(), "report": report_page(), "commands": commands_page()}
    pages |= {"api": api_page()}
    for name, text in (pages | {"modules": modules_page()}).items():
        path = folder / f"{name}.md"
        if not path.exists() or path.read_text("utf-8") != text:
            path.write_text(text, "utf-8")


def scene_page() -> str:
    """Every table of a scene file with its keys, defaults and ranges."""
    lines = [
        "# Scene files",
        "A scene is a TOML file of these tables. Every key has a default unless it is marked as",
        "needed, and the units are in the keys' names. The scene at the end of this page, which",
        "`pvdf-fem example four_electrodes` prints, explains every key.",
        "",
        _cleaned(Scene.__doc__),
    ]
    for heading, models in TABLES.items():
        lines += ["", f"## `{heading}`", ""]
        lines += _alone(models[0]) if len(models) == 1 else _beside(models)
    commented = example_text("four_electrodes", examples()).rstrip()
    lines += ["", "## A scene with every key", "", "```toml", commented, "```"]
    return "\n".join(lines) + "\n"


def report_page() -> str:
    """Every table of a report script, and every kind of figure and table, with its keys."""
    lines = [
        "# Report scripts",
        "A report script is a TOML file of these tables; [the guide](../report.md) has examples.",
    ]
    tables: dict[str, type[Section]] = {
        "at the head": Script,
        "[data.NAME]": DataSource,
        "[[section]]": ScriptSection,
        "[[other]]": Other,
    }
    for heading, model in tables.items():
        lines += ["", f"## `{heading}`", "", *_alone(model)]
    lines += ["", "## Keys of every figure and table", "", *_alone(Kind)]
    for form, kinds in {"figure": FIGURES, "table": REPORT_TABLES}.items():
        for name, model in kinds.items():
            keys = [key for key in model.model_fields if key not in Kind.model_fields]
            lines += ["", f'## `[[section.{form}]]` with `kind = "{name}"`', ""]
            lines += [_cleaned(model.__doc__), "", *_table(model, keys)]
    lines += ["", "## A script", "", "```toml", example_text("report", examples()).rstrip(), "```"]
    return "\n".join(lines) + "\n"


def _cleaned(doc: str | None) -> str:
    """A docstring as Markdown: double backticks are single ones."""
    return inspect.cleandoc(doc or "").replace("``", "`")


def _alone(model: type[Section]) -> list[str]:
    """A model's docstring, and a table of its keys."""
    return [_cleaned(model.__doc__), "", *_table(model, model.model_fields)]


def _beside(models: Sequence[type[Section]]) -> list[str]:
    """The keys that models of one table share, and for each shape those that it has besides."""
    shared = set.intersection(*(set(model.model_fields) for model in models)) - {"shape"}
    if models[0] not in PROBES.values():
        shared -= {"edge_radius_mm", *HEAT}  # which only probes have
    lines = _table(models[0], [key for key in models[0].model_fields if key in shared])
    for model in models:
        shape = model.model_fields["shape"].default
        lines += ["", f'`shape = "{shape}"`: {_cleaned(model.__doc__)}', ""]
        known = {"shape", "edge_radius_mm", *HEAT, *shared}
        lines += _table(model, [key for key in model.model_fields if key not in known])
    return lines


def _table(model: type[Section], keys: Iterable[str]) -> list[str]:
    lines = ["| key | default | values |", "| --- | --- | --- |"]
    for key in keys:
        field = model.model_fields[key]
        default = "needed"
        if not field.is_required():
            default = _written(field.get_default(call_default_factory=True))
        lines += [f"| `{key}` | {default} | {_values(field.annotation, field.metadata)} |"]
    return lines


def _written(value: Any) -> str:
    if value is None:
        return "not given"
    if value in ((), {}):
        return "none"
    if isinstance(value, Section | tuple):
        return "the table's"
    return f"`{json.dumps(value)}`"


def _values(annotation: Any, metadata: Any = ()) -> str:
    """What a type takes, in words, with the range of `quantity.within`."""
    for check in (getattr(entry, "func", None) for entry in metadata):
        found = inspect.getclosurevars(check).nonlocals if inspect.isfunction(check) else {}
        if {"low", "high", "unit"} <= found.keys():
            return f"{found['low']:g} to {found['high']:g} {found['unit']}".rstrip()
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _values(arguments[0], arguments[1:])
    if origin is Literal:
        return ", ".join(_written(value) for value in arguments)
    if origin in (Union, types.UnionType):
        kinds = dict.fromkeys(_values(a) for a in arguments if a is not type(None))
        return " or ".join(kind for kind in kinds if kind)
    if origin is tuple:
        kinds = dict.fromkeys(_values(a) for a in arguments if a is not Ellipsis)
        is_tables = any("Patch" in kind for kind in kinds)
        return "list of the next table" if is_tables else f"list of {'; '.join(kinds)}"
    if origin is dict:
        is_number = _values(arguments[1]) not in ("value", "list of value")
        return f"table by {'electrode' if is_number else 'key'} of {_values(arguments[1])}"
    if inspect.isclass(annotation) and issubclass(annotation, Section):
        return f"table {annotation.__name__}"
    names = {bool: "`true`, `false`", float: "number", int: "whole number", str: "text"}
    names[Any] = "value"
    return names.get(annotation, "as said above")


def commands_page() -> str:
    """The help of the command and of its commands."""
    whole = parser()
    [commands] = [a for a in whole._actions if hasattr(a, "choices") and a.choices]
    lines = ["# Commands", "This is what `--help` prints.", "", "## `pvdf-fem`", ""]
    lines += ["```text", whole.format_help().rstrip(), "```"]
    for name, command in dict(commands.choices or {}).items():
        lines += ["", f"## `pvdf-fem {name}`", "", "```text", command.format_help().rstrip(), "```"]
    return "\n".join(lines) + "\n"


def api_page() -> str:
    """The public names under the headings of the package's docstring, then what they return."""
    lines = ["# Python interface", "", "Public names come from `pvdf_fem` itself,"]
    lines += [
        "other classes and functions from the modules that are written before their names.",
        "",
    ]
    doc = inspect.cleandoc(pvdf_fem.__doc__ or "")
    groups = re.findall(r"^(\w[^\n]*)\n((?:    [^\n]*\n?)+)", doc, re.M)
    left = list(pvdf_fem.__all__)
    for heading, text in groups:
        named = [name for name in re.findall(r"`(\w+)`", text) if name in left]
        left = [name for name in left if name not in named]
        lines += [f"## {heading}", "", inspect.cleandoc(text).replace("``", "`"), ""]
        for name in dict.fromkeys(named):
            lines += _documented(name)
    assert not left, f"in no group of the package's docstring: {left}"
    for heading, names in RESULTS.items():
        lines += [f"## {heading}", ""]
        for name in names:
            lines += _documented(name)
    return "\n".join(lines)


def _documented(path: str) -> list[str]:
    """What makes Sphinx show the docstrings of a class or function."""
    module, _, name = f"pvdf_fem.{path}".rpartition(".")
    found = getattr(import_module(module), name)
    # the arguments of models and results are their keys and attributes
    takes_arguments = not inspect.isclass(found) or name in ("Tracker", "LocateOptions")
    kind = "autoclass" if inspect.isclass(found) else "autofunction"
    lines = [f".. {kind}:: {module}.{name}{'' if takes_arguments else '()'}"]
    if inspect.isclass(found):
        lines += ["   :members:", "   :exclude-members: model_config, model_post_init"]
    return ["```{eval-rst}", *lines, "```", ""]


def modules_page() -> str:
    """Every module with the first sentence of its docstring."""
    root = Path(pvdf_fem.__file__).parent
    lines = ["# Modules", "A scene passes through these folders on its way to charges and touches."]
    lines += ["`CONTRIBUTING.md` says what may import what.", ""]
    for folder in [root, *sorted(path for path in root.rglob("*") if path.is_dir())]:
        modules = sorted(folder.glob("*.py"))
        if not modules:
            continue
        lines += [f"## `{folder.relative_to(root.parent)}/`", ""]
        lines += ["| module | holds |", "| --- | --- |"]
        for module in modules:
            doc = ast.get_docstring(ast.parse(module.read_text("utf-8"))) or ""
            first = " ".join(doc.partition("\n\n")[0].split()).replace("|", r"\|")
            lines += [f"| `{module.name}` | {first} |"] if first else []
        lines += [""]
    return "\n".join(lines)

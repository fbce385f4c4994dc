"""Reference pages of the guide, from the code: scene files, commands, and the public names."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path

import pvdf_fem
from pvdf_fem.cli.main import make_command_parsers, make_parser
from pvdf_fem.report.data import DataSource
from pvdf_fem.report.kind import Kind
from pvdf_fem.report.registry import FIGURES
from pvdf_fem.report.registry import TABLES as REPORT_TABLES
from pvdf_fem.report.script import Other, Script, ScriptSection
from pvdf_fem.scene.keys import Section
from pvdf_fem.scene.scene_file import get_example_text, read_examples
from pvdf_fem.scene.validation.table_forms import TableForm
from reports.guide.scene_keys import clean_docstring, make_key_table, make_scene_page

#: What public names return or take, by headings of the page.
RESULTS: Mapping[str, tuple[str, ...]] = {
    "What results hold": (
        "pvdf_fem.electrodes.point_values.PointValues",
        "pvdf_fem.problem.contact_result.ContactResult",
        "pvdf_fem.film.loads.punch.PunchTilt",
        "pvdf_fem.solver.nonlinear.status.Status",
        "pvdf_fem.solver.history.MeshRecord",
        "pvdf_fem.solver.sensitivity.gradients.Gradients",
        "pvdf_fem.solver.sensitivity.uncertainty.Uncertainty",
        "pvdf_fem.dynamics.modes.Modes",
        "pvdf_fem.dynamics.frequency_response.FrequencyResponse",
        "pvdf_fem.dynamics.transient.Transient",
        "pvdf_fem.inverse.calibration.calibration.Calibration",
        "pvdf_fem.inverse.touch.location.Location",
        "pvdf_fem.inverse.touch.touch.Touch",
        "pvdf_fem.inverse.touch.touches.Touches",
        "pvdf_fem.inverse.tracking.results.TrackRow",
        "pvdf_fem.report.report.MadeReport",
        "pvdf_fem.report.kind.Content",
    ),
    "What they take": (
        "pvdf_fem.surrogate.response_options.ResponseOptions",
        "pvdf_fem.surrogate.touch_domain.Domain",
        "pvdf_fem.inverse.touch.search.LocateOptions",
        "pvdf_fem.batch.store.Store",
        "pvdf_fem.report.kind.Kind",
        "pvdf_fem.report.task.Task",
        "pvdf_fem.electrodes.channel.Channel",
    ),
}


#: Members of public classes that only other modules of the package and pydantic use.
INTERNAL = (
    "discrete",
    "film_data",
    "find_unused_load_keys",
    "is_fast",
    "loaded",
    "loaded_probes",
    "model_config",
    "model_post_init",
    "plan",
    "problem",
    "quantities",
    "require_no_tips",
    "require_plain_charges",
    "single_probe",
    "stress_modes",
    "summary",
    "table",
    "tips",
    "unloaded_integrals",
    "validation",
    "warm_probes",
    "with_loaded_probes",
    "with_measured_error",
)


def write_references(folder: Path) -> None:
    """Write all pages to a folder; a page that has not changed keeps its time."""
    folder.mkdir(exist_ok=True)
    pages = {"scene": make_scene_page(), "report": report_page(), "commands": commands_page()}
    pages |= {"api": api_page()}
    for name, text in (pages | {"modules": modules_page()}).items():
        path = folder / f"{name}.md"
        if not path.exists() or path.read_text("utf-8") != text:
            path.write_text(text, "utf-8")


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
            lines += [clean_docstring(model.__doc__), "", *make_key_table(TableForm(model), keys)]
    lines += [
        "",
        "## A script",
        "",
        "```toml",
        get_example_text("report", read_examples()).rstrip(),
        "```",
    ]
    return "\n".join(lines) + "\n"


def _alone(model: type[Section]) -> list[str]:
    """A model's docstring, and a table of its keys."""
    return [
        clean_docstring(model.__doc__),
        "",
        *make_key_table(TableForm(model), model.model_fields),
    ]


def commands_page() -> str:
    """The help of the command and of its commands."""
    lines = ["# Commands", "This is what `--help` prints.", "", "## `pvdf-fem`", ""]
    lines += ["```text", make_parser().format_help().rstrip(), "```"]
    for name, command in make_command_parsers().items():
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
            lines += _documented(f"pvdf_fem.{name}")
    assert not left, f"in no group of the package's docstring: {left}"
    for heading, names in RESULTS.items():
        lines += [f"## {heading}", ""]
        for name in names:
            lines += _documented(name)
    return "\n".join(lines)


def _documented(path: str) -> list[str]:
    """What makes Sphinx show the docstrings of a class or function."""
    module, _, name = path.rpartition(".")
    found = getattr(import_module(module), name)
    # the arguments of models and results are their keys and attributes
    takes_arguments = not inspect.isclass(found) or name in ("Tracker", "LocateOptions")
    kind = "autoclass" if inspect.isclass(found) else "autofunction"
    lines = [f".. {kind}:: {module}.{name}{'' if takes_arguments else '()'}"]
    if inspect.isclass(found):
        lines += ["   :members:", f"   :exclude-members: {', '.join(INTERNAL)}"]
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

"""Reference pages of the guide, generated from the code: scene files, commands, public names."""

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
from pvdf_fem.report.script_keys import Other, Script, ScriptSection
from pvdf_fem.scene.keys import Section
from pvdf_fem.scene.scene_file import get_example_text, read_examples
from pvdf_fem.scene.validation.table_forms import TableForm
from reports.guide.scene_keys import clean_docstring, make_key_table, make_scene_page

#: Classes that public names return or take, by headings of the page.
RESULTS: Mapping[str, tuple[str, ...]] = {
    "Results and their parts": (
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
        "pvdf_fem.studies.decks.write_deck.Deck",
        "pvdf_fem.studies.decks.compare_deck.DeckComparison",
        "pvdf_fem.inverse.touch.location.Location",
        "pvdf_fem.inverse.touch.touch.Touch",
        "pvdf_fem.inverse.touch.touches.Touches",
        "pvdf_fem.inverse.tracking.results.TrackRow",
        "pvdf_fem.report.report.MadeReport",
        "pvdf_fem.scene.materials.catalogue.Materials",
        "pvdf_fem.scene.materials.material.Material",
        "pvdf_fem.scene.materials.material.SourcedValue",
        "pvdf_fem.scene.materials.material.Statement",
        "pvdf_fem.scene.materials.material.Source",
        "pvdf_fem.report.kind.Content",
    ),
    "Options and other arguments": (
        "pvdf_fem.surrogate.response_options.ResponseOptions",
        "pvdf_fem.surrogate.touch_domain.Domain",
        "pvdf_fem.inverse.touch.search.LocateOptions",
        "pvdf_fem.batch.store.Store",
        "pvdf_fem.report.kind.Kind",
        "pvdf_fem.report.task.Task",
        "pvdf_fem.electrodes.channel.Channel",
    ),
}


#: Members of public classes that only the package itself uses, and pydantic's.
INTERNAL = (
    *("model_config", "model_post_init", "table_keys", "summary", "film_data", "plan", "refresh"),
    *("loaded_probes", "single_probe", "tips", "warm_probes", "with_loaded_probes"),
    *("find_unused_load_keys", "require_no_tips", "require_plain_charges", "require_rows"),
    *("discrete", "unloaded_integrals", "quantity_names", "make_empty", "store", "from_state"),
    *("is_fast", "with_measured_error", "stress_modes", "validation"),
    *("unloaded_scene", "unloaded_stress", "unloaded_outputs", "checked_loads", "resolve"),
    *("with_scene",),
)


def write_references(folder: Path) -> None:
    """Write all reference pages to a folder; the file of an unchanged page is not touched."""
    folder.mkdir(exist_ok=True)
    pages = {
        "scene": make_scene_page(),
        "report": make_report_page(),
        "commands": make_commands_page(),
        "api": make_api_page(),
        "modules": make_modules_page(),
    }
    for name, text in pages.items():
        path = folder / f"{name}.md"
        if not path.exists() or path.read_text("utf-8") != text:
            path.write_text(text, "utf-8")


def make_report_page() -> str:
    """Describe the tables of report scripts and every kind of figure and table."""
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
        lines += ["", f"## `{heading}`", "", *_describe_table(model)]
    lines += ["", "## Keys of every figure and table", "", *_describe_table(Kind)]
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


def _describe_table(model: type[Section]) -> list[str]:
    """Return the docstring of a model and a table of its keys."""
    return [
        clean_docstring(model.__doc__),
        "",
        *make_key_table(TableForm(model), model.model_fields),
    ]


def make_commands_page() -> str:
    """Show the help of `pvdf-fem` and of each of its commands."""
    lines = ["# Commands", "Each section shows the output of `--help`.", "", "## `pvdf-fem`", ""]
    lines += ["```text", make_parser().format_help().rstrip(), "```"]
    for name, command in make_command_parsers().items():
        lines += ["", f"## `pvdf-fem {name}`", "", "```text", command.format_help().rstrip(), "```"]
    return "\n".join(lines) + "\n"


def make_api_page() -> str:
    """Document the public names under the headings of the package's docstring, then the results."""
    lines = [
        "# Python interface",
        "",
        "Import public names from `pvdf_fem` itself, and all other classes and functions from the",
        "modules that are written before their names.",
        "",
    ]
    doc = inspect.cleandoc(pvdf_fem.__doc__ or "")
    undocumented = set(pvdf_fem.__all__)
    for heading, text in re.findall(r"^(\w[^\n]*)\n((?:    [^\n]*\n?)+)", doc, re.M):
        names = [
            name for name in dict.fromkeys(re.findall(r"`(\w+)`", text)) if name in undocumented
        ]
        undocumented.difference_update(names)
        lines += [f"## {heading}", "", inspect.cleandoc(text).replace("``", "`"), ""]
        for name in names:
            lines += _make_autodoc_block(f"pvdf_fem.{name}")
    assert not undocumented, f"in no group of the package's docstring: {sorted(undocumented)}"
    for heading, paths in RESULTS.items():
        lines += [f"## {heading}", ""]
        for path in paths:
            lines += _make_autodoc_block(path)
    return "\n".join(lines)


def _make_autodoc_block(path: str) -> list[str]:
    """Return the directive with which Sphinx shows the docstrings of a class or function."""
    module, _, name = path.rpartition(".")
    documented = getattr(import_module(module), name)
    is_class = inspect.isclass(documented)
    # The arguments of models and results are their keys and attributes.
    shows_arguments = not is_class or name in ("Tracker", "LocateOptions")
    directive = "autoclass" if is_class else "autofunction"
    lines = [f".. {directive}:: {module}.{name}{'' if shows_arguments else '()'}"]
    if is_class:
        lines += ["   :members:", f"   :exclude-members: {', '.join(INTERNAL)}"]
    return ["```{eval-rst}", *lines, "```", ""]


def make_modules_page() -> str:
    """List every module with the first sentence of its docstring."""
    root = Path(pvdf_fem.__file__).parent
    lines = [
        "# Modules",
        "A scene passes through these folders on its way to charges and touches.",
        "`CONTRIBUTING.md` says which folder may import which.",
        "",
    ]
    for folder in [root, *sorted(path for path in root.rglob("*") if path.is_dir())]:
        modules = sorted(folder.glob("*.py"))
        if not modules:
            continue
        lines += [f"## `{folder.relative_to(root.parent)}/`", ""]
        lines += ["| module | content |", "| --- | --- |"]
        for module in modules:
            doc = ast.get_docstring(ast.parse(module.read_text("utf-8"))) or ""
            first = " ".join(doc.partition("\n\n")[0].split()).replace("|", r"\|")
            lines += [f"| `{module.name}` | {first} |"] if first else []
        lines += [""]
    return "\n".join(lines)

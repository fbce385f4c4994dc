"""How the house is built: who imports whom, how large a folder is, and which names lead in."""

from __future__ import annotations

import graphlib
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

import pvdf_fem

ROOT = Path(__file__).parents[1]
# A folder, together with the folders in it, imports from itself and from the folders before it.
# `pvdf_fem.root` stands for files and arrays, `pvdf_fem.door` for `__init__` and `__main__`, which
# lead into all folders.
ORDER = """
root readings scene mesh film problem electrodes view solver dynamics batch surrogate inverse
studies report explore cli door
"""
ORDER_OF_REPORTS = "reference accuracy thesis locating tracking design stability gallery guide"
LIBRARY = [f"pvdf_fem.{name}" for name in ORDER.split()]
REPORTS = [*LIBRARY, *(f"reports.{name}" for name in ORDER_OF_REPORTS.split()), "reports"]
# `reports.reference` checks the rest, so it shares none of its code.
MAY_IMPORT = {folder: set(REPORTS[: i + 1]) for i, folder in enumerate(REPORTS)}
MAY_IMPORT["reports.reference"] = {"reports.reference", "pvdf_fem.root"}

MOST_MODULES = {"pvdf_fem": 12, "reports": 15, "tests": 15}


def name_of(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {
    name_of(path): path for top in ("pvdf_fem", "reports") for path in ROOT.glob(f"{top}/**/*.py")
}


def folder_of(module: str) -> str:
    """The folder of the tables above that a module belongs to."""
    parts = module.split(".")
    if module in ("pvdf_fem", "pvdf_fem.__main__"):
        return "pvdf_fem.door"
    is_folder = MODULES[module].name == "__init__.py"
    if len(parts) > 2 or (len(parts) == 2 and is_folder):
        return ".".join(parts[:2])
    return "pvdf_fem.root" if parts[0] == "pvdf_fem" else "reports"


def module_named(name: str) -> str:
    """The module that has a dotted name, or the one that an attribute of this name stands in."""
    while name not in MODULES:
        name = name.rpartition(".")[0]
    return name


#: An import of ours: a module or folder, and names from it, in brackets or not.
IMPORT = re.compile(
    r"^ *(?:from|import) ((?:pvdf_fem|reports)\b[\w.]*)(?: import (?:\(([^)]*)\)|(.*)))?", re.M
)


def imports_of(module: str) -> Iterator[tuple[str, str]]:
    """The module with each module of ours that it imports."""
    for place, *names in IMPORT.findall(MODULES[module].read_text(encoding="utf-8")):
        for name in "".join(names).split(","):
            imported = f"{place}.{name.strip().split(' as ')[0]}"
            if imported != "pvdf_fem.__version__":  # it stands in the door
                yield module, module_named(imported)


IMPORTS = sorted({found for module in MODULES for found in imports_of(module)})


def test_modules_and_imports_are_found():
    assert len(MODULES) > 150
    assert len(IMPORTS) > 500


def test_nothing_imports_upwards():
    upward = {
        f"{importer} -> {imported}"
        for importer, imported in IMPORTS
        if folder_of(imported) not in MAY_IMPORT[folder_of(importer)]
    }
    assert not upward, "\n".join(sorted(upward))


def test_imports_make_no_circle():
    graph: dict[str, set[str]] = {}
    for importer, imported in IMPORTS:
        # `pvdf_fem/__init__.py` runs before every module and imports public names when asked for
        if "pvdf_fem" not in (importer, imported):
            graph.setdefault(importer, set()).add(imported)
    graphlib.TopologicalSorter(graph).prepare()


@pytest.mark.parametrize("top", MOST_MODULES)
def test_folders_are_small(top):
    modules = (path for path in ROOT.glob(f"{top}/**/*.py") if path.name != "__init__.py")
    counts = Counter(str(path.parent.relative_to(ROOT)) for path in modules)
    assert not {folder: count for folder, count in counts.items() if count > MOST_MODULES[top]}


def test_one_module_meshes_with_gmsh_and_a_script_reads_with_it():
    line = re.compile(r"^\s*(import|from) gmsh\b", re.MULTILINE)
    importers = {name for name, path in MODULES.items() if line.search(path.read_text("utf-8"))}
    assert importers == {"pvdf_fem.mesh.gmsh_mesh", "pvdf_fem.mesh.files.library_script"}


def test_public_names_are_documented_early_and_functions_whatever_was_imported_before():
    names = pvdf_fem.__all__
    modules = sorted({f"pvdf_fem.{module}" for module in pvdf_fem._MODULES.values()})
    script = (
        "import inspect\n"
        "import pvdf_fem\n"
        "print(*dir(pvdf_fem))\n"
        "print(pvdf_fem.__doc__, 'PUBLIC')\n"
        f"import {', '.join(modules)}, pvdf_fem.cli.inverse.locate, pvdf_fem.cli.studies.sweep\n"
        f"from pvdf_fem import {', '.join(names)}\n"
        f"for public in ({', '.join(names)}):\n"
        "    assert public.__module__.startswith('pvdf_fem.'), public\n"
        "    kind = 'class' if inspect.isclass(public) else type(public).__name__\n"
        "    print(kind, public.__name__)\n"
    )
    command = [sys.executable, "-W", "error", "-c", script]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert (result.returncode, result.stderr) == (0, "")
    early, _, late = result.stdout.rpartition("PUBLIC\n")
    listed, text = early.split("\n", 1)
    assert set(names) <= set(listed.split())
    assert set(names) <= set(re.findall(r"`(\w+)`", text))
    expected = [f"{'class' if name[0].isupper() else 'function'} {name}" for name in names]
    assert late.splitlines() == expected


#: A longer module has two nouns.
MOST_LINES_OF_A_MODULE = 450


def test_modules_are_read_in_one_go():
    paths = ROOT.glob("pvdf_fem/**/*.py")
    lines = {str(path): path.read_text(encoding="utf-8").count("\n") for path in paths}
    assert not {name for name, count in lines.items() if count > MOST_LINES_OF_A_MODULE}

"""The project's texts are complete and agree with the code."""

from __future__ import annotations

import itertools
import re
from importlib import import_module
from pathlib import Path

import pytest

import pvdf_fem
from pvdf_fem import Scene, solve
from pvdf_fem.cli.main import make_command_parsers
from pvdf_fem.report.registry import FIGURES, TABLES
from pvdf_fem.scene.validation.table_forms import TABLES as SCENE_TABLES
from pvdf_fem.scene.validation.table_forms import list_forms
from reports.gallery import pictures
from reports.guide import references, scene_keys

ROOT = Path(__file__).parents[1]


def test_scene_page_documents_every_key_without_python_types():
    page = scene_keys.make_scene_page()
    forms = [form for table in SCENE_TABLES.values() for form in list_forms(table)]
    forms += itertools.chain(*scene_keys.TABLES.values())
    keys = {f"`{key}`" for form in forms for key in form.fields if key != "shape"}
    assert not {key for key in keys if key not in page}
    tables = [line for line in page.splitlines() if line.startswith("| `")]
    assert not [line for line in tables if re.search(r"<|typing|Annotated|None|\| \|$", line)]
    assert "| `thickness_um` | `25.0` | 0.001 to 100000 µm | Thickness. |" in tables


def test_example_with_every_key_is_generated_from_the_code():
    """``python -m reports.guide.scene_keys`` writes it."""
    assert scene_keys.EXAMPLE.read_text("utf-8") == scene_keys.make_commented_scene()


def test_report_page_documents_every_kind_and_key():
    page = references.make_report_page()
    for name, kind in {**FIGURES, **TABLES}.items():
        assert f'kind = "{name}"`' in page
        assert not [key for key in kind.model_fields if f"`{key}`" not in page]


def test_every_command_and_public_name_is_documented():
    commands = references.make_commands_page()
    names = list(make_command_parsers())
    assert len(names) > 10
    assert not [name for name in names if f"usage: pvdf-fem {name} " not in commands]
    api = references.make_api_page()
    assert not [name for name in pvdf_fem.__all__ if f":: pvdf_fem.{name}" not in api]


def test_members_hidden_from_the_api_page_exist():
    paths = [f"pvdf_fem.{name}" for name in pvdf_fem.__all__]
    paths += itertools.chain(*references.RESULTS.values())
    members: set[str] = set()
    for path in paths:
        module, _, name = path.rpartition(".")
        documented = getattr(import_module(module), name)
        members.update(dir(documented), getattr(documented, "__annotations__", ()))
    assert not set(references.INTERNAL) - members


STALE = "README's pictures or sample are stale: run python -m reports.gallery, and look at them"


@pytest.mark.parametrize("name", ["deflection", pytest.param("rotation", marks=pytest.mark.slow)])
def test_picture_shows_current_charges(name):
    """Its first solve is repeated; those of the thesis's scenes take long."""
    shown = pictures.read_content(pictures.Path(pictures.__file__).with_name(f"{name}.png"))
    expected = Scene.example("triangle")
    if name == "rotation":
        expected = pictures.plan_rotation()[1].scenes[0]
    assert Scene.parse(shown["scenes"][0]) == expected, STALE
    assert solve(expected).charges_pC == pytest.approx(shown["charges_pC"][0], rel=1e-6), STALE


def test_readme_shows_current_sample_output():
    """All lines except the times, which differ between machines."""
    [written] = pictures.SAMPLE.findall(pictures.README.read_text("utf-8"))
    printed = pictures.make_sample()
    assert drop_times(written) == drop_times(printed), STALE


def drop_times(text: str) -> list[str]:
    """Return the lines of a printed solution without the rows of the table of meshes."""
    return [line for line in text.splitlines() if not line[:1].isdigit()]


def test_version_is_the_same_everywhere():
    citation = ROOT.joinpath("CITATION.cff").read_text("utf-8")
    [cited] = re.findall(r"^version: (\S+)$", citation, re.MULTILINE)
    assert cited == pvdf_fem.__version__
    latest = re.search(r"^## (\S+)", ROOT.joinpath("CHANGELOG.md").read_text("utf-8"), re.MULTILINE)
    assert latest is not None
    assert latest[1] == pvdf_fem.__version__


#: A path in backticks: it ends like a source file, or names a folder.
PATH = re.compile(
    r"`((?:[\w-]+/)*[\w-]+\.(?:py|cff|mplstyle)|(?:[\w-]+/)+(?:[\w-]+\.(?:toml|csv|md))?)`"
)
#: Link to a file of the checkout in Markdown.
LINK = re.compile(r"\]\((?!https?:|#)([^)#]+)")
#: Folders that paths in texts start from.
STARTS = ("", "pvdf_fem", "reports/guide", "reports")
#: Files and folders that commands and cells of the guide write.
WRITTEN = ("reports/out/", "reports/guide/generated/", "data/", "figures/", "scenes/")
TEXTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(ROOT.glob("reports/guide/*.md"))]


@pytest.mark.parametrize("text", TEXTS, ids=lambda path: path.stem)
def test_paths_in_texts_exist(text):
    content = text.read_text("utf-8")
    written = {*WRITTEN, *re.findall(r"^%%writefile (\S+)", content, re.MULTILINE)}
    named = set(PATH.findall(content)) - written
    missing = {path for path in named if not any(ROOT.joinpath(s, path).exists() for s in STARTS)}
    linked = {link for link in LINK.findall(content) if not link.startswith("generated/")}
    missing |= {link for link in linked if not text.parent.joinpath(link).exists()}
    assert not missing


def find_words(text: str) -> set[str]:
    """Return the identifiers of at least four characters in a text."""
    return {word for word in re.findall(r"[A-Za-z]\w{3,}", text) if not word.endswith("_")}


@pytest.fixture(scope="module")
def words_of_sources():
    """All identifiers in the Python files of the checkout, and the names of these files."""
    words: set[str] = set()
    for folder in ("pvdf_fem", "reports", "tests"):
        for path in ROOT.glob(f"{folder}/**/*.py"):
            words |= {path.stem, *find_words(path.read_text("utf-8"))}
    return words


CODE_BLOCK = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("text", TEXTS, ids=lambda path: path.stem)
def test_names_in_texts_exist(text, words_of_sources):
    content = text.read_text("utf-8")
    code = "\n".join(CODE_BLOCK.findall(content))
    names = find_words(" ".join(re.findall(r"`([^`]+)`", CODE_BLOCK.sub("", content))))
    assert not names - words_of_sources - find_words(code)


def test_new_names_in_the_change_log_exist(words_of_sources):
    rows = re.findall(
        r"^\| (.+) \| (.+) \|$", ROOT.joinpath("CHANGELOG.md").read_text("utf-8"), re.MULTILINE
    )
    assert len(rows) > 20
    names = find_words(
        " ".join(itertools.chain(*(re.findall(r"`([^`]+)`", new) for _, new in rows)))
    )
    assert not names - words_of_sources


#: A row of CONTRIBUTING's table of folders.
FOLDER_ROW = re.compile(r"^\| `(\w+)/` \| [^|]+ \| `\1/[^|]+ \|$", re.MULTILINE)


def test_contributing_names_every_folder_of_the_package():
    named = FOLDER_ROW.findall(ROOT.joinpath("CONTRIBUTING.md").read_text("utf-8"))
    folders = {path.parent.name for path in ROOT.glob("pvdf_fem/*/__init__.py")}
    assert sorted(named) == sorted(folders)

"""The guide's reference pages have everything, and README shows what the package computes now."""

from __future__ import annotations

import itertools
import re
from pydoc import locate as locate_object

import pytest

import pvdf_fem
from pvdf_fem import Scene, solve
from pvdf_fem.cli.main import make_command_parsers
from pvdf_fem.report.registry import FIGURES, TABLES
from pvdf_fem.scene.validation.table_forms import TABLES as SCENE_TABLES
from pvdf_fem.scene.validation.table_forms import list_forms
from reports.gallery import pictures
from reports.guide import references, scene_keys


def test_scene_files_are_told_with_every_key_and_no_python():
    page = scene_keys.make_scene_page()
    forms = [form for table in SCENE_TABLES.values() for form in list_forms(table)]
    forms += itertools.chain(*scene_keys.TABLES.values())
    keys = {f"`{key}`" for form in forms for key in form.fields if key != "shape"}
    assert not {key for key in keys if key not in page}
    tables = [line for line in page.splitlines() if line.startswith("| `")]
    assert not [line for line in tables if re.search(r"<|typing|Annotated|None|\| \|$", line)]
    assert "| `thickness_um` | `25.0` | 0.001 to 100000 µm | Thickness. |" in tables


def test_the_example_with_every_key_is_written_from_the_code():
    """``python -m reports.guide.scene_keys`` writes it."""
    assert scene_keys.EXAMPLE.read_text("utf-8") == scene_keys.make_commented_scene()


def test_report_scripts_are_told_with_every_kind_and_key():
    page, kinds = references.report_page(), {**FIGURES, **TABLES}
    for name, kind in kinds.items():
        assert f'kind = "{name}"`' in page
        assert not [key for key in kind.model_fields if f"`{key}`" not in page]


def test_every_command_and_public_name_is_told():
    commands = references.commands_page()
    names = [*make_command_parsers()]
    assert len(names) > 10
    assert [name for name in names if f"usage: pvdf-fem {name} " not in commands] == []
    api = references.api_page()
    assert not [name for name in pvdf_fem.__all__ if f":: pvdf_fem.{name}" not in api]


def test_internal_members_exist():
    """Members that the guide does not show are those of classes that it shows."""
    public = [getattr(pvdf_fem, name) for name in pvdf_fem.__all__]
    paths = [path for group in references.RESULTS.values() for path in group]
    shown = [*public, *(locate_object(path) for path in paths)]
    members = {member for documented in shown for member in dir(documented)}
    fields = {f for c in shown for f in getattr(c, "__dataclass_fields__", ())}
    assert set(references.INTERNAL) - members - fields == set()


STALE = "README's pictures or sample are stale: run python -m reports.gallery, and look at them"


@pytest.mark.parametrize("name", ["deflection", pytest.param("rotation", marks=pytest.mark.slow)])
def test_a_picture_is_of_today_s_charges(name):
    """Its first solve is repeated; those of the thesis's scenes take long."""
    shown = pictures.read_content(pictures.Path(pictures.__file__).with_name(f"{name}.png"))
    expected = (
        Scene.example("triangle") if name == "deflection" else pictures.plan_rotation()[1].scenes[0]
    )
    assert Scene.parse(shown["scenes"][0]) == expected, STALE
    assert solve(expected).charges_pC == pytest.approx(shown["charges_pC"][0], rel=1e-6), STALE


def test_readme_s_sample_output_is_printed_now():
    """All but the times, which every machine has of its own."""
    [written] = pictures.SAMPLE.findall(pictures.README.read_text("utf-8"))
    told, now = (
        [x for x in t.splitlines() if not x[:1].isdigit()]
        for t in (written, pictures.make_sample())
    )
    assert told == now, STALE

"""The guide's reference pages have everything."""

from __future__ import annotations

import itertools
import re

import pvdf_fem
from pvdf_fem.reporting.registry import FIGURES, TABLES
from pvdf_fem.scene.shapes import MODELS
from reports.guide import references, scene_keys


def test_scene_files_are_told_with_every_key_and_no_python():
    page = scene_keys.scene_page()
    models = {*itertools.chain(*scene_keys.TABLES.values()), *MODELS.values()}
    keys = {f"`{key}`" for model in models for key in model.model_fields if key != "shape"}
    assert not {key for key in keys if key not in page}
    tables = [line for line in page.splitlines() if line.startswith("| `")]
    assert not [line for line in tables if re.search(r"<|typing|Annotated|None|\| \|$", line)]
    assert "| `thickness_um` | `25.0` | 0.001 to 100000 µm | Thickness. |" in tables


def test_the_example_with_every_key_is_written_from_the_code():
    """``python -m reports.guide.scene_keys`` writes it."""
    assert scene_keys.EXAMPLE.read_text("utf-8") == scene_keys.commented_scene()


def test_report_scripts_are_told_with_every_kind_and_key():
    page, kinds = references.report_page(), {**FIGURES, **TABLES}
    for name, kind in kinds.items():
        assert f'kind = "{name}"`' in page
        assert not [key for key in kind.model_fields if f"`{key}`" not in page]


def test_every_command_and_public_name_is_told():
    commands = references.commands_page()
    for name in ("example", "solve", "sweep", "report", "calibrate", "locate", "track"):
        assert f"usage: pvdf-fem {name}" in commands
    api = references.api_page()
    assert not [name for name in pvdf_fem.__all__ if f":: pvdf_fem.{name}" not in api]

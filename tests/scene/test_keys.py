"""Keys of a scene: all is said of each, and its range is kept."""

from __future__ import annotations

import re
from typing import Annotated, Literal

import pytest
from pydantic import ValidationError

from pvdf_fem import Scene
from pvdf_fem.scene.quantity import Affects, Key, Section, in_words
from pvdf_fem.scene.shapes import MODELS
from reports.guide.scene_keys import TABLES, meaning
from tests.helpers.refusals import refused

MODELS_OF_SCENES = {Scene, *MODELS.values(), *(m for models in TABLES.values() for m in models)}


def test_each_key_says_its_meaning_unit_and_range():
    for model in MODELS_OF_SCENES:
        for name, field in model.model_fields.items():
            key = model.key_of(name)
            assert meaning(model, name), (model, name)
            is_number = re.search(r"\b(float|int)\b", str(field.annotation))
            assert not is_number or key.within, (model, name)
            assert in_words(name)[1] in ("", key.unit), (model, name)
            assert field.default is not None or key.example is not None or not is_number


class Tile(Section):
    """A table with keys of all sorts."""

    kind: Literal["thin", "thick"] = "thin"
    width_mm: Annotated[float, Key("mm", (0.1, 1e3), usual=(1.0, 50.0), mistaken={"m": 1e3})] = 2.0
    sides_mm: Annotated[tuple[float, ...] | None, Key("mm", (0.1, 1e3))] = None
    count: Annotated[int, Key("tiles", (1, 9), Affects.READING)] = 3
    glued: Annotated[bool, Key(needs=("kind", "thick"))] = False
    glue: Annotated[str, Key(needs=("glued", None), idle="none")] = "none"


@pytest.mark.parametrize(
    ("table", "where"),
    [
        ({"width_mm": 0.05}, "width_mm"),
        ({"width_mm": "2"}, "width_mm"),
        ({"width_mm": float("nan")}, "width_mm"),
        ({"width_mm": True}, "width_mm"),
        ({"sides_mm": [1.0, 2e3]}, "sides_mm.1"),
        ({"count": 10}, "count"),
        ({"count": 2.0}, "count"),
        ({"glued": 1}, "glued"),
        ({"glued": True}, "glued"),
        ({"kind": "thin", "glued": True}, "glued"),
    ],
)
def test_a_value_that_a_key_does_not_take_is_refused_where_it_stands(table, where):
    with pytest.raises(ValidationError) as caught:
        Tile(**table)
    assert [".".join(map(str, found["loc"])) for found in caught.value.errors()] == [where]


@pytest.mark.parametrize(
    "table",
    [
        {"width_mm": 0.1, "count": 9, "sides_mm": [0.1, 1e3]},
        {"sides_mm": None},
        {"kind": "thin", "glued": False},
        {"kind": "thick", "glued": True, "glue": "epoxy"},
    ],
)
def test_the_ends_of_a_range_and_idle_values_are_taken(table):
    found = Tile(**table).model_dump(mode="json")
    assert {key: found[key] for key in table} == table


def test_a_number_in_another_unit_is_doubted_or_refused():
    width = Tile.key_of("width_mm")
    assert width.meant(0.02)
    # 500 mm is as unusual, and 20 mm is usual
    assert [width.meant(0.5), width.meant(20.0), Tile.key_of("count").meant(20.0)] == [""] * 3
    told = refused(Scene().with_, {"film.youngs_modulus_GPa": [2e9, 3.0]})
    assert told == ["film.youngs_modulus_GPa[0] = 2000000000.0"]

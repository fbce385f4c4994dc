"""README's pictures show what the package computes now."""

from __future__ import annotations

import pytest

from pvdf_fem import Scene, solve
from reports.gallery import pictures

STALE = "README's pictures or sample are stale: run python -m reports.gallery, and look at them"


@pytest.mark.parametrize("name", ["deflection", pytest.param("rotation", marks=pytest.mark.slow)])
def test_a_picture_is_of_today_s_charges(name):
    """Its first solve is repeated; those of the thesis's scenes take long."""
    shown = pictures.read(pictures.Path(pictures.__file__).with_name(f"{name}.png"))
    expected = Scene.example("triangle") if name == "deflection" else pictures.turned()[1].scenes[0]
    assert Scene.parse(shown["scenes"][0]) == expected, STALE
    assert solve(expected).charges_pC == pytest.approx(shown["charges_pC"][0], rel=1e-6), STALE


def test_readme_s_sample_output_is_printed_now():
    """All but the times, which every machine has of its own."""
    [written] = pictures.SAMPLE.findall(pictures.README.read_text("utf-8"))
    told, now = (
        [x for x in t.splitlines() if not x[:1].isdigit()] for t in (written, pictures.sample())
    )
    assert told == now, STALE

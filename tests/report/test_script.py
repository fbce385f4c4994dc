"""Report scripts: what is refused, by key, before anything is solved."""

from __future__ import annotations

import contextlib
import io
import math
import re
from collections.abc import Iterator
from functools import reduce
from operator import getitem
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pvdf_fem import Report, SceneError
from pvdf_fem.batch import batch as sweep
from pvdf_fem.cli.main import main
from tests.helpers.damage import damages, drawn
from tests.helpers.report_scripts import TOUCHES, script, text_of


@pytest.fixture(autouse=True)
def no_solves(monkeypatch):
    monkeypatch.setattr(sweep, "make_records", lambda *_: pytest.fail("a scene was solved"))


def load(folder, table: dict[str, Any]) -> Report:
    path = folder / "report.toml"
    path.write_text(text_of(table), encoding="utf-8")
    return Report.load(path)


def problems(folder, table: dict[str, Any]) -> tuple[str, ...]:
    with pytest.raises(SceneError) as refused:
        load(folder, table)
    return refused.value.problems


def changed(path: str, value: Any) -> dict[str, Any]:
    """The script with a value, by a path of names and numbers, or without it for None."""
    table = node = script()
    *steps, last = [int(s) if s.isdigit() else s for s in path.split("/")]
    for step in steps:
        node = node[step]
    if value is None:
        del node[last]
    else:
        node[last] = value
    return table


def test_the_first_screen_has_summary_items_then_one_of_each_kind(tmp_path):
    names = [item.name for item in load(tmp_path, script()).plan.summary]
    assert names == ["charge-vs-distance", "isocharge", "charges"]
    table = changed("section/1/table/1/summary", True)
    names = [item.name for item in load(tmp_path, table).plan.summary]
    assert names == ["positions", "charge-vs-distance", "isocharge"]


FIGURE = "section/0/figure"
TABLE = "section/1/table"


@pytest.mark.parametrize(
    ("path", "value", "key"),
    [
        ("title", None, "title"),
        ("section", [], "section"),
        ("scene", None, "scene"),
        ("scene", "no_such.toml", "scene"),
        ("example", "triangle", "scene"),
        ("scene/uncertain", {"film.radius_mm": 1.0}, "scene: uncertain.film.radius_mm"),
        ("section/0/text", "word " * 121, "section[0].text"),
        (f"{FIGURE}/0/kind", "comparison", "section[0].figure[0].kind"),
        (f"{FIGURE}/0/electrodes", ["A", "Z"], "section[0].figure[0].electrodes"),
        (f"{FIGURE}/0/electrodes", ["A", "A"], "section[0].figure[0].electrodes"),
        (f"{FIGURE}/0/step_mm", 1e-5, "section[0].figure[0].step_mm"),
        (f"{FIGURE}/1/pitch_mm", 1e-5, "section[0].figure[1].pitch_mm"),
        (f"{FIGURE}/2/values/start", 0.0, "section[0].figure[2].values"),
        (f"{FIGURE}/2/values/count", 9000, "section[0].figure[2].values"),
        (f"{FIGURE}/0/reach_mm", 19.0, "section[0].figure[0].reach_mm"),
        (f"{FIGURE}/0/data", "touchs", "section[0].figure[0].data"),
        (f"{FIGURE}/2/data", "touches", "section[0].figure[2].data"),  # none is on a curve
        (f"{FIGURE}/0/set", {"film.d31": 1.0}, "section[0].figure[0].set: film.d31"),
        (f"{FIGURE}/0/variants/0/titel", "x", "section[0].figure[0].variants[0].titel"),
        (f"{FIGURE}/1/levels_pC", [500, "x"], "section[0].figure[1].levels_pC[1]"),
        (f"{FIGURE}/2/values", {"start": 1.0, "stop": 2.0}, "section[0].figure[2].values.count"),
        (f"{FIGURE}/2/x", "film.d31", "section[0].figure[2].x, values, family: film.d31"),
        (f"{FIGURE}/2/full", {"name": "other"}, "section[0].figure[2].full.name"),
        (f"{FIGURE}/2/family", {"film.thickness_um": []}, "section[0].figure[2].family"),
        (f"{FIGURE}/3/set", {"probe": {"x_mm": 19.0}}, "section[0].figure[3].set: probe"),
        (f"{FIGURE}/3/name", "charges", "section[1].table[0].name"),
        (f"{TABLE}/0/data", None, "section[1].table[0].data"),
        (f"{TABLE}/1/sigma", 0.0, "section[1].table[1].sigma"),
        ("data/touches/table", None, "data.touches.file"),
        ("data/touches/file", "touches.csv", "data.touches.file"),
        ("data/touches/unit", "V", "data.touches.unit"),  # without channels
        ("data/touches/labels", [], 'data.touches.columns = "case"'),
        ("data/touches/where", {"case": "ten"}, "data.touches"),
        ("data/touches/table", "case, A\n1, x\n", "data.touches: row 1, column A"),
        ("data/touches/table", f"case, A\n1, {10**400}\n", "data.touches: row 1, column A"),
        ("data/touches/table", "case, A, A\n1, 100, 90\n", "data.touches.file"),
        ("data/touches/table", "case, x_mm, A\n1, 19, 5\n", "data.touches, row 1: probe"),
        ("data/touches/table", "case, film.thick, A\n1, 9, 5\n", "data.touches, row 1: film.thick"),
    ],
)
def test_a_mistake_is_reported_with_its_key(path, value, key, tmp_path):
    found = problems(tmp_path, changed(path, value))
    assert any(told.startswith(key) or f".{key}" in told for told in found)


def test_mistakes_of_all_tables_are_reported_together(tmp_path):
    table = changed("titel", "x")
    table["scene"]["film"]["radius_mm"] = "wide"
    table["section"][0]["figure"][1]["reach"] = 8.0
    told = {line.partition(" = ")[0] for line in problems(tmp_path, table)}
    assert told == {"titel", "scene: film.radius_mm", "section[0].figure[1].reach"}


NUMBERS = [0, 0.5, -1, 1e9, -1e300, 1e-300, math.inf, -math.inf, math.nan, 10**40]
OTHERS = ["", "x", "A", "\n", True, [], [[]], {}, [1, "a"], {"x": 1}, [{}], "touches"]
VALUES = st.sampled_from([*NUMBERS, *OTHERS])
#: Where a mistake is told: a key of the script, or one of its files.
TOLD = re.compile(
    r"(title|text|scene|example|data|section|other|[^ ]*report\.toml|[^ ]*touches\.csv)\b"
)


def small() -> dict[str, Any]:
    """A script of every kind, with few scenes and its data in a file."""
    table = script()
    table["data"]["touches"] = {"file": "touches.csv", "labels": ["case"], "unit": "pC"}
    table["section"][0]["figure"][1] |= {"pitch_mm": 8.0, "full": {"pitch_mm": 4.0}}
    table["section"][1]["table"][1]["pitch_mm"] = 8.0
    table["other"] = [{"title": "Another", "page": "other/index.html", "how": "by hand"}]
    return table


def paths(node: Any) -> Iterator[tuple[Any, ...]]:
    """Of all tables, lists and values."""
    for key, value in node.items() if isinstance(node, dict) else enumerate(node):
        yield (key,)
        if isinstance(value, dict | list):
            yield from ((key, *path) for path in paths(value))


def damage(draw: Any, table: dict[str, Any]) -> bool:
    """Drop, change, add or rename an entry; whether the change is surely a mistake."""
    *steps, last = draw(st.sampled_from(list(paths(table))))
    node: Any = reduce(getitem, steps, table)
    how = draw(st.sampled_from(["drop", "change", "add", "rename"]))
    if how == "drop":
        del node[last]
    elif how == "change" or isinstance(node, list):
        node[last] = draw(VALUES)
    elif how == "add":
        node[draw(st.sampled_from(["kind", "x", "data", "full", "set", "name"]))] = draw(VALUES)
    else:
        node[draw(st.sampled_from(["{}x", "_{}", "{} ", "{}\n"])).format(last)] = node.pop(last)
        return True
    return False


@drawn(0.2)
@given(data=st.data())
def test_a_damaged_script_is_refused_by_key_before_any_solve(data, tmp_path_factory):
    """The command ends with 2 and names a key or a file, or comes to the first solve of a script
    that is sound in spite of the damage."""
    table, solves, touches = small(), [], TOUCHES.strip().encode()

    def solve(*task):
        solves.append(task)
        raise KeyboardInterrupt

    is_certain = damage(data.draw, table)
    folder = tmp_path_factory.mktemp("damaged", numbered=True)
    folder.joinpath("report.toml").write_text(text_of(table), encoding="utf-8")
    folder.joinpath("touches.csv").write_bytes(data.draw(st.just(touches) | damages(touches)))
    out, told = folder / "out", io.StringIO()
    command = ["report", str(folder / "report.toml"), "--out", str(out), "--processes", "1"]
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stderr(told):
        patch.setattr(sweep, "make_records", solve)
        code = main(command)
    lines = told.getvalue().splitlines()
    assert not any("Traceback" in line for line in lines), told.getvalue()
    if code == 2:
        assert lines
        assert not solves
        assert not out.exists()
        assert all(TOLD.search(line) for line in lines), lines
    else:
        assert (code, len(solves)) == (130, 1)
        assert not is_certain

"""Reports end to end: pages, files, exit codes, and what survives an interruption."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd
import pytest

from pvdf_fem import Report, Scene, SceneError, solve, uncertainty
from pvdf_fem.cli.main import main
from pvdf_fem.reporting.drawing import spread
from pvdf_fem.reporting.kind import Kind
from pvdf_fem.reporting.page import LONG_TABLE
from pvdf_fem.reporting.registry import kinds_of
from pvdf_fem.reporting.solved import NothingToShow
from tests.helpers.browsers import browser_or_skip, faults_of
from tests.helpers.report_scripts import only, script, text_of

NAMES = ("charge-vs-distance", "isocharge", "curve", "sensor", "charges", "positions")


def write(folder: Path, table) -> Path:
    path = folder / "report.toml"
    path.write_text(text_of(table), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A report with figures and tables of every kind."""
    folder = tmp_path_factory.mktemp("report")
    report = Report.load(write(folder, script()))
    found = report.make(folder / "out", processes=1)
    assert found.complete
    assert found.page == folder / "out" / "index.html"
    return folder / "out"


@pytest.fixture(scope="module")
def scene(made):
    return Scene.load(made / "scenes" / "scene.toml")


def test_page_has_all_figures_and_needs_nothing_else(made):
    page = made.joinpath("index.html").read_text(encoding="utf-8")
    assert all(page.count(f'<svg id="svg-{name}"') == 1 for name in NAMES)
    assert page.count('<use href="#svg-') == 3
    identifiers = re.findall(r'\bid="([^"]+)"', page)
    assert len(set(identifiers)) == len(identifiers)
    assert set(re.findall(r'href="#([^"]+)"', page)) <= set(identifiers)
    assert not re.search(r"<script|<link|src=|https?://(?!www\.w3\.org)", page)
    linked = {link for link in re.findall(r'href="([^"#]+)"', page)}
    assert linked == {f"data/{name}.csv" for name in NAMES}
    assert all(made.joinpath(link).is_file() for link in linked)
    assert {path.stem for path in made.glob("figures/*.svg")} == set(NAMES)


def test_charges_of_the_figures_are_those_of_fresh_solves(made, scene):
    lines = pd.read_csv(made / "data" / "charge-vs-distance.csv")
    curve = pd.read_csv(made / "data" / "curve.csv")
    charges = pd.read_csv(made / "data" / "charges.csv")
    last = curve[curve.electrode == "B"].iloc[-1]
    forced = {"film.thickness_um": 50.0, "load.force_N": last.x}
    cases = [
        (lines[lines.curve == "180°"].iloc[3], {"film.thickness_um": 25.0}),
        (last, forced),
        (charges[charges.case == "two"].iloc[2], {}),
    ]
    for row, changes in cases:
        place = {"probe.x_mm": row.x_mm, "probe.y_mm": row.y_mm, "numerics.tolerance": 1e-3}
        fresh = solve(scene.with_(**changes, **place)).charges_pC[row.electrode]
        assert row.computed_pC == pytest.approx(fresh, abs=max(2.0 * row.error_pC, 2e-3 * fresh))
    assert lines.distance_mm.max() == 14.0  # from A at 6 mm to 8 mm on the other side


def test_comparison_is_computed_less_measured_in_percent(made):
    charges = pd.read_csv(made / "data" / "charges.csv")
    assert list(charges.electrode) == list("ABCD") * 3
    assert list(charges.charge_pC[:4]) == [700.0, 610.0, 560.0, 570.0]
    percent = 100.0 * (charges.computed_pC - charges.charge_pC) / charges.charge_pC
    np.testing.assert_allclose(charges.difference_percent, percent)


def test_differences_are_told_over_the_deviation_by_uncertain_values(tmp_path):
    table = script(section=[script()["section"][1]])
    table["section"][0]["table"] = [{"kind": "comparison", "data": "touches"}]
    uncertain = {"film.thickness_um": "5 %", "film.d31_pC_N": "20 %"}
    table["scene"]["uncertain"] = uncertain
    report = Report.load(write(tmp_path, table))
    assert report.make(tmp_path / "out", processes=1).complete
    charges = pd.read_csv(tmp_path / "out" / "data" / "charges.csv")
    row = charges.iloc[4]
    scene = report.plan.scene.with_(**{"probe.x_mm": row.x_mm, "probe.y_mm": row.y_mm})
    deviation = np.hypot(uncertainty(scene).charges_pC[row.electrode], row.error_pC)
    expected = (row.computed_pC - row.charge_pC) / deviation
    assert row.difference_over_deviation == pytest.approx(expected, rel=1e-2)
    table["scene"]["uncertain"] = {"film.radius_mm": 1.0}
    with pytest.raises(SceneError, match=r"uncertain\.film\.radius_mm"):
        Report.load(write(tmp_path, table))


def test_data_on_a_line_are_beside_their_own_solves(tmp_path):
    table = only("charge-vs-distance")
    table["section"][0]["figure"][0] |= {"data": "touches", "variants": [], "step_mm": 4.0}
    report = Report.load(write(tmp_path, table))
    report.make(tmp_path / "out", processes=1)
    lines = pd.read_csv(tmp_path / "out" / "data" / "charge-vs-distance.csv")
    [row] = lines[lines.charge_pC.notna()].to_dict("records")  # the touch at (6, 2)
    assert (row["curve"], row["distance_mm"], row["charge_pC"]) == ("90°", 2.0, 1000.0)
    touch = {"probe.x_mm": 6.0, "probe.y_mm": 2.0, "numerics.tolerance": 1e-3}
    fresh = solve(report.plan.scene.with_(**touch)).charges_pC["A"]
    assert row["computed_pC"] == pytest.approx(fresh, rel=5e-3)
    assert row["difference_percent"] == pytest.approx(row["computed_pC"] / 10.0 - 100.0)


def test_first_screen_has_what_asks_for_it_then_one_of_each_kind(tmp_path):
    table = script()
    names = [item.name for item in Report.load(write(tmp_path, table)).plan.summary]
    assert names == ["charge-vs-distance", "isocharge", "charges"]
    table["section"][1]["table"][1]["summary"] = True
    names = [item.name for item in Report.load(write(tmp_path, table)).plan.summary]
    assert names == ["positions", "charge-vs-distance", "isocharge"]


def test_names_at_the_ends_of_curves_do_not_overlap():
    at = np.array([[0.0, 0.0], [1.0, 1.0], [0.0, 2.0], [50.0, 1.0]])
    heights = spread(at, width=10.0, gap=5.0)
    assert heights[3] == 1.0  # nothing is near
    assert (np.diff(np.sort(heights[:3])) > 4.9).all()
    assert list(np.argsort(heights[:3])) == [0, 1, 2]


def test_command_refuses_by_key_and_makes_a_preview(tmp_path, command):
    table, out = only("sensor"), tmp_path / "out"
    asked = ["report", write(tmp_path, {**table, "titel": "x"}), "--out"]
    assert command(*asked, out, "--processes", 0).mistakes == ["--processes 0", 'titel = "x"']
    assert not out.exists()
    write(tmp_path, table)
    assert command(*asked, out, "--quick", "--processes", 1).code == 0
    assert "Preview" in out.joinpath("index.html").read_text(encoding="utf-8")
    assert command(*asked, tmp_path).code == 2  # would hold the script


class Square(Kind):
    """A kind of a script's own."""

    kind: Literal["square"]
    side_mm: float

    def scenes(self, inputs):
        return []

    def compose(self, inputs, solved):
        raise NothingToShow("is too small") if self.side_mm < 0.0 else ZeroDivisionError


def test_faults_are_told_in_their_places_and_do_not_stop_the_others(tmp_path, capfd):
    """Scenes that fail, a figure that has nothing to show, and a kind with a mistake."""
    table = only("comparison", "curve")
    changes = {"numerics.max_unknowns": 150, "numerics.tolerance": 1e-6}
    (curve,) = table["section"][0]["figure"]
    curve |= {"set": changes, "values": [0.5, 1.0], "family": {}}
    table["section"][0]["figure"] += [{"kind": "square", "side_mm": s} for s in (-1.0, 1.0)]
    report = Report.load(write(tmp_path, table), kinds={"square": Square})
    made = report.make(tmp_path / "out", processes=1)
    places = [failure.partition(" ")[0] for failure in made.failures]
    assert set(places) == {f"section[0].figure[{n}]" for n in range(3)}
    assert "ZeroDivisionError" in capfd.readouterr().err
    page = made.page.read_text(encoding="utf-8")
    assert '<svg id="svg-charges"' in page
    assert '<svg id="svg-curve"' not in page


def test_a_preview_of_a_curve_goes_as_far_as_the_curve(tmp_path):
    table = only("curve")
    (curve,) = table["section"][0]["figure"]
    del curve["family"]
    curve |= {"x": "force_N", "values": [0.2, 0.4, 0.6, 0.8]}
    Report.load(write(tmp_path, table)).make(tmp_path / "out", quick=True, processes=1)
    drawn = pd.read_csv(tmp_path / "out" / "data" / "curve.csv")
    assert sorted(set(drawn.x)) == [0.2, 0.6, 0.8]


def test_warnings_of_scenes_stand_below_their_figure(tmp_path):
    """A coefficient in C/N is a doubt about the scene, which is solved all the same."""
    table = only("curve")
    (curve,) = table["section"][0]["figure"]
    del curve["family"]
    curve |= {"x": "film.d31_pC_N", "values": [1e-7, 2e-7, 8.0]}
    made = Report.load(write(tmp_path, table)).make(tmp_path / "out", processes=1)
    assert made.complete
    [remark] = re.findall('<p class="pending">(.*?)</p>', made.page.read_text("utf-8"))
    assert "film.d31_pC_N = 1e-07" in remark


OWN = """
from dataclasses import dataclass
from pathlib import Path
from typing import Literal
import os
import pandas as pd
from pvdf_fem import Scene
from pvdf_fem.reporting.kind import Content, Kind
from pvdf_fem.reporting.task import Task

@dataclass(frozen=True)
class Word:
    text: str

@dataclass(frozen=True)
class Count(Task):
    scene: Scene
    word: Word
    log: str

    def run(self):
        with open(self.log, "a") as file:
            file.write(self.word.text + "\\n")
        if self.word.text == "raise":
            raise ValueError("is no word")
        words = Path(self.log).read_text().split()
        if self.word.text == "crash" or self.word.text == "die" and words.count("die") == 1:
            os.kill(os.getpid(), 9)
        radius = self.scene.film.radius_mm
        return [{"word": self.word.text, "letters": len(self.word.text), "radius": radius}]

class Told(Kind):
    kind: Literal["told"]
    words: tuple[str, ...]
    log: str
    claim: str = ""

    def scenes(self, inputs):
        return []

    def tasks(self, inputs):
        return [Count(inputs.scene, Word(word), self.log) for word in self.words]

    def compose(self, inputs, solved):
        rows = [row for task in self.tasks(inputs) for row in solved.rows(task)]
        return Content("", pd.DataFrame(rows), shown=pd.DataFrame(rows), claim=self.claim)
"""


@pytest.fixture
def counted(tmp_path):
    """Makes a report whose tables are of tasks, by the command; returns its exit code."""

    def make(*tables, processes=1, more=(), **keys):
        table = {**only("sensor"), **keys}
        log = str(tmp_path / "log")
        table["section"][0]["figure"] += [{"kind": "told", "log": log, **of} for of in tables]
        path, kinds = write(tmp_path, table), tmp_path / "own.py"
        if not kinds.exists():
            kinds.write_text(OWN)
        how = ["--kinds", str(kinds), "--processes", str(processes)]
        return main(["report", str(path), "--out", str(tmp_path / "out"), *how, *more])

    return make


def ran(folder):
    """What tasks have run, in their order."""
    log = folder / "log"
    return log.read_text().split() if log.exists() else []


def test_tasks_of_a_file_run_once_in_processes_and_in_this_one(tmp_path, counted):
    table = {"name": "told", "words": ["hear", "see"], "full": {"words": ["hear", "smell"]}}
    assert counted(table, processes=2) == 0
    assert sorted(ran(tmp_path)) == ["hear", "see"]
    page = tmp_path.joinpath("out", "index.html").read_bytes()
    told = pd.read_csv(tmp_path / "out" / "data" / "told.csv")
    assert told.values.tolist() == [["hear", 4, 20.0], ["see", 3, 20.0]]
    assert counted(table) == 0
    assert tmp_path.joinpath("out", "index.html").read_bytes() == page
    assert len(ran(tmp_path)) == 2
    assert counted(table, more=["--full"]) == 0  # one is known
    assert ran(tmp_path)[2:] == ["smell"]
    kinds = tmp_path / "own.py"
    kinds.write_text(kinds.read_text().replace('"letters": len', '"letters": 2 * len'))
    assert counted(table) == 0  # an edited file computes anew
    assert ran(tmp_path)[3:] == ["hear", "see"]
    assert pd.read_csv(tmp_path / "out" / "data" / "told.csv").letters.tolist() == [8, 6]


@pytest.mark.parametrize(
    ("word", "processes"),
    [("raise", 1), ("raise", 2), pytest.param("crash", 2, marks=pytest.mark.slow)],
)
def test_a_task_that_fails_is_told_in_its_place_and_tried_again(
    tmp_path, counted, capfd, word, processes
):
    tables = [{"name": "bad", "words": [word]}, {"name": "good", "words": ["see"]}]
    assert counted(*tables, processes=processes) == 3
    assert "section[0].figure[1] (bad)" in capfd.readouterr().err
    page = tmp_path.joinpath("out", "index.html").read_text("utf-8")
    assert re.search(r'<figure id="bad">\s*<p class="pending">', page)
    assert (tmp_path / "out" / "data" / "good.csv").is_file()
    assert not (tmp_path / "out" / "data" / "bad.csv").exists()
    before = len(ran(tmp_path))
    assert counted(*tables, processes=processes) == 3
    assert set(ran(tmp_path)[before:]) == {word}


#: The command, which logs each solve, and kills itself in the solve of a number.
LOGGED = """
import os, signal, sys
from pvdf_fem.cli.main import main
from pvdf_fem.sweeps import store, sweep
log, last = sys.argv[1], int(sys.argv[2])
real, solves = sweep.records_of, []
def solve(scenes, frames):
    solves.append(scenes)
    with open(log, "a") as file:
        print(*map(store.key, scenes), sep=",", file=file)
    if len(solves) == last:
        os.kill(os.getpid(), signal.SIGKILL)
    return real(scenes, frames)
sweep.records_of = solve
sys.exit(main(sys.argv[3:]))
"""


def test_killed_in_a_solve_and_in_a_task_it_goes_on_to_the_same_page(tmp_path):
    """Neither a scene nor a task is computed twice, but those during which the kills came."""
    table, logs = only("charge-vs-distance", "sensor"), (tmp_path / "solves", tmp_path / "log")
    told = {"kind": "told", "words": ["a", "b", "die", "c"], "log": str(logs[1])}
    table["section"][0]["figure"] += [told]
    path, kinds = write(tmp_path, table), tmp_path / "own.py"
    kinds.write_text(OWN)

    def run(out, last=0):
        program = [sys.executable, "-c", LOGGED, str(logs[0]), str(last), "report", str(path)]
        how = ["--kinds", str(kinds), "--processes", "1", "--out", str(tmp_path / out)]
        return subprocess.run([*program, *how], capture_output=True).returncode

    assert run("out", last=4) == -signal.SIGKILL
    [*before, during] = logs[0].read_text().split()
    page = tmp_path.joinpath("out", "index.html").read_text(encoding="utf-8")
    assert '<svg id="svg-sensor"' in page
    assert '<svg id="svg-charge-vs-distance"' not in page
    assert run("out") == -signal.SIGKILL  # in the task
    assert run("out") == 0
    solved = logs[0].read_text().split()
    assert sorted(solved) == sorted([*dict.fromkeys(solved), during])
    assert set(before) < set(solved)
    assert ran(tmp_path) == ["a", "b", "die", "die", "c"]
    whole = Report.load(path, kinds_of(kinds)).make(tmp_path / "whole", processes=1)
    assert tmp_path.joinpath("out", "index.html").read_bytes() == whole.page.read_bytes()


def test_pages_are_readable_on_screens_and_in_print(made, tmp_path, counted):
    """No text is cut or hidden, and print shows what is folded, and no links to places."""
    words = ["a" * (i + 1) for i in range(LONG_TABLE + 1)]
    assert counted({"words": words, "title": "A folded table"}) == 0
    page = tmp_path / "out" / "index.html"
    with browser_or_skip() as browser:
        assert not faults_of(page, browser)
        assert not faults_of(made / "index.html", browser)
        shown = browser.new_page()
        shown.goto(page.as_uri())
        for medium in ("screen", "print"):
            shown.emulate_media(media=medium)
            in_print = medium == "print"
            assert shown.get_by_text(words[-1], exact=True).is_visible() == in_print
            assert shown.locator("nav").is_visible() != in_print


def test_mistakes_in_full_are_told_by_their_keys(tmp_path, counted, capsys):
    assert counted({"words": ["a"], "full": {"words": 3, "wrods": ["b"]}}) == 2
    told = capsys.readouterr().err
    assert all(f"section[0].figure[1].full.{key} = " in told for key in ("words", "wrods"))
    assert not ran(tmp_path)


def test_a_page_has_the_verdicts_of_others_and_of_itself(tmp_path, counted):
    other = {"title": "Another <one>", "page": "../other/index.html", "how": "make other"}
    assert counted({"words": ["a"], "claim": "words have 1 letter"}, other=[other]) == 0
    assert tmp_path.joinpath("out", "verdict.txt").read_text() == "Words have 1 letter.\n"
    page = tmp_path / "out" / "index.html"
    assert "make other" in page.read_text()
    assert 'href="../other' not in page.read_text()
    folder = tmp_path / "other"
    folder.mkdir()
    folder.joinpath("index.html").touch()
    folder.joinpath("verdict.txt").write_text(r"It is \1 & good.")
    before = page.read_text()
    Report.load(tmp_path / "report.toml", kinds_of(tmp_path / "own.py")).refresh(tmp_path / "out")
    line = r'<li><a href="../other/index.html">Another &lt;one&gt;</a>: It is \1 &amp; good.</li>'
    assert line in page.read_text()
    assert counted({"words": ["a"], "claim": "words have 1 letter"}, other=[other]) == 0
    assert page.read_text() == re.sub("<li>Another.*</li>", lambda _: line, before)


def test_kinds_come_from_a_python_file(tmp_path, command):
    table, kinds = only("sensor"), tmp_path / "own.py"
    table["section"][0]["figure"] += [
        {"kind": "told", "words": ["hear"], "log": str(tmp_path / "log")}
    ]
    asked = ["report", write(tmp_path, table), "--out", tmp_path / "out", "--processes", 1]
    assert command(*asked).code == 2  # no such kind
    for text in (None, "import", "x = 1"):
        if text is not None:
            kinds.write_text(text)
        run = command(*asked, "--kinds", kinds)
        assert (run.code, run.err.startswith("kinds = ")) == (2, True)
    kinds.write_text(OWN)
    assert command(*asked, "--kinds", kinds).code == 0
    assert '<td data-label="word">hear</td>' in (tmp_path / "out" / "index.html").read_text("utf-8")

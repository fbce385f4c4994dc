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

from pvdf_fem import Report, Scene, solve, uncertainty
from pvdf_fem.batch import batch as sweep
from pvdf_fem.cli.main import main
from pvdf_fem.report.kind import Kind
from pvdf_fem.report.page import MAX_OPEN_ROWS
from pvdf_fem.report.registry import load_kinds
from pvdf_fem.report.results import NothingToShowError
from tests.helpers.browsers import browser_or_skip, faults_of
from tests.helpers.report_scripts import script, text_of

NAMES = ("charge-vs-distance", "isocharge", "curve", "sensor", "charges", "positions")


def write(folder: Path, *figures, **keys) -> Path:
    """A script with the sensor's figure, and with others."""
    table = {**script(), **keys}
    sensor = {"kind": "sensor"}
    table["section"] = [{"title": "Figures", "figure": [sensor, *figures]}]
    path = folder / "report.toml"
    path.write_text(text_of(table), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A report with figures and tables of every kind."""
    folder = tmp_path_factory.mktemp("report")
    folder.joinpath("report.toml").write_text(text_of(script()), encoding="utf-8")
    found = Report.load(folder / "report.toml").make(folder / "out", processes=1)
    assert found.complete
    return folder / "out"


@pytest.fixture(scope="module")
def scene(made):
    return Scene.from_file(made / "scenes" / "scene.toml")


def test_the_page_has_all_figures_and_is_self_contained(made):
    page = made.joinpath("index.html").read_text(encoding="utf-8")
    assert all(page.count(f'<svg id="svg-{name}"') == 1 for name in NAMES)
    assert page.count('<use href="#svg-') == 3
    identifiers = re.findall(r'\bid="([^"]+)"', page)
    assert len(set(identifiers)) == len(identifiers)
    assert set(re.findall(r'href="#([^"]+)"', page)) <= set(identifiers)
    assert not re.search(r"<script|<link|src=|https?://(?!www\.w3\.org)", page)
    linked = {made / link for link in re.findall(r'href="([^"#]+)"', page)}
    assert linked == {*made.glob("data/*.csv")}
    assert {path.stem for path in made.glob("figures/*.svg")} == set(NAMES)


def test_figures_have_the_charges_of_solves(made, scene):
    names = ("charge-vs-distance", "curve", "charges")
    lines, curve, charges = (pd.read_csv(made / "data" / f"{name}.csv") for name in names)
    last = curve[curve.electrode == "B"].iloc[-1]
    thick = {"film.thickness_um": 50.0}
    [_, touched] = lines[lines.charge_pC.notna()].to_dict("records")  # at (6, 2), in two panels
    assert (touched["curve"], touched["distance_mm"], touched["charge_pC"]) == ("90°", 2.0, 1000.0)
    assert list(charges.charge_pC[:4]) == [700.0, 610.0, 560.0, 570.0]
    cases = [
        (lines[lines.curve == "180°"].iloc[3], {}),
        (pd.Series(touched), thick),
        (last, {**thick, "load.force_N": last.x}),
        (charges[charges.case == "two"].iloc[2], {}),
    ]
    for row, changes in cases:
        place = {"probe.x_mm": row.x_mm, "probe.y_mm": row.y_mm, "numerics.tolerance": 1e-3}
        fresh = solve(scene.with_(**changes, **place)).charges_pC[row.electrode]
        assert row.computed_pC == pytest.approx(fresh, abs=max(2.0 * row.error_pC, 2e-3 * fresh))
        percent = 100.0 * (row.computed_pC - row.charge_pC) / row.charge_pC
        assert row.difference_percent == pytest.approx(percent, nan_ok=True)
    assert lines.distance_mm.max() == 14.0  # from A at 6 mm to 8 mm on the other side


def test_differences_are_given_over_the_deviation_due_to_uncertain_values(made, scene):
    row = pd.read_csv(made / "data" / "charges.csv").iloc[4]
    spread = uncertainty(scene.with_(**{"probe.x_mm": row.x_mm, "probe.y_mm": row.y_mm}))
    deviation = np.hypot(spread.charges_pC[row.electrode], row.error_pC)
    expected = (row.computed_pC - row.charge_pC) / deviation
    assert row.difference_over_deviation == pytest.approx(expected)


def test_the_command_reports_mistakes_by_key_and_makes_a_preview(tmp_path, command):
    out = tmp_path / "out"
    asked = ["report", write(tmp_path, titel="x"), "--out"]
    assert command(*asked, out, "--processes", 0).error_keys == ["--processes 0", 'titel = "x"']
    assert not out.exists()
    write(tmp_path)
    assert command(*asked, out, "--quick", "--processes", 1).code == 0
    assert "Preview" in out.joinpath("index.html").read_text(encoding="utf-8")
    assert command(*asked, tmp_path).code == 2  # would hold the script


class Square(Kind):
    """A kind of a script's own."""

    kind: Literal["square"]
    side_mm: float

    def compose(self, inputs, results):
        raise NothingToShowError("is too small") if self.side_mm < 0.0 else ZeroDivisionError


def test_a_failed_figure_shows_its_reason_and_does_not_stop_the_others(tmp_path, capfd):
    """Scenes that fail, a figure that has nothing to show, and a kind with a mistake."""
    curve = {"kind": "curve", "x": "force_N", "values": [0.5, 1.0]}
    curve["set"] = {"numerics.max_unknowns": 150, "numerics.tolerance": 1e-6}
    squares = [{"kind": "square", "side_mm": side} for side in (-1.0, 1.0)]
    report = Report.load(write(tmp_path, curve, *squares), kinds={"square": Square})
    made = report.make(tmp_path / "out", processes=1)
    places = [failure.partition(" ")[0] for failure in made.failures]
    assert set(places) == {f"section[0].figure[{n}]" for n in (1, 2, 3)}
    assert "ZeroDivisionError" in capfd.readouterr().err
    page = made.page.read_text(encoding="utf-8")
    assert '<svg id="svg-sensor"' in page
    assert '<svg id="svg-curve"' not in page


def test_a_preview_covers_the_whole_curve_and_shows_warnings(tmp_path):
    """A coefficient in C/N is a doubt about the scene, which is solved all the same."""
    curve = {"kind": "curve", "x": "film.d31_pC_N", "values": [1e-7, 2e-7, 4.0, 8.0]}
    report = Report.load(write(tmp_path, curve))
    made = report.make(tmp_path / "out", quick=True, processes=1)
    assert made.complete
    drawn = pd.read_csv(tmp_path / "out" / "data" / "curve.csv")
    assert sorted(set(drawn["x"])) == [1e-7, 4.0, 8.0]
    [remark] = re.findall('<p class="pending">(.*?)</p>', made.page.read_text("utf-8"))
    assert "film.d31_pC_N = 1e-07" in remark


OWN = """
from dataclasses import dataclass
from pathlib import Path
from typing import Literal
import os
from pvdf_fem import Scene
from pvdf_fem.report.kind import Kind
from pvdf_fem.report.task import Task

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

class Words(Kind):
    kind: Literal["words"]
    words: tuple[str, ...]
    log: str
    claim: str = ""

    def list_tasks(self, inputs):
        return [Count(inputs.scene, Word(word), self.log) for word in self.words]

    def make_table(self, data):
        return data

    def make_claim(self, data):
        return self.claim
"""


class Counted:
    """A report whose figures are of tasks, by the command."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.out, self.kinds = folder, folder / "out", folder / "own.py"
        self.log = folder / "log"
        self.kinds.write_text(OWN)

    def write(self, *figures, **keys) -> Path:
        tables = [{"kind": "words", "log": str(self.log), **figure} for figure in figures]
        return write(self.folder, *tables, **keys)

    def make(self, *figures, processes=1, more=(), **keys) -> int:
        """The exit code of the command."""
        path = str(self.write(*figures, **keys))
        how = ["--kinds", str(self.kinds), "--processes", str(processes), *more]
        return main(["report", path, "--out", str(self.out), *how])

    @property
    def ran(self) -> list[str]:
        """What tasks have run, in their order."""
        return self.log.read_text().split()

    @property
    def page(self) -> str:
        return self.out.joinpath("index.html").read_text("utf-8")


@pytest.fixture
def counted(tmp_path):
    return Counted(tmp_path)


def test_tasks_run_once_until_their_file_or_scene_changes(counted):
    table = {"name": "words", "words": ["hear", "see"], "full": {"words": ["hear", "smell"]}}
    assert counted.make(table, processes=2) == 0
    assert sorted(counted.ran) == ["hear", "see"]
    page, path = counted.page, counted.out / "data" / "words.csv"
    assert '<td data-label="word">hear</td>' in page
    assert pd.read_csv(path).values.tolist() == [["hear", 4, 20.0], ["see", 3, 20.0]]
    assert counted.make(table) == 0
    assert counted.page == page
    assert len(counted.ran) == 2
    assert counted.make(table, more=["--full"]) == 0  # one is known
    assert counted.ran[2:] == ["smell"]
    counted.kinds.write_text(OWN.replace('"letters": len', '"letters": 2 * len'))
    assert counted.make(table) == 0  # an edited file computes anew
    assert counted.ran[3:] == ["hear", "see"]
    assert pd.read_csv(path).letters.tolist() == [8, 6]
    other = {**script()["scene"], "film": {"radius_mm": 20.0, "d31_pC_N": 9.0}}
    assert counted.make(table, scene=other) == 0  # so does another scene
    assert counted.ran[5:] == ["hear", "see"]


@pytest.mark.parametrize(
    ("word", "processes"),
    [("raise", 1), ("raise", 2), pytest.param("crash", 2, marks=pytest.mark.slow)],
)
def test_a_failed_task_shows_its_reason_and_is_tried_again(counted, capfd, word, processes):
    tables = [{"name": "bad", "words": [word]}, {"name": "good", "words": ["see"]}]
    assert counted.make(*tables, processes=processes) == 3
    assert "section[0].figure[1] (bad)" in capfd.readouterr().err
    assert re.search(r'<figure id="bad">\s*<p class="pending">', counted.page)
    assert {path.stem for path in counted.out.glob("data/*")} == {"sensor", "good"}
    before = len(counted.ran)
    assert counted.make(*tables, processes=processes) == 3
    assert set(counted.ran[before:]) == {word}


def test_a_killed_report_continues_to_the_same_page(tmp_path, counted, monkeypatch):
    """What was computed before is not computed again; the kill comes in a task."""
    lines = script()["section"][0]["figure"][0]
    words = {"kind": "words", "words": ["a", "b", "die", "c"], "log": str(counted.log)}
    path = write(tmp_path, lines, words)
    asked = ["report", path, "--kinds", counted.kinds, "--processes", "1", "--out", counted.out]
    killed = subprocess.run([sys.executable, "-m", "pvdf_fem", *asked], capture_output=True)
    assert killed.returncode == -signal.SIGKILL
    assert counted.ran == ["a", "b", "die"]
    assert '<svg id="svg-sensor"' in counted.page
    assert 'data-label="word"' not in counted.page
    whole = Report.load(path, load_kinds(counted.kinds)).make(tmp_path / "whole", processes=1)
    counted.log.write_text("die\n")
    monkeypatch.setattr(sweep, "make_records", None)  # every scene is known
    assert main([*map(str, asked)]) == 0
    assert counted.ran == ["die", "die", "c"]
    assert counted.page == whole.page.read_text("utf-8")


def test_pages_are_readable_on_screens_and_in_print(made, counted):
    """No text is cut or hidden, and print shows what is folded, and no links to places."""
    words = ["a" * (i + 1) for i in range(MAX_OPEN_ROWS + 1)]
    assert counted.make({"words": words, "title": "A folded table"}) == 0
    page, planted = counted.out / "index.html", counted.out / "planted.html"
    cut = "<p style='width: 5em; overflow: hidden; white-space: nowrap'>words are cut</p>"
    over = "<p>beneath</p><p style='margin-top: -2em'>over it</p>"
    planted.write_text(counted.page.replace("<body>", f"<body>{cut}{over}"))
    with browser_or_skip() as browser:
        assert not faults_of(page, browser)
        assert not faults_of(made / "index.html", browser)
        assert {of.kind for of in faults_of(planted, browser)} == {"cut", "overlap"}
        shown = browser.new_page()
        shown.goto(page.as_uri())
        for medium in ("screen", "print"):
            shown.emulate_media(media=medium)
            in_print = medium == "print"
            assert shown.get_by_text(words[-1], exact=True).is_visible() == in_print
            assert shown.locator("nav").is_visible() != in_print


def test_a_page_has_the_verdicts_of_others_and_of_itself(tmp_path, counted):
    page = "../other/index.html"
    others = [{"title": "Another <one>", "page": page, "how": "make other"}]
    words = {"words": ["a"], "claim": "words have 1 letter"}
    assert counted.make(words, other=others) == 0
    assert counted.out.joinpath("verdict.txt").read_text() == "Words have 1 letter.\n"
    before = counted.page
    assert "make other" in before
    assert f'href="{page}' not in before
    folder = tmp_path / "other"
    folder.mkdir()
    folder.joinpath("index.html").touch()
    folder.joinpath("verdict.txt").write_text(r"It is \1 & good.")
    Report.load(tmp_path / "report.toml", load_kinds(counted.kinds)).refresh(counted.out)
    line = rf'<li><a href="{page}">Another &lt;one&gt;</a>: It is \1 &amp; good.</li>'
    refreshed = counted.page
    assert refreshed == re.sub("<li>Another.*</li>", lambda _: line, before) != before
    assert counted.make(words, other=others) == 0
    assert counted.page == refreshed


OWN_FIGURE = """
from typing import Literal
from pvdf_fem.report.kind import FigureKind

class ChargeByForce(FigureKind):
    \"\"\"Charge of each electrode
    against the force.\"\"\"

    kind: Literal["charge-by-force"]
    forces_N: tuple[float, ...]

    def list_changes(self):
        return [{"load.force_N": force} for force in self.forces_N]

    def draw(self, data, axes):
        for electrode, rows in data.groupby("electrode"):
            axes.plot(rows["load.force_N"], rows.computed_pC, label=electrode)
"""


def test_a_figure_of_keys_changes_and_draw_alone(tmp_path):
    """The report solves the scenes; caption and data have defaults."""
    file = tmp_path / "own.py"
    file.write_text(OWN_FIGURE)
    film = {"film.d31_pC_N": 12.0}
    figure = {"kind": "charge-by-force", "name": "own", "forces_N": [0.5, 1.0], "set": film}
    made = Report.load(write(tmp_path, figure), load_kinds(file)).make(
        tmp_path / "out", processes=1
    )
    assert (made.complete, made.scenes) == (True, 2)
    data = pd.read_csv(tmp_path / "out" / "data" / "own.csv")
    scene = Scene.from_file(tmp_path / "out" / "scenes" / "own.toml")
    charges = solve(scene.with_(**{"load.force_N": 0.5})).charges_pC
    half = data[data["load.force_N"] == 0.5]
    assert dict(zip(half.electrode, half.computed_pC, strict=True)) == pytest.approx(charges)
    assert len(data) == 2 * len(charges)
    page = made.page.read_text("utf-8")
    assert "<figcaption>Charge of each electrode against the force." in page
    assert '<svg id="svg-own"' in page


@pytest.mark.parametrize("text", [None, "import", "x = 1"])
def test_a_file_without_kinds_is_refused(counted, command, text):
    counted.kinds.unlink() if text is None else counted.kinds.write_text(text)
    asked = ["report", counted.write(), "--out", counted.out, "--kinds", counted.kinds]
    [told] = command(*asked).error_keys
    assert told.startswith("kinds = ")

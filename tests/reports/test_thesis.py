"""The report on the thesis: its data, its charges, and where everything is."""

from __future__ import annotations

import re
from pathlib import Path

import pandas as pd
import pytest

from pvdf_fem import Report, solve
from pvdf_fem.report.results import ReportResults
from pvdf_fem.report.task import compute_key
from reports import __main__ as reports

THESIS = Path(reports.__file__).parent / "thesis"


@pytest.fixture(scope="module")
def report() -> Report:
    return reports.load_report("thesis")


def test_203_of_222_printed_charges_are_compared(report):
    counted, printed = report.plan.data["charges"].frame, pd.read_csv(THESIS / "charges.csv")
    assert [of[[*"ABCD"]].notna().sum().sum() for of in (counted, printed)] == [203, 222]


@pytest.mark.parametrize("name", [name for name in reports.REPORTS if name != reports.DEFAULT])
def test_previews_of_reports_are_small(name):
    plan, counts = reports.load_report(name).plan, []
    for how in ({"quick": True}, {}, {"full": True}):
        _, needed = plan.collect_requirements(**how)
        counts.append(len({compute_key(task) for need in needed for task in need.tasks}))
    preview, usual, full = counts
    assert 0 < preview <= usual <= full
    assert preview < 110


def test_charges_of_each_kind_of_scene_are_within_2_percent(report):
    readings = report.plan.data["charges"]
    scenes = readings.make_scenes(report.plan.scene)
    kinds = readings.frame.groupby(["probe.shape", "electrodes.layout"]).head(1).index
    assert len(kinds) == 4
    for row in kinds:
        charges = solve(scenes[row]).charges_pC
        printed = readings.frame.loc[row, list(charges)].to_numpy(float)
        assert [*charges.values()] == pytest.approx(printed, rel=0.02, nan_ok=True)


@pytest.mark.parametrize(("name", "rows"), [("findings", 12), ("numbers", 12), ("contents", 21)])
def test_texts_are_tables_with_numbers_in_braces(name, rows):
    texts = pd.read_csv(THESIS / f"{name}.csv", dtype=str, keep_default_na=False)
    assert len(texts) == rows
    fields = texts.to_csv().count("{")
    assert fields == texts.to_csv().count("}")
    assert (fields > 0) == (name != "contents")


def test_links_of_texts_lead_to_figures_and_files(report):
    names = {item.name for item in report.plan.items}
    for file in ("findings", "contents"):
        links = re.findall(r"\]\(([^)]+)\)", (THESIS / f"{file}.csv").read_text("utf-8"))
        assert links, file
        for link in links:
            name = re.sub(r"^#|^data/|\.csv$", "", link)
            assert name in names, link


@pytest.mark.slow
def test_the_kinds_of_the_thesis_work_in_a_preview(report):
    inputs, needed = report.plan.collect_requirements(quick=True)
    own = [need for need in needed if need.tasks or need.item.name == "contents"]
    assert len(own) == 4
    tasks = {compute_key(task): task for need in own for task in need.tasks}
    results = ReportResults({name: task.run() for name, task in tasks.items()})
    made = {need.item.name: need.item.kind.compose(inputs, results) for need in own}
    for content in made.values():
        assert not content.frame.astype(str).isin(["nan"]).any(axis=None)
        assert "{" not in content.frame.to_csv()
    assert "<a href=" in made["contents"].table.to_csv()
    effects = made["effects"].frame.set_index(["probe", "effect"])
    # a tape over A takes more than half of its charge; d33 adds to the electrode under the probe
    assert effects.A_percent["beside A", "tape over each electrode"] < -50.0
    assert effects.B_percent["on a part of A", "d33 = −15 pC/N"] == pytest.approx(0.0, abs=1e-9)
    assert effects.A_percent["on a part of A", "d33 = −15 pC/N"] > 0.0


FOUND = """
from typing import Literal
import pandas as pd
from pvdf_fem.report.kind import Kind

class Found(Kind):
    kind: Literal["found"]

    def collect_data(self, inputs, results):
        return pd.DataFrame(dict(a=[1]))

    def make_claim(self, data):
        return "{claim}"
"""


def test_reports_are_made_by_their_names(tmp_path, monkeypatch):
    """Each in its folder, and the landing page has its verdict."""
    title = 'title = "A sensor"\nexample = "triangle"\n'
    other = '[[other]]\ntitle = "How good"\npage = "accuracy/index.html"\nhow = "by hand"\n'
    section = '[[section]]\ntitle = "Found"\n[[section.figure]]\nkind = "found"\n'
    for name, text in {"thesis": title + other + section, "accuracy": title + section}.items():
        (folder := tmp_path / name).mkdir()
        folder.joinpath("report.toml").write_text(text)
        folder.joinpath("special.py").write_text(FOUND.format(claim=name))
    monkeypatch.setattr(reports, "HERE", tmp_path)
    monkeypatch.setattr(reports, "OUT", tmp_path / "out")
    landing = tmp_path / "out" / "index.html"
    for arguments, verdicts in {(): ["Thesis"], ("accuracy",): ["Thesis", "Accuracy"]}.items():
        assert reports.main([*arguments]) == 0
        assert re.findall(r">(?:: )?(\w+)\.</", landing.read_text()) == verdicts
    for wrong in (["stability"], ["thesys"], ["--processes", "0"]):  # the first has no script there
        assert reports.main(wrong) == 2

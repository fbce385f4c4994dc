"""The landing page: links, numbers from tables, and what is not made yet."""

from __future__ import annotations

from pathlib import Path

import pytest
from matplotlib.figure import Figure

from reports import __main__ as command_line
from reports import thesis
from reports.common.figures import preview, save
from reports.common.page import Cell, Column, Link, Page, Picture, Section, Table
from reports.front.catalogue import REPORTS, command
from reports.front.landing import publish, write_landing
from tests.reports.test_page import assert_links_work, parsed


def table(name: str, **columns: list[Cell]) -> Table:
    heads = [Column(key, key) for key in columns]
    return Table(name, "caption", heads, list(zip(*columns.values(), strict=True)))


CHARGES = table(
    "charges",
    difference_percent=[-1.0, -3.0, 0.5, 50.0],
    defect_of_the_thesis=["", "", "", "copied"],
)
FINDINGS = table(
    "findings",
    place=["3.1", "4.1"],
    states=["The earth is <flat>.", "No clue."],
    gives=["It is round.", "There is one."],
    shown=[Link("figure", "Figure"), Link("summary", "Summary")],
)


@pytest.fixture
def reports(tmp_path: Path) -> Path:
    """A directory with a thesis report and a preview of a design study."""
    (tmp_path / "design").mkdir()
    for file in ("sensor.svg", "curve.svg", "design/steps.svg"):
        (tmp_path / file).write_text("<svg xmlns='http://www.w3.org/2000/svg'/>")
    sections = [
        Section("sensor", "Sensor", blocks=[Picture("sensor.svg", "The sensor")]),
        Section("summary", "Summary", blocks=[CHARGES]),
        Section("figure", "Figure", blocks=[Picture("curve.svg", "Curve")]),
        Section("findings", "Findings", blocks=[FINDINGS]),
    ]
    for section in sections:
        section.write_tables(tmp_path)
    page = Page(REPORTS["thesis"].title, [], sections, home="index.html")
    page.write(tmp_path, REPORTS["thesis"].page)
    compared = table("recommended", position_mm_firm=[0.25, 1.5], force_percent_firm=[2.0, 6.0])
    section = Section("steps", "Steps", blocks=[Picture("steps.svg", "Steps"), compared])
    section.write_tables(tmp_path / "design")
    publish(Page("Design", [], [section], is_preview=True), tmp_path / "design")
    return tmp_path


def test_links_lead_both_ways(reports: Path) -> None:
    landing = assert_links_work(reports / "index.html")
    assert {"thesis.html", "design/index.html", "thesis.html#figure"} <= set(landing.targets)
    for report in ("thesis", "design"):
        page = reports / REPORTS[report].page
        home = [target for target in assert_links_work(page).targets if "index.html" in target]
        assert [(page.parent / target).resolve() for target in home] == [reports / "index.html"]


def test_sentences_have_the_numbers_of_the_tables(reports: Path) -> None:
    text = " ".join(parsed(reports / "index.html").text.split())
    assert "3 printed charges count" in text
    assert "1.00 % in the median and by 3.00 % at most" in text
    assert "2 of ours are smaller: the median of ours − thesis is −1.00 %" in text
    assert "2 statements of the thesis are contradicted" in text
    assert "1.50 mm and its force to 6.0 %" in text
    assert "resolves 0.25 mm and 2.0 %" in text
    assert "“The earth is <flat>” It is round." in text


def test_what_is_not_made_has_its_command_and_a_preview_says_so(reports: Path) -> None:
    text = parsed(reports / "index.html").text
    for name in REPORTS:
        assert (command(name) + "\n" in text.replace("</", "\n")) == (
            name not in ("thesis", "design")
        )
    assert "Preview." in text
    (reports / "design" / "index.json").write_text("damaged")
    write_landing(reports)
    text = parsed(reports / "index.html").text
    assert "./run report design" in text
    assert "Preview." not in text


def test_without_any_report_the_page_says_what_to_type(tmp_path: Path) -> None:
    write_landing(tmp_path)
    assert "Nothing is computed yet" in assert_links_work(tmp_path / "index.html").text


def test_pages_of_unknown_folders_are_listed(reports: Path) -> None:
    folder = reports / "mine & more"
    folder.mkdir()
    publish(Page("Sensors <of> A & B", [], []), folder)
    landing = assert_links_work(reports / "index.html")
    assert "mine%20%26%20more/index.html" in landing.targets
    assert "Sensors <of> A & B" in landing.text


def test_a_report_by_itself_has_no_landing_page(tmp_path: Path) -> None:
    (tmp_path / "design").mkdir()
    publish(Page("Design", [], []), tmp_path / "design")
    assert not (tmp_path / "index.html").exists()
    assert "All reports" not in parsed(tmp_path / "design" / "index.html").text


def test_every_report_has_a_command(monkeypatch: pytest.MonkeyPatch) -> None:
    given: dict[str, list[str]] = {}
    for name, report in REPORTS.items():
        main = lambda arguments, name=name: given.setdefault(name, arguments) and 0  # noqa: E731
        monkeypatch.setattr(f"{report.module}.main", main)
        assert command_line.main([name, "--quick"]) == 0
        assert given[name] == [*report.arguments, "--quick"]
    given.clear()
    monkeypatch.setattr("reports.thesis.main", lambda arguments: 7)
    assert command_line.main(["--quick"]) == command_line.main([]) == 7


def test_an_unknown_report_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert command_line.main(["shaer"]) == 2
    told = capsys.readouterr().err
    assert "'shaer' is not a report" in told
    assert all(name in told for name in REPORTS)


def test_sections_of_the_catalogue_are_chapters() -> None:
    names = {chapter.name: chapter.title for chapter in thesis.CHAPTERS}
    for report in REPORTS.values():
        if report.arguments:
            assert names[report.arguments[-1]] == report.title
            assert report.page == f"{report.arguments[-1]}.html"


def test_figures_of_a_preview_are_stamped(tmp_path: Path) -> None:
    figure = Figure(layout="constrained")
    figure.subplots()
    save(figure, tmp_path / "final.svg")
    with preview(True):
        save(figure, tmp_path / "preview.svg")
    assert "<!-- preview -->" not in (tmp_path / "final.svg").read_text()
    assert "<!-- preview -->" in (tmp_path / "preview.svg").read_text()

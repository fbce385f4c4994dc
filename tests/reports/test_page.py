"""The HTML page: every link leads somewhere, text is escaped, numbers survive."""

from __future__ import annotations

import csv
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import pytest

from reports.common.page import (
    LONG_ROWS,
    WIDE_COLUMNS,
    Cell,
    Column,
    Link,
    Page,
    Picture,
    Section,
    Table,
    joined,
    signed,
)


class Links(HTMLParser):
    """Ids, links and images of a page, and tags that are not closed properly."""

    VOID = ("meta", "img", "br", "link", "hr")

    def __init__(self) -> None:
        super().__init__()
        self.ids: list[str] = []
        self.targets: list[str] = []
        self.alternatives: list[str] = []
        self.open: list[str] = []
        self.text = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = {key: value or "" for key, value in attrs}
        if tag not in self.VOID:
            self.open.append(tag)
        self.ids += [values["id"]] if "id" in values else []
        self.targets += [values[key] for key in ("href", "src") if key in values]
        if tag == "img":
            self.alternatives.append(values["alt"])

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if "style" not in self.open:
            self.text += data


def parsed(path: Path) -> Links:
    links = Links()
    links.feed(path.read_text(encoding="utf-8"))
    links.close()
    assert not links.open
    return links


def assert_links_work(path: Path) -> Links:
    """Every anchor and file that a page refers to is there."""
    links = parsed(path)
    assert len(links.ids) == len(set(links.ids))
    for target in links.targets:
        file, _, anchor = unquote(target).partition("#")
        assert not file or (path.parent / file).is_file(), target
        ids = parsed(path.parent / file).ids if file and anchor else links.ids
        assert not anchor or anchor in ids, target
    assert all(links.alternatives)
    return links


TABLE = Table(
    "table_1",
    "Charges <of> A & B",
    [
        Column("case", "case"),
        Column("A_pC", "ours (pC)", 1, "electrode A"),
        Column("A_percent", "diff. (%)", 2, "electrode A", signed=True),
        Column("angle_deg", "angle (°)", None),
        Column("hidden", "hidden", on_page=False),
    ],
    [["r0", 803.4066832570486, -1.4731, 22.901, 1], ["r90", float("nan"), None, 90.0, 2]],
)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    TABLE.write_csv(tmp_path)
    (tmp_path / "one.svg").write_text("<svg xmlns='http://www.w3.org/2000/svg'/>")
    sections = [
        Section("first", "First <b>", ["a < b & c"], [Picture("one.svg", "A picture"), TABLE]),
        Section("second", "Second", error="ValueError: <script>alert(1)</script>"),
        Section("third", "Third", note="1 of 3 solves failed: unstable"),
    ]
    return Page("Title", ["Introduction"], sections, {"numpy": "2.0"}).write(tmp_path)


def test_links_and_images_are_there(path: Path) -> None:
    links = assert_links_work(path)
    assert {"#first", "#second", "#third", "one.svg", "table_1.csv"} <= set(links.targets)


def test_text_is_escaped(path: Path) -> None:
    links = parsed(path)
    assert "a < b & c" in links.text
    assert "<script>" not in path.read_text(encoding="utf-8")
    assert "First <b>" in links.text


def test_what_failed_stands_in_its_section_and_in_the_contents(path: Path) -> None:
    html = path.read_text(encoding="utf-8")
    contents, body = html.split("</nav>")
    assert "(failed)" in contents
    assert "1 of 3 solves failed" in contents
    assert "alert(1)" in body
    assert "1 of 3 solves failed" in body


def test_numbers_on_the_page_and_in_the_csv(path: Path) -> None:
    assert [[text for text, _ in row] for row in TABLE.shown_rows] == [
        ["r0", "803.4", "−1.47", "22.901"],
        ["r90", "–", "–", "90"],
    ]
    assert TABLE.groups == [("", 1), ("electrode A", 2), ("", 1)]
    with (path.parent / "table_1.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert float(rows[0]["A_pC"]) == 803.4066832570486
    assert rows[1] == {
        "case": "r90",
        "A_pC": "",
        "A_percent": "",
        "angle_deg": "90.0",
        "hidden": "2",
    }


def test_a_row_of_the_wrong_length_is_an_error(tmp_path: Path) -> None:
    table = Table("t", "", [Column("a", "a"), Column("b", "b")], [[1.0]])
    with pytest.raises(ValueError, match="zip"):
        Page("Title", [], [Section("s", "S", (), [table])]).html()


def test_nothing_comes_from_elsewhere(path: Path) -> None:
    assert not [t for t in parsed(path).targets if t.startswith(("http", "/", "file"))]


def test_a_page_is_read_back(path: Path) -> None:
    page = Page.read(path)
    assert page.html() == path.read_text(encoding="utf-8")
    assert [picture.file for picture in page.pictures] == ["one.svg"]


def test_a_preview_says_so_and_a_page_leads_home() -> None:
    plain, page = Page("Title", [], []), Page("Title", [], [], {}, True, "../index.html")
    assert "Preview" in page.html()
    assert '<a href="../index.html">' in page.html()
    assert not {"Preview", "All reports"} & set(plain.html().split())


def test_a_link_to_a_section_of_another_page_is_text() -> None:
    cells: list[list[Cell]] = [[Link("s", "Here")], [Link("elsewhere", "There")]]
    table = Table("t", "caption", [Column("a", "a")], cells)
    text = Page("Title", [], [Section("s", "S", (), [table])]).html()
    assert '<a href="#s">Here</a>' in text
    assert ">There</td>" in text


def test_long_and_wide_tables_have_classes_and_nothing_is_collapsed() -> None:
    columns = [Column(str(key), "head") for key in range(WIDE_COLUMNS + 1)]
    rows = [["cell"] * len(columns)] * (LONG_ROWS + 1)
    table = Table("t", "caption", columns, rows)
    assert table.size == "wide long"
    assert TABLE.size == ""
    assert Table("t", "", [Column("a", "a")], [["word " * 20]]).size == "wordy"
    text = Page("Title", [], [Section("s", "S", (), [table])]).html()
    assert text.count("<td") == len(rows) * len(columns)
    assert "<details" not in text


def test_numbers_and_lists_in_sentences() -> None:
    assert [signed(-1.25, 2), signed(0.5)] == ["−1.25", "+0.5"]
    assert [joined(["a", "b", "c"]), joined(["a"]), joined([])] == ["a, b and c", "a", ""]

"""Tables are read as they were written, in any dialect, or are refused by row and column."""

from __future__ import annotations

import math

from hypothesis import assume, given
from hypothesis import strategies as st

from pvdf_fem.readings.text.numbers import read_both_ways
from tests.readings.dialects import Dialect, read_table

SEPARATORS = [",", ";", "\t", "|", " "]
GROUPINGS = [
    "",
    ".",
    ",",
    "'",
    "\N{RIGHT SINGLE QUOTATION MARK}",
    " ",
    "\u00a0",
    "\u202f",
    "\u2009",
]
PREAMBLES = [
    (),
    ("sensor 7", "Date: 2024-05-02", "Channels: A,B,C,D", "Rate;1000"),
    ("LabVIEW Measurement\t", "Separator\tTab", "***End_of_Header***\t"),
    ("# bench 3", "% gain 1000 pF", "// nothing else"),
]
NUMBERS = st.tuples(st.integers(-4_000_000, 4_000_000), st.integers(0, 4))
ROWS = st.lists(
    st.lists(st.none() | NUMBERS, min_size=4, max_size=4).filter(
        lambda row: None in row[:1] or row
    ),
    min_size=1,
    max_size=6,
)


@st.composite
def dialects(draw):
    """Draw a dialect in which a table can be read at all."""
    separator = draw(st.sampled_from(SEPARATORS))
    decimal = draw(st.sampled_from([".", ","]))
    grouping = draw(st.sampled_from([each for each in GROUPINGS if each != decimal]))
    # Between commas a point is a decimal point, unless other cells have decimal commas.
    assume(not (separator == "," and grouping == "."))
    is_spaced = separator == " "
    unit_styles = ["", "{}_{}", "{} ({})", "{} [{}]"] + ([] if is_spaced else ["{} / {}", "{}, {}"])
    preamble = draw(st.sampled_from(PREAMBLES))
    if separator in ",;" and draw(st.booleans()):
        preamble = (f"sep={separator}",)
    return Dialect(
        separator=separator,
        decimal=decimal,
        grouping=grouping,
        minus=draw(st.sampled_from(["-", "\N{MINUS SIGN}"])),
        is_quoted=draw(st.booleans()),
        unit_style=draw(st.sampled_from(unit_styles)),
        has_unit_row=draw(st.booleans()),
        preamble=preamble,
        comments=draw(st.sampled_from([(), ("# touched at 3 s",), ("", "  ")])),
        row_end="" if is_spaced else draw(st.sampled_from(["", separator])),
        header_end="" if is_spaced else draw(st.sampled_from(["", separator])),
        line_end=draw(st.sampled_from(["\n", "\r\n", "\r"])),
        encoding=draw(st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "utf-16-le"])),
        missing="nan" if is_spaced else draw(st.sampled_from(["", "nan", "#DIV/0!", "--"])),
        padding="" if is_spaced or preamble[:1] == ("sep=;",) else draw(st.sampled_from(["", " "])),
        order=tuple(draw(st.permutations(range(5)))),
    )


def expected_rows(rows):
    """Return the numbers of rows, the times in s."""
    for row in rows:
        values = []
        for index, cell in enumerate(row):
            value = math.nan if cell is None else float(f"{cell[0]}e-{cell[1]}")
            values.append(value / 1e3 if index == 0 else value)
        yield values


@given(dialect=dialects(), rows=ROWS, times=st.data(), is_live=st.booleans())
def test_a_table_is_read_as_written_or_refused_as_ambiguous(dialect, rows, times, is_live):
    rows = [[times.draw(NUMBERS), *row] for row in rows]
    read = read_table(dialect.write(rows), is_live=is_live)
    has_units = bool(dialect.unit_style) or dialect.has_unit_row
    assert read.unit == ("mV" if has_units else None)
    assert len(read.rows) == len(rows)
    cells = [dialect.format_number(*cell) for row in rows for cell in row if cell]
    is_decided = any(len(read_both_ways(cell)) == 1 and set(cell) & set(".,") for cell in cells)
    for found, expected in zip(read.rows, expected_rows(rows), strict=True):
        if isinstance(found, str):
            assert "could be" in found
            assert is_live or not is_decided
        else:
            assert [*map(repr, found)] == [*map(repr, expected)]


@given(dialect=dialects(), rows=ROWS, data=st.data())
def test_a_damaged_row_is_refused_and_changes_no_other(dialect, rows, data):
    rows = [[(10_005, 4), *row] for row in [[(5, 1)] * 4, *rows]]
    lines = dialect.write(rows).decode(dialect.encoding).split(dialect.line_end)
    position = len(lines) - 1 - data.draw(st.integers(0, len(rows) - 2))
    damaged = data.draw(st.sampled_from(["oops", '"', dialect.join(["1"] * 5) + ";1|1 1\t1,1"]))
    lines.insert(position, damaged)
    read = read_table(dialect.line_end.join(lines).encode(dialect.encoding))
    is_refused = [isinstance(row, str) for row in read.rows]
    whole = read_table(dialect.write(rows))
    kept = [row for row in read.rows if not isinstance(row, str)]
    assert sum(is_refused) == 1
    assert str(kept) == str(whole.rows)

"""Columns of tables that are named by a choice of channels, or have the times of a rate."""

from __future__ import annotations

import io

import pytest

from pvdf_fem.files import FileError
from pvdf_fem.readings.formats import parse_csv
from pvdf_fem.readings.selection import NumberColumns, choose_readings, choose_times
from pvdf_fem.readings.table_channels import (
    add_times,
    make_channel_test,
    name_channels,
    suggest_channels,
)
from pvdf_fem.readings.text.csv_table import open_csv_table
from pvdf_fem.readings.text.header import make_name_test

ELECTRODES = ("A", "B")


def open_named(text, choice, *, rate_Hz=None, is_live=False):
    """Open a table as commands do, with a choice of channels."""
    has_name = make_name_test(ELECTRODES)
    is_channel = make_channel_test(choice)

    def is_wanted(column):
        return has_name(column) or is_channel(column)

    if is_live:
        table = open_csv_table(io.BytesIO(text.encode()), "a stream", is_wanted)
    else:
        table = parse_csv(text.encode(), "a file", is_wanted)
    table = name_channels(table, choice, ELECTRODES)
    return table if rate_Hz is None else add_times(table, rate_Hz)


def read_all(table):
    """Return the times, if there are any, and readings of all rows, with their unit."""
    readings, unit = choose_readings(table, ELECTRODES, None)
    times = choose_times(table)
    numbers = NumberColumns(table, [*([times] if times else []), *readings.values()])
    rows = [numbers.read(row) for batch in table.batches for row in batch]
    return rows, unit


@pytest.mark.parametrize(
    ("header", "choice"),
    [
        ("Channel A;Channel B", {"A": "Channel A", "B": "Channel B"}),
        ("AI A [V];AI B [V]", {"A": "ai a", "B": "AI B [V]"}),
        ("1;2", {"A": "1", "B": "2"}),
        ("ai0;ai1", {"A": "Dev1/ai0", "B": "Group/ai1"}),
        ("A;ai1", {"B": "ai1"}),
        ("B;A", {"A": "B", "B": "A"}),
        ("film 1;B", {"A": "film 1"}),
    ],
)
def test_columns_are_those_of_the_choice(header, choice):
    rows, unit = read_all(open_named(f"{header}\n0,5;1\n", choice))
    assert rows == [[0.5, 1.0]]
    assert unit == ("V" if "[V]" in header else None)


@pytest.mark.parametrize(("key", "scale"), [("t_s", 1.0), ("t_ms", 1e-3), ("t_us", 1e-6)])
def test_a_column_of_times_has_the_unit_of_the_choice(key, scale):
    table = open_named("Clock,A,B\n500,0.5,1\n501,0.5,1\n", {key: "Clock"})
    rows, _ = read_all(table)
    assert [row[0] for row in rows] == pytest.approx([500.0 * scale, 501.0 * scale])


def test_a_table_with_other_columns_is_read_by_the_names_of_electrodes():
    """As with channels of the scene, which are those of another file."""
    table = open_named("A,B\n0.5,1\n", {"A": "Film/ai0", "B": "Film/ai1"})
    assert read_all(table)[0] == [[0.5, 1.0]]
    (note,) = table.notes
    assert "Film/ai0, Film/ai1" in note


@pytest.mark.parametrize(
    ("header", "choice", "words"),
    [
        ("ai0,ai1", {"A": "ai0", "B": "ai7"}, ["no column ai7", "ai0, ai1", '"B=NAME"']),
        ("ai0,AI0", {"A": "ai0"}, ["ai0 and AI0"]),
        ("x,y", {"A": "ai0"}, ["no column ai0"]),
    ],
)
def test_a_column_that_is_missing_or_occurs_twice_is_named(header, choice, words):
    with pytest.raises(FileError) as error:
        open_named(f"{header}\n0.5,1\n", choice)
    for word in words:
        assert word in str(error.value)


@pytest.mark.parametrize("is_live", [True, False])
def test_rows_without_times_have_those_of_the_rate(is_live):
    """Rows that are malformed count, and headings may be fewer than cells."""
    text = "A;B;note\n0,5;1;\n0,6;2;x\n0,7\n0,8;4\n"
    table = open_named(text, {}, rate_Hz=4.0, is_live=is_live)
    readings, _ = choose_readings(table, ELECTRODES, None)
    numbers = NumberColumns(table, [choose_times(table), *readings.values()])
    found = {}
    for batch in table.batches:
        for row in batch:
            found[row.number] = row.defect or numbers.read(row)
            assert numbers.read_cell_or_nan(row, 0) == (row.number - 1) / 4.0
    assert found[1] == [0.0, 0.5, 1.0]
    assert "has 1 cell" in found[3]


def test_a_rate_is_refused_for_a_table_with_times():
    with pytest.raises(FileError, match="omit --rate"):
        open_named("t_s,A,B\n0,1,2\n", {}, rate_Hz=100.0)


def test_the_advice_names_the_columns_with_the_names_of_electrodes():
    table = parse_csv(b"Time;Kanal A;Kanal B [V]\n0;1,5;2\n", "a file", make_name_test(ELECTRODES))
    assert suggest_channels(table.columns, ELECTRODES) == "A=Kanal A,B=Kanal B"
    table = parse_csv(b"A (raw),B (raw)\n1,2\n", "a file", make_name_test(ELECTRODES))
    assert suggest_channels(table.columns, ELECTRODES) == "A=A (raw),B=B (raw)"


def test_the_advice_without_such_columns_has_a_word_to_replace():
    assert suggest_channels([], ELECTRODES) == "A=NAME"

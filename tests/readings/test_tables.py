"""Files as people and instruments write them: values, units, times, words and refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pvdf_fem.files import FileError
from tests.readings.dialects import read_table

NAN, INF = math.nan, math.inf


@pytest.mark.parametrize(
    ("cells", "values"),
    [
        ("1.200,28;1’200,28;1'200,28", 3 * [1200.28]),
        ("1\u00a0200,28;1\u202f200,28;1\u2009200,28", 3 * [1200.28]),
        ("1,200.28;1’200.28;1 200.28", 3 * [1200.28]),
        ('"1.200,28";"558,79";1.041', [1200.28, 558.79, 1041.0]),
        ("1,5E-3;\u22121,5e3;+,5", [1.5e-3, -1500.0, 0.5]),
        ("1.5D-3;5.;.5", [1.5e-3, 5.0, 0.5]),
        ("0.041;1.041;-1.041", [0.041, 1.041, -1.041]),
        ("1,234,567.8;1,041;12", [1234567.8, 1041.0, 12.0]),
        ("1.234.567;12;1", [1234567.0, 12.0, 1.0]),
        ("0.5;nan;NaN", [0.5, NAN, NAN]),
        ("0.5;#DIV/0!;", [0.5, NAN, NAN]),
        ("#NV;0.5;--", [NAN, 0.5, NAN]),
        ("OVER;-OVLD;OL", [INF, -INF, INF]),
        ("inf;-inf;UNDER", [INF, -INF, -INF]),
        ("9.9E+37;-9.9E37;9.91E37", [INF, -INF, NAN]),
        ("1;2;3", [1.0, 2.0, 3.0]),
    ],
)
def test_numbers_are_read_as_they_are_meant(cells, values):
    np.testing.assert_array_equal(read_table(f"A;B;C\n{cells}\n").rows, [values])


@pytest.mark.parametrize(
    ("text", "rows"),
    [
        ("A,B\n0.5,1.041\n", [[0.5, 1.041]]),
        ('A,B\n"558,79","1,041"\n', [[558.79, 1.041]]),
        ('A,B\n0.5,"1,041"\n', [[0.5, 1041.0]]),
        ("A,B\n2.113,1.041\n", [[2.113, 1.041]]),
        ("A\tB\n0,5\t1\n", [[0.5, 1.0]]),
        ("A|B\n0.5|1\n", [[0.5, 1.0]]),
        ('"A" \t "B"\n0.5 \t "1"\n', [[0.5, 1.0]]),
        ("  A      B\n 0.500  -1\n", [[0.5, -1.0]]),
        ("# A B\n0.5 1\n", [[0.5, 1.0]]),
        ("# A B\n0.5,1\n", [[0.5, 1.0]]),
        ("A,B\n0.5;1\n", [[0.5, 1.0]]),
        ("A\n558,79\n", [[558.79]]),
        ("A\n1.041\n", [[1.041]]),
        ("sep=;\r\nA;B\r\n0,5;1\r\n", [[0.5, 1.0]]),
        ('"sep=;"\nA;B\n0,5;1\n', [[0.5, 1.0]]),
        ("note,A,B\nx,0.5,1\n", [[0.5, 1.0]]),
        ("B, a \n1,0.5\n", [[0.5, 1.0]]),
        ("A;B_raw;C (left)\n0.5;9;9\n", [[0.5]]),
        ("A,B (raw),C (raw)\n0.5,9,9\n", [[0.5]]),
        ("A,a,B\n1,9,2\n", [[1.0, 2.0]]),
        ("A,B,comment\n0.5,1\n0.6,1,later\n", [[0.5, 1.0], [0.6, 1.0]]),
        ("A;B;\n0.5;1\n0.6;1;\n", [[0.5, 1.0], [0.6, 1.0]]),
        ("A,B\n0.5,1,\n0.6,1,,\n", [[0.5, 1.0], [0.6, 1.0]]),
        ("A,B\n0.5,1\n# end\n\n% end\n// end\n0.6,1\n", [[0.5, 1.0], [0.6, 1.0]]),
        ("Rate;1000\nA;left\nB;right\n\nA;B\n0,5;1\n", [[0.5, 1.0]]),
        ("Channels: A,B\nGain A: 2\nA,B\n0.5,1\n", [[0.5, 1.0]]),
        ("Channel;A;B\nRange;5;5\nUnit;V;V\n\ntime (s);A;B\n0;0,5;1\n", [[0.0, 0.5, 1.0]]),
        (" A | B \n---+---\n 0.5 | 1 \n", [[0.5, 1.0]]),
        ("x\t1\n***End_of_Header***\t\nA,B\n0.5,1\n", [[0.5, 1.0]]),
        ("A;B\n1.041;2.113\n0.5;1\n", [[1.041, 2.113], [0.5, 1.0]]),
        ("A;B;note\n1.041;2;x\n3;4;241,5\n", [[1041.0, 2.0], [3.0, 4.0]]),
        ('"Name","A","B"\n"Size","2","2"\n"Rate","1e3"\n"","0.5","1"\n', [[0.5, 1.0]]),
        ("Name,A,B\nref,0.5,1\n1,0.6,2\n", [[0.5, 1.0], [0.6, 2.0]]),
        ("Name;A;B\nx;0,5;1\ny;0,6;2\n", [[0.5, 1.0], [0.6, 2.0]]),
        ("boot\nA:0.5,B:1\nA:0.6,B:2\n", [[0.5, 1.0], [0.6, 2.0]]),
        ("A=0.5 B=1\nB=2\n", [[0.5, 1.0], [math.nan, 2.0]]),
    ],
)
def test_the_header_and_the_separator_are_found(text, rows):
    read = read_table(text)
    for found, row in zip(read.rows, rows, strict=True):
        np.testing.assert_array_equal(found, row)


@pytest.mark.parametrize("is_live", [True, False])
@pytest.mark.parametrize(
    "lines",
    [
        ["A,B", "0.5,1", "0.6,2"],
        ["A\tB", "0.5\t1", "0.6\t2"],
        ["Setup done", "A:0.5 B:1", "A:0.6 B:2"],
    ],
)
def test_times_that_a_serial_monitor_adds_are_read(lines, is_live):
    stamped = [f"10:00:00.{125 * i:03d} -> {line}" for i, line in enumerate(lines)]
    read = read_table("\n".join([*stamped, ""]), is_live=is_live)
    assert read.rows == [[0.0, 0.5, 1.0], [0.125, 0.6, 2.0]]


def test_labels_below_rows_of_numbers_are_not_those_of_a_serial_monitor():
    read = read_table("A,B\n0.5,1\nA=7,B=8\n0.6,2\n")
    assert [read.rows[0], read.rows[2]] == [[0.5, 1.0], [0.6, 2.0]]
    assert "'A=7' is not a number" in str(read.rows[1])


def test_units_are_found_in_a_block_below_the_header():
    """As instruments write it, with labels in the first column, which is empty in the rows."""
    block = '"Name","A","B"\n"Size","2","2"\n"VUnit","mV","mV"\n"HUnit","s"\n\n'
    read = read_table(f'{block}"","0.5","1"\n')
    assert (read.rows, read.unit) == ([[0.5, 1.0]], "mV")


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "latin-1"])
def test_any_usual_encoding_is_read(encoding):
    read = read_table("A (µV);B (µV)\r\n0,5;1\r\n".encode(encoding))
    assert (read.rows, read.unit) == ([[0.5, 1.0]], "µV")


@pytest.mark.parametrize(
    ("row", "reason"),
    [
        ("1.041;2.113", "row 1, column A: 1.041 could be 1.041 or 1041: write 1.0410 or 1041,0"),
        ("2,113;1,041", "row 1, column A: 2,113 could be 2.113 or 2113: write 2,1130 or 2113.0"),
        ("0,5;1.5", "row 1, column B: 1.5 has a decimal point"),
        ("0.5;1,5", "row 1, column B: 1,5 has a decimal comma"),
        ("0.5;oops", "row 1, column B: 'oops' is not a number"),
        ("0.5;1_000", "row 1, column B: '1_000' is not a number"),
        ("0.5;1.2.3", "row 1, column B: '1.2.3' is not a number"),
        ("0.5;1e999", "row 1, column B: 1e999 is too large"),
        ("0.5;1;2", "row 1 has 3 cells between semicolons, not 2"),
        ('0.5;"1', "row 1 has a quote that is not closed"),
    ],
)
def test_a_refusal_names_row_and_column(row, reason):
    [refused] = read_table(f"A;B\n{row}\n").rows
    assert isinstance(refused, str)
    assert refused.startswith(reason)


def test_decimal_commas_between_commas_are_refused():
    [refused] = read_table("A,B\n0,5,1,5\n").rows
    assert "decimal commas" in str(refused)
    [refused] = read_table('A,B\n"1,041","2,113"\n').rows
    assert "could be 1.041 or 1041" in str(refused)


def test_a_stream_decides_by_its_first_rows():
    read = read_table("A;B\n1.041;2\n1,5;2\n1.041;2\n1.5;2\n", is_live=True)
    assert [read.rows[1], read.rows[2]] == [[1.5, 2.0], [1041.0, 2.0]]
    assert "could be" in str(read.rows[0])
    assert "decimal point" in str(read.rows[3])


def test_words_in_place_of_numbers_are_counted():
    read = read_table("A,B\nOVER,1\nOVER,nan\n,-9.9E37\n")
    assert read.words == {("B", "nan"): 1}
    assert read.range_words == {("A", "OVER"): 2, ("B", "-9.9E37"): 1}


# ----------------------------------------------------------------------------------------- units


@pytest.mark.parametrize(
    ("header", "unit", "values"),
    [
        ("A (pC);B (nC)", "pC", [1.5, 2000.0]),
        ("A [V];B [mV]", "V", [1.5, 0.002]),
        ("A / µV;B / uV", "µV", [1.5, 2.0]),
        ("A_mV;B_V", "V", [0.0015, 2.0]),
        ("A in fC;B in C", "pC", [0.0015, 2e12]),
        ("A (mv);B (MV)", "mV", [1.5, 2.0]),
        ('"A, mV";"B, volts"', "V", [0.0015, 2.0]),
        ("A;B\nmV;V", "V", [0.0015, 2.0]),
        ("A;B\n[pC];[pC]", "pC", [1.5, 2.0]),
        ("A (mV);B\n(mV);(V)", "V", [0.0015, 2.0]),
        ("reading_pC.A;reading_pC.B", "pC", [1.5, 2.0]),
        ("A (VDC);B (mVDC)", "V", [1.5, 0.002]),
        ("A;B", None, [1.5, 2.0]),
    ],
)
def test_units_of_readings_are_converted(header, unit, values):
    read = read_table(f"{header}\n1,5;2\n")
    assert (read.rows, read.unit) == ([values], unit)


@pytest.mark.parametrize(
    ("header", "unit", "reason"),
    [
        ("A (mV);B (mV)", "pC", "column A .mV.: is in mV, but --unit says pC"),
        ("A (mV);B (mV)", "V", "but --unit says V"),
        ("A (mV);B", None, "column B: has no unit"),
        ("A (mV);B (pC)", None, "column B .pC.: is in pC, but A .mV. in mV"),
        ("A (N);B (V)", None, "column A .N.: is in N; give pC"),
        ("A (mV);A [V]", None, "columns A .mV. and A .V.: both may be A"),
        ("A (mV);B (mV)\nV;mV", None, "column A .mV.: is in V by the row of units"),
        ("A;B;A", None, "column A occurs twice"),
    ],
)
def test_units_and_names_that_do_not_fit_are_refused(header, unit, reason):
    with pytest.raises(FileError, match=reason):
        read_table(f"{header}\n1;2\n", unit=unit)


# ----------------------------------------------------------------------------------------- times


@pytest.mark.parametrize(
    ("heading", "cells", "times_s"),
    [
        ("t_s", ["0.5", "0.75"], [0.5, 0.75]),
        ("t_ms", ["500", "750"], [0.5, 0.75]),
        ("t_us", ["500", "750"], [500e-6, 750e-6]),
        ("t_µs", ["500", "750"], [500e-6, 750e-6]),
        ("time (s)", ["0.5", "0.75"], [0.5, 0.75]),
        ('"time, s"', ["0.5", "0.75"], [0.5, 0.75]),
        ("Time [ms]", ["500", "750"], [0.5, 0.75]),
        ("timestamp", ["2024-05-02T10:00:00.25Z", "2024-05-02T10:00:00.5Z"], [0.0, 0.25]),
        ("timestamp", ["2024-02-28 23:59:59.9", "2024-02-29 00:00:00.1"], [0.0, 0.2]),
        ("time", ["2024-05-02T10:00:00+02:00", "2024-05-02T08:00:01Z"], [0.0, 1.0]),
        ("time", ["02.05.2024 10:00:00,5", "02.05.2024 10:00:01,5"], [0.0, 1.0]),
        ("time", ["25/12/2024 11:59:59 PM", "26/12/2024 12:00:01 AM"], [0.0, 2.0]),
        ("time", ["01.02.24 10:00:00", "2.2.24 10:00:00"], [0.0, 86400.0]),
        ("time", ["31.12.99 23:59:59", "1.1.2000 00:00:00"], [0.0, 1.0]),
        ("time", ["10:00", "10:00:30"], [0.0, 30.0]),
        ("time", ["2024/5/2 10:00", "2024/5/2 10:01"], [0.0, 60.0]),
        ("Time", ["23:59:59.9", "00:00:00.1"], [0.0, 0.2]),
        ("timestamp", ["1714650000123", "1714650000124"], [0.0, 0.001]),
        ("timestamp", ["1714650000.25", "1714650000.5"], [0.0, 0.25]),
        ("timestamp", ["1714650000123456789", "1714650000123457789"], [0.0, 1e-6]),
    ],
)
@pytest.mark.parametrize("is_live", [True, False])
def test_times_are_read_in_seconds(heading, cells, times_s, is_live):
    rows = "".join(f"{cell};1;0.5\n" for cell in cells)
    read = read_table(f"{heading};A;B\n{rows}", is_live=is_live)
    assert [row[0] for row in read.rows] == pytest.approx(times_s, abs=1e-12)


@pytest.mark.parametrize(
    ("dates", "days"),
    [
        (["5/2/2024", "5/2/2024"], [0, 0]),
        (["5/2/2024", "5/3/2024", "5/4/2024"], [0, 1, 2]),
        (["30-1-2024", "31-1-2024", "1-2-2024", "2-2-2024"], [0, 1, 2, 3]),
        (["1/2/2024", "13/2/2024", "1/3/2024"], [0, 12, 29]),
        (["2/5/2024", "2/5/2024", "2/13/2024", "3/1/2024"], [0, 0, 8, 25]),
        (["12/12/2023", "13/12/2023", "1/1/2024", "2/1/2024"], [0, 1, 20, 21]),
    ],
)
def test_days_are_counted_in_dates_whose_order_the_next_day_tells(dates, days):
    rows = "".join(f"{date} 10:00:00;1\n" for date in dates)
    read = read_table(f"time;A\n{rows}")
    assert [row[0] for row in read.rows] == [86400.0 * day for day in days]


def test_dates_that_may_be_exchanged_and_times_without_a_unit_are_refused():
    *_, refused = read_table("time;A\n5/2/2024 10:00:00;1\n5/4/2024 10:00:00;1\n").rows
    assert "row 2, column time: 5/4/2024 has a day and a month" in str(refused)
    [refused] = read_table("time;A\n31/31/2024 10:00:00;1\n").rows
    assert "31/31/2024 is not a date" in str(refused)
    with pytest.raises(FileError, match=r"column time: has no unit.*t_s=time"):
        read_table("time;A\n0.5;1\n")
    with pytest.raises(FileError, match="column t: has no unit"):
        read_table("t;A\n0.5;1\n")

"""LVM files in the layouts that LabVIEW writes."""

import numpy as np
import pytest

from pvdf_fem.files import FileError
from tests.helpers.recordings import NAMES, make_samples, read_recording

SAMPLES = make_samples(6)


def make_header(x_columns="One", decimal=".", separator="Tab", multiple="No"):
    return (
        "LabVIEW Measurement\t\nWriter_Version\t2\nReader_Version\t2\n"
        f"Separator\t{separator}\nDecimal_Separator\t{decimal}\nMulti_Headings\t{multiple}\n"
        f"X_Columns\t{x_columns}\nTime_Pref\tAbsolute\nOperator\tme\n"
        f"Date\t2026/05/01\nTime\t12:00:00{decimal}2500000000000001\n***End_of_Header***\t\n\t\n"
    )


def make_segment(
    samples, x_columns="One", decimal=".", time="12:00:00.25", names=NAMES, first_s=0.0
):
    """Make a segment at 1 kHz; its header claims 100 samples, as those of LabVIEW may."""
    is_multiple = x_columns == "Multi"
    gap = "\t\t" if is_multiple else "\t"

    def line(key, cell):
        return f"{key}\t" + gap.join([cell] * 4) + "\t\n"

    text = "Notes\tof a film\n" + f"Channels\t4{gap}\n" + line("Samples", "100")
    text += line("Date", "2026/05/01") + line("Time", time) + line("Y_Unit_Label", "mV")
    text += line("X_Dimension", "Time") + line("X0", f"{first_s:.16E}")
    text += line("Delta_X", "1.000000E-3") + "***End_of_Header***\t\t\t\t\n"
    headings = "\tX_Value\t".join(names) if is_multiple else "\t".join(names)
    text += f"X_Value\t{headings}\tComment\n"
    for i, row in enumerate(samples):
        x = "" if x_columns == "No" else f"{first_s + 1e-3 * i:.6f}"
        cells = [f"{value:.6f}" for value in row]
        columns = f"\t{x}\t".join(cells) if is_multiple else "\t".join(cells)
        text += f"{x}\t{columns}" + ("\tpressed" if i == 0 else "") + "\n"
    if decimal == ",":
        text = text.replace(".", ",")
    return text + "\n"


@pytest.mark.parametrize("x_columns", ["No", "One", "Multi"])
@pytest.mark.parametrize("decimal", [".", ","])
@pytest.mark.parametrize("line_end", ["\n", "\r\n"])
def test_every_layout_of_times_and_decimals(tmp_path, x_columns, decimal, line_end):
    text = make_header(x_columns, decimal) + make_segment(SAMPLES, x_columns, decimal)
    (tmp_path / "r.lvm").write_bytes(text.replace("\n", line_end).encode())
    read = read_recording(tmp_path / "r.lvm")
    assert read.values == pytest.approx(SAMPLES, abs=1e-6)
    assert read.times_s == pytest.approx(1e-3 * np.arange(6))
    assert read.units == ["mV"] * 4
    assert read.recording.start.isoformat() == "2026-05-01T12:00:00.250000"


@pytest.mark.parametrize("x_columns", ["No", "One", "Multi"])
def test_segments_are_counted_from_the_start_of_the_file(tmp_path, x_columns):
    first = make_segment(SAMPLES, x_columns)
    second = make_segment(-SAMPLES, x_columns, time="12:00:03.75")
    text = make_header(x_columns, multiple="Yes") + first + second
    (tmp_path / "r.lvm").write_text(text)
    read = read_recording(tmp_path / "r.lvm")
    steps = 1e-3 * np.arange(6)
    assert read.values == pytest.approx(np.concatenate([SAMPLES, -SAMPLES]), abs=1e-6)
    assert read.times_s == pytest.approx(np.concatenate([steps, 3.5 + steps]))


def test_rows_without_headings_between_follow_each_other(tmp_path):
    text = make_header() + make_segment(SAMPLES).rstrip("\n") + "\n\n"
    text += "0.006000\t" + "\t".join(["0.5"] * 4) + "\n"
    (tmp_path / "r.lvm").write_text(text)
    read = read_recording(tmp_path / "r.lvm")
    assert read.times_s == pytest.approx(1e-3 * np.arange(7))
    assert read.values[-1] == pytest.approx([0.5] * 4)


def test_times_since_1904_are_counted_from_the_start(tmp_path):
    text = make_header() + make_segment(SAMPLES, first_s=3_860_481_600.25)
    (tmp_path / "r.lvm").write_text(text)
    read = read_recording(tmp_path / "r.lvm")
    assert read.times_s == pytest.approx(1e-3 * np.arange(6), abs=1e-5)


def test_commas_texts_of_other_programs_and_the_code_page_of_windows(tmp_path):
    text = make_header() + make_segment(SAMPLES)
    text = text.replace("\t", ",").replace("Separator,Tab", "Separator\tComma").replace("mV", "µV")
    text = text.replace(
        "***End_of_Header***,\n,\n",
        "***End_of_Header***\n***Start_Special***\nChannels,9\n***End_Special***\n\n",
        1,
    )
    (tmp_path / "r.lvm").write_bytes(text.encode("cp1252"))
    read = read_recording(tmp_path / "r.lvm")
    assert read.values == pytest.approx(SAMPLES, abs=1e-6)
    assert read.units == ["µV"] * 4


def test_empty_cells_are_missing(tmp_path):
    text = make_header() + make_segment(SAMPLES)
    text = text.replace(f"{SAMPLES[2, 1]:.6f}", "").replace(f"\t{SAMPLES[5, 3]:.6f}", "")
    (tmp_path / "r.lvm").write_text(text)
    expected = SAMPLES.copy()
    expected[2, 1] = np.nan
    expected[5, 3] = np.nan
    assert read_recording(tmp_path / "r.lvm").values == pytest.approx(
        expected, abs=1e-6, nan_ok=True
    )


def test_different_intervals_are_refused(tmp_path):
    text = make_header("Multi") + make_segment(SAMPLES, "Multi")
    text = text.replace("Delta_X\t1.000000E-3", "Delta_X\t2.000000E-3")
    (tmp_path / "r.lvm").write_text(text)
    with pytest.raises(FileError, match=r"intervals 1.000000E-3, 2.000000E-3 s"):
        read_recording(tmp_path / "r.lvm")


def test_a_header_without_data_is_refused(tmp_path):
    (tmp_path / "r.lvm").write_text(make_header())
    with pytest.raises(FileError, match="no segment with data"):
        read_recording(tmp_path / "r.lvm")

"""Pauses between the touches of a contact, and the onset of each."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pvdf_fem.inverse.tracking.charges.sample_buffer import BufferedSamples
from pvdf_fem.inverse.tracking.charges.touch_pauses import find_onset, find_pauses

DIRECTION = np.array([0.6, 0.8])


def make_rows(sizes, noise_pC=1e-3):
    """Make rows with charges of given sizes along one direction, one a second."""
    charges_pC = np.outer(sizes, DIRECTION)
    zeros = np.zeros_like(charges_pC)
    return BufferedSamples(
        np.arange(float(len(sizes))),
        charges_pC,
        noise_variance=np.full_like(charges_pC, noise_pC**2),
        walk_variance=zeros,
        drift_pC=zeros,
        sampling_variance=np.zeros(len(sizes)),
        is_clipped=zeros > 0.0,
        voltages=zeros,
    )


def make_touch(row_count, size):
    """Make the sizes of a touch, which are positive in all rows."""
    phase = (np.arange(row_count) + 0.5) / row_count
    return size * np.sin(np.pi * phase)


@given(
    counts=st.lists(st.integers(4, 30), min_size=1, max_size=5),
    gaps=st.lists(st.integers(2, 20), min_size=5, max_size=5),
    sizes=st.lists(st.floats(0.3, 1.0), min_size=5, max_size=5),
)
def test_each_pause_is_found_once(counts, gaps, sizes):
    parts = []
    expected = []
    start = 0
    for number, count in enumerate(counts):
        parts += [make_touch(count, sizes[number]), np.zeros(gaps[number])]
        start += count
        expected.append((start, start + gaps[number]))
        start += gaps[number]
    pauses = find_pauses(make_rows(np.concatenate(parts)))
    assert len(pauses) == len(counts) - 1
    for pause, (begin, end) in zip(pauses, expected, strict=False):
        assert pause.start <= begin
        assert pause.stop >= end


@pytest.mark.parametrize("lowest", [0.2, 0.5])
def test_a_force_that_falls_and_rises_again_is_one_touch(lowest):
    sizes = np.concatenate([make_touch(20, 1.0)[:18], np.full(10, lowest), make_touch(20, 0.9)[2:]])
    assert find_pauses(make_rows(sizes)) == []


def test_a_single_row_without_charges_is_no_pause():
    sizes = np.concatenate([np.ones(10), [0.0], np.ones(10)])
    assert find_pauses(make_rows(sizes)) == []


def test_the_onset_follows_a_disturbance_before_the_touch():
    """Hum before the touch swings to both sides of zero."""
    disturbance = 0.1 * np.sin(0.9 * np.arange(100))
    sizes = np.concatenate([disturbance, np.linspace(0.2, 1.0, 20)])
    onset_s = find_onset(make_rows(sizes), DIRECTION, largest_row=119)
    assert 100.0 - 2.0 * np.pi / 0.9 < onset_s < 100.0


def test_a_touch_that_presses_in_the_first_row_has_no_onset_in_its_rows():
    assert find_onset(make_rows(np.linspace(0.5, 1.0, 20)), DIRECTION, largest_row=19) is None

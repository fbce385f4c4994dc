"""The charges of a touch that has ended, without the drift of their integration."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.inverse.tracking.charges.charge_sample import ChargeSample
from pvdf_fem.inverse.tracking.charges.drift_bridge import Bridge, make_bridge
from pvdf_fem.inverse.tracking.charges.peak import choose_larger_peak, compute_peak
from pvdf_fem.inverse.tracking.charges.sample_buffer import BufferedSamples
from pvdf_fem.inverse.tracking.charges.touch_pauses import find_onset, find_pauses

#: Deviations from the charges after the end with which a touch has not ended yet.
END_DEVIATIONS = 4.0


@dataclass(frozen=True, eq=False)
class TouchRecord:
    """Charges of a touch that has ended, without drift."""

    onset_s: float  #: Last time before the peak at which the film was not pressed.
    end_s: float  #: Last time at which the charges differed from zero.
    rows: BufferedSamples
    largest: ChargeSample  #: Sample with the largest charges.
    peak: ChargeSample  #: Smoothed charges at the peak.


@dataclass(frozen=True, eq=False)
class ReleasedRows:
    """Charges of a contact from its onset until it has ended, with the drift of their integration.

    Parameters
    ----------
    rows : BufferedSamples
        The charges.
    last : ChargeSample
        Last sample.
    onset_s : float
        Time just before the first sample.
    still_count : int
        Number of rows after the end.
    kept_peak : ChargeSample, optional
        Peak from a time when the rows were finer.
    """

    rows: BufferedSamples
    last: ChargeSample
    onset_s: float
    still_count: int
    kept_peak: ChargeSample | None = None

    def subtract_drift(self) -> TouchRecord:
        """Subtract the drift from the charges.

        After the contact the charge must be zero, so that the measured residual is a drift. The
        errors of all samples are conditioned on this residual (Brownian bridge), and their
        conditional mean is subtracted.

        Returns
        -------
        TouchRecord
        """
        bridge = self._make_bridge()
        rows = self._correct_rows(bridge)
        kept = self.kept_peak and bridge.correct_sample(self.kept_peak)
        largest_row = int(np.argmax(np.linalg.norm(rows.charges_pC, axis=1)))
        largest = rows.get_sample(largest_row)
        released_s = find_onset(rows, largest.direction, largest_row)
        return TouchRecord(
            max(self.onset_s, released_s or self.onset_s),
            self._find_end(),
            rows=rows,
            largest=largest,
            peak=choose_larger_peak(compute_peak(rows), kept, rows),
        )

    def find_pauses(self) -> list[slice]:
        """Find the rows of the pauses between touches of the contact; see `touch_pauses`."""
        return find_pauses(self._correct_rows(self._make_bridge()))

    def select_until(self, pause: slice) -> ReleasedRows:
        """Return the rows of the first touch, until the end of the pause after it.

        Parameters
        ----------
        pause : slice
            Rows of the pause.

        Returns
        -------
        ReleasedRows
        """
        rows = self.rows.select(slice(pause.stop))
        return replace(
            self,
            rows=rows,
            last=rows.get_sample(-1),
            still_count=pause.stop - pause.start,
            kept_peak=self._keep_peak_within(rows),
        )

    def select_between(self, before: slice, after: slice) -> ReleasedRows:
        """Return the rows from a pause until the end of another, with zero charges in the first.

        Parameters
        ----------
        before, after : slice
            Rows of the pauses before and after a touch.

        Returns
        -------
        ReleasedRows
        """
        residual, noise_variance = average_charges(self.rows.select(before))
        middle = self.rows.get_sample((before.start + before.stop) // 2)
        start = replace(middle, charges_pC=residual, noise_variance=noise_variance)
        chosen = self.rows.select(slice(before.start, after.stop))
        rows = chosen._replace(**_subtract_errors(chosen, start))
        kept = self._keep_peak_within(chosen)
        is_end = after.stop == len(self.rows.time_s)
        last = self.last if is_end else chosen.get_sample(-1)
        return ReleasedRows(
            rows,
            last=replace(last, **_subtract_errors(last, start)),
            onset_s=middle.time_s,
            still_count=after.stop - after.start,
            kept_peak=kept and replace(kept, **_subtract_errors(kept, start)),
        )

    def _keep_peak_within(self, rows: BufferedSamples) -> ChargeSample | None:
        """Return the kept peak if its time is within that of some rows."""
        kept = self.kept_peak
        is_within = kept is not None and rows.time_s[0] <= kept.time_s <= rows.time_s[-1]
        return kept if is_within else None

    def _average_residual(self) -> tuple[Array, Array]:
        """Average the charges after the end; see `average_charges`."""
        return average_charges(self.rows.select(slice(-self.still_count, None)))

    def _make_bridge(self) -> Bridge:
        """Make the correction of charges by their residual at the end."""
        residual, noise_variance = self._average_residual()
        return make_bridge(
            residual, noise_variance, last=self.last, direction=self._find_direction()
        )

    def _find_direction(self) -> Array:
        """Return the unit vector along the largest charges, shape (electrodes,)."""
        sizes = np.linalg.norm(self.rows.charges_pC, axis=1)
        return self.rows.get_sample(int(np.argmax(sizes))).direction

    def _correct_rows(self, bridge: Bridge) -> BufferedSamples:
        """Return a copy of the rows without drift."""
        corrected = bridge.condition(self.rows)
        return self.rows._replace(
            charges_pC=corrected.charges_pC,
            walk_variance=corrected.walk_variance,
            drift_pC=np.zeros_like(self.rows.drift_pC),
            sampling_variance=corrected.sampling_variance,
        )

    def _find_end(self) -> float:
        """Find the last time at which the charges differed significantly from their residual.

        Returns
        -------
        float
            Time in s; that of the first sample if the charges never differed.
        """
        residual, noise_variance = self._average_residual()
        direction = self._find_direction()
        pressed = self.rows.select(slice(len(self.rows.time_s) - self.still_count))
        last = self.last
        walk = last.walk_variance - pressed.walk_variance
        since = walk + np.square(last.drift_pC - pressed.drift_pC)
        variance = since + pressed.noise_variance + noise_variance
        sizes = (pressed.charges_pC - residual) @ direction
        limits = END_DEVIATIONS * np.sqrt(variance @ np.square(direction))
        is_changed = np.flatnonzero(sizes > limits)
        return float(pressed.time_s[max(is_changed, default=0)])


def split_at_pauses(whole: ReleasedRows) -> list[TouchRecord]:
    """Split a contact that has ended at the pauses between its touches, and correct each.

    Parameters
    ----------
    whole : ReleasedRows
        Charges of the contact.

    Returns
    -------
    list of TouchRecord
        The touches in their order.
    """
    pauses = whole.find_pauses()
    if not pauses:
        return [whole.subtract_drift()]
    row_count = len(whole.rows.time_s)
    end = slice(row_count - whole.still_count, row_count)
    parts = [whole.select_until(pauses[0])]
    for before, after in pairwise([*pauses, end]):
        parts.append(whole.select_between(before, after))
    return [part.subtract_drift() for part in parts]


def average_charges(rows: BufferedSamples) -> tuple[Array, Array]:
    """Average the charges of rows, weighted by the inverse variance of their noise.

    Parameters
    ----------
    rows : BufferedSamples
        The rows.

    Returns
    -------
    mean : ndarray, shape (electrodes,)
        Mean charges in pC.
    variance : ndarray, shape (electrodes,)
        Variance of the mean in pC² due to the noise of the samples.
    """
    weights = 1.0 / rows.noise_variance
    variance = 1.0 / weights.sum(axis=0)
    return variance * (weights * rows.charges_pC).sum(axis=0), variance


def _subtract_errors(
    samples: ChargeSample | BufferedSamples, start: ChargeSample
) -> dict[str, Any]:
    """Return charges and accumulated errors of samples relative to those at a start.

    Parameters
    ----------
    samples : ChargeSample or BufferedSamples
        Samples.
    start : ChargeSample
        Charges and errors at the start. Their noise becomes a part of the random walk.
    """
    walk_variance = np.maximum(samples.walk_variance - start.walk_variance, 0.0)
    sampling_variance = np.maximum(samples.sampling_variance - start.sampling_variance, 0.0)
    return {
        "charges_pC": samples.charges_pC - start.charges_pC,
        "walk_variance": walk_variance + start.noise_variance,
        "drift_pC": samples.drift_pC - start.drift_pC,
        "sampling_variance": sampling_variance,
    }

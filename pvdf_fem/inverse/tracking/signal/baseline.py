"""The baseline: the channel voltages while nothing touches the film, and their noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pvdf_fem.arrays import Array, Mask
from pvdf_fem.inverse.tracking.options import TrackOptions
from pvdf_fem.inverse.tracking.signal.channel_baseline import ChannelBaseline, ChannelSnapshot
from pvdf_fem.inverse.tracking.signal.circuit import ReadoutCircuit


@dataclass(frozen=True, eq=False)
class SettledBaseline:
    """Straight lines through samples without a touch, in arrays of shape (electrodes,)."""

    time_s: float  #: Time of the last sample of the lines.
    level: Array  #: Voltages in V on the lines at this time.
    slope: Array  #: In V/s.
    residual: Array  #: Voltages in V that earlier touches have left at this time.
    noise_V: Array  #: Standard deviations of a voltage about the lines.
    count: Array  #: Number of voltages on each line; 0 for a channel without a signal.
    is_coloured: bool = False  #: Whether the noise is not white, so that it stays as it is here.


class Baseline:
    """Level, slope and noise of all channel voltages without a contact.

    A straight line per channel follows the samples. A contact leaves residual voltages, which decay
    through the resistances. They are estimated from the samples after the contact and added to the
    line. A channel that is missing or was restarted does not influence the others.

    The tracker adds each sample with a delay. By then, a contact that begins slowly in that sample
    would have been detected, so that it does not enter the baseline.

    Parameters
    ----------
    circuit : ReadoutCircuit
        Capacitances, resistances and noise of the channels.
    options : TrackOptions
        Memory of the filter and the minimum noise.
    """

    def __init__(self, circuit: ReadoutCircuit, options: TrackOptions) -> None:
        self.circuit = circuit
        decay_rates = (circuit.conductance / circuit.capacitance).tolist()
        min_noises_V = np.maximum(circuit.noise, options.min_noise_V).tolist()
        self._options = options
        self.channels = []
        for decay_rate, min_noise_V in zip(decay_rates, min_noises_V, strict=True):
            self.channels.append(ChannelBaseline(decay_rate, min_noise_V))

    @property
    def is_settled(self) -> Mask:
        """Mask of the channels whose line holds enough samples, shape (electrodes,)."""
        return np.array([channel.is_settled for channel in self.channels])

    @property
    def noise_V(self) -> Array:
        """Standard deviations of the voltages in V, shape (electrodes,).

        Each is at least the noise of the channel and `TrackOptions.min_noise_V`.
        """
        return np.array([channel.noise_V for channel in self.channels])

    @property
    def noise_count(self) -> int:
        """Smallest number of samples that the noise of a settled channel was estimated from."""
        counts = [channel.noise_count for channel in self.channels if channel.is_settled]
        return min(counts, default=0)

    def take_snapshots(self, drift_errors: Sequence[float]) -> list[ChannelSnapshot]:
        """Return the present state of each channel, which predicts voltages during a contact.

        Parameters
        ----------
        drift_errors : sequence of float
            Errors by drifts that the lines have not followed, relative to the noise.
        """
        snapshots = []
        for channel, drift_error in zip(self.channels, drift_errors, strict=True):
            snapshots.append(channel.take_snapshot(drift_error))
        return snapshots

    def set_lines(self, settled: SettledBaseline, interval_s: float) -> None:
        """Set the lines and the noise of all channels to those that were learned.

        Parameters
        ----------
        settled : SettledBaseline
            Lines and noise.
        interval_s : float
            Sampling interval, which the memory of the filter is set by.
        """
        options = self._options
        memory = max(options.memory_s / interval_s, options.min_memory_samples)
        for number, channel in enumerate(self.channels):
            channel.set_memory(memory)
            channel.set_line(
                settled.time_s,
                float(settled.level[number]),
                float(settled.slope[number]),
                noise_V=float(settled.noise_V[number]),
                count=int(settled.count[number]),
            )
            if settled.is_coloured:
                channel.set_min_noise(float(settled.noise_V[number]))
            residual = float(settled.residual[number])
            if residual and channel.line_count:  # else the channel had no reading
                channel.replace_residual(settled.time_s, residual, count=channel.line_count)

    def replace_residuals(self, times_s: Array, voltages: Array) -> None:
        """Replace the residuals by the means of the decayed voltages that a contact has left.

        Parameters
        ----------
        times_s : ndarray, shape (samples,)
            Times after the end of the contact.
        voltages : ndarray, shape (samples, electrodes)
            Voltages in V above the line at these times. A channel without any has no residual; a
            channel whose line is being learned starts again.
        """
        end_s = float(times_s[-1])
        decay = self.circuit.compute_decay(end_s - times_s)
        is_measured = ~np.isnan(voltages)
        counts = is_measured.sum(axis=0)
        sums = np.where(is_measured, voltages * decay, 0.0).sum(axis=0)
        means = sums / np.maximum(counts, 1)
        for channel, mean, count in zip(self.channels, means.tolist(), counts, strict=True):
            if channel.is_settled:
                channel.replace_residual(end_s, mean, max(int(count), 1))
            else:
                # The contact has changed the voltage that the channel is learned from.
                channel.forget_line()

    def add(self, time_s: float, voltages: Sequence[float], interval_s: float) -> None:
        """Update the channels with a sample without a contact.

        Parameters
        ----------
        time_s : float
            Time of the sample.
        voltages : sequence of float
            Voltages in V; NaN where they are missing.
        interval_s : float
            Sampling interval.
        """
        for channel, voltage in zip(self.channels, voltages, strict=True):
            if voltage == voltage:  # not NaN
                channel.add(time_s, voltage, interval_s)

    def has_changing_error(self) -> bool:
        """Whether the error of a channel changes quickly; see `ChannelBaseline`."""
        return any(channel.has_changing_error() for channel in self.channels)

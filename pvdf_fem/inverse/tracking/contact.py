"""One touch under way: its charges from the first sample on, and where it may be."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.inverse.touch.touch import compute_chi_square_limit
from pvdf_fem.inverse.tracking.circuit import ChargeIntegrator, ReadoutCircuit
from pvdf_fem.inverse.tracking.contact_problem import CandidatePlaces, ChargeSample, ContactProblem
from pvdf_fem.surrogate.touch_domain import TouchColumn


class Contact:
    """A touch under way."""

    def __init__(
        self, model: ContactProblem, circuit: ReadoutCircuit, time: float, before: Array
    ) -> None:
        """Begin at a time just before the touch; `before` are the voltages left by others."""
        self.model, self.options, self.onset, self.end = model, model.options, time, time
        self.history: list[ChargeSample] = []
        self.places: CandidatePlaces | None = None  #: By the charges at their peak.
        #: The likeliest touch at the last sample, and chi-square of its charges.
        self.at, self.chi_square = np.full(4, math.nan), math.nan
        self.largest = 0  #: Number of the sample with the largest charges.
        self.impulse = 0.0  #: Integral of the force in N s.
        self.voltages = [before]  #: Voltages over the baseline, from the beginning on.
        self.rested = 0  #: Number of the last samples after the end.
        self._circuit, self._sum = circuit, ChargeIntegrator(circuit, time, before)
        self._located = self.options.first  #: Number of samples when the place was last sought.

    def add(self, time: float, voltage: Array, noise: Array, drift: Array) -> None:
        """Take in a sample. Voltages are those over the baseline, NaN where missing, and `noise`
        their deviations in V; `drift` is the deviation in pC of the baseline's error by now."""
        charges = self._sum.add(time, voltage, noise)
        white = np.square(self._circuit.capacitance * noise)
        white[np.isnan(voltage)] = ChargeSample.UNHEARD
        sample = ChargeSample(time, charges, white, self._sum.variance, drift, self._sum.missed)
        self.history.append(sample)
        self.voltages.append(voltage)
        count, again = len(self.history), self.options.again if self.places else 0.0
        if np.linalg.norm(charges) > np.linalg.norm(self.history[self.largest].charges):
            self.largest = count - 1
        if count >= (1.0 + again) * self._located:
            peak = self._peak()
            if peak.significance > self.options.significant:
                self._located = count
                self.places = self.model.located(peak) or self.places
        if self.places:
            self.at, self.chi_square = self.model.pressed(self.places.at[0], sample)
            self.impulse += (time - self.end) * math.exp(self.at[TouchColumn.FORCE])
        self.end = time

    @property
    def charges(self) -> Array:
        """Charges (samples, electrodes) of the whole course in pC."""
        return np.array([sample.charges for sample in self.history])

    def _peak(self) -> ChargeSample:
        """The charges at their peak, on a parabola through as many samples as three deviations of
        the noise may have made the largest, where their mean is largest. The largest charges
        themselves are where noise is largest, too."""
        charges, largest = self.charges, self.history[self.largest]
        sizes = np.linalg.norm(charges, axis=1)
        spread = math.sqrt(np.square(self._unit[largest.heard]) @ largest.noise[largest.heard])
        half = (int((sizes >= sizes.max() - 3.0 * spread).sum()) - 1) // 2
        apart = np.arange(-half, half + 1)
        weights = np.linalg.pinv(np.vander(apart, min(3, len(apart))))[-1]
        first = int(np.argmax(np.convolve(sizes, np.ones(len(apart)), "valid")))
        window = slice(first, first + len(apart))
        noise = np.array([sample.noise for sample in self.history[window]])
        each = weights[:, None] * (noise < ChargeSample.UNHEARD)
        share = each.sum(axis=0)
        noise = (np.square(each) * noise).sum(axis=0)
        heard = share > 0.5
        share = np.where(heard, share, 1.0)
        return replace(
            self.history[first + half],
            charges=(each * charges[window]).sum(axis=0) / share,
            noise=np.where(heard, noise / np.square(share), ChargeSample.UNHEARD),
        )

    def _mean(self, first: int, count: int) -> tuple[Array, Array]:
        """Mean charges of some samples, and the variance of the mean by their noise."""
        samples = self.history[first:][:count]
        weights = 1.0 / np.array([sample.noise for sample in samples])
        variance = 1.0 / weights.sum(axis=0)
        charges = np.array([sample.charges for sample in samples])
        return variance * (weights * charges).sum(axis=0), variance

    def _rested(self, share: float) -> int:
        """Number of the last samples, a share of all, whose mean charges are the mean of as many
        before; 0 if they are not."""
        count = max(self.options.still, int(share * len(self.history)))
        if len(self.history) <= 2 * count:
            return 0
        (early, white), (late, noise) = self._mean(-2 * count, count), self._mean(-count, count)
        variance = self._since(self.history[-2 * count]) + white + noise
        return count if _is_noise(late - early, variance) else 0

    def _since(self, sample: ChargeSample) -> Array:
        """Variance in pC² of what has summed up since a sample, (electrodes,)."""
        last = self.history[-1]
        return last.walked - sample.walked + np.square(last.drift - sample.drift)

    def ended(self) -> bool:
        """Whether the charges do not change any longer, and are none by what their errors may be.
        Where they are hardly any, they must not change for longer."""
        self.rested = count = self._rested(self.options.still_share)
        if not count:
            return False
        largest = self.history[self.largest]
        left, noise = self._mean(-count, count)
        if _is_noise(left, self._total + noise):
            # charges may come out of the noise only later
            came = largest.charges - left, self._total + noise + largest.noise
            return len(self.history) > self.options.patience or not _is_noise(*came)
        is_small = left @ largest.charges < self.options.left * np.square(largest.charges).sum()
        return bool(is_small and self._rested(4.0 * self.options.still_share))

    @property
    def _unit(self) -> Array:
        """Direction of the largest charges, (electrodes,)."""
        return self.history[self.largest].direction

    @property
    def _total(self) -> Array:
        """Variances in pC² of all that has summed up since the onset, (electrodes,)."""
        last = self.history[-1]
        return last.walked + np.square(last.drift) + last.missed * np.square(self._unit)

    def lost(self) -> bool:
        """Whether the errors have grown over the charges, or no place was found in time."""
        deviation = np.linalg.norm(np.sqrt(self._total))
        largest = np.linalg.norm(self.history[self.largest].charges)
        drowned = self.places is None or deviation > self.options.lost * largest
        return bool(drowned) and len(self.history) > self.options.memory

    def after(self) -> tuple[float, Array]:
        """Time of the last sample but those after the end, and their voltages (n, electrodes)."""
        count = max(self.rested, 1)
        times = [self.onset, *(sample.time for sample in self.history)]
        return times[-1 - count], np.array(self.voltages[-count:])

    def close(self) -> None:
        """Locate the touch by what its end tells: no charge is left, so that what is was an error.
        The errors' walk is a bridge between onset and end then."""
        (left, noise), along = self._mean(-self.rested, self.rested), np.square(self._unit)
        total, pressed = self._total + noise, self.history[: -self.rested]
        sizes = (np.array([sample.charges for sample in pressed]) - left) @ self._unit
        apart = np.array([self._since(sample) + sample.noise + noise for sample in pressed])
        changed = np.flatnonzero(sizes > 4.0 * np.sqrt(apart @ along))
        self.end = pressed[max(changed, default=0)].time
        self.history = [self._bridged(sample, left, total) for sample in self.history]
        self.largest = int(np.argmax(np.linalg.norm(self.charges, axis=1)))
        self.places = self.model.located(self._peak())

    def _bridged(self, sample: ChargeSample, left: Array, total: Array) -> ChargeSample:
        """A sample whose errors are such that charges `left` of a variance `total` are none."""
        last, along = self.history[-1], np.square(self._unit)
        shared = sample.walked + sample.drift * last.drift
        of_missed = sample.missed * along
        missed = last.missed + float(along @ (total - last.missed * along))
        summed = sample.walked + np.square(sample.drift) - np.square(shared) / total
        return replace(
            sample,
            charges=sample.charges - left * (shared + of_missed) / total,
            walked=np.maximum(summed, 0.0),
            drift=np.zeros_like(left),
            missed=sample.missed * (1.0 - sample.missed / missed),
        )


def _is_noise(difference: Array, variance: Array) -> bool:
    """Whether errors with a variance (electrodes,) commonly make such a difference."""
    return bool(
        np.square(difference) @ (1.0 / variance) < compute_chi_square_limit(len(difference))
    )

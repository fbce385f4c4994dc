"""One touch under way: its charges from the first sample on, and where it may be."""

from __future__ import annotations

import math
from copy import copy
from dataclasses import replace

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.response.model import FORCE
from pvdf_fem.touch.problem import Problem
from pvdf_fem.touch.search import DEFAULTS, location, search
from pvdf_fem.touch.touch import common_limit
from pvdf_fem.tracking.circuit import ChargeSum
from pvdf_fem.tracking.course import ChangeModel, Places, Sample, fitted
from pvdf_fem.tracking.options import TrackOptions


class Contact:
    """A touch under way."""

    def __init__(
        self, model: ChangeModel, options: TrackOptions, time: float, before: Array
    ) -> None:
        """Begin at a time just before the touch; `before` are the voltages left by others."""
        self.model, self.options, self.onset, self.end = model, options, time, time
        self.history: list[Sample] = []
        self.places: Places | None = None
        #: The likeliest touch at the last sample, and chi-square of its charges.
        self.at, self.chi_square = np.full(4, math.nan), math.nan
        #: Number of the sample with the largest charges, and the integral of the force in N s.
        self.peak, self.impulse = 0, 0.0
        self.voltages = [before]  #: Voltages over the baseline, from the beginning on.
        self.rested = 0  #: Number of the last samples after the end.
        self._aside = np.zeros_like(before)  #: Variance in pC² of missed charge off the direction.
        self._sum = ChargeSum(model.circuit, time, before)
        self._located = options.first  #: Number of samples when the place was last sought.

    def add(self, time: float, voltage: Array, noise: Array, doubt: Array) -> None:
        """Take in a sample. Voltages are those over the baseline, NaN where missing, and `noise`
        their deviations in V; `doubt` is the variance in pC² of the baseline's error by now."""
        charges = self._sum.add(time, voltage, noise)
        white = np.square(self.model.circuit.capacitance * noise)
        white[np.isnan(voltage)] = Sample.UNHEARD
        along = np.square(charges) / max(charges @ charges, math.ulp(0.0))
        self._aside = np.maximum(
            self._aside, self.options.skew**2 * self._sum.missed * along
        )  # errors only grow
        walked = self._sum.variance + doubt + self._aside
        sample = Sample(time, charges, white, walked, self._sum.missed)
        self.history.append(sample)
        self.voltages.append(voltage)
        count, options = len(self.history), self.options
        if np.linalg.norm(charges) > np.linalg.norm(self.history[self.peak].charges):
            self.peak = count - 1
        is_due = count >= (1.0 + options.again * (self.places is not None)) * self._located
        if is_due and self._telling(sample) and sample.significance > options.significant:
            self._located = count
            self._fit(self._candidates(sample), count - 1)
        if self.places:
            self.at, self.chi_square = self.model.pressed(self.places.at[0], sample)
            self.impulse += (time - self.end) * math.exp(self.at[FORCE])
        self.end = time

    def _telling(self, sample: Sample) -> bool:
        largest = self.history[self.peak].charges
        least = self.options.telling * np.linalg.norm(largest)
        return bool(np.linalg.norm(sample.charges) >= least)

    def _fit(self, others: Array, last: int, total: Array | float = np.inf) -> None:
        """Fit the known places, and others, to telling samples of the whole course, one of them
        last. The variance of errors walks on to `total` (electrodes,), where they are known."""
        starts = np.concatenate([others, self.places.at]) if self.places else others
        if not len(starts):
            return
        telling = [k for k, sample in enumerate(self.history) if self._telling(sample)]
        chosen = np.linspace(0, len(telling) - 1, self.options.fitted).round().astype(int)
        numbers = {telling[k] for k in chosen.tolist()} - {last}
        samples = [self.history[k] for k in (*sorted(numbers), last)]
        self.places = fitted(self.model, starts, samples, total)

    def _candidates(self, sample: Sample) -> Array:
        """Coordinates (n, 4) of the likely touches that explain the charges of one sample; none
        where the likeliest is lighter than the model knows."""
        model, heard = self.model, np.flatnonzero(sample.heard)
        if not len(heard):
            return np.empty((0, 4))
        total = (sample.charges + model.rest_pC)[heard]
        error = model.model.error_bound * total
        spread = np.sqrt(sample.variance[heard] + np.square(error))
        problem = Problem(model.model, heard, total[None], spread[None], model.unknown)
        with np.errstate(divide="ignore", invalid="ignore"):  # charges may be far from any touch's
            ends = search(problem, model.known, DEFAULTS)
        touches = location(problem, ends).touches[: self.options.places]
        at = np.array([touch.values for touch in touches]).reshape(-1, 4)
        at[:, FORCE] = np.log(at[:, FORCE])
        return at if len(at) and at[0, FORCE] > model.least else at[:0]

    @property
    def charges(self) -> Array:
        """Charges (samples, electrodes) of the whole course in pC."""
        return np.array([sample.charges for sample in self.history])

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
        walked = self.history[-1].walked - self.history[-2 * count].walked
        return count if _is_noise(late - early, walked + white + noise) else 0

    def ended(self) -> bool:
        """Whether the charges do not change any longer, and are none by what their errors may be.
        Where they are hardly any, they must not change for longer."""
        self.rested = count = self._rested(self.options.still_share)
        if not count:
            return False
        largest = self.history[self.peak].charges
        left, noise = self._mean(-count, count)
        if _is_noise(left, self._total + noise):
            # charges may come out of the noise only later
            came = largest - left, self._total + noise + self.history[self.peak].noise
            return len(self.history) > self.options.patience or not _is_noise(*came)
        is_small = left @ largest < self.options.left * (largest @ largest)
        return bool(is_small and self._rested(4.0 * self.options.still_share))

    @property
    def _unit(self) -> Array:
        """Direction of the largest charges, (electrodes,)."""
        largest = self.history[self.peak].charges
        return np.asarray(largest / np.linalg.norm(largest))

    @property
    def _total(self) -> Array:
        """Variances in pC² of all that has summed up since the onset, (electrodes,)."""
        return self.history[-1].walked + self.history[-1].missed * np.square(self._unit)

    def lost(self) -> bool:
        """Whether the errors have grown over the charges, or no place was found in time."""
        deviation = np.linalg.norm(np.sqrt(self.history[-1].walked))
        largest = np.linalg.norm(self.history[self.peak].charges)
        drowned = self.places is None or deviation > self.options.lost * largest
        return bool(drowned) and len(self.history) > self.options.memory

    def _smooth_peak(self) -> int:
        """Number of the sample with the largest mean of charges about it. The largest charges
        themselves are where noise is largest, too. The mean is over a quarter of as many samples as
        four deviations of the noise may have made the largest."""
        charges, heard = self.charges, self.history[self.peak].heard
        sizes, noise = np.linalg.norm(charges, axis=1), self.history[self.peak].noise
        along = charges[self.peak] / sizes[self.peak]
        spread = math.sqrt(np.square(along[heard]) @ noise[heard])
        width = max(int((sizes >= sizes.max() - 4.0 * spread).sum()) // 4, 1)
        return int(np.argmax(np.convolve(sizes, np.full(width, 1.0 / width), "same")))

    def after(self) -> tuple[float, Array]:
        """Time of the last sample but those after the end, and their voltages (n, electrodes)."""
        count = max(self.rested, 1)
        times = [self.onset, *(sample.time for sample in self.history)]
        return times[-1 - count], np.array(self.voltages[-count:])

    def closed(self) -> Contact:
        """The touch with what its end tells: no charge is left, so that what is was an error. The
        errors' walk is a bridge between onset and end then. The touch is that at its peak."""
        last, count = self.history[-1], self.rested
        (left, noise), along = self._mean(-count, count), np.square(self._unit)
        total, missed = self._total + noise, last.missed + float(along @ (last.walked + noise))
        closed = copy(self)
        size = (self.charges[:-count] - left) @ self._unit
        walks = [along @ (last.walked - s.walked + s.noise) for s in self.history[:-count]]
        changed = np.flatnonzero(size > 4.0 * np.sqrt(np.array(walks) + along @ noise))
        closed.end = self.history[max(changed, default=0)].time
        closed.history = [
            replace(
                s,
                charges=s.charges - left * (s.walked + s.missed * along) / total,
                missed=s.missed * (1.0 - s.missed / missed),
            )
            for s in self.history
        ]
        closed.peak = closed._smooth_peak()
        closed._fit(closed._candidates(closed.history[closed.peak]), closed.peak, total)
        if closed.places:
            closed.at = closed.places.at[0]
        return closed


def _is_noise(difference: Array, variance: Array) -> bool:
    """Whether errors with a variance (electrodes,) commonly make such a difference."""
    return bool(np.square(difference) @ (1.0 / variance) < common_limit(len(difference)))

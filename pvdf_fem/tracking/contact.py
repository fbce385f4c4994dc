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
from pvdf_fem.tracking.onset import missed_charge

UNKNOWN = 1e12  #: Variance in pC² of a charge that is not known.
#: Charges are located when they are this many deviations large, and again as they grow by a factor.
ENOUGH = 15.0
GROWTH = 1.3
#: Most places that are followed, and samples of the course that they are fitted to.
MOST = 6
FITTED = 16
MORE = 0.1  #: Places are fitted again when there are more samples by this share.
TELLING = 0.3  #: Share of the largest charges that a sample needs to tell of the place.
#: Samples after the onset before the first search; up to more the onset is corrected again.
FIRST_SEARCH = 6
ONSET_SAMPLES = 24
SLOW = 0.1  #: Share of a voltage lost in a sample below which sampling misses little.
#: Relative error of charges by what sampling misses at an onset or an end that is not corrected,
#: where it may be large.
ONSET_ERROR = 0.05
#: Charges may be at their largest where they are this many deviations below the largest.
AT_PEAK = 4.0
STILL = 12  #: Samples over which charges must not change for a touch to have ended.
#: A touch has ended when this share of its largest charges is left, or, after a number of samples
#: in which the charges of a light one come out of the noise, this many deviations.
ENDED = 0.2
INSIGNIFICANT = 4.0
PATIENCE = 100
LOST = 0.3  #: It is lost when the deviations of charges are this share of its largest, then.
#: Mean chi-square per degree of freedom above which places are searched for anew, and the share of
#: a new sample in it.
BAD = 4.0
FORGET = 1.0 / 16.0


class Contact:
    """A touch under way."""

    def __init__(self, model: ChangeModel, time: float, before: Array) -> None:
        """Begin at a time just before the touch; `before` are the voltages left by others."""
        self.model, self.onset, self.end = model, time, time
        self.history: list[Sample] = []
        self.places: Places | None = None
        #: The likeliest touch at the last sample, and chi-square of its charges.
        self.at, self.chi_square = np.full(4, math.nan), math.nan
        self.strain = 1.0  #: Mean chi-square of the last samples over its degrees of freedom.
        #: Number of the sample with the largest charges, and the integral of the force in N s.
        self.peak, self.impulse = 0, 0.0
        self._sum = ChargeSum(model.circuit, time, before)
        self.voltages = [before]  #: Voltages over the baseline, from the beginning on.
        self._missed, self._onset_error = np.zeros_like(before), ONSET_ERROR
        self._searched, self._fitted, self._corrected = 0.0, 0, False

    def add(self, time: float, voltage: Array, noise: Array, doubt: Array) -> None:
        """Take in a sample. Voltages are those over the baseline, NaN where missing, and `noise`
        their deviations in V; `doubt` is the variance in pC² of the baseline's error by now."""
        charges = self._sum.add(time, voltage, noise) + self._missed
        white = np.square(self.model.circuit.capacitance * noise)
        white[np.isnan(voltage)] = UNKNOWN
        sample = Sample(time, charges, white, self._sum.variance + doubt)
        self.history.append(sample)
        self.voltages.append(voltage)
        if np.linalg.norm(charges) > np.linalg.norm(self.history[self.peak].charges):
            self.peak = len(self.history) - 1
        count = len(self.history)
        larger = self._significance > max(ENOUGH, GROWTH * self._searched)
        if count >= FIRST_SEARCH and larger:
            self._search()
        elif self.places and self._telling(sample) and count > (1.0 + MORE) * self._fitted:
            self._fit(self.places.at[:0])
            if self.strain > BAD:
                self._search()
        if self.places:
            self.at, self.chi_square = self.model.pressed(self.places.at[0], sample)
            freedom = max(int((white < UNKNOWN).sum()) - 1, 1)
            self.strain += FORGET * (self.chi_square / freedom - self.strain)
            self.impulse += (time - self.end) * math.exp(self.at[FORCE])
        self.end = time

    @property
    def _significance(self) -> float:
        """Size of the charges of the last sample in standard deviations."""
        last = self.history[-1]
        return float(np.linalg.norm(last.charges / np.sqrt(last.walked + last.noise)))

    def _telling(self, sample: Sample) -> bool:
        largest = self.history[self.peak].charges
        return bool(np.linalg.norm(sample.charges) >= TELLING * np.linalg.norm(largest))

    def _search(self) -> None:
        """Look for all places that explain the charges of the last sample, then the course."""
        self._searched, self.strain = self._significance, 1.0
        at = self._candidates(-1)
        if len(at) and (len(self.history) <= ONSET_SAMPLES or not self._corrected):
            self._correct_onset(at[0])
            at = self._candidates(-1)
        self._fit(at)

    def _fit(self, others: Array) -> None:
        """Fit the known places and others to the course, the last sample last."""
        last, self._fitted = len(self.history) - 1, len(self.history)
        error = math.hypot(self._onset_error, self._jump_error())
        common = error * np.abs(self.history[-1].charges)
        none = np.zeros_like(common)
        self._fit_places(others, last, none, none + np.inf, common)

    def _fit_places(
        self, others: Array, last: int, begin: Array, total: Array, common: Array
    ) -> None:
        """Fit the places, and others, to telling samples of the whole course, one of them last. The
        variance of errors walks from `begin` on to `total`, at whose end they are known."""
        starts = np.concatenate([others, self.places.at]) if self.places else others
        if not len(starts):
            return
        telling = [k for k, sample in enumerate(self.history) if self._telling(sample)]
        chosen = np.linspace(0, len(telling) - 1, FITTED).round().astype(int)
        numbers = {telling[k] for k in chosen.tolist()} - {last}
        samples = [self.history[k] for k in (*sorted(numbers), last)]
        walked = begin[:, None] + np.array([sample.walked for sample in samples]).T
        noise = np.array([sample.noise for sample in samples]).T[:, :, None] * np.eye(len(samples))
        errors = np.minimum(walked[:, :, None], walked[:, None]) + noise
        errors -= walked[:, :, None] * walked[:, None] / total[:, None, None]
        self.places = fitted(self.model, starts, samples, errors, common)

    def _candidates(self, number: int) -> Array:
        """Coordinates (n, 4) of the likely touches that explain the charges of one sample; none
        where the likeliest is lighter than the model knows."""
        model, sample = self.model, self.history[number]
        heard = np.flatnonzero(sample.noise < UNKNOWN)
        if not len(heard):
            return np.empty((0, 4))
        total = (sample.charges + model.rest_pC)[heard]
        response, unknown = model.model, model.unknown
        error = response.error_bound * total
        spread = np.sqrt((sample.walked + sample.noise)[heard] + np.square(error))
        problem = Problem(response, heard, total[None], spread[None], unknown)
        with np.errstate(divide="ignore", invalid="ignore"):  # charges may be far from any touch's
            ends = search(problem, model.known, DEFAULTS)
        touches = location(problem, ends).touches
        at = np.array([touch.values for touch in touches[:MOST]]).reshape(-1, 4)
        at[:, FORCE] = np.log(at[:, FORCE])
        return at if len(at) and at[0, FORCE] > model.least else at[:0]

    def _correct_onset(self, at: Array) -> None:
        """Add the charge that sampling misses at the onset."""
        circuit, before = self.model.circuit, self._missed
        times = np.array([self.onset, *(sample.time for sample in self.history)])
        self._corrected, self._onset_error = True, 0.0
        if self._loss < SLOW:
            return
        noise = np.sqrt(self.history[-1].noise) / circuit.capacitance
        voltages = np.array(self.voltages)
        self._missed, self._onset_error = missed_charge(self.model, at, times, voltages, noise)
        self.history = [
            replace(sample, charges=sample.charges + self._missed - before)
            for sample in self.history
        ]

    @property
    def _loss(self) -> float:
        """Largest share of a voltage that is lost in the first interval."""
        return 1.0 - float(self.model.circuit.decay(self.history[0].time - self.onset).min())

    @property
    def _charges(self) -> Array:
        """Charges (samples, electrodes) of the whole course in pC."""
        return np.array([sample.charges for sample in self.history])

    def _jump_error(self) -> float:
        """Relative error of charges by what sampling misses of a jump, where voltages decay slowly:
        it comes anywhere within an interval, for half of which its decay is told."""
        if not self._corrected or self._loss >= SLOW:
            return 0.0
        charges = self._charges
        jump = np.linalg.norm(np.diff(charges, axis=0, prepend=0.0), axis=1).max()
        size = np.linalg.norm(charges[self.peak])
        return float(self._loss / math.sqrt(12.0) * jump / size)

    def _smooth_peak(self) -> int:
        """Number of the sample with the largest mean of charges about it. The largest charges
        themselves are where noise is largest, too. The mean is over a quarter of as many samples as
        noise may have made the largest."""
        charges = self._charges
        sizes, noise = np.linalg.norm(charges, axis=1), self.history[self.peak].noise
        heard = noise < UNKNOWN
        along = charges[self.peak] / sizes[self.peak]
        spread = math.sqrt(np.square(along[heard]) @ noise[heard])
        width = max(int((sizes >= sizes.max() - AT_PEAK * spread).sum()) // 4, 1)
        return int(np.argmax(np.convolve(sizes, np.full(width, 1.0 / width), "same")))

    def ended(self) -> bool:
        """Whether the charges do not change any longer, and hardly any are left."""
        if len(self.history) <= STILL:
            return False
        last, before, largest = (self.history[k] for k in (-1, -1 - STILL, self.peak))
        heard = (last.noise < UNKNOWN) & (before.noise < UNKNOWN)
        variance = last.walked - before.walked + last.noise + before.noise
        change = np.square(last.charges - before.charges) / variance
        if change[heard].sum() > common_limit(int(heard.sum())):
            return False
        left = (last.charges @ largest.charges) / (largest.charges @ largest.charges)
        faint = len(self.history) > PATIENCE and self._significance < INSIGNIFICANT
        return bool(left < ENDED) or faint

    def lost(self, patience: int) -> bool:
        """Whether the errors have grown over the charges, or no place was found in time."""
        deviation = np.linalg.norm(np.sqrt(self.history[-1].walked))
        largest = np.linalg.norm(self.history[self.peak].charges)
        count = len(self.history)
        drowned = count > PATIENCE and deviation > LOST * largest
        return bool(drowned) or (self.places is None and count > patience)

    def _left(self) -> tuple[Array, Array]:
        """Mean charges (electrodes,) after the end in pC, and the variance of their noise."""
        weights = 1.0 / np.array([sample.noise for sample in self.history[-STILL:]])
        variance = 1.0 / weights.sum(axis=0)
        return variance * (weights * self._charges[-STILL:]).sum(axis=0), variance

    def closed(self) -> Contact:
        """The touch with what its end tells: no charge is left, so that what is was an error. The
        errors' walk is a bridge between onset and end then. The touch is that at its peak."""
        last, size = self.history[-1], np.square(self.history[self.peak].charges)
        left, noise = self._left()
        begin = self._onset_error**2 * size
        end = ONSET_ERROR**2 * size if self._onset_error else 0.0
        total = begin + last.walked + end + noise
        closed = copy(self)
        closed.end = self.history[-1 - STILL].time
        closed.history = [
            replace(s, charges=s.charges - left * (begin + s.walked) / total) for s in self.history
        ]
        closed.peak = closed._smooth_peak()
        others, common = closed._candidates(closed.peak), self._jump_error() * np.sqrt(size)
        closed._fit_places(others, closed.peak, begin, total, common)
        if closed.places:
            closed.at = closed.places.at[0]
        return closed

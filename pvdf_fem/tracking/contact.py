"""One touch under way: its charges from the first sample on, and where it may be."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from pvdf_fem.arrays import Array
from pvdf_fem.response.model import FORCE
from pvdf_fem.touch.locate import LocateOptions, location, search
from pvdf_fem.touch.touch import SIGNIFICANCE
from pvdf_fem.tracking.circuit import ChargeSum, Circuit
from pvdf_fem.tracking.course import ChangeModel, Hypotheses, Sample, replayed
from pvdf_fem.tracking.onset import missed_charge

#: Variance in pC² of a charge that is not known.
UNKNOWN = 1e12
#: Charges are located when they are this many deviations large, and again as they grow by a factor.
ENOUGH = 15.0
GROWTH = 1.3
#: Most places that are followed.
MOST = 6
#: Samples after the onset before the first search.
FIRST_SEARCH = 6
#: With more samples than this a correction of the onset is not made again.
ONSET_SAMPLES = 24
#: Share of a voltage left after a sample above which sampling misses nothing.
SLOW = 0.9
#: Relative error of charges by what sampling misses at an onset or an end that is not corrected.
ONSET_ERROR = 0.05
#: Samples over which charges must not change for a touch to have ended.
STILL = 12
#: A touch has ended when this share of its largest charges is left, or this many deviations.
ENDED = 0.2
INSIGNIFICANT = 4.0
#: It is lost when the deviations of charges are this share of its largest charges.
LOST = 0.3
#: Mean chi-square per degree of freedom above which places are searched for anew.
BAD = 4.0
#: Share of a new sample in that mean.
FORGET = 1.0 / 16.0


@dataclass(frozen=True, eq=False)
class Sought:
    """What is sought with which model, and the values of what is known by index."""

    model: ChangeModel
    circuit: Circuit
    known: Mapping[int, float]
    options: LocateOptions


class Contact:
    """A touch under way."""

    def __init__(self, sought: Sought, time: float, before: Array) -> None:
        """Begin at a time just before the touch; `before` are the voltages left by others."""
        self.sought, self.onset = sought, time
        self.history: list[Sample] = []
        self.hypotheses: Hypotheses | None = None
        #: Forces in N by sample, NaN where not known, and the number of the largest charges.
        self.forces: list[float] = []
        self.peak, self.end = 0, time
        #: Mean chi-square of the last samples over its degrees of freedom.
        self.strain = 1.0
        self._sum = ChargeSum(sought.circuit, time, before)
        self._voltages = [before]
        self._missed, self._onset_error = np.zeros_like(before), ONSET_ERROR
        self._searched_size, self._searched_at, self._corrected = 0.0, 0, False

    def add(self, time: float, voltage: Array, noise: Array, doubt: Array) -> None:
        """Take in a sample.

        Voltages are those over the baseline, NaN where missing, and `noise` their deviations in V;
        `doubt` is the variance in pC² that the baseline's error has by now.
        """
        charges = self._sum.add(time, voltage, noise) + self._missed
        white = np.square(self.sought.circuit.capacitance * noise)
        white[np.isnan(voltage)] = UNKNOWN
        self.history.append(Sample(time, charges, white, self._sum.variance + doubt))
        self._voltages.append(voltage)
        if np.linalg.norm(charges) > np.linalg.norm(self.history[self.peak].charges):
            self.peak = len(self.history) - 1
        self.end = time
        if self.hypotheses:
            self.hypotheses.update(self.history[-1])
            self.hypotheses.settle()
            strain = self.hypotheses.chi_square[0] / max(int((white < UNKNOWN).sum()) - 1, 1)
            self.strain += FORGET * (float(strain) - self.strain)
        if self._search_pays():
            self._search()
        self.forces.append(math.exp(self.hypotheses.at[0, FORCE]) if self.hypotheses else math.nan)

    @property
    def _significance(self) -> float:
        """Size of the charges of the last sample in standard deviations."""
        last = self.history[-1]
        return float(np.linalg.norm(last.charges / np.sqrt(last.walked + last.noise)))

    def _search_pays(self) -> bool:
        count = len(self.history)
        if count < FIRST_SEARCH:
            return False
        larger = self._significance > max(ENOUGH, GROWTH * self._searched_size)
        return larger or (self.strain > BAD and count - self._searched_at > 1.0 / FORGET)

    def _search(self) -> None:
        """Look for all places that explain the charges of the last sample, and their history."""
        self._searched_size, self._searched_at = self._significance, len(self.history)
        at, spread = self._places(self.history[-1])
        if not len(at):
            return
        if len(self.history) <= ONSET_SAMPLES or not self._corrected:
            self._correct_onset(at[0])
            at, spread = self._places(self.history[-1])
        self._follow(at, spread, self.history)
        self.strain = 1.0

    def _follow(self, at: Array, spread: Array, history: Sequence[Sample]) -> None:
        """Hear the history of places, and of those that are followed already."""
        if self.hypotheses:
            at = np.concatenate([at, self.hypotheses.at])
            spread = np.concatenate([spread, self.hypotheses.covariance[:, :FORCE, :FORCE]])
        if len(at):
            doubt = self._onset_error * history[self.peak].charges
            self.hypotheses = replayed(self.sought.model, at, spread, history, doubt)

    def _places(self, sample: Sample) -> tuple[Array, Array]:
        """The likely touches that explain the charges of one sample.

        Coordinates (n, 4), and covariances (n, 3, 3) of x, y and rotation. None where the likeliest
        touch is lighter than the model knows.
        """
        model, heard = self.sought.model, np.flatnonzero(sample.noise < UNKNOWN)
        total = (sample.charges + model.rest_pC)[heard]
        error = model.problem.model.error_bound * total
        spread = np.sqrt((sample.walked + sample.noise)[heard] + np.square(error))
        problem = replace(
            model.problem, electrodes=heard, charges_pC=total[None], deviations_pC=spread[None]
        )
        options = self.sought.options
        touches = location(problem, search(problem, self.sought.known, options), options).touches
        at = np.array([touch.values for touch in touches[:MOST]]).reshape(-1, 4)
        at[:, FORCE] = np.log(at[:, FORCE])
        if not len(at) or at[0, FORCE] <= model.least:
            return at[:0], np.zeros((0, FORCE, FORCE))
        spread, moving = np.zeros((len(at), FORCE + 1, FORCE + 1)), model.problem.unknown
        spread[:, moving[:, None], moving] = [touch.covariance for touch in touches[:MOST]]
        return at, spread[:, :FORCE, :FORCE]

    def _correct_onset(self, at: Array) -> None:
        """Add the charge that sampling misses at the onset."""
        circuit = self.sought.circuit
        times = np.array([self.onset, *(sample.time for sample in self.history)])
        if circuit.decay(times[1] - times[0]).min() > SLOW:
            self._onset_error, self._corrected = 0.0, True
            return
        noise = np.sqrt(self.history[-1].noise) / circuit.capacitance
        before, voltages = self._missed, np.array(self._voltages)
        self._missed, self._onset_error = missed_charge(
            self.sought.model, circuit, at, times, voltages, noise
        )
        self._corrected = True
        self.history = [
            replace(sample, charges=sample.charges + self._missed - before)
            for sample in self.history
        ]

    def ended(self) -> bool:
        """Whether the charges do not change any longer, and hardly any are left."""
        if len(self.history) <= STILL:
            return False
        last, before, largest = (self.history[k] for k in (-1, -1 - STILL, self.peak))
        heard = (last.noise < UNKNOWN) & (before.noise < UNKNOWN)
        variance = last.walked - before.walked + last.noise + before.noise
        change = np.square(last.charges - before.charges) / variance
        if change[heard].sum() > chi2.isf(SIGNIFICANCE, max(int(heard.sum()), 1)):
            return False
        left = (last.charges @ largest.charges) / (largest.charges @ largest.charges)
        return left < ENDED or self._significance < INSIGNIFICANT

    def lost(self, patience: int) -> bool:
        """Whether the errors have grown over the charges, or no place was found in time."""
        deviation = np.linalg.norm(np.sqrt(self.history[-1].walked))
        errors = deviation > LOST * np.linalg.norm(self.history[self.peak].charges)
        return bool(errors) or (not self.hypotheses and len(self.history) > patience)

    def closed(self) -> Contact:
        """The touch with what its end tells: no charge is left, so that what is was an error.

        The error at a sample is the share of that at the end which its variance has in the end's.
        """
        size = np.square(self.history[self.peak].charges)
        begin, last = self._onset_error**2 * size, self.history[-1]
        end = begin + last.walked + (ONSET_ERROR**2 * size if self._onset_error else 0.0)
        history = [
            replace(
                sample,
                charges=sample.charges - last.charges * (begin + sample.walked) / end,
                walked=sample.walked / 2.0,
            )
            for sample in self.history
        ]
        closed = copy(self)
        closed.history, closed.end = history, self.history[-1 - STILL].time
        at, spread = self._places(history[self.peak])
        closed._follow(at, spread, history)
        if closed.hypotheses:
            doubt = self._onset_error * history[self.peak].charges
            log_force = at[0, FORCE] if len(at) else math.log(self.forces[self.peak])
            closed.hypotheses.press(history[self.peak], doubt, log_force)
        return closed

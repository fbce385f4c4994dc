"""Touches in a stream of readings: when they begin and end, where they are, and their force.

Readings are those of the channels of the response's scene (`scene.readout`). Places and rotations
are in the frame of its stage.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.charges.rest import rest_charges
from pvdf_fem.readout.channel import channels
from pvdf_fem.response.model import FORCE, QUANTITIES, Model, period_deg, touch_of
from pvdf_fem.scene.stage import Stage
from pvdf_fem.touch.locate import PLACE_AND_FORCE, LocateOptions
from pvdf_fem.touch.location import SHARE
from pvdf_fem.touch.mistakes import known_mistakes
from pvdf_fem.tracking.baseline import WINDOWS, Baseline, Watch
from pvdf_fem.tracking.circuit import PICO, Circuit
from pvdf_fem.tracking.contact import BAD, Contact, Sought
from pvdf_fem.tracking.course import ChangeModel, Places
from pvdf_fem.tracking.rows import NUMBERS, Row, TouchSummary


@dataclass(frozen=True)
class TrackOptions:
    """What is sought, and how the baseline is followed."""

    #: What is sought, of `QUANTITIES`; the force is always.
    unknown: tuple[str, ...] = PLACE_AND_FORCE
    #: Values of the rest in the film's frame; by default those of the response's scene.
    known: Mapping[str, float] = field(default_factory=dict)
    #: ``V``, or ``pC``: V times the channel's capacitance.
    unit: str = "V"
    #: Readings of this size or more, in their unit, are clipped and count as missing.
    limit: float = math.inf
    #: Samples of quiet signal before touches are looked for.
    settle: int = 256
    #: Samples over which the baseline is followed. A faster drift than in this time is not.
    memory: int = 2000
    #: A pause in samples after which a touch is lost.
    pause: int = 50
    #: Options of the searches.
    locate: LocateOptions = field(default_factory=LocateOptions)


DEFAULTS = TrackOptions()


class Tracker:
    """Follows touches from sample to sample.

    Parameters
    ----------
    response : Response
        Its scene has the readout of the channels and the stage.
    options : TrackOptions

    Attributes
    ----------
    touches : list of TouchSummary
        Summaries of the touches that have ended.

    Raises
    ------
    ValueError
        Listing all mistakes in the options, a line each.
    """

    def __init__(self, response: Model, *, options: TrackOptions = DEFAULTS) -> None:
        scene = response.scene
        default = touch_of(scene)
        mistakes = [*known_mistakes(response.domain, options.unknown, options.known, default)]
        if "force_N" not in options.unknown:
            mistakes.append("unknown: force_N is missing; the force of a touch is always sought")
        if options.unit not in ("V", "pC"):
            mistakes.append(f"unit = {options.unit}: choose from V, pC")
        if mistakes:
            raise ValueError("\n".join(mistakes))
        values = {**default, **options.known}
        known = {i: values[n] for i, n in enumerate(QUANTITIES) if n not in options.unknown}
        unknown = np.array([i for i, n in enumerate(QUANTITIES) if n in options.unknown])
        model = ChangeModel(response, PICO * rest_charges(scene), unknown)
        circuit = Circuit.of(channels(scene))
        self.names, self.options = response.names, options
        self._stage = scene.stage or Stage()
        self._sought = Sought(model, circuit, known, options.locate)
        self._model, self._domain = response, response.domain
        self.touches: list[TouchSummary] = []
        self._restart()

    def _restart(self) -> None:
        self._time, self._step = -math.inf, math.inf
        self._baseline = Baseline(self._sought.circuit, self.options.memory)
        self._watch = Watch(len(self.names))
        self._contact: Contact | None = None
        self._missing: set[str] = set()

    def update(self, t: float, readings: Mapping[str, float] | Sequence[float]) -> Row:
        """What is known with a further sample.

        Parameters
        ----------
        t : float
            Time in s. When it does not grow, all begins anew.
        readings : mapping or sequence
            Readings of the channels by name or in their order, NaN where there is none.

        Raises
        ------
        ValueError
            For readings of another number of channels.
        """
        if isinstance(readings, Mapping):
            readings = [readings.get(name, math.nan) for name in self.names]
        values = np.array(readings, dtype=float)
        if values.shape != (len(self.names),):
            names = ", ".join(self.names)
            raise ValueError(f"readings: {values.size} given; give one for each of {names}")
        values[~(np.abs(values) < self.options.limit)] = math.nan
        voltage = self._sought.circuit.voltages(values, self.options.unit == "pC")
        step = t - self._time
        most = self.options.pause if self._contact else self.options.memory
        if math.isfinite(step) and 0.0 < step <= most * self._step:
            row = self._follow(t, voltage) if self._contact else self._watch_out(t, voltage)
            known = self._step if math.isfinite(self._step) else step
            self._step = known + (min(step, 2.0 * known) - known) / 16.0
            self._time = t
        else:
            row = self._begin_anew(t)
        silent = np.isnan(voltage)
        if silent.any():
            row = replace(row, missing=" ".join(np.array(self.names)[silent].tolist()))
        return row

    def _begin_anew(self, t: float) -> Row:
        """After the first sample, a pause, or a time that did not grow."""
        status, remark = "lost", "lost: readings paused"
        if not t > self._time:
            status, remark = "clock", "lost: the clock went back"
        if math.isinf(self._time) and math.isfinite(t):
            status = "settling"
        if self._contact:
            self._finish(self._time, remark)
        self._restart()
        self._time = t if math.isfinite(t) else -math.inf
        return Row(t, status)

    def _watch_out(self, t: float, voltage: Array) -> Row:
        """Without a touch: follow the baseline with old samples, and see whether a touch begins."""
        baseline, watch = self._baseline, self._watch
        settling = baseline.count < self.options.settle
        deviation = np.zeros_like(voltage)
        if not settling:
            deviation = np.nan_to_num((voltage - baseline.at(t)) / baseline.noise)
        window = watch.add(
            t, voltage, deviation, baseline.relative_error() if baseline.count else 0.0
        )
        if window:
            return self._begin(watch.onset(window))
        if len(watch.samples) > WINDOWS[-1]:
            old, quiet, _ = watch.samples.popleft()
            baseline.follow(old, quiet)
        return Row(t, "settling" if settling else "quiet")

    def _begin(self, size: int) -> Row:
        """Begin a touch with the last samples."""
        samples = self._watch.samples
        while len(samples) > size:
            old, quiet, _ = samples.popleft()
            self._baseline.follow(old, quiet)
        self._missing = set()
        start = samples[0][0] - self._step
        self._contact = Contact(self._sought, start, self._baseline.remaining(start))
        for t, voltage, _ in samples:
            self._contact.add(t, *self._over_baseline(t, voltage, self._contact.onset))
        return self._row(t, self._contact)

    def _over_baseline(self, t: float, voltage: Array, onset: float) -> tuple[Array, Array, Array]:
        """Voltages over the baseline, their noise, and the variance of charges by its error."""
        baseline, circuit, elapsed = self._baseline, self._sought.circuit, t - onset
        level = baseline.at(t) - baseline.remaining(t)
        charge = (circuit.capacitance + circuit.leak * elapsed) * baseline.error(
            elapsed / self._step
        )
        return voltage - level, baseline.noise, np.square(charge)

    def _follow(self, t: float, voltage: Array) -> Row:
        """During a touch."""
        contact = self._contact
        assert contact is not None
        over, noise, doubt = self._over_baseline(t, voltage, contact.onset)
        contact.add(t, over, noise, doubt)
        self._missing |= {n for n, v in zip(self.names, voltage, strict=True) if math.isnan(v)}
        if contact.ended():
            self._finish(t)
            return Row(t, "quiet")
        if contact.lost(self.options.memory):
            self._finish(t, "lost: its errors have grown over its charges")
            return Row(t, "lost")
        return self._row(t, contact)

    def _finish(self, t: float, remark: str = "") -> None:
        """End the touch, and begin to watch out for another."""
        contact = self._contact
        assert contact is not None
        told = contact if remark else contact.closed()
        self.touches.append(self._summary(told, remark))
        self._baseline.keep(told.end, t, contact.left())
        self._contact, self._watch = None, Watch(len(self.names))

    def _row(self, t: float, contact: Contact) -> Row:
        """The row of a touch."""
        number, (low, high) = len(self.touches) + 1, self._domain.log_force
        if contact.places is None:
            return Row(t, "starting", number)
        force, status = contact.at[FORCE], "touch"
        if contact.strain > BAD:
            status = "unexplained"
        elif not low <= force <= high:
            status = "too_light" if force < low else "too_strong"
        values = self._values(contact, contact.places)
        chi_square, alternatives = contact.chi_square, _likely(contact.places)
        return Row(t, status, number, **values, chi_square=chi_square, alternatives=alternatives)

    def _values(self, contact: Contact, places: Places) -> dict[str, Any]:
        """The touch on the stage and its deviations, as rows and summaries name them."""
        x, y, rotation, log_force = contact.at.tolist()
        (x, y), rotation = self._stage.to_stage((x, y), rotation)
        rotation, force = rotation % period_deg(self._model), math.exp(log_force)
        dx, dy, turn, relative = places.deviations(self._stage.turn).tolist()
        values = (x, y, force, rotation, dx, dy, relative * force, turn)
        return dict(zip(NUMBERS, map(float, values), strict=True))

    def _summary(self, contact: Contact, remark: str) -> TouchSummary:
        """What is known of a touch that has ended."""
        places, remarks = contact.places, [remark] if remark else []
        values, alternatives = dict.fromkeys(NUMBERS, math.nan), 0
        if places is None:
            remarks.append("not located: the charges are too small, or no touch gives them")
        else:
            values, alternatives = self._values(contact, places), _likely(places)
            (low, high), force = self._domain.force_N, values["force_N"]
            if alternatives > 1:
                remarks.append(f"ambiguous: {alternatives} places are likely")
            if not low <= force <= high:
                beyond = "too_light" if force < low else "too_strong"
                remarks.append(f"{beyond}: the model is of {low:g} to {high:g} N")
            if contact.strain > BAD:
                remarks.append("unexplained: no touch of this probe gives such charges")
        if self._missing:
            remarks.append(f"without readings for a while: {' '.join(sorted(self._missing))}")
        return TouchSummary(
            number=len(self.touches) + 1,
            onset_s=contact.onset,
            end_s=contact.end,
            **values,
            peak_s=contact.history[contact.peak].time,
            impulse_N_s=contact.impulse,
            alternatives=alternatives,
            remarks=tuple(remarks),
        )


def _likely(places: Places) -> int:
    """The number of places that may be touched."""
    return int((places.weights > SHARE).sum())

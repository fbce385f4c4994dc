"""Touches in a stream of readings: when they begin and end, where they are, and their force.

Readings are those of the channels of the response's scene (`scene.readout`). Places and rotations
are in the frame of its stage.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.channel import make_channels
from pvdf_fem.inverse.touch.locate import PLACE_AND_FORCE, get_scene_quantities
from pvdf_fem.inverse.touch.measurement import find_quantity_errors, get_centre_mm
from pvdf_fem.inverse.tracking.baseline import Baseline, ContactDetector
from pvdf_fem.inverse.tracking.circuit import ReadoutCircuit
from pvdf_fem.inverse.tracking.contact import Contact
from pvdf_fem.inverse.tracking.contact_problem import CandidatePlaces, ContactProblem
from pvdf_fem.inverse.tracking.options import DEFAULTS, TrackOptions
from pvdf_fem.inverse.tracking.results import TouchSummary, TrackRow
from pvdf_fem.scene.arguments import Names, as_response, coerce, coerce_array
from pvdf_fem.scene.scene_file import suggest
from pvdf_fem.surrogate.charge_function import ChargeFunction, find_rotation_period_deg
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, TouchColumn


class Tracker:
    """Follows touches from sample to sample; `touches` are summaries of the ended touches.

    Parameters
    ----------
    response : Response
        Its scene has the readout of the channels and the stage.
    unknown : sequence of str
        What is sought, of ``x_mm``, ``y_mm``, ``rotation_deg`` and ``force_N``, which always is;
        the rest is that of the response's scene.
    unit : str
        Of the readings: ``V``, or ``pC``: V times the channel's capacitance.
    options : TrackOptions
        When touches begin and end, and when they are located.

    Raises
    ------
    ValueError
        With a line for each mistake in the options.

    Examples
    --------
    >>> tracker = Tracker(build_response("sensor.toml", tolerance=3e-2), unit="pC")
    >>> for i in range(1000):  # at 1 kHz, in the order of tracker.response.names
    ...     row = tracker.update(1e-3 * i, [0.1, 0.0, -0.1, 0.0])
    >>> tracker.settling_ends_s, tracker.touches
    """

    def __init__(
        self,
        response: ChargeFunction,
        *,
        unknown: Sequence[str] = PLACE_AND_FORCE,
        unit: str = "V",
        options: TrackOptions = DEFAULTS,
    ) -> None:
        scene, known = as_response(response).scene, get_scene_quantities(response.scene)
        unknown = coerce("unknown", unknown, Names)
        origin = (*get_centre_mm(scene), 0.0, 0.0)
        mistakes = [*find_quantity_errors(response.domain, unknown, {}, known, origin)]
        if "force_N" not in unknown:
            mistakes.append("unknown: force_N is missing; the force of a touch is always sought")
        if unit not in ("V", "pC"):
            mistakes.append(f"unit = {unit}: choose from V, pC")
        if mistakes:
            raise ValueError("\n".join(mistakes))
        fixed = {
            i: known[n] - origin[i] for i, n in enumerate(TOUCH_QUANTITIES) if n not in unknown
        }
        self.touches: list[TouchSummary] = []
        self._names, self._unit, self._circuit = (
            response.names,
            unit,
            ReadoutCircuit.of(make_channels(scene)),
        )
        self._model = ContactProblem.of(response, fixed, options)
        self._options, self._time = options, -math.inf
        self._restart()

    def _restart(self) -> None:
        self._step = math.inf
        self._baseline = Baseline(self._circuit, self._options)
        self._watch, self._missing = ContactDetector(len(self._names), self._options), set[str]()
        self._contact: Contact | None = None

    def update(self, t: float, readings: Mapping[str, float] | Sequence[float]) -> TrackRow:
        """What is known with a sample at a time in s; if that does not grow, all begins anew.

        `readings` are those of the channels by name or in their order, NaN where there is none.
        """
        if isinstance(readings, Mapping):
            if unknown := readings.keys() - {*self._names}:
                advice = suggest(min(unknown), self._names)
                raise ValueError(f"readings.{min(unknown)}: is of no channel; {advice}")
            readings = [readings.get(name, math.nan) for name in self._names]
        values = coerce_array("readings", readings)
        if values.shape != (len(self._names),):
            names = ", ".join(self._names)
            raise ValueError(f"readings: {values.size} given; give one for each of {names}")
        values[np.isinf(values)] = math.nan
        silent = [n for n, v in zip(self._names, values.tolist(), strict=True) if math.isnan(v)]
        self._missing.update(silent)
        voltage = self._circuit.voltages(values, self._unit == "pC")
        options, step = self._options, t - self._time
        most = options.pause if self._contact else options.memory
        if math.isfinite(step) and 0.0 < step <= most * self._step:
            touch = self._contact
            row = self._follow(t, voltage, touch) if touch else self._watch_out(t, voltage)
            known = self._step if math.isfinite(self._step) else step
            self._step = known + (min(step, 2.0 * known) - known) / 16.0
        else:
            row = self._begin_anew(t)
        self._time = t
        if row.status == "settling":
            row = replace(row, settling_s=self.settling_ends_s - t)
        return replace(row, missing=" ".join(silent)) if silent else row

    @property
    def settling_ends_s(self) -> float:
        """When touches are looked for, if the samples go on as they do; NaN while that is unknown.

        Until then the baseline and its noise are learned, from `TrackOptions.settle` samples.
        """
        wanted = self._options.settle + int(self._watch.windows[-1])
        left = wanted - self._baseline.count - len(self._watch.samples)
        return self._time + left * self._step if math.isfinite(self._step) else math.nan

    def _begin_anew(self, t: float) -> TrackRow:
        """After the first sample, a pause, or a time that did not grow."""
        status = "lost" if t > self._time else "clock"
        if self._contact:
            self._finish(self._time, self._contact, status)
        first = self._time == -math.inf and math.isfinite(t)
        self._restart()
        return TrackRow(t, "settling" if first else status)

    def _watch_out(self, t: float, voltage: Array) -> TrackRow:
        """Without a touch: follow the baseline with old samples, and see whether a touch begins."""
        baseline, watch, deviation = self._baseline, self._watch, np.zeros_like(voltage)
        error = deviation
        settling = baseline.count < self._options.settle
        if not settling:
            error = baseline.relative_error(t)
            deviation = np.nan_to_num((voltage - baseline.at(t)) / baseline.noise)
        watch.samples.append((t, voltage, deviation))
        if size := watch.touched(error):
            return self._begin(size)
        if len(watch.samples) > watch.windows[-1]:
            old, quiet, _ = watch.samples.popleft()
            baseline.follow(old, quiet)
        return TrackRow(t, "settling" if settling else "quiet")

    def _begin(self, size: int) -> TrackRow:
        """Begin a touch with the last samples."""
        samples = self._watch.samples
        while len(samples) > size:
            old, quiet, _ = samples.popleft()
            self._baseline.follow(old, quiet)
        self._missing = set()
        start = samples[0][0] - self._step
        contact = self._contact = Contact(
            self._model, self._circuit, start, self._baseline.remaining(start)
        )
        for t, voltage, _ in samples:
            self._add(contact, t, voltage)
        return self._row_of(t, contact)

    def _add(self, contact: Contact, t: float, voltage: Array) -> None:
        """Give a touch the voltages over the baseline, and the drift by the baseline's error."""
        baseline, circuit, elapsed = self._baseline, self._circuit, t - contact.onset
        error = baseline.noise * baseline.relative_error(t, elapsed / self._step)
        drift = (circuit.capacitance + circuit.leak * elapsed) * error
        contact.add(t, voltage - baseline.at(t) + baseline.remaining(t), baseline.noise, drift)

    def _follow(self, t: float, voltage: Array, contact: Contact) -> TrackRow:
        """During a touch."""
        self._add(contact, t, voltage)
        status = "quiet" if contact.ended() else "lost" if contact.lost() else ""
        if not status:
            return self._row_of(t, contact)
        self._finish(t, contact, status.removeprefix("quiet"))
        return TrackRow(t, status)

    def _finish(self, t: float, contact: Contact, status: str = "") -> None:
        """End the touch, for a reason if it is no plain end, and watch out for another."""
        if not status:
            contact.close()
        places = contact.places
        row = TrackRow(contact.history[contact.largest].time, "starting", len(self.touches) + 1)
        if places:
            row = self._row(places.sample.time, places, places.at[0], places.chi_square)
        missing = " ".join(sorted(self._missing))
        told = asdict(row) | {"missing": missing} | ({"status": status} if status else {})
        impulse = math.nan if math.isnan(row.force_N) else contact.impulse
        self.touches.append(
            TouchSummary(**told, onset_s=contact.onset, end_s=contact.end, impulse_N_s=impulse)
        )
        since, voltages = contact.after()
        self._baseline.keep(since, t, voltages)
        self._contact, self._watch = None, ContactDetector(len(self._names), self._options)

    def _row_of(self, t: float, contact: Contact) -> TrackRow:
        """The touch at the last sample."""
        if contact.places is None:
            return TrackRow(t, "starting", len(self.touches) + 1)
        return self._row(t, contact.places, contact.at, contact.chi_square)

    def _row(self, t: float, places: CandidatePlaces, at: Array, chi_square: float) -> TrackRow:
        """A touch on the stage at coordinates (4,), with the deviations of its places."""
        model = self._model
        x, y, rotation, force = model.to_touches(at[None])[0].tolist()
        low, high = model.response.domain.force_N
        status = "too_light" if force < low else "too_strong" if force > high else "touch"
        status = status if places.explained else "unexplained"
        force = force if at[TouchColumn.FORCE] < model.log_forces[1] else math.nan
        dx, dy, turn, relative = places.deviations.tolist()
        numbers = (
            x,
            y,
            force,
            rotation % find_rotation_period_deg(model.response),
            dx,
            dy,
            relative * force,
            turn,
        )
        count = len(places.at)
        return TrackRow(t, status, len(self.touches) + 1, *numbers, chi_square, count)

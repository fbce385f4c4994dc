"""Rows and summaries of the tracker, made from contacts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import fields

from pvdf_fem.arrays import Array
from pvdf_fem.inverse.tracking.contact import Contact
from pvdf_fem.inverse.tracking.problem.contact_problem import CandidateTouches, ContactProblem
from pvdf_fem.inverse.tracking.problem.ended_touch import EndedTouch
from pvdf_fem.inverse.tracking.results import TouchSummary, TrackRow, TrackStatus
from pvdf_fem.inverse.tracking.signal.filtered_sample import FilteredSample
from pvdf_fem.surrogate.charge_function import find_rotation_period_deg
from pvdf_fem.surrogate.touch_domain import TouchColumn


class ResultBuilder:
    """Builder of the rows and summaries of touches, in the frame of the stage.

    Parameters
    ----------
    problem : ContactProblem
        Template of the contact problems.
    names : sequence of str
        Names of the channels.
    """

    def __init__(self, problem: ContactProblem, names: Sequence[str]) -> None:
        self._problem = problem
        self._names = names
        self._rotation_period_deg = find_rotation_period_deg(problem.response)
        #: Candidates of the last row, and a row with their place.
        self._located: CandidateTouches | None = None
        self._located_row = TrackRow(math.nan, TrackStatus.TOUCH)

    def summarise_touch(
        self, touch: EndedTouch, contact: Contact, *, number: int, status: TrackStatus | None
    ) -> TouchSummary:
        """Summarise a touch at the sample from which it was last located.

        If it is not located, the summary is that of the sample with the largest charges, without
        position and force.

        Parameters
        ----------
        touch : EndedTouch
            Touch that has ended or is cut off.
        contact : Contact
            Contact that the touch belongs to.
        number : int
            Number of the touch.
        status : TrackStatus, optional
            Status of a contact that was cut off. Default: the status that follows from its touch.
        """
        candidates = touch.candidates
        if candidates is None:
            peak_s = touch.largest.time_s if touch.largest else touch.onset_s
            row = TrackRow(peak_s, TrackStatus.STARTING, touch=number)
        else:
            row = self._make_touch_row(
                candidates.sample.time_s,
                candidates,
                number=number,
                coordinates=candidates.likeliest,
                chi_square=candidates.chi_square,
            )
        values = {field.name: getattr(row, field.name) for field in fields(row)}
        values["missing"] = self._join_names(contact.was_missing.tolist())
        values["clipped"] = self._join_names(contact.was_clipped.tolist())
        if status is not None:
            values["status"] = status
        elif contact.is_hidden_by_clipping(touch):
            values["status"] = TrackStatus.CLIPPED
            values["force_N"] = math.nan
            values["force_deviation_N"] = math.nan
        elif contact.begins_in_pause or contact.record.is_peak_hidden:
            values["status"] = TrackStatus.LOST
        return TouchSummary(
            **values,
            onset_s=touch.onset_s,
            end_s=touch.end_s,
            impulse_N_s=math.nan if math.isnan(row.force_N) else touch.impulse_N_s,
        )

    def _join_names(self, is_named: Sequence[bool]) -> str:
        """Return the names of the channels in a mask, separated by spaces."""
        chosen = []
        for name, is_chosen in zip(self._names, is_named, strict=True):
            if is_chosen:
                chosen.append(name)
        return " ".join(chosen)

    def list_missing(self, voltages: Sequence[float]) -> str:
        """Return the names of the channels without a voltage, separated by spaces."""
        if not math.isnan(sum(voltages)):
            return ""
        return self._join_names(list(map(math.isnan, voltages)))

    def make_row_without_readings(self, time_s: float, before: TrackRow) -> TrackRow:
        """Make the row of a sample in which all readings are missing, after another row."""
        return TrackRow(time_s, before.status, touch=before.touch, missing=" ".join(self._names))

    def make_contact_row(self, sample: FilteredSample, contact: Contact, number: int) -> TrackRow:
        """Make the row of the last sample of a contact; it has no position until it is located.

        Parameters
        ----------
        sample : FilteredSample
            The newest sample.
        contact : Contact
            Contact in progress.
        number : int
            Number of the touch.
        """
        locator = contact.locator
        missing = self.list_missing(sample.voltages)
        clipped = self._join_names(sample.is_clipped) if any(sample.is_clipped) else ""
        if locator.candidates is None:
            return TrackRow(
                sample.time_s,
                TrackStatus.STARTING,
                touch=number,
                missing=missing,
                clipped=clipped,
            )
        return self._make_touch_row(
            sample.time_s,
            locator.candidates,
            number=number,
            coordinates=locator.coordinates,
            chi_square=locator.chi_square,
            missing=missing,
            clipped=clipped,
        )

    def _make_touch_row(
        self,
        time_s: float,
        candidates: CandidateTouches,
        *,
        number: int,
        coordinates: Array,
        chi_square: float,
        missing: str = "",
        clipped: str = "",
    ) -> TrackRow:
        """Make the row of a located touch, in the frame of the stage.

        The force is NaN if it is at the upper end of the extrapolated range.

        Parameters
        ----------
        time_s : float
            Time of the sample.
        candidates : CandidateTouches
            Candidates of the last location, with the standard deviations of the coordinates.
        number : int
            Number of the touch.
        coordinates : ndarray, shape (4,)
            Coordinates of the touch at this time.
        chi_square : float
            Chi-square of the charges at this time.
        missing, clipped : str
            Names of the channels without a reading, and of clipped ones, in this sample.
        """
        if candidates is not self._located:
            self._located = candidates
            self._located_row = self._make_located_row(candidates)
        log_force = float(coordinates[TouchColumn.FORCE])
        force_N = math.exp(log_force)
        lowest_N, highest_N = self._problem.response.domain.force_N
        if not candidates.is_explained:
            status = TrackStatus.UNEXPLAINED
        elif force_N < lowest_N:
            status = TrackStatus.TOO_LIGHT
        elif force_N > highest_N:
            status = TrackStatus.TOO_STRONG
        else:
            status = TrackStatus.TOUCH
        # A force at the upper end of the extrapolated range is unknown.
        if log_force >= self._problem.log_force_range[1]:
            force_N = math.nan
        log_deviation = float(candidates.deviations[TouchColumn.FORCE])
        return self._located_row.copy_with(
            t_s=time_s,
            status=status,
            touch=number,
            force_N=force_N,
            force_deviation_N=log_deviation * force_N,
            chi_square=chi_square,
            missing=missing,
            clipped=clipped,
        )

    def _make_located_row(self, candidates: CandidateTouches) -> TrackRow:
        """Make a row with the place of the likeliest candidate, which many samples share."""
        x_mm, y_mm, rotation_deg = candidates.likeliest_pose
        x_deviation, y_deviation, rotation_deviation, _ = candidates.deviations.tolist()
        return TrackRow(
            candidates.sample.time_s,
            TrackStatus.TOUCH,
            x_mm=x_mm,
            y_mm=y_mm,
            rotation_deg=rotation_deg % self._rotation_period_deg,
            x_deviation_mm=x_deviation,
            y_deviation_mm=y_deviation,
            rotation_deviation_deg=rotation_deviation,
            alternatives=len(candidates),
        )

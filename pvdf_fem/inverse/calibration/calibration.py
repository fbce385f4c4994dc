"""The result of a calibration: parameters, their uncertainties, and outliers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.inverse.calibration.diagnosis import CalibrationStatus
from pvdf_fem.inverse.calibration.fit import CalibrationFit
from pvdf_fem.inverse.calibration.parameters import find_scene_key
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solver.sensitivity.parameters import expand_pair_key
from pvdf_fem.summary import Result, Summary, TextTable, format_with_error

#: Parameters that contribute less than this fraction of the largest component to an undetermined
#: direction are not named.
MIN_NAMED_FRACTION = 0.15
CORRELATION_DIGITS = 6  #: Number of decimals of correlations in a scene.


@dataclass(frozen=True, eq=False, repr=False)
class Calibration(Result):
    """Result of a calibration."""

    status: CalibrationStatus
    reason: str  #: Explanation of the status in words.
    notes: tuple[str, ...]  #: Sentences about touches and parameters that should be checked.
    #: Reasons why touches were not used, by their rows.
    outliers: dict[int, str]
    fit: CalibrationFit  #: Fit with its residuals, `degrees_of_freedom` and `p_value`.

    @property
    def is_calibrated(self) -> bool:
        """Whether the status is ``calibrated``, so that the parameters can be used."""
        return self.status is CalibrationStatus.CALIBRATED

    @cached_property
    def scene(self) -> Scene:
        """Copy of the nominal scene with the calibrated parameters and the meaning of the readings.

        The covariance of the parameters is in its ``[calibration]``, from which it gets into the
        deviations of located touches. Calibrated parameters that are in the scene's
        ``[uncertain]`` get their posterior standard
        deviations there. A key that stands for two parameters, such as ``film.pretension_N_m``,
        gets the mean of their standard deviations.

        Raises
        ------
        ValueError
            If the status is not ``calibrated``.
        """
        if not self.is_calibrated:
            raise ValueError(f"{self.status}: {self.reason}")
        model = self.fit.model
        scene = model.parameters.apply(self.fit.values, model.reading)
        if model.parameters.scene.readout is None:
            # Later readings of the same instrument are then in the unit of these.
            scene = scene.with_(**{"readout.unit": model.unit})
        deviations = {}
        for key in scene.uncertain or ():
            names = expand_pair_key(key, self.parameters)
            if names:
                pair_deviations = [self.parameters[name]["deviation"] for name in names]
                deviations[key] = float(np.mean(pair_deviations))
        changes: dict[str, Any] = {"calibration": self._make_table()}
        if deviations:
            changes["uncertain"] = deviations
        return scene.with_(**changes)

    def _make_table(self) -> dict[str, Any]:
        """Make the table ``[calibration]`` of the scene; numbers have six digits."""
        names = self.fit.model.parameters.names
        deviations = np.sqrt(np.diag(self.covariance))
        correlations = self.covariance / np.outer(deviations, deviations)
        return {
            "keys": [find_scene_key(name) for name in names],
            "deviations": [float(f"{deviation:.6g}") for deviation in deviations],
            "correlations": np.round(correlations, CORRELATION_DIGITS).tolist(),
        }

    @cached_property
    def parameters(self) -> dict[str, dict[str, float]]:
        """Fitted value and standard deviation of each parameter, by its name.

        Each parameter has a dict with ``value`` and ``deviation``, the posterior standard
        deviation. Both are in the unit at the end of the name; those of offsets are in V.
        """
        values = self.fit.values.tolist()
        deviations = np.sqrt(np.diag(self.fit.covariance)).tolist()
        parameters = {}
        names = self.fit.model.parameters.names
        for name, value, deviation in zip(names, values, deviations, strict=True):
            parameters[name] = {"value": value, "deviation": deviation}
        return parameters

    @property
    def covariance(self) -> Array:
        """Posterior covariance of the parameters, see `CalibrationFit.covariance`."""
        return self.fit.covariance

    @property
    def places_mm(self) -> Array:
        """Positions x, y of all touches on the stage in mm, with their fitted corrections.

        Returns
        -------
        ndarray, shape (touches, 2)
        """
        return self.fit.model.table.places_mm + self.fit.place_corrections_mm

    @cached_property
    def leave_one_out(self) -> dict[str, float]:
        """Leave-one-out errors: ``charge``, ``place_mm`` and ``force``.

        Each used touch is compared with a fit to the other touches. ``charge`` is the root mean
        square of the residuals, divided by that of the predicted readings. ``place_mm`` and
        ``force`` are the median errors in mm and as a fraction of the force with which the touches
        would be located by such a fit; each error is estimated by one Gauss-Newton step.
        """
        fit = self.fit
        is_used = fit.is_used
        # The residuals are whitened with the errors of the positions; here they are in the unit of
        # the readings again, and weighted with the errors of the readings alone.
        whitened = fit.compute_deleted_residuals().residuals[is_used][..., None]
        residuals = fit.whitened.roots[is_used] @ whitened
        weights = 1.0 / fit.deviations[is_used][..., None]
        slopes = weights * fit.prediction.by_touch[is_used]
        steps = (np.linalg.pinv(slopes) @ (weights * residuals))[..., 0]
        mean_square = np.sum(residuals**2) / np.sum(fit.prediction.readings[is_used] ** 2)
        place_errors_mm = np.hypot(steps[:, 0], steps[:, 1])
        force_errors = np.abs(steps[:, 2]) / fit.model.table.forces_N[is_used]
        return {
            "charge": float(np.sqrt(mean_square)),
            "place_mm": float(np.median(place_errors_mm)),
            "force": float(np.median(force_errors)),
        }

    @cached_property
    def undetermined(self) -> tuple[str, ...]:
        """Descriptions of the combinations of parameters that are determined mainly by the priors.

        In these directions of the parameter space, the standard deviation of the prior is smaller
        than the one that the readings alone would give. A description names the parameters that
        contribute most to the direction (`MIN_NAMED_FRACTION`).
        """
        parameters = self.fit.model.parameters
        information = self.fit.information
        texts = []
        for direction in np.abs(information.directions[information.singular_values < 1.0]):
            indices = np.flatnonzero(direction > MIN_NAMED_FRACTION * direction.max()).tolist()
            names = " and ".join(parameters.names[i] for i in indices)
            priors = []
            for i in indices:
                prior = f"{parameters.initial[i]:.4g} ± {parameters.prior_deviations[i]:.2g}"
                priors.append(f"{parameters.names[i]} {prior}")
            reason = f"determined by the priors {', '.join(priors)}"
            texts.append(f"{names}: have little effect on the readings; {reason}")
        return tuple(texts)

    def to_json(self) -> dict[str, Any]:
        """Return the dict that `pvdf-fem calibrate --json` prints.

        The parameters and the results that depend on them are left out unless the status is
        ``calibrated``.
        """
        fit = self.fit
        values: dict[str, Any] = {"status": str(self.status), "reason": self.reason}
        if self.is_calibrated:
            values |= {
                "parameters": self.parameters,
                "covariance": fit.covariance.tolist(),
                "not_told_apart": list(self.undetermined),
                "leave_one_out": self.leave_one_out,
                "places_mm": self.places_mm.tolist(),
            }
        return values | {
            "chi_square": fit.chi_square,
            "degrees_of_freedom": fit.degrees_of_freedom,
            "p_value": fit.p_value,
            "outliers": [{"row": row, "reason": why} for row, why in self.outliers.items()],
            "clipped": [
                {"row": reading.row, "electrode": reading.electrode}
                for reading in fit.model.table.clipped
            ],
            "remarks": list(self.notes),
            "reading": fit.model.reading,
            "unit": fit.model.unit,
        }

    def write_html_page(self, path: Path, about: Mapping[str, str] | None = None) -> None:
        """Write a self-contained HTML page with plots of readings, residuals and positions.

        Parameters
        ----------
        path : Path
            Path of the HTML file; an existing file is replaced.
        about : mapping of str to str, optional
            Labels and texts of additional lines below the status, such as the file and the date.
        """
        from pvdf_fem.view.calibration_page import CalibrationData, write_calibration_page

        model = self.fit.model
        table = model.table
        data = CalibrationData(
            scene=model.parameters.apply(self.fit.values, model.reading),
            channels=[channel.name for channel in model.channels],
            unit=model.unit,
            rows=table.rows,
            is_outlier=np.isin(table.rows, list(self.outliers)),
            readings=table.readings,
            predicted=self.fit.prediction.readings,
            file_positions_mm=table.places_mm,
            calibrated_positions_mm=self.places_mm,
        )
        write_calibration_page(data, self.status, self._repr_html_(), about or {}, path)

    def summary(self) -> Summary:
        """Summarize the status with its reason, the parameters if calibrated, and notes."""
        fit = self.fit
        freedom = f"{fit.degrees_of_freedom} degrees of freedom (p = {fit.p_value:.2g})"
        notes = [f"chi-square: {fit.chi_square:.1f} with {freedom}"]
        rows = []
        if self.is_calibrated:
            for name, parameter in self.parameters.items():
                texts = format_with_error(parameter["value"], parameter["deviation"])
                rows.append((name, *texts))
            errors = self.leave_one_out
            notes.append(
                f"leave-one-out errors: readings {100 * errors['charge']:.2g} %, positions"
                f" {errors['place_mm']:.2g} mm, forces {100 * errors['force']:.2g} %"
            )
            notes += [f"undetermined: {text}" for text in self.undetermined]
        notes += [f"outlier: row {row}: {reason}" for row, reason in self.outliers.items()]
        notes += [f"note: {text}" for text in self.notes]
        table = TextTable(("parameter", "value", "±"), tuple(rows))
        return Summary(self.status, [self.reason], tables=[table], notes=notes)

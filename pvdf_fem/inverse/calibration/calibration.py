"""What a calibration found: parameters with deviations, what they are worth, and what is wrong."""

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
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solver.sensitivity.parameters import expand_pair_key
from pvdf_fem.summary import Result, Summary, TextTable, format_with_error


@dataclass(frozen=True, eq=False, repr=False)
class Calibration(Result):
    """How a calibration ended, and the calibrated scene."""

    status: CalibrationStatus
    reason: str  #: The status in words.
    remarks: tuple[str, ...]  #: What to look at.
    #: Rows of bad touches, which did not count, and what is wrong with them.
    outliers: dict[int, str]
    fit: CalibrationFit  #: With `degrees_of_freedom` and `p_value`.

    @cached_property
    def scene(self) -> Scene:
        """The scene with what was found; raises ValueError unless calibrated. What its
        ``[uncertain]`` says of parameters that were found are the deviations found."""
        if self.status is not CalibrationStatus.CALIBRATED:
            raise ValueError(f"{self.status}: {self.reason}")
        scene = self.fit.model.unknowns.scene_at(self.fit.values, self.fit.model.reading)
        deviations = {}
        for key in scene.uncertain or ():
            if names := expand_pair_key(key, self.parameters):
                deviations[key] = float(np.mean([self.parameters[n]["deviation"] for n in names]))
        return scene.with_(uncertain=deviations) if deviations else scene

    @cached_property
    def parameters(self) -> dict[str, dict[str, float]]:
        """Value and standard deviation by name, in the name's unit; offsets in V."""
        rows = np.stack([self.fit.values, np.sqrt(np.diag(self.fit.covariance))], axis=1).tolist()
        rows = [dict(zip(("value", "deviation"), row, strict=True)) for row in rows]
        return dict(zip(self.fit.model.unknowns.names, rows, strict=True))

    @property
    def covariance(self) -> Array:
        """Covariance of the parameters, (parameters, parameters)."""
        return self.fit.covariance

    @property
    def places_mm(self) -> Array:
        """Corrected places of the touches on the stage, (touches, 2)."""
        return self.fit.model.touches.touches[:, :2] + self.fit.moves

    @cached_property
    def leave_one_out(self) -> dict[str, float]:
        """Errors of each touch by a calibration with the others.

        ``charge`` is the root mean square relative to that of the readings; ``place_mm`` and
        ``force`` (relative) are medians of what a touch would be located off its place and force
        in the file, by linear steps.
        """
        fit, kept = self.fit, self.fit.kept
        left = fit.whitened[0][kept] @ fit.deleted()[0][kept][..., None]
        weights = 1.0 / fit.deviations[kept][..., None]
        steps = np.linalg.pinv(weights * fit.prediction.by_touch[kept]) @ (weights * left)
        forces = fit.model.touches.touches[kept, 3]
        size = np.sum(fit.prediction.readings[kept] ** 2)
        return {
            "charge": float(np.sqrt(np.sum(left**2) / size)),
            "place_mm": float(np.median(np.hypot(steps[:, 0, 0], steps[:, 1, 0]))),
            "force": float(np.median(np.abs(steps[:, 2, 0]) / forces)),
        }

    @cached_property
    def undetermined(self) -> tuple[str, ...]:
        """Combinations of parameters that the priors decided, rather than the readings."""
        of, texts, (values, directions) = self.fit.model.unknowns, [], self.fit.told
        for direction in np.abs(directions[values < 1.0]):
            large = np.flatnonzero(direction > 0.15 * direction.max()).tolist()
            names = " and ".join(of.names[i] for i in large)
            priors = [f"{of.names[i]} {of.start[i]:.4g} ± {of.priors[i]:.2g}" for i in large]
            texts.append(
                f"{names}: hardly seen in the readings; decided by the priors {', '.join(priors)}"
            )
        return tuple(texts)

    def to_json(self) -> dict[str, Any]:
        """What `pvdf-fem calibrate --json` prints; without parameters unless calibrated."""
        fit, found = self.fit, {}
        if self.status is CalibrationStatus.CALIBRATED:
            found = {
                "parameters": self.parameters,
                "covariance": fit.covariance.tolist(),
                "not_told_apart": list(self.undetermined),
                "leave_one_out": self.leave_one_out,
                "places_mm": self.places_mm.tolist(),
            }
        return {
            "status": str(self.status),
            "reason": self.reason,
            **found,
            "chi_square": fit.chi_square,
            "degrees_of_freedom": fit.degrees_of_freedom,
            "p_value": fit.p_value,
            "outliers": [{"row": row, "reason": why} for row, why in self.outliers.items()],
            "remarks": list(self.remarks),
            "reading": fit.model.reading,
            "unit": fit.model.unit,
        }

    def write_page(self, path: Path, about: Mapping[str, str] | None = None) -> None:
        """Write one self-contained HTML page: the verdict, what the page is about by name, such as
        the file and the date, and pictures of readings, residuals and places."""
        from pvdf_fem.view.calibration_page import CalibrationData, write_calibration_page

        model = self.fit.model
        touches, names = model.touches, [channel.name for channel in model.channels]
        bad = np.isin(touches.rows, list(self.outliers))
        read = touches.readings, self.fit.prediction.readings
        places = touches.touches[:, :2], self.places_mm
        sensor = model.unknowns.scene_at(self.fit.values, model.reading)
        file = names, model.unit, touches.rows, bad
        data = CalibrationData(sensor, *file, *read, *places)
        write_calibration_page(data, self.status, self._repr_html_(), about or {}, path)

    def summary(self) -> Summary:
        """Status, reason, the table of parameters, and what is said below it."""
        fit, rows, notes = self.fit, [], []
        if self.status is CalibrationStatus.CALIBRATED:
            rows = [
                (n, *format_with_error(of["value"], of["deviation"]))
                for n, of in self.parameters.items()
            ]
            left = self.leave_one_out
            notes.append(
                f"leave-one-out: readings {100 * left['charge']:.2g} %, places"
                f" {left['place_mm']:.2g} mm, forces {100 * left['force']:.2g} %"
            )
            notes += [f"not told apart: {text}" for text in self.undetermined]
        freedom = f"{fit.degrees_of_freedom} degrees of freedom (p = {fit.p_value:.2g})"
        notes.insert(0, f"chi-square: {fit.chi_square:.1f} with {freedom}")
        notes += [f"left out: row {row}: {why}" for row, why in self.outliers.items()]
        notes += [f"remark: {text}" for text in self.remarks]
        table = TextTable(("parameter", "value", "±"), tuple(rows))
        return Summary(self.status, [self.reason], tables=[table], notes=notes)

"""What a calibration found: parameters with deviations, what they are worth, and what is wrong."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from html import escape
from typing import Any

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.calibration.diagnosis import CalibrationStatus
from pvdf_fem.calibration.fit import Fit
from pvdf_fem.calibration.unknowns import ABSOLUTE_PRIORS
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solution.summary import Grid, rounded

#: Parts of a direction, over its largest, that are told.
PART = 0.15


@dataclass(frozen=True, eq=False)
class Calibration:
    """How a calibration ended, and the calibrated scene.

    Attributes
    ----------
    status : CalibrationStatus
        `CalibrationStatus.CALIBRATED`, or what is wrong with the touches.
    reason : str
        The status in words.
    remarks : tuple of str
        What to look at.
    outliers : dict of int to str
        Rows of bad touches, which did not count, and what is wrong with them.
    seconds : float
    """

    status: CalibrationStatus
    reason: str
    remarks: tuple[str, ...]
    outliers: dict[int, str]
    seconds: float
    _fit: Fit

    @cached_property
    def scene(self) -> Scene:
        """The scene with what was found; raises ValueError unless calibrated."""
        if self.status is not CalibrationStatus.CALIBRATED:
            raise ValueError(f"{self.status}: {self.reason}")
        return self._fit.model.unknowns.scene_at(self._fit.values, self._fit.model.reading)

    @property
    def parameters(self) -> dict[str, dict[str, float]]:
        """Value and standard deviation by name, in the name's unit; offsets in V."""
        deviations = np.sqrt(np.diag(self.covariance)).tolist()
        names, values = self._fit.model.unknowns.names, self._fit.values.tolist()
        return {
            name: {"value": value, "deviation": deviation}
            for name, value, deviation in zip(names, values, deviations, strict=True)
        }

    @property
    def covariance(self) -> Array:
        """Covariance of the parameters, (parameters, parameters)."""
        return self._fit.covariance

    @property
    def chi_square(self) -> float:
        """Squares of residuals over their variances, errors of places included."""
        return self._fit.chi_square

    @property
    def degrees_of_freedom(self) -> int:
        """Readings less what they tell of the parameters."""
        return self._fit.degrees_of_freedom

    @property
    def p_value(self) -> float:
        """Probability of as large a chi-square."""
        return self._fit.p_value

    @property
    def rows(self) -> list[int]:
        """Numbers of the touches' rows."""
        return [int(row) for row in self._fit.model.touches.rows]

    @property
    def electrodes(self) -> list[str]:
        """Names of the electrodes."""
        return [channel.name for channel in self._fit.model.channels]

    @property
    def unit(self) -> str:
        """Of readings, predictions and residuals: pC or V."""
        return self._fit.model.unit

    @property
    def readings(self) -> Array:
        """What was read, (touches, electrodes)."""
        return self._fit.model.touches.readings

    @property
    def predictions(self) -> Array:
        """What the calibrated sensor reads at the corrected places, (touches, electrodes)."""
        return self._fit.prediction.readings

    @property
    def residuals(self) -> Array:
        """Readings less predictions, (touches, electrodes)."""
        return self.readings - self.predictions

    @property
    def given_places_mm(self) -> Array:
        """Places of the touches on the stage as they were given, (touches, 2)."""
        return self._fit.model.touches.touches[:, :2]

    @property
    def places_mm(self) -> Array:
        """Corrected places of the touches on the stage, (touches, 2)."""
        return self.given_places_mm + self._fit.moves

    @cached_property
    def leave_one_out(self) -> dict[str, float]:
        """Errors of each touch by a calibration with the others, root mean squares or medians.

        ``charge`` is relative to the readings; ``place_mm`` and ``force`` (relative) are medians of
        what a touch would be located off its place and force in the file, by linear steps.
        """
        fit = self._fit
        roots = fit.whitened[0][fit.kept]
        left = (roots @ fit.deleted()[0][fit.kept][..., None])[..., 0]
        weights = 1.0 / fit.deviations[fit.kept]
        slopes = weights[..., None] * fit.prediction.by_touch[fit.kept]
        steps = (np.linalg.pinv(slopes) @ (weights * left)[..., None])[..., 0]
        forces = fit.model.touches.touches[fit.kept, 3]
        sizes = np.abs(fit.prediction.readings[fit.kept])
        return {
            "charge": float(np.sqrt(np.sum(left**2) / np.sum(sizes**2))),
            "place_mm": float(np.median(np.hypot(steps[:, 0], steps[:, 1]))),
            "force": float(np.median(np.abs(steps[:, 2]) / forces)),
        }

    @cached_property
    def not_told_apart(self) -> tuple[str, ...]:
        """Combinations of parameters that the priors decided, rather than the readings."""
        unknowns, texts = self._fit.model.unknowns, []
        for value, direction in zip(*self._fit.told, strict=True):
            if value >= 1.0:
                continue
            large = np.flatnonzero(np.abs(direction) > PART * np.abs(direction).max())
            signs = np.sign(direction[large]) * np.sign(unknowns.start[large] + 1e-300)
            ways = [
                " and ".join([unknowns.names[i] for i in large[signs == sign]])
                for sign in (1.0, -1.0)
            ]
            move = (
                " up with ".join(ways) + " down" if all(ways) else f"{ways[0] or ways[1]} together"
            )
            if len(large) == 1:
                move = unknowns.names[large[0]]
            priors = ", ".join(self._prior(int(i)) for i in large)
            texts.append(f"{move}: hardly seen in the readings; decided by the priors {priors}")
        return tuple(texts)

    def _prior(self, i: int) -> str:
        unknowns = self._fit.model.unknowns
        name, sd, start = unknowns.names[i], unknowns.priors[i], unknowns.start[i]
        kind = name.split(".")[0] if name.startswith("offset.") else name
        if kind in ABSOLUTE_PRIORS or not start:
            return f"{name} {start:.4g} ± {sd:.2g}"
        return f"{name} {start:.4g} ± {100.0 * sd / abs(start):.2g} %"

    def to_json(self) -> dict[str, Any]:
        """What `pvdf-fem calibrate --json` prints; without parameters unless calibrated."""
        results: dict[str, Any] = {"reason": self.reason}
        if self.status is CalibrationStatus.CALIBRATED:
            names, places, residuals = (
                self.electrodes,
                self.places_mm.tolist(),
                self.residuals.tolist(),
            )
            results = {
                "parameters": self.parameters,
                "covariance": self.covariance.tolist(),
                "not_told_apart": list(self.not_told_apart),
                "leave_one_out": self.leave_one_out,
                "touches": [
                    {
                        "row": row,
                        "x_mm": x,
                        "y_mm": y,
                        "residuals": {
                            n: v if v == v else None for n, v in zip(names, r, strict=True)
                        },
                    }
                    for row, (x, y), r in zip(self.rows, places, residuals, strict=True)
                ],
            }
        return {
            "status": str(self.status),
            **results,
            "chi_square": self.chi_square,
            "degrees_of_freedom": self.degrees_of_freedom,
            "p_value": self.p_value,
            "outliers": [{"row": row, "reason": why} for row, why in self.outliers.items()],
            "remarks": list(self.remarks),
            "reading": self._fit.model.reading,
            "unit": self.unit,
            "solves": self._fit.model.solves,
            "seconds": self.seconds,
        }

    def __str__(self) -> str:
        grid, notes = self._parts()
        return "\n".join([f"{self.status}: {self.reason}", "", *grid.lines(), "", *notes])

    def __repr__(self) -> str:
        count = len(self._fit.values)
        return f"<Calibration: {self.status}, {count} parameters, {len(self.rows)} touches>"

    def _repr_html_(self) -> str:
        grid, notes = self._parts()
        head = f"<p><b>{self.status}</b>: {escape(self.reason)}</p>"
        return head + grid.html() + "".join(f"<p>{escape(note)}</p>" for note in notes)

    def _parts(self) -> tuple[Grid, list[str]]:
        """The table of parameters, and what is said below it."""
        rows = tuple(
            (name, *rounded(of["value"], of["deviation"])) for name, of in self.parameters.items()
        )
        calibrated = self.status is CalibrationStatus.CALIBRATED
        grid = Grid(("parameter", "value", "±"), rows if calibrated else ())
        freedom = f"{self.degrees_of_freedom} degrees of freedom"
        notes = [f"chi-square: {self.chi_square:.1f} with {freedom} (p = {self.p_value:.2g})"]
        if calibrated:
            left = self.leave_one_out
            notes.append(
                f"leave-one-out: readings {100 * left['charge']:.2g} %, places"
                f" {left['place_mm']:.2g} mm, forces {100 * left['force']:.2g} %"
            )
            notes += [f"not told apart: {text}" for text in self.not_told_apart]
        notes += [f"left out: row {row}: {why}" for row, why in self.outliers.items()]
        return grid, notes + [f"remark: {text}" for text in self.remarks]

"""The table ``[calibration]`` of a scene: how uncertain its calibrated values are."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, model_validator

from pvdf_fem.arrays import Array
from pvdf_fem.scene.changes import get_number
from pvdf_fem.scene.keys import Finite, Key, Section, make_validation_error
from pvdf_fem.scene.registry import FILM_LOAD_CLASSES, SUPPORT_CLASSES
from pvdf_fem.scene.scene_file import format_error, suggest

STAGE_KEYS = ("stage.x_mm", "stage.y_mm", "stage.rotation_deg")
#: Numbers of the film that change the charges of a touch smoothly.
FILM_NAMES = (
    "thickness_um",
    "temperature_change_K",
    "pretension_N_m",
    "youngs_modulus_GPa",
    "poisson_ratio",
    "d31_pC_N",
    "d32_pC_N",
    *FILM_LOAD_CLASSES,
    *SUPPORT_CLASSES,
)
#: Beginnings of the keys of a channel, which end with the name of its electrode.
CHANNEL_KEYS = ("readout.gain.", "readout.offset_V.")
#: Smallest eigenvalue of a matrix of correlations that counts as zero. Their rounding to six digits
#: changes an eigenvalue by up to 1e-6 per parameter.
MIN_EIGENVALUE = -1e-4


def _check_deviations(deviations: tuple[float, ...]) -> tuple[float, ...]:
    """Return standard deviations; refuse those that are negative."""
    for deviation in deviations:
        if deviation < 0.0:
            reason = f"has a negative standard deviation, {deviation:g}; give zero or a larger one"
            raise make_validation_error(reason)
    return deviations


class CalibratedParameters(Section):
    """Uncertainty of calibrated values of the scene, from `pvdf-fem calibrate`.

    It makes the standard deviations of located touches larger. As all touches of a sensor have the
    same calibration, averaging over touches does not reduce this part of their errors.
    """

    keys: Annotated[tuple[str, ...], Key()] = ()
    """Keys of the calibrated values: numbers of the film, ``readout.gain.A``,
    ``readout.offset_V.A``, ``stage.x_mm``, ``stage.y_mm`` and ``stage.rotation_deg``."""
    deviations: Annotated[tuple[Finite, ...], AfterValidator(_check_deviations), Key()] = ()
    """Standard deviation of each value, in the unit of its key."""
    correlations: Annotated[tuple[tuple[Finite, ...], ...] | None, Key(example=[[1.0]])] = None
    """Matrix of the correlations of the values, by default without any."""
    date: Annotated[str | None, Key(example="2026-11-28")] = None
    """Date of the calibration, for information."""

    @model_validator(mode="after")
    def _require_matching_sizes(self) -> CalibratedParameters:
        """Refuse keys that occur twice, lists of another length, and impossible correlations."""
        count = len(self.keys)
        for key in self.keys:
            if self.keys.count(key) > 1:
                reason = f"has {key} twice; give each key once"
                raise make_validation_error(reason, key="keys", value=list(self.keys))
        if len(self.deviations) != count:
            reason = f"has {len(self.deviations)} numbers for {count} keys; give one for each key"
            raise make_validation_error(reason, key="deviations", value=list(self.deviations))
        if self.correlations is None:
            return self
        reason = _explain_bad_correlations(self.correlations, count)
        if reason:
            raise make_validation_error(reason, key="correlations", value=self._plain_correlations)
        return self

    @property
    def _plain_correlations(self) -> list[Any]:
        """Correlations as lists, for messages."""
        return [list(row) for row in self.correlations or ()]

    @property
    def covariance(self) -> Array:
        """Covariance of the values, in the units of `keys`.

        Returns
        -------
        ndarray, shape (keys, keys)
        """
        count = len(self.keys)
        correlations = np.eye(count)
        if self.correlations is not None:
            correlations = np.array(self.correlations, dtype=float).reshape(count, count)
        return correlations * np.outer(self.deviations, self.deviations)

    def find_key_errors(self, film: Section, electrodes: Sequence[str]) -> Iterator[str]:
        """Yield a message for each key that is not a calibrated value of a scene.

        Parameters
        ----------
        film : Film
            Film of the scene.
        electrodes : sequence of str
            Names of the scene's electrodes.
        """
        channel_keys = [key + name for key in CHANNEL_KEYS for name in electrodes]
        for key in self.keys:
            if key in STAGE_KEYS or key in channel_keys or _is_film_number(film, key):
                continue
            advice = suggest(key, [*channel_keys, *STAGE_KEYS])
            if key.startswith("film."):
                advice = "remove it with its deviation, or calibrate again"
            reason = f"is not a number of this scene that can be calibrated; {advice}"
            yield format_error("calibration.keys", key, reason)


def _explain_bad_correlations(rows: tuple[tuple[float, ...], ...], count: int) -> str:
    """Return why rows of numbers are not a matrix of correlations; empty if they are one."""
    if len(rows) != count or any(len(row) != count for row in rows):
        return f"must have {count} rows of {count} numbers, one for each key; correct it"
    matrix = np.array(rows, dtype=float).reshape(count, count)
    if count == 0:
        return ""
    if not np.allclose(np.diag(matrix), 1.0):
        return "must have ones on the diagonal; correct it"
    if not np.allclose(matrix, matrix.T):
        return "must be symmetric; correct it"
    if np.linalg.eigvalsh(matrix).min() < MIN_EIGENVALUE:
        return "has a negative eigenvalue, so that no values have such correlations; correct it"
    return ""


def _is_film_number(film: Section, key: str) -> bool:
    """Return whether a film has a number under a key such as ``film.thickness_um``."""
    section, _, name = key.partition(".")
    if section != "film" or name.removesuffix(".0").removesuffix(".1") not in FILM_NAMES:
        return False
    try:
        get_number(film, name)
    except (AttributeError, IndexError, KeyError, TypeError, ValueError):
        return False
    return True

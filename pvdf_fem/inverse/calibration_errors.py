"""Errors of charges that a calibration has left, and their effect on located touches.

The parameters θ of a calibrated sensor have errors with the covariance S. They change the residual
of each charge by A δθ, with the derivatives A of the residuals with respect to the parameters at
the touch. So residuals have the covariance V = diag(σ²) + A S Aᵀ, with the standard deviations σ of
the noise. Whitened by V, they give the weighted least-squares estimate of the touch with its
covariance (Jᵀ V⁻¹ J)⁻¹ and the right chi-square, as if the parameters were fitted together with the
touch, with the calibration as their prior (Golub and Pereyra, Inverse Problems 19 (2003) R1-R26).

The noise σ of a mean of many samples is small, but S is not: the errors of the calibration are the
same in all samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Protocol

import numpy as np

from pvdf_fem.arrays import Array, Indices, Mask
from pvdf_fem.electrodes.channel import make_channels
from pvdf_fem.progress import TaskRunner
from pvdf_fem.scene.instrument.calibration import (
    CHANNEL_KEYS,
    STAGE_KEYS,
    CalibratedParameters,
)
from pvdf_fem.surrogate.charge_function import ChargeFunction, count_probes
from pvdf_fem.surrogate.charge_sensitivity import fit_sensitivities, list_film_keys
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, TouchColumn

GAIN_KEY, OFFSET_KEY = CHANNEL_KEYS


class Sensitivities(Protocol):
    """Derivatives of charges with respect to parameters of the film, as a function of the touch."""

    @property
    def unloaded_slopes(self) -> Array:
        """Derivatives of the charges of the unloaded film, shape (electrodes, keys)."""

    def evaluate(self, touches: Array, charges_pC: Array, slopes: Array) -> Array:
        """Compute derivatives of the changes of the charges; see `ChargeSensitivities.evaluate`."""


@dataclass(frozen=True, eq=False)
class CalibrationErrors:
    """Uncertain parameters of a calibrated sensor, and their effect on residuals of charges.

    Columns are in the order of ``calibration.keys`` in the scene.
    """

    #: Square root R of the covariance R Rᵀ of the parameters, shape (parameters, directions).
    root: Array
    electrodes: Indices  #: Indices in the response of the electrodes that were measured.
    #: Derivatives of the residuals with respect to gains and offsets, and zeros in other columns,
    #: shape (rows, electrodes, parameters).
    channel_effects: Array
    gain_columns: Indices  #: Column of the gain of each electrode, -1 for none.
    gains: Array  #: Gains of the electrodes.
    #: Columns of the position x, y and the rotation of the stage, -1 for none.
    stage_columns: tuple[int, int, int]
    film_columns: Indices  #: Columns of the parameters of the film.
    film: Sensitivities | None  #: Derivatives with respect to these; None if there are none.
    includes_unloaded: bool  #: Whether total charges are read, which include the unloaded ones.
    probe_count: int = 1  #: Number of probes of a touch.

    @classmethod
    def from_response(
        cls,
        response: ChargeFunction,
        electrodes: Sequence[int],
        reading: str,
        *,
        has_offsets: bool = True,
    ) -> CalibrationErrors | None:
        """Make the errors of the calibration of a response's scene, or None without any.

        Parameters
        ----------
        response : ChargeFunction
            The response, whose scene may have a table ``[calibration]``.
        electrodes : sequence of int
            Indices in the response of the electrodes that are measured.
        reading : str
            Meaning of the readings, ``total`` or ``change``.
        has_offsets : bool
            Whether errors of the offsets matter. They do not if a baseline is subtracted.

        Raises
        ------
        ValueError
            If charges have no derivative with respect to a key.
        """
        table = response.scene.calibration
        if table is None or not any(table.deviations):
            return None
        keys = table.keys
        film_keys = list_film_keys(response.scene)
        every_channel = make_channels(response.scene)
        channels = [every_channel[index] for index in electrodes]
        effects = np.zeros((1, len(channels), len(keys)))
        gain_columns = []
        for row, channel in enumerate(channels):
            gain_key = GAIN_KEY + channel.name
            gain_columns.append(keys.index(gain_key) if gain_key in keys else -1)
            offset_key = OFFSET_KEY + channel.name
            if has_offsets and offset_key in keys:
                volt_pC = 1e12 * channel.capacitance
                effects[0, row, keys.index(offset_key)] = volt_pC / channel.gain
        x, y, rotation = (keys.index(key) if key in keys else -1 for key in STAGE_KEYS)
        return cls(
            root=_compute_root(table),
            electrodes=np.array(electrodes),
            channel_effects=effects,
            gain_columns=np.array(gain_columns),
            gains=np.array([channel.gain for channel in channels]),
            stage_columns=(x, y, rotation),
            film_columns=np.array([keys.index(key) for key in film_keys], dtype=int),
            film=find_sensitivities(response, film_keys) if film_keys else None,
            includes_unloaded=reading == "total",
            probe_count=count_probes(response),
        )

    def with_signals(self, signals_pC: Array) -> CalibrationErrors:
        """Return a copy with the effects of the gains on measured signals.

        Parameters
        ----------
        signals_pC : ndarray, shape (rows, electrodes)
            Signals in pC, corrected for the gains g. A signal s has the derivative -s/g.
        """
        effects = np.repeat(self.channel_effects[:1], len(signals_pC), axis=0)
        rows = np.flatnonzero(self.gain_columns >= 0)
        finite = np.where(np.isfinite(signals_pC), signals_pC, 0.0)
        effects[:, rows, self.gain_columns[rows]] = finite[:, rows] / self.gains[rows]
        return replace(self, channel_effects=effects)

    def select_electrodes(self, indices: Indices) -> CalibrationErrors:
        """Return a copy with some of the measured electrodes only.

        Parameters
        ----------
        indices : ndarray of int
            Indices of the electrodes in `electrodes`.
        """
        return replace(
            self,
            electrodes=self.electrodes[indices],
            channel_effects=self.channel_effects[:, indices],
            gain_columns=self.gain_columns[indices],
            gains=self.gains[indices],
        )

    def select_rows(self, rows: Indices) -> CalibrationErrors:
        """Return a copy with the rows of the signals at these indices only."""
        return replace(self, channel_effects=self.channel_effects[rows])

    def evaluate_film(self, touches: Array, charges_pC: Array, slopes: Array) -> Array | None:
        """Compute the derivatives of the measured charges with respect to the film's parameters.

        Parameters
        ----------
        touches : ndarray, shape (n, k)
            Touches in the axes of the film.
        charges_pC : ndarray, shape (n, electrodes of the response)
            Total charges of these touches in pC.
        slopes : ndarray, shape (n, electrodes of the response, k)
            Derivatives of the charges with respect to the touch, in the axes of the film.

        Returns
        -------
        ndarray, shape (n, electrodes, film parameters), or None
            None if no parameter of the film is uncertain.
        """
        if self.film is None:
            return None
        effects = self.film.evaluate(touches, charges_pC, slopes)
        if self.includes_unloaded:
            effects = effects + self.film.unloaded_slopes
        return effects[:, self.electrodes]

    def compute_effects(
        self, coordinates: Array, jacobian: Array, film_effects: Array | None, rows: Indices | slice
    ) -> Array:
        """Compute the derivatives A of residuals, times the square root R of the covariance.

        Parameters
        ----------
        coordinates : ndarray, shape (n, k)
            Coordinates of touches, relative to the film's centre along the axes of the stage.
        jacobian : ndarray, shape (n, electrodes, k)
            Derivatives of the charges with respect to the coordinates.
        film_effects : ndarray, shape (n, electrodes, film parameters), or None
            Result of `evaluate_film`.
        rows : ndarray of int, shape (n,), or slice
            Indices of the rows of the signals.

        Returns
        -------
        ndarray, shape (n, electrodes, directions)

        Notes
        -----
        If the film moves by (dx, dy) on the stage, and a touch does not, the touch moves by
        (-dx, -dy) on the film. If the film rotates by dφ, it moves by dφ (y, -x) and rotates by
        -dφ.
        """
        shape = (len(coordinates), *self.channel_effects.shape[1:])
        effects = np.array(np.broadcast_to(self.channel_effects[rows], shape))
        if film_effects is not None:
            effects[:, :, self.film_columns] += film_effects
        stage_x, stage_y, stage_rotation = self.stage_columns
        width = len(TOUCH_QUANTITIES)
        for first in range(0, self.probe_count * width, width):
            by_x = jacobian[:, :, first + TouchColumn.X]
            by_y = jacobian[:, :, first + TouchColumn.Y]
            if stage_x >= 0:
                effects[:, :, stage_x] -= by_x
            if stage_y >= 0:
                effects[:, :, stage_y] -= by_y
            if stage_rotation >= 0:
                x = coordinates[:, None, first + TouchColumn.X]
                y = coordinates[:, None, first + TouchColumn.Y]
                turned = np.pi / 180.0 * (y * by_x - x * by_y)
                effects[:, :, stage_rotation] += turned
                effects[:, :, stage_rotation] -= jacobian[:, :, first + TouchColumn.ROTATION]
        return np.asarray(effects @ self.root)


def whiten(system: Array, deviations_pC: Array, effects: Array, is_limit: Mask) -> Array:
    """Whiten residuals with errors of their own and errors of common causes.

    Parameters
    ----------
    system : ndarray, shape (n, electrodes, 1 + k)
        Augmented matrices [r J] in pC.
    deviations_pC : ndarray, shape (n, electrodes) or (1, electrodes)
        Standard deviations σ of independent errors.
    effects : ndarray, shape (n, electrodes, directions)
        Changes B of the residuals by one standard deviation of each common cause.
    is_limit : ndarray of bool, shape (n, electrodes) or (1, electrodes)
        Whether a charge is a limit. Limits have their own variance, without correlations.

    Returns
    -------
    ndarray, shape (n, electrodes, 1 + k)
        L⁻¹ [r J] with the Cholesky factor L of diag(σ²) + B Bᵀ.
    """
    is_limit = np.broadcast_to(is_limit, effects.shape[:2])
    correlated = np.where(is_limit[:, :, None], 0.0, effects)
    covariance = np.matmul(correlated, correlated.swapaxes(1, 2))
    variance = np.square(deviations_pC) + np.where(is_limit, np.square(effects).sum(axis=2), 0.0)
    np.einsum("nii->ni", covariance)[:] += variance
    limits = system[is_limit] / np.sqrt(variance[is_limit])[:, None]
    # A limit at infinity must not reach the other rows.
    finite = np.where(is_limit[:, :, None], 0.0, system)
    whitened = np.linalg.solve(np.linalg.cholesky(covariance), finite)
    whitened[is_limit] = limits
    return np.asarray(whitened)


def _compute_root(table: CalibratedParameters) -> Array:
    """Compute a square root of the covariance; of correlations, so that units do not matter."""
    deviations = np.array(table.deviations)
    scale = np.where(deviations > 0.0, deviations, 1.0)
    eigenvalues, vectors = np.linalg.eigh(table.covariance / np.outer(scale, scale))
    root = scale[:, None] * vectors * np.sqrt(np.maximum(eigenvalues, 0.0))
    return np.asarray(root)


@lru_cache(maxsize=8)
def find_sensitivities(response: ChargeFunction, keys: tuple[str, ...]) -> Sensitivities:
    """Return the derivatives of a response's charges with respect to parameters of the film.

    They are those that the response stores. Otherwise they are solved, which takes seconds, and
    cached for the last few responses.

    Parameters
    ----------
    response : ChargeFunction
        The response. It may have an attribute `sensitivities`, see `Response.sensitivities`.
    keys : tuple of str
        Keys of the film.

    Raises
    ------
    ValueError
        If charges have no derivative with respect to a key.
    """
    stored = getattr(response, "sensitivities", None)
    if stored is not None and set(keys) <= set(stored.keys):
        selected: Sensitivities = stored.select(keys)
        return selected
    return fit_sensitivities(response.scene, response.domain, keys, response.evaluate, TaskRunner())

"""A channel's reading from an electrode's charge.

The charge Q sits on a capacitance C, which a resistance R discharges: C dV/dt + V/R = dQ/dt. In
front of a voltage amplifier, C includes electrode and cable (Mirbagheri's thesis, App. 5, where the
cable is left out). A charge amplifier moves the charge to its feedback capacitance, whatever
electrode and cable have. A reading is an offset plus a gain times V.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pvdf_fem.arrays import Array
from pvdf_fem.scene.readout import Readout
from pvdf_fem.scene.scene import Scene

#: Meanings of a reading, and their names.
READINGS = {"total": "total charges", "change": "changes by the touch"}


@dataclass(frozen=True)
class Channel:
    """One electrode's channel; all quantities are SI."""

    name: str
    capacitance: float  #: In F, that of the feedback or of electrode and cable.
    resistance: float = math.inf  #: In Ω; infinite where nothing discharges the capacitance.
    gain: float = 1.0
    offset: float = 0.0  #: In V.
    noise: float = 0.0  #: Standard deviation of readings in V.

    @property
    def time_constant(self) -> float:
        """R C in s, in which the voltage of a charge at rest falls to 1/e."""
        return self.resistance * self.capacitance

    def reading(self, charge: ArrayLike) -> Array:
        """Readings in V for charges in C that have just arrived."""
        return self.offset + self.gain * np.asarray(charge, dtype=float) / self.capacitance

    def step(self, charge: float, time: ArrayLike) -> Array:
        """Readings in V at times in s after a charge in C has come at once and stayed."""
        time = np.asarray(time, dtype=float)
        decay = np.where(time < 0.0, 0.0, np.exp(-np.maximum(time, 0.0) / self.time_constant))
        return self.offset + self.gain * charge / self.capacitance * decay

    def harmonic(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Complex amplitudes of the reading over the charge in V/C, by frequency in Hz.
        i ω R/(1 + i ω R C): a high-pass filter, whose phase leads."""
        turn = 2j * np.pi * np.asarray(frequency, dtype=float)
        if math.isinf(self.resistance):
            return np.where(turn == 0.0, 0.0, self.gain / self.capacitance + 0j)
        return self.gain * turn * self.resistance / (1.0 + turn * self.time_constant)


def list_units_pC(channels: Sequence[Channel]) -> dict[str, Array]:
    """Nominal pC per unit of readings, by unit, (channels,)."""
    volt = 1e12 * np.array([channel.capacitance for channel in channels])
    charges = {"pC": 1.0, "fC": 1e-3, "nC": 1e3, "µC": 1e6, "C": 1e12}
    units = {unit: np.full(len(channels), factor) for unit, factor in charges.items()}
    return units | {"V": volt, "mV": 1e-3 * volt, "µV": 1e-6 * volt}


def compute_capacitance(area: float, thickness: float, permittivity: float) -> float:
    """Capacitance in F of an electrode of an area in m² on a film of a thickness in m: ε0 εr A/h.
    Stray fields at the edges are neglected: the thesis's electrode is 120 times as wide as the film
    is thick."""
    from scipy.constants import epsilon_0  # most scenes have no readout

    return epsilon_0 * permittivity * area / thickness


def make_channels(scene: Scene) -> tuple[Channel, ...]:
    """The channels of a scene's electrodes; ideal ones where it has no ``[readout]``."""
    readout, film, found = scene.readout or Readout(), scene.film, []
    for electrode in scene.electrode_list:
        name = electrode.name
        if readout.get_value("kind", name) == "charge":
            capacitance = readout.get_value("feedback_capacitance_pF", name) / 1e12
            resistance = readout.get_value("feedback_resistance_MOhm", name)
        else:
            area = electrode.outline.area
            capacitance = compute_capacitance(area, film.thickness, film.permittivity)
            capacitance += readout.get_value("cable_capacitance_pF", name) / 1e12
            resistance = readout.get_value("input_resistance_MOhm", name)
        gain, offset, noise = (
            readout.get_value(key, name) for key in ("gain", "offset_V", "noise_V")
        )
        resistance = math.inf if resistance is None else 1e6 * resistance
        found.append(Channel(name, capacitance, resistance, gain, offset, noise))
    return tuple(found)


def compute_readings_V(scene: Scene, charges_pC: ArrayLike, changes_pC: ArrayLike) -> Array:
    """Readings in V just after a sudden touch, (electrodes,), of total charges or of their changes
    by the touch, (electrodes,) both, whichever the scene's readout reads."""
    total = scene.readout is not None and scene.readout.reading == "total"
    read = np.asarray(charges_pC if total else changes_pC, dtype=float) / 1e12
    return np.array(
        [c.reading(charge) for c, charge in zip(make_channels(scene), read, strict=True)]
    )

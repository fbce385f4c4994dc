"""A channel of the readout: the reading that an electrode's charge makes.

The charge Q sits on a capacitance C, which a resistance R discharges: C dV/dt + V/R = dQ/dt. In
front of a voltage amplifier, C is the capacitance of electrode and cable (Mirbagheri's thesis,
App. 5, where the cable is left out). A charge amplifier transfers the charge to its feedback
capacitance, whatever the capacitance of electrode and cable. A reading is an offset plus a gain
times V.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pvdf_fem.arrays import Array
from pvdf_fem.scene.readout import Readout
from pvdf_fem.scene.scene import Scene

#: What readings measure, in words, by the value of the scene's key ``readout.reading``.
READINGS = {"total": "total charges", "change": "changes by the touch"}
#: Size of each unit of charge in pC.
CHARGE_UNITS_PC = {"pC": 1.0, "fC": 1e-3, "nC": 1e3, "µC": 1e6, "C": 1e12}
#: Size of each unit of voltage in V.
VOLTAGE_UNITS_V = {"V": 1.0, "mV": 1e-3, "µV": 1e-6}
READING_UNITS = (*CHARGE_UNITS_PC, *VOLTAGE_UNITS_V)  #: Units in which readings may be given.


@dataclass(frozen=True)
class Channel:
    """The channel of the readout that reads one electrode; all quantities are in SI units."""

    name: str
    #: Capacitance of a charge amplifier's feedback, or of electrode and cable, in F.
    capacitance: float
    #: Resistance in Ω that discharges the capacitance; infinite if there is none.
    resistance: float = math.inf
    gain: float = 1.0  #: Factor from the voltage of the capacitance to the reading.
    offset: float = 0.0  #: Reading in V without charge.
    noise: float = 0.0  #: Standard deviation of readings in V.
    low_V: float = -math.inf  #: Lowest possible reading in V.
    high_V: float = math.inf  #: Highest possible reading in V.

    @property
    def time_constant(self) -> float:
        """Time constant R C in s, within which the voltage decays to 1/e; may be infinite."""
        return self.resistance * self.capacitance

    def reading(self, charge: ArrayLike) -> Array:
        """Return the readings in V just after charges in C have appeared suddenly.

        The result has the shape of `charge`. Noise is not added.
        """
        charge = np.asarray(charge, dtype=float)
        return self.offset + self.gain * charge / self.capacitance

    def step(self, charge: float, time: ArrayLike) -> Array:
        """Return the step response: readings after a constant charge appears suddenly.

        Parameters
        ----------
        charge : float
            The charge in C, which appears at time 0.
        time : array_like
            Times in s.

        Returns
        -------
        ndarray
            Readings in V at these times; before time 0 they equal the offset.
        """
        time = np.asarray(time, dtype=float)
        decay = np.exp(-np.maximum(time, 0.0) / self.time_constant)
        voltage = charge / self.capacitance * np.where(time < 0.0, 0.0, decay)
        return self.offset + self.gain * voltage

    def harmonic(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Return the transfer function from charge to reading at given frequencies.

        The gain times i ω R/(1 + i ω R C) is a high-pass filter; the reading leads the charge.

        Parameters
        ----------
        frequency : array_like
            Frequencies in Hz.

        Returns
        -------
        ndarray of complex
            Complex amplitude of the reading divided by that of the charge, in V/C.
        """
        i_omega = 2j * np.pi * np.asarray(frequency, dtype=float)
        if math.isinf(self.resistance):
            return np.where(i_omega == 0.0, 0.0, self.gain / self.capacitance + 0j)
        return self.gain * i_omega * self.resistance / (1.0 + i_omega * self.time_constant)


def list_units_pC(channels: Sequence[Channel]) -> dict[str, Array]:
    """List the units in which readings may be given, with their sizes in pC.

    Units of voltage are converted by the capacitance of each channel. Gains and offsets are
    ignored.

    Parameters
    ----------
    channels : sequence of Channel
        The channels that make the readings.

    Returns
    -------
    dict of str to ndarray, shape (channels,)
        For every unit, its size in pC on each channel.
    """
    units = {}
    for unit, size_pC in CHARGE_UNITS_PC.items():
        units[unit] = np.full(len(channels), size_pC)
    volt_pC = 1e12 * np.array([channel.capacitance for channel in channels])
    for unit, size_V in VOLTAGE_UNITS_V.items():
        units[unit] = size_V * volt_pC
    return units


def get_reading_unit(scene: Scene) -> str:
    """Return the unit of readings without one: ``readout.unit``, or pC if there is no readout."""
    return scene.readout.unit if scene.readout else "pC"


def find_unit_errors(scene: Scene, unit: str | None, name: str = "unit =") -> Iterator[str]:
    """Yield a message if a unit of readings is unknown, or one of voltage without a readout.

    Parameters
    ----------
    scene : Scene
        Scene with or without a readout.
    unit : str or None
        The unit; None for that of `get_reading_unit`, which is always valid.
    name : str
        Name of the argument or option, for the beginning of the message.
    """
    if unit is None:
        return
    if unit not in READING_UNITS:
        yield f"{name} {unit}: choose from {', '.join(READING_UNITS)}"
    elif unit in VOLTAGE_UNITS_V and scene.readout is None:
        yield f"{name} {unit}: the scene has no [readout]; add one, or give readings in pC"


def compute_capacitance(area: float, thickness: float, permittivity: float) -> float:
    """Compute the capacitance of an electrode, ε0 εr A/h.

    Stray fields at the edges are neglected: the thesis's electrode is 120 times as wide as the film
    is thick.

    Parameters
    ----------
    area : float
        Area of the electrode in m².
    thickness : float
        Thickness of the film in m.
    permittivity : float
        Relative permittivity εr.

    Returns
    -------
    float
        In F.
    """
    from scipy.constants import epsilon_0  # most scenes have no readout

    return epsilon_0 * permittivity * area / thickness


def make_channels(scene: Scene) -> tuple[Channel, ...]:
    """Make the channels of a scene's electrodes, in their order.

    A scene without a table ``[readout]`` gets the default readout: charge amplifiers of gain 1,
    without feedback resistance, offset and noise.
    """
    readout = scene.readout or Readout()
    film = scene.film
    channels = []
    for electrode in scene.electrode_list:
        name = electrode.name
        if readout.get_value("kind", name) == "charge":
            capacitance = readout.get_value("feedback_capacitance_pF", name) / 1e12
            resistance_MOhm = readout.get_value("feedback_resistance_MOhm", name)
        else:
            area = electrode.outline.area
            capacitance = compute_capacitance(area, film.thickness, film.permittivity)
            capacitance += readout.get_value("cable_capacitance_pF", name) / 1e12
            resistance_MOhm = readout.get_value("input_resistance_MOhm", name)
        low_V, high_V = readout.get_range_V(name)
        channel = Channel(
            name,
            capacitance,
            resistance=math.inf if resistance_MOhm is None else 1e6 * resistance_MOhm,
            gain=readout.get_value("gain", name),
            offset=readout.get_value("offset_V", name),
            noise=readout.get_value("noise_V", name),
            low_V=low_V,
            high_V=high_V,
        )
        channels.append(channel)
    return tuple(channels)


def compute_readings_V(scene: Scene, charges_pC: ArrayLike, changes_pC: ArrayLike) -> Array:
    """Compute the readings just after a sudden touch.

    Parameters
    ----------
    scene : Scene
        The scene, whose key ``readout.reading`` says which charges are read; without a table
        ``[readout]`` the changes are read.
    charges_pC : array_like, shape (electrodes,)
        Total charges, which are ignored if changes are read.
    changes_pC : array_like, shape (electrodes,)
        Changes of the charges by the touch, which are ignored if total charges are read.

    Returns
    -------
    ndarray, shape (electrodes,)
        In V.
    """
    reads_total = scene.readout is not None and scene.readout.reading == "total"
    read_pC = charges_pC if reads_total else changes_pC
    charges = np.asarray(read_pC, dtype=float) / 1e12
    readings = []
    for channel, charge in zip(make_channels(scene), charges, strict=True):
        readings.append(channel.reading(charge))
    return np.array(readings)

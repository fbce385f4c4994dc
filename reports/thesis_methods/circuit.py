"""The voltage that an electrode's charge makes in a measuring circuit, and the film's resonance.

An electrode is a charge source in parallel with its capacitance or, equally well, a voltage source
Q/C in series with it (Mirbagheri's thesis, App. 5). An amplifier loads it with a resistance. All
quantities are SI.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from pvdf_fem.readout.channel import Channel


@dataclass(frozen=True)
class Circuit:
    """An electrode and the resistance that loads it.

    Parameters
    ----------
    capacitance : float
        Capacitance of the electrode in F, with those of cable and amplifier input in parallel if
        they are not negligible.
    load_resistance : float
        Input resistance of the amplifier in Ω, with the resistance of the film in parallel.
    """

    capacitance: float
    load_resistance: float

    def __post_init__(self) -> None:
        _require_positive(capacitance=self.capacitance, load_resistance=self.load_resistance)

    @property
    def time_constant(self) -> float:
        """R C in s, in which the charge of a static touch falls to 1/e."""
        return self.load_resistance * self.capacitance

    @property
    def corner_frequency(self) -> float:
        """1/(2π R C) in Hz, at which R equals the reactance."""
        return 1 / (2 * math.pi * self.time_constant)

    def reactance(self, frequency: float) -> float:
        """X = 1/(2π f C) in Ω at a frequency in Hz."""
        _require_positive(frequency=frequency)
        return 1 / (2 * math.pi * frequency * self.capacitance)

    def open_circuit_voltage(self, charge: float) -> float:
        """V = Q/C in V for a charge in C."""
        return charge / self.capacitance

    def parallel_load(self, frequency: float) -> complex:
        """Voltage across the load over the open-circuit voltage, at a frequency in Hz.

        R/(R − iX): the source Q/C in series with C, loaded by R, a high-pass filter. The modulus
        is R/√(R² + X²), the phase atan(X/R) leads. This is what the elements of App. 5 give when
        the voltage is measured where an amplifier measures it.
        """
        _require_positive(frequency=frequency)
        channel = Channel("", self.capacitance, self.load_resistance)
        return complex(self.capacitance * channel.harmonic(frequency))

    def series_load(self, frequency: float) -> complex:
        """Voltage across the capacitance over the source's, at a frequency in Hz.

        1/(1 + iR/X): the thesis's reading of App. 5, Fig. 2, with R in series between the source
        and the capacitance across which the voltage is measured, a low-pass filter. The modulus is
        1/√(1 + (R/X)²), the phase −atan(R/X) lags.
        """
        return 1 / (1 + 1j * self.load_resistance / self.reactance(frequency))

    def voltage(self, charge: float, frequency: float) -> complex:
        """Voltage in V across the load (in parallel) for a charge amplitude in C, in Hz."""
        return self.open_circuit_voltage(charge) * self.parallel_load(frequency)


def voltage_ratio(first: Circuit, second: Circuit, frequency: float | None = None) -> float:
    """Ratio of the voltages that two electrodes give for equal charges.

    Parameters
    ----------
    first, second : Circuit
    frequency : float, optional
        In Hz. Without a frequency the ratio is that of the open-circuit voltages, C_second/C_first,
        which is the largest there is. Far below the corner frequencies, where all charge passes
        through the load, the ratio tends to R_first/R_second whatever the capacitances are.
    """
    if frequency is None:
        return second.capacitance / first.capacitance
    return abs(first.voltage(1.0, frequency)) / abs(second.voltage(1.0, frequency))


def dynamic_factor(frequency: float, first_mode: float, damping_ratio: float = 0.0) -> float:
    """Amplitude of a mode under a harmonic force over its static value.

    1/√((1 − r²)² + (2ζr)²), r = f/f1: the steady state of a linear oscillator, in any textbook on
    vibrations (e.g. Den Hartog, Mechanical Vibrations, ch. 2). For ζ = 0 this is 1/|1 − r²|.

    Parameters
    ----------
    frequency, first_mode : float
        In Hz.
    damping_ratio : float
        ζ, the damping over the critical one, not negative.

    Raises
    ------
    ValueError
        At resonance without damping, where there is no steady state.
    """
    _require_positive(first_mode=first_mode)
    if frequency < 0 or damping_ratio < 0:
        raise ValueError(f"frequency = {frequency}, damping_ratio = {damping_ratio}: give >= 0")
    ratio = frequency / first_mode
    gap = math.hypot(1 - ratio**2, 2 * damping_ratio * ratio)
    if gap == 0:
        raise ValueError(f"frequency = {frequency} Hz is the undamped first mode; give a damping")
    return 1 / gap


def _require_positive(**values: float) -> None:
    for name, value in values.items():
        if not (value > 0 and math.isfinite(value)):
            raise ValueError(f"{name} = {value}: give a positive, finite number")

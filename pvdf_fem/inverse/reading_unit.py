"""Test whether readings are in the unit that they are said to be in.

The sizes of units differ by factors of a hundred and more. So a response, or a few solves of
touches with known forces, show within seconds that readings are in another unit. This is tested
before any other explanation of readings that do not fit.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.channel import Channel, list_units_pC, make_channels
from pvdf_fem.electrodes.misreadings import USUAL_UNITS, choose_usual_unit, list_unit_ratios
from pvdf_fem.inverse.touch.measurement import Deviations, Measurement, get_units_pC
from pvdf_fem.inverse.touch.search import mark_explained, search_rows
from pvdf_fem.scene.scene import Scene
from pvdf_fem.surrogate.charge_function import ChargeFunction
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, TouchColumn, draw_touches

#: Maximum number of rows of a table with which its unit is tested. A row takes about 1 ms.
MAX_ROWS = 64
#: Number of random touches from which the range of possible readings is computed.
RANGE_TOUCHES = 512
#: Another unit is clear if it explains this fraction of the rows, and more rows than the present
#: unit by the factor `CLEAR_RATIO`.
MIN_FRACTION = 0.5
CLEAR_RATIO = 10.0
#: Readings are possible if they are in the range of those of the response's touches, extended by
#: this factor at both ends. For channels of more than 10 pF, the sizes of 1 V and 1 pC differ by
#: more than its square.
RANGE_MARGIN = 3.0
#: Maximum ratio of readings in the right unit to predicted ones, or its inverse. The priors of
#: pretension and gains allow for 1.7 at two standard deviations.
MAX_SIZE_RATIO = 2.0
#: Minimum ratio, or its inverse, of readings in a wrong unit to predicted ones.
MIN_WRONG_RATIO = 5.0
#: Maximum spread of this ratio over the touches, as the ratio of the largest to the smallest. With
#: a wrong unit of the readings it is the same at all forces. With a wrong unit of the forces it is
#: not, since charges are not proportional to the force.
MAX_RATIO_SPREAD = 1.6


class OtherUnit(NamedTuple):
    """The unit in which readings fit, if it is not the one that they are said to be in."""

    #: A name of each size of units in which the readings fit, at least one.
    units: tuple[str, ...]
    text: str  #: The mistake in words, such as ``readings are in pC, not in V``.

    @property
    def unit(self) -> str | None:
        """The most probable unit: the only one, or the only usual one; None if there is none."""
        usual = [unit for unit in self.units if unit in USUAL_UNITS]
        candidates = usual or self.units
        return candidates[0] if len(candidates) == 1 else None

    @property
    def options(self) -> str:
        """The option ``--unit`` to give, or the possible ones."""
        return " or ".join(f"--unit {unit}" for unit in self.units)


def name_other_unit(scene: Scene, sizes: Sequence[Sequence[str]], unit: str) -> OtherUnit | None:
    """Describe the mistake that readings are in one of several other units.

    Parameters
    ----------
    scene : Scene
        Scene of the sensor. Without a readout, a unit of charge is chosen.
    sizes : sequence of sequence of str
        Units in which the readings fit. Each inner sequence has the names of the units of one size,
        of which one is chosen, preferably one of `USUAL_UNITS`.
    unit : str
        The unit that the readings are said to be in.

    Returns
    -------
    OtherUnit or None
        None if `sizes` is empty.
    """
    chosen = []
    for names in sizes:
        chosen.append(choose_usual_unit(names) if scene.readout else names[0])
    if not chosen:
        return None
    # Without a readout, readings in V look like nC: both are named.
    possible = chosen if scene.readout else [*itertools.chain(*sizes)]
    return OtherUnit(tuple(chosen), f"readings are in {' or '.join(possible)}, not in {unit}")


def find_other_unit(
    response: ChargeFunction,
    readings: Mapping[str, Array],
    unit: str,
    *,
    sigma: Deviations = 0.01,
    noise: float | None = None,
    reading: str | None = None,
    rotations_deg: Array | None = None,
    forces_N: Array | None = None,
) -> OtherUnit | None:
    """Find the unit in which touches explain readings, if it is clearly not the given one.

    Parameters
    ----------
    response : ChargeFunction
        The response of the sensor.
    readings : mapping of str to ndarray, shape (n,)
        Columns of readings by electrode. Rows with missing readings are ignored, and of many rows
        only `MAX_ROWS` are used.
    unit : str
        The unit that the readings are said to be in.
    sigma, reading
        As for `locate`.
    noise : float, optional
        Absolute standard deviation of the readings, in their unit. Default: that of the readout.
    rotations_deg, forces_N : ndarray, shape (n,), optional
        Known rotations and forces of the rows.

    Returns
    -------
    OtherUnit or None
        The units in which touches explain at least half of the rows, and more than ten times as
        many rows as in `unit`. If no row is explained in any unit, for example because channels are
        swapped: pC or V, if the sizes of all readings are possible in it, but of none in `unit`.
        Otherwise None.
    """
    known: dict[int, Array] = {}
    if rotations_deg is not None:
        known[TouchColumn.ROTATION] = np.asarray(rotations_deg, dtype=float)
    if forces_N is not None:
        known[TouchColumn.FORCE] = np.asarray(forces_N, dtype=float)
    table = np.stack([np.asarray(column, dtype=float) for column in readings.values()], axis=1)
    is_usable = np.isfinite(np.column_stack([table, *known.values()])).all(axis=1)
    is_usable &= (table != 0.0).all(axis=1)
    if TouchColumn.FORCE in known:
        is_usable &= known[TouchColumn.FORCE] > 0.0
    usable = np.flatnonzero(is_usable)
    if not len(usable):
        return None
    rows = usable[np.unique(np.linspace(0, len(usable) - 1, MAX_ROWS).astype(int))]
    known = {column: values[rows] for column, values in known.items()}
    if TouchColumn.FORCE in known:
        known[TouchColumn.FORCE] = np.log(known[TouchColumn.FORCE])
    test = _UnitTest(
        response, tuple(readings), table[rows], known, sigma=sigma, noise=noise, reading=reading
    )
    # in a wrong unit, readings may be too large for a search, or their deviations underflow to 0
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        return test.find_other(unit)


@dataclass(frozen=True, eq=False)
class _UnitTest:
    """Rows of readings whose unit is tested with a response."""

    response: ChargeFunction
    names: tuple[str, ...]  #: Names of the electrodes.
    readings: Array  #: Readings of these electrodes; shape (n, electrodes).
    known: Mapping[int, Array]  #: Known coordinates by column; shape (n,) each.
    sigma: Deviations
    #: Standard deviation in the unit of the readings; None for that of the readout.
    noise: float | None
    reading: str | None

    def find_other(self, unit: str) -> OtherUnit | None:
        """Find another unit in which touches explain the readings, or in which they are possible.

        Possible readings are considered only if no unit explains any row.

        Parameters
        ----------
        unit : str
            The unit that the readings are said to be in.

        Returns
        -------
        OtherUnit or None
            As returned by `find_other_unit`.
        """
        other_sizes = [names for names, _ in list_unit_ratios(self.channels, unit)]
        explained = self._count_explained(unit)
        fitting = []
        for names in other_sizes:
            count = self._count_explained(names[0])
            if count >= MIN_FRACTION * len(self.readings) and count > CLEAR_RATIO * explained:
                fitting.append(names)
        if not fitting and not explained and not self._count_possible(unit):
            for names in other_sizes:
                is_usual = not set(names).isdisjoint(USUAL_UNITS)
                if is_usual and self._count_possible(names[0]) == len(self.readings):
                    fitting.append(names)
        return name_other_unit(self.response.scene, fitting, unit)

    @cached_property
    def channels(self) -> list[Channel]:
        """Channels of the electrodes that are read."""
        by_name = {channel.name: channel for channel in make_channels(self.response.scene)}
        return [by_name[name] for name in self.names]

    def _make_measurement(self, unit: str) -> Measurement:
        """Describe how the electrodes are read, if the readings are in the given unit."""
        noise_pC = None
        if self.noise is not None:
            sizes_pC = get_units_pC(self.response.scene, unit)
            noise_pC = {name: self.noise * sizes_pC[name] for name in self.names}
        return Measurement.from_response(
            self.response, self.names, self.sigma, noise_pC, self.reading, unit
        )

    def _count_explained(self, unit: str) -> int:
        """Count the rows that a touch explains if the readings are in the given unit."""
        unknown = [i for i in range(len(TOUCH_QUANTITIES)) if i not in self.known]
        readings_pC = self.readings * list_units_pC(self.channels)[unit]
        problem = self._make_measurement(unit).make_problem(readings_pC, np.array(unknown))
        if not problem.is_determinable:
            return 0
        ends = search_rows(problem, self.known, count=1)
        return int(mark_explained(problem, ends).sum())

    @cached_property
    def _size_range_pC(self) -> tuple[float, float]:
        """Range of the sizes of signals that touches in the response's domain can have."""
        touches = draw_touches(self.response.domain, RANGE_TOUCHES)
        charges_pC, _ = self.response.evaluate(touches)
        measurement = self._make_measurement("pC")
        signals = charges_pC[:, measurement.electrodes] - measurement.zero_pC
        sizes = np.linalg.norm(signals, axis=1)
        return float(sizes.min()) / RANGE_MARGIN, float(sizes.max()) * RANGE_MARGIN

    def _count_possible(self, unit: str) -> int:
        """Count the rows whose size is possible if the readings are in the given unit."""
        readings_pC = self.readings * list_units_pC(self.channels)[unit]
        sizes = np.linalg.norm(self._make_measurement(unit).to_signals(readings_pC), axis=1)
        lowest, highest = self._size_range_pC
        return int(((lowest < sizes) & (sizes < highest)).sum())


def find_unit_of_known_touches(
    scene: Scene, readings: Array, predicted: Array, unit: str
) -> OtherUnit | None:
    """Find the unit of the readings of touches whose readings are predicted.

    Parameters
    ----------
    scene : Scene
        Scene of the sensor with its readout.
    readings : ndarray, shape (touches, electrodes)
        Readings, NaN where missing.
    predicted : ndarray, shape (touches, electrodes)
        Predicted readings in `unit`.
    unit : str
        The unit that the readings are said to be in.

    Returns
    -------
    OtherUnit or None
        None unless the sizes of the readings agree with the prediction in another unit only, and
        about equally for all touches.
    """
    ratios = []
    for measured_row, predicted_row in zip(readings, predicted, strict=True):
        is_measured = np.isfinite(measured_row)
        size = np.linalg.norm(measured_row[is_measured])
        ratios.append(size / max(float(np.linalg.norm(predicted_row[is_measured])), 1e-300))
    if not ratios or min(ratios) <= 0.0 or max(ratios) > MAX_RATIO_SPREAD * min(ratios):
        return None
    ratio = float(np.median(ratios))
    if max(ratio, 1.0 / ratio) < MIN_WRONG_RATIO:
        return None
    sizes = []
    for names, factors in list_unit_ratios(make_channels(scene), unit):
        corrected = ratio * float(np.median(factors))
        if max(corrected, 1.0 / corrected) < MAX_SIZE_RATIO:
            sizes.append(names)
    return name_other_unit(scene, sizes, unit)

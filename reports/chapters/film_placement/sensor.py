"""The positions that the thesis's method finds on a film that is not where it is thought to be.

The film lies shifted and turned under the stage that places the probe, and each electrode's charge
is read with a gain. The contours are those of the thesis's sensor: the film in its place, the probe
not turned, lines of the reference electrode serving all four.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import shapely

from pvdf_fem import Scene
from pvdf_fem.arrays import Array
from reports.chapters.calibration import (
    TURNS,
    Setting,
    TurnedMap,
    calibration_scenes,
    charge_functions,
    mapping,
)
from reports.chapters.positions.location import REFERENCE, PositionCase
from reports.common.results import Results
from reports.common.thesis_data import Thesis
from reports.maps.isocharge import Contour, ContourCurve, contour
from reports.thesis_methods.mapping import LineMapping, polynomial_contour
from reports.thesis_methods.triangulation import triangulate

#: Electrodes in the order of charges and gains.
NAMES = tuple(sorted(TURNS))
#: Distance in mm from its place within which the film is taken to lie. The thesis says that it may
#: be larger than the 1 mm of the probe.
FILM_MM = 2.0
#: Largest turn of the film in degrees: 2.4 mm at the rim.
FILM_TURN_DEG = 3.0
#: Largest relative change of an electrode's gain, before the common factor is taken out.
GAIN_SHARE = 0.1
#: Contours are drawn at charges that differ by this share, which moves places by 0.01 mm.
LEVEL_SHARE = 1e-3


@dataclass(frozen=True, eq=False)
class SensorStates:
    """States of the sensor, one per row."""

    #: Place of the film's centre in the frame of the stage, (n, 2).
    shifts_mm: Array
    #: Turn of the film in that frame, counter-clockwise, (n,).
    turns_deg: Array
    #: Gains of A, B, C and D. Their geometric mean is 1, as the thesis relates measured to
    #: simulated charges by a calibration factor, (n, 4).
    gains: Array

    @classmethod
    def none(cls, count: int = 1) -> SensorStates:
        """The sensor as the thesis takes it to be."""
        return cls(np.zeros((count, 2)), np.zeros(count), np.ones((count, len(NAMES))))

    @classmethod
    def drawn(cls, count: int, *, placed: bool, gains: bool, seed: int = 1) -> SensorStates:
        """Random states: a film that is misplaced, gains that differ, or both."""
        random, states = np.random.default_rng(seed), cls.none(count)
        if placed:
            turns = FILM_TURN_DEG * random.uniform(-1.0, 1.0, count)
            states = replace(states, shifts_mm=_over_disc(random, count, FILM_MM), turns_deg=turns)
        if gains:
            logs = np.log1p(GAIN_SHARE * random.uniform(-1.0, 1.0, states.gains.shape))
            states = replace(states, gains=np.exp(logs - logs.mean(axis=1, keepdims=True)))
        return states

    def and_(self, *others: SensorStates) -> SensorStates:
        """These states, followed by others."""
        every = (self, *others)
        return SensorStates(
            np.concatenate([states.shifts_mm for states in every]),
            np.concatenate([states.turns_deg for states in every]),
            np.concatenate([states.gains for states in every]),
        )

    def one(self, index: int) -> SensorStates:
        """One of the states."""
        i = slice(index, index + 1)
        return SensorStates(self.shifts_mm[i], self.turns_deg[i], self.gains[i])

    @classmethod
    def touch_misplaced(cls, count: int, reach_mm: float, seed: int) -> SensorStates:
        """The film in its place, the probe anywhere within a distance of the place meant."""
        shifts_mm = _over_disc(np.random.default_rng(seed), count, reach_mm)
        return replace(cls.none(count), shifts_mm=shifts_mm)


def _over_disc(random: np.random.Generator, count: int, radius_mm: float) -> Array:
    r, a = radius_mm * np.sqrt(random.random(count)), 2.0 * np.pi * random.random(count)
    return np.stack([r * np.cos(a), r * np.sin(a)], axis=1)


def placement_scenes(thesis: Thesis, cases: Sequence[PositionCase]) -> list[Scene]:
    """The scenes that `Touch` needs."""
    settings = [setting for case in cases for setting in _settings(case)]
    return calibration_scenes(thesis, settings)


def _settings(case: PositionCase) -> list[Setting]:
    """The probe turned by the film's largest turn clockwise, as it is, and counter-clockwise."""
    turns = (-FILM_TURN_DEG, 0.0, FILM_TURN_DEG)
    return [replace(case.setting, rotation_deg=case.rotation_deg + turn) for turn in turns]


@dataclass(frozen=True, eq=False)
class Touch:
    """A touch of the thesis on a film that may be misplaced."""

    case: PositionCase
    #: Charge maps of A, B, C and D for each of the `_settings`.
    maps: Sequence[Sequence[TurnedMap]]

    @classmethod
    def of(cls, thesis: Thesis, results: Results, case: PositionCase) -> Touch:
        """The touch of a case, from the records of `placement_scenes`."""
        by_setting = [
            charge_functions(thesis, results, setting, case.layout, case.film)
            for setting in _settings(case)
        ]
        return cls(case, [[functions[name] for name in NAMES] for functions in by_setting])

    def charges_pC(self, states: SensorStates) -> Array:
        """Charges read, (n, 4)."""
        angles = np.radians(states.turns_deg)
        away = self.case.target_mm - states.shifts_mm
        x = np.cos(angles) * away[:, 0] + np.sin(angles) * away[:, 1]
        y = np.cos(angles) * away[:, 1] - np.sin(angles) * away[:, 0]
        places = np.stack([x, y], axis=1)
        steps = -states.turns_deg / FILM_TURN_DEG  # of the probe against the film
        weights = (0.5 * steps * (steps - 1.0), 1.0 - steps**2, 0.5 * steps * (steps + 1.0))
        charges = np.zeros_like(states.gains)
        for weight, functions in zip(weights, self.maps, strict=True):
            values = [function.value_and_gradient(places)[0] for function in functions]
            charges += weight[:, None] * np.stack(values, axis=1)
        return states.gains * charges


@dataclass(frozen=True, eq=False)
class SampledCurve(ContourCurve):
    """A curve whose crossings are those of its polyline, right to within a µm."""

    def crossings(self, other: ContourCurve) -> Array:
        """All points, (n, 2), at which the polylines cross."""
        return shapely.get_coordinates(shapely.intersection(self.line, other.line))


@dataclass(frozen=True, eq=False)
class ThesisContours:
    """Contours of the thesis's method for one probe and force, kept by their charge."""

    #: Charges of the reference electrode on its lines, the probe not turned.
    mapping: LineMapping
    _kept: dict[tuple[str, int], Contour] = field(default_factory=dict)

    @classmethod
    def of(cls, thesis: Thesis, results: Results, case: PositionCase) -> ThesisContours:
        """The contours that serve a case."""
        functions = charge_functions(thesis, results, case.setting.unturned, "4", case.film)
        return cls(mapping(thesis, "4", REFERENCE, functions[REFERENCE]))

    def place_mm(self, charges_pC: Array) -> Array:
        """The place of four charges by the thesis's rule, (2,); NaN if contours do not cross."""
        named = zip(NAMES, charges_pC.tolist(), strict=True)
        return triangulate([self._contour(name, charge) for name, charge in named]).position_mm

    def _contour(self, electrode: str, charge_pC: float) -> Contour:
        level = round(np.log(max(charge_pC, 1.0)) / LEVEL_SHARE)
        if (electrode, level) not in self._kept:
            self._kept[electrode, level] = self._drawn(electrode, level)
        return self._kept[electrode, level]

    def _drawn(self, electrode: str, level: int) -> Contour:
        """The reference's contour, turned to another electrode."""
        charge_pC = float(np.exp(level * LEVEL_SHARE))
        if electrode == REFERENCE:
            unturned = polynomial_contour(self.mapping, charge_pC)
        else:
            unturned = self._contour(REFERENCE, charge_pC)
        points = (curve.points_mm @ self._matrices[electrode].T for curve in unturned.curves)
        return Contour(electrode, charge_pC, tuple(map(SampledCurve, points)))

    @cached_property
    def _matrices(self) -> dict[str, Array]:
        quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
        return {name: np.linalg.matrix_power(quarter, turns) for name, turns in TURNS.items()}


def position_errors_mm(touch: Touch, contours: ThesisContours, states: SensorStates) -> Array:
    """Errors (n,) of the thesis's method; NaN where contours do not cross."""
    places = [contours.place_mm(charges) for charges in touch.charges_pC(states)]
    return np.linalg.norm(np.array(places) - touch.case.target_mm, axis=1)


def own_errors_mm(
    thesis: Thesis, results: Results, case: PositionCase, touch: Touch, shifts_mm: Array
) -> Array:
    """Errors (n,) of contours that were measured on the shifted film itself, the probe not turned.

    Gains drop out of them, as the charge of a contour and the charge located have the same.
    """
    functions = charge_functions(thesis, results, case.setting.unturned, "4", case.film)
    states = replace(SensorStates.none(len(shifts_mm)), shifts_mm=shifts_mm)
    places = []
    for charges, shift in zip(touch.charges_pC(states), shifts_mm, strict=True):
        named = zip(NAMES, charges.tolist(), strict=True)
        contours = [contour(name, functions[name], charge, 1.0) for name, charge in named]
        places.append(triangulate(contours).position_mm + shift)
    return np.linalg.norm(np.array(places) - case.target_mm, axis=1)

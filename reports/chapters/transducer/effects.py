"""What the thesis left out of its charges, effect by effect: charges, and the place found of them.

An effect is keys of the scene. Its charges are changes by the touch, which a zeroed amplifier
reads; the place is what `locate` finds of them with a model of the film that lacks the effect.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np

from pvdf_fem import Scene, respond, solve
from pvdf_fem.arrays import Array
from pvdf_fem.derivatives.rates import charge_rates
from pvdf_fem.touch.by_solves import SolveOptions, locate_by_solves
from reports.common.results import MATERIAL
from reports.common.thesis_scene import thesis_scene

Place = tuple[float, float]

#: Place in mm of section 3.1.2, whose probe ends where electrode A begins, and places where the
#: probe lies on a part of A and on the whole of it.
BESIDE_MM, ON_PART_MM, ON_WHOLE_MM = (5.0714, 0.8757), (6.0, 0.0), (10.0, 0.0)
#: Relative tolerance of charges, a small part of the smallest effect.
TOLERANCE = 1e-4
#: Relative standard deviation of a charge.
NOISE = 0.01
#: That of an amplifier that is good enough to tell a temperature.
FINE_NOISE = 1e-3
WITH_TEMPERATURE = ("x_mm", "y_mm", "force_N", "temperature_K")
#: One start: nearly all touches found are near the true one.
QUICK = SolveOptions(
    first_tolerance=3e-4,
    tolerance=3e-4,
    pitch_mm=5.0,
    starts=1,
    first_steps=1,
    rounds=0,
    arrived=1e-3,
)
#: Coefficients of PVDF beside the thesis's d31 = 8: d33 (App. 1) and a larger d31 in pC/N, the
#: pyroelectric one in µC/(m² K) with the sign that goes with a positive d31.
D33_PC_N, HIGH_D31_PC_N, PYRO_UC_M2K = -15.0, 23.0, -25.0


def touch(place: Place, force_N: float = 1.0, kind: str = "follower", **keys: Any) -> Scene:
    """The thesis's triangle on its sensor with four electrodes."""
    scene = thesis_scene("4", "tri7", x_mm=place[0], y_mm=place[1], force_N=force_N)
    plain = {"numerics.observable": MATERIAL, "numerics.tolerance": TOLERANCE, "load.kind": kind}
    return scene.with_(**plain).with_(**keys)


@lru_cache(maxsize=256)
def charges_pC(scene: Scene) -> Array:
    """Changes by the touch, of A, B, C and D."""
    return np.array(list(solve(scene).charge_changes_pC.values()))


@lru_cache(maxsize=16)
def oscillating_ratios(scene: Scene, frequency_Hz: float) -> Array:
    """Charges of A, B, C and D by a small oscillating force about the load over static ones."""
    both = np.array(list(respond(scene, [0.0, frequency_Hz]).charges_pC_N.values()))
    return np.abs(both[:, 1] / both[:, 0])


@dataclass(frozen=True)
class Found:
    """The touch that explains charges best, and the probability of a worse agreement."""

    x_mm: float
    y_mm: float
    force_N: float
    p_value: float

    def away_mm(self, other: Found) -> float:
        """Distance of the places."""
        return math.hypot(self.x_mm - other.x_mm, self.y_mm - other.y_mm)


@lru_cache(maxsize=256)
def found(model: Scene, *charges: float, starts: int = QUICK.starts) -> Found:
    """The touch on the film of the model that explains charges in pC with `NOISE` best."""
    options = replace(QUICK, starts=starts, followed=starts)
    named = dict(zip((e.name for e in model.electrode_list), charges, strict=True))
    fits = locate_by_solves(model, named, NOISE, reading="change", options=options)
    best = min(fits, key=lambda fit: fit.chi_square)
    x_mm, y_mm, force_N = best.values.values()
    return Found(x_mm, y_mm, force_N, best.p_value)


@dataclass(frozen=True, eq=False)
class Effect:
    """Something that the thesis left out, and the keys that turn it on."""

    name: str
    key: str
    keys: Mapping[str, Any]
    #: Keys of both films, that with the effect and that without.
    film: Mapping[str, Any] = field(default_factory=dict)
    #: Starts of the search for the touch; more where that lies far from the true one.
    starts: int = QUICK.starts

    def model(self, place: Place) -> Scene:
        """The touch without the effect."""
        return touch(place, **self.film)

    def plain_pC(self, place: Place) -> Array:
        """Charges without the effect, (4,)."""
        return charges_pC(self.model(place))

    def charges_pC(self, place: Place) -> Array:
        """Charges with the effect, (4,)."""
        return charges_pC(self.model(place).with_(**self.keys))

    def percent(self, place: Place) -> Array:
        """Changes of the charges of a touch, (4,)."""
        return 100.0 * (self.charges_pC(place) / self.plain_pC(place) - 1.0)

    def found(self, place: Place) -> Found:
        """The touch that `locate`, which knows nothing of the effect, finds."""
        charges = self.charges_pC(place).tolist()
        return found(self.model(place), *charges, starts=self.starts)

    def shift_mm(self, place: Place) -> float:
        """Distance from the place that charges without the effect give; the errors of both are
        alike, and cancel."""
        plain = found(self.model(place), *self.plain_pC(place).tolist())
        return self.found(place).away_mm(plain)

    def found_with_temperature(self, place: Place) -> dict[str, float]:
        """The touch that `locate` finds where the probe's temperature is sought, too."""
        film = self.model(place).with_(**self.keys)
        names = [electrode.name for electrode in film.electrode_list]
        charges = dict(zip(names, self.charges_pC(place).tolist(), strict=True))
        fits = locate_by_solves(
            film, charges, NOISE, unknown=WITH_TEMPERATURE, reading="change", options=QUICK
        )
        best = min(fits, key=lambda fit: fit.chi_square)
        return dict(zip(WITH_TEMPERATURE, best.values.values(), strict=True))

    def deviations_with_temperature(self, place: Place) -> Array:
        """Cramér-Rao deviations of x and y in mm, force in N and temperature in K, sought together
        from charges with `FINE_NOISE`."""
        keys = ("probe.x_mm", "probe.y_mm", "load.force_N", "probe.temperature_K")
        solution = solve(self.model(place).with_(**self.keys))
        slopes = 1e12 * charge_rates(solution, keys) / (FINE_NOISE * self.charges_pC(place))
        return np.sqrt(np.linalg.inv(slopes @ slopes.T).diagonal())


@dataclass(frozen=True, eq=False)
class Oscillating(Effect):
    """A small force that oscillates about the load, in place of a static one."""

    frequency_Hz: float = 20.0

    def charges_pC(self, place: Place) -> Array:
        """Those of a static touch times the oscillation's ratio."""
        moving = touch(place, **self.film).with_(**self.keys)
        return self.plain_pC(place) * oscillating_ratios(moving, self.frequency_Hz)


def _open(pF: float) -> dict[str, Any]:
    return {"film.coupling": True, "readout": {"kind": "voltage", "cable_capacitance_pF": pF}}


def finger(seconds: float, kelvins: float = 10.0) -> Effect:
    """A probe that is warmer than the film, for a time."""
    time = f"{seconds:g} s" if seconds >= 1.0 else f"{1e3 * seconds:g} ms"
    heat = {"probe.temperature_K": kelvins, "probe.contact_time_s": seconds}
    keys = {**heat, "film.pyroelectric_uC_m2K": PYRO_UC_M2K}
    return Effect(f"finger {kelvins:g} K warmer, {time}", "probe.temperature_K", keys)


def tapes(inner_mm: float, outer_mm: float = 44.5, **layer: Any) -> list[dict[str, Any]]:
    """A tape of 5 mm by 50 µm (3 GPa, if `layer` says nothing else) along the radius to each of
    the four electrodes."""
    strip = {"shape": "rectangle", "width_mm": outer_mm - inner_mm, "height_mm": 5.0}
    middle, both = 0.5 * (inner_mm + outer_mm), {"thickness_um": 50.0, "youngs_modulus_GPa": 3.0}
    return [
        {**strip, "x_mm": middle * x, "y_mm": middle * y, "rotation_deg": turn, **both, **layer}
        for x, y, turn in ((1, 0, 0.0), (0, 1, 90.0), (-1, 0, 180.0), (0, -1, 270.0))
    ]


#: A tape that begins at the inner edge of its electrode, and one that begins beyond the outer one.
OVER_MM, BEYOND_MM = 8.5, 11.7
#: The thesis's tension at rest in N/m.
TENSION_N_M = 25.0 / 3.0
_UNEVEN = {"film.pretension_N_m": [0.9 * TENSION_N_M, 1.1 * TENSION_N_M]}
_OVAL = {"film.rim_displacement_um": [0.0, 0.0, 0.0, 1.0, 0.0]}
#: For effects of tens of percent.
_COARSE = {"numerics.tolerance": 2e-3}
_VOLTAGE = 'readout.kind = "voltage", film.coupling'

EFFECTS: tuple[Effect, ...] = (
    Effect("electrodes open", _VOLTAGE, _open(0.0)),
    Effect("electrodes on 100 pF", _VOLTAGE + ", readout.cable_capacitance_pF", _open(100.0)),
    Effect(
        f"electrodes open, {HIGH_D31_PC_N:g} pC/N",
        _VOLTAGE + ", film.d31_pC_N",
        _open(0.0),
        {"film.d31_pC_N": HIGH_D31_PC_N, "film.d32_pC_N": HIGH_D31_PC_N},
    ),
    Effect("thickness direction", "film.d33_pC_N", {"film.d33_pC_N": D33_PC_N}),
    *map(finger, (0.01, 0.1, 1.0)),
    Effect("film 1 K warmer: tension alone", "film.warming_K", {"film.warming_K": 1.0}),
    Effect(
        "film 1 K warmer",
        "film.warming_K, film.pyroelectric_uC_m2K",
        {"film.warming_K": 1.0, "film.pyroelectric_uC_m2K": PYRO_UC_M2K},
        starts=2,
    ),
    Oscillating("20 Hz in air about 1 N", "[air], respond", {"air": {"baffle": True}}),
    Oscillating(
        "20 Hz in air about 0.1 N",
        "[air], respond",
        {"air": {"baffle": True}},
        {"load.force_N": 0.1},
    ),
    *(
        Effect(
            f"tape {where} each electrode", "[[film.patches]]", {"film.patches": strips}, _COARSE
        )
        for where, strips in (("over", tapes(OVER_MM)), ("beyond", tapes(BEYOND_MM)))
    ),
    Effect("tension 10 % less along x, more along y", "film.pretension_N_m", _UNEVEN),
    Effect("rim displaced by 1 µm cos 2θ", "film.rim_displacement_um", _OVAL),
)

BY_NAME = {effect.name: effect for effect in EFFECTS}
FINGERS = tuple(effect for effect in EFFECTS if effect.key == "probe.temperature_K")
WARM = BY_NAME["film 1 K warmer"]
#: Effects that are also shown with the probe on an electrode.
ON_ELECTRODE = (BY_NAME["thickness direction"], *FINGERS, WARM)

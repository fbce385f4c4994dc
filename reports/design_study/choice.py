"""Choice of the recommended sensor, one parameter after the other, by the study's numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from reports.design_study.sensor import Sensor
from reports.design_study.study import (
    THESIS,
    TURNS_DEG,
    Performance,
    Study,
    drawn,
    light,
    pretensions,
    rings,
    thicknesses,
)

#: Ratio of two errors below which the designs are equally good.
INDIFFERENCE = 1.1
#: Lowest tensile strength of Goodfellow's PVDF film in MPa (appendix 1 of the thesis).
STRENGTH_MPA = 25.0
#: Force in N under which the film's stress must stay below its strength.
OVERLOAD_N = 2.0


@dataclass(frozen=True)
class Alternative:
    """A sensor that a decision may take.

    Attributes
    ----------
    label : str
    sensor : Sensor
    merit : float
        Error by which the sensor is judged: less is better, NaN for a failed solve.
    admissible : bool
        Whether the film stands the overload.
    """

    label: str
    sensor: Sensor
    merit: float
    admissible: bool = True


@dataclass(frozen=True)
class Decision:
    """The alternatives for a parameter, and the one that was taken."""

    alternatives: tuple[Alternative, ...]
    taken: Alternative


def choose(
    alternatives: Sequence[Alternative], preference: Callable[[Sensor], float] | None = None
) -> Decision:
    """Take the best admissible alternative, or the preferred one among those nearly as good.

    Parameters
    ----------
    alternatives : sequence of Alternative
    preference : callable, optional
        The sensor with the largest value is taken among those whose merits are within
        `INDIFFERENCE` of the best one.

    Raises
    ------
    ValueError
        When no admissible alternative has a finite merit.
    """
    eligible = [
        alternative
        for alternative in alternatives
        if alternative.admissible and np.isfinite(alternative.merit)
    ]
    if not eligible:
        labels = ", ".join(alternative.label for alternative in alternatives)
        raise ValueError(f"none of {labels} is admissible with a finite error; widen the axes")
    best = min(eligible, key=lambda alternative: alternative.merit)
    if preference is not None:
        nearly_best = [
            alternative
            for alternative in eligible
            if alternative.merit <= INDIFFERENCE * best.merit
        ]
        best = max(nearly_best, key=lambda alternative: preference(alternative.sensor))
    return Decision(tuple(alternatives), best)


@dataclass(frozen=True)
class Step:
    """The recommended sensor with one parameter set back to the thesis's value.

    Attributes
    ----------
    label : str
    firm, soft : Performance
        Performance under 1 N, and under the light touch.
    stress_MPa : float
        Stress of the film under `OVERLOAD_N`.
    """

    label: str
    firm: Performance
    soft: Performance
    stress_MPa: float


@dataclass(frozen=True)
class Recommendation:
    """The decisions in their order, and the recommended sensor with each of them undone."""

    count: Decision
    ring: Decision
    poling: Decision
    thickness: Decision
    temperature: Decision
    steps: tuple[Step, ...]

    @property
    def sensor(self) -> Sensor:
        """The recommended sensor."""
        return self.steps[0].firm.sensor


def recommend(study: Study, solve: Callable[[Sequence[Sensor]], None]) -> Recommendation:
    """Decide on one parameter after the other.

    Number, place and size of the electrodes and the poling are chosen on the thesis's film under
    1 N. Thickness and then pretension are chosen with the thesis's electrodes under both forces.

    Parameters
    ----------
    study : Study
        All sensors of its axes are solved already.
    solve : callable
        Solves further sensors for the study.
    """
    count = choose([_best_of(study, n) for n in study.axes.counts])
    by_ring = {ring_label(sensor): sensor for sensor in rings(study, count.taken.sensor.count)}
    ring = choose(
        _alternatives(study, by_ring),
        lambda sensor: study.performance(sensor).sensitivity_pC_N,
    )
    by_poling = {"biaxial": ring.taken.sensor, "uniaxial": drawn(ring.taken.sensor)}
    solve([by_poling["uniaxial"]])
    poling = choose(_alternatives(study, by_poling), lambda sensor: float(sensor.is_biaxial))
    thickness = choose([_film(study, sensor) for sensor in thicknesses(study.axes)])
    thickness_um = thickness.taken.sensor.thickness_um
    tight = pretensions(study.axes, thickness_um)
    solve(_under_both_forces(tight))
    temperature = choose(
        [_film(study, sensor) for sensor in tight], lambda sensor: -sensor.temperature_change_K
    )
    sensor = replace(
        poling.taken.sensor,
        thickness_um=thickness_um,
        temperature_change_K=temperature.taken.sensor.temperature_change_K,
    )
    variants = {"recommended": sensor, **_undone(study, sensor), "the thesis's": THESIS}
    solve(_under_both_forces(variants.values()))
    steps = tuple(_step(study, label, sensor) for label, sensor in variants.items())
    return Recommendation(count, ring, poling, thickness, temperature, steps)


def _alternatives(study: Study, sensors: Mapping[str, Sensor]) -> list[Alternative]:
    """Alternatives that are judged by their position errors."""
    return [
        Alternative(label, sensor, study.performance(sensor).position_mm)
        for label, sensor in sensors.items()
    ]


def _under_both_forces(sensors: Iterable[Sensor]) -> list[Sensor]:
    return [loaded for sensor in sensors for loaded in (sensor, light(sensor))]


def worst_mm(study: Study, sensor: Sensor) -> float:
    """The larger position error of the two forces."""
    return float(
        np.max([study.performance(loaded).position_mm for loaded in (sensor, light(sensor))])
    )


def ring_label(sensor: Sensor) -> str:
    """Spacing and size of the electrodes."""
    return f"{sensor.spacing_mm:g} mm, side {sensor.width_mm:g} mm"


def _best_of(study: Study, count: int) -> Alternative:
    """The best ring for `count` of the thesis's electrodes.

    More electrodes average more noise, which alone divides the error by the root of their number.
    The merit is multiplied by that root, so that it shows what they gain beyond averaging.
    """
    same_size = [ring for ring in rings(study, count) if ring.width_mm == THESIS.width_mm]
    best = study.best(same_size)
    return Alternative(str(count), best.sensor, best.position_mm * np.sqrt(count))


def _film(study: Study, sensor: Sensor) -> Alternative:
    merit, stress = worst_mm(study, sensor), study.stress_MPa(sensor, OVERLOAD_N)
    label = f"{sensor.thickness_um:g} µm, {sensor.temperature_change_K:g} K"
    return Alternative(label, sensor, merit, stress <= STRENGTH_MPA)


def _undone(study: Study, sensor: Sensor) -> dict[str, Sensor]:
    """The sensor with one parameter set back to the thesis's value, for each that differs.

    Sensors whose electrodes have no room are left out.
    """
    n = THESIS.count
    variants = {
        f"{n} electrodes": replace(sensor, count=n, turn_deg=TURNS_DEG[n]),
        f"spacing {THESIS.spacing_mm:g} mm": replace(sensor, ring_mm=THESIS.ring_mm),
        f"side {THESIS.width_mm:g} mm": replace(
            sensor, width_mm=THESIS.width_mm, height_mm=THESIS.height_mm
        ),
        "biaxial": replace(sensor, d31_pC_N=THESIS.d31_pC_N, d32_pC_N=THESIS.d32_pC_N),
        f"film {THESIS.thickness_um:g} µm": replace(sensor, thickness_um=THESIS.thickness_um),
        f"cooled by {-THESIS.temperature_change_K:g} K": replace(
            sensor, temperature_change_K=THESIS.temperature_change_K
        ),
    }
    return {
        label: variant
        for label, variant in variants.items()
        if variant != sensor and study.is_possible(variant)
    }


def _step(study: Study, label: str, sensor: Sensor) -> Step:
    firm, soft = study.performance(sensor), study.performance(light(sensor))
    return Step(label, firm, soft, study.stress_MPa(sensor, OVERLOAD_N))

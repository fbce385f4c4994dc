"""Which sensor the study recommends, decided by its numbers one parameter after the other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
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

#: Designs whose errors differ by less are equally good.
INDIFFERENCE = 1.1
#: The lowest tensile strength of Goodfellow's PVDF film (the thesis's appendix 1), in MPa, which
#: the stress is to stay below under this many times the force of 1 N.
STRENGTH_MPA, OVERLOAD = 25.0, 2.0


@dataclass(frozen=True)
class Candidate:
    """A sensor that may be taken.

    Attributes
    ----------
    label : str
    sensor : Sensor
    merit : float
        What it is judged by: less is better, NaN for a failed solve.
    admissible : bool
    """

    label: str
    sensor: Sensor
    merit: float
    admissible: bool = True


@dataclass(frozen=True)
class Choice:
    """The candidates for a parameter, and which one was taken."""

    candidates: tuple[Candidate, ...]
    taken: Candidate


def choose(
    candidates: Sequence[Candidate], preference: Callable[[Sensor], float] | None = None
) -> Choice:
    """The best admissible candidate; with a preference the most preferred of those nearly as good.

    Raises
    ------
    ValueError
        When no admissible candidate has a finite merit.
    """
    good = [one for one in candidates if one.admissible and np.isfinite(one.merit)]
    if not good:
        labels = ", ".join(one.label for one in candidates)
        raise ValueError(f"none of {labels} is admissible with a finite error; widen the axes")
    best = min(good, key=lambda one: one.merit)
    if preference is not None:
        near = [one for one in good if one.merit <= INDIFFERENCE * best.merit]
        best = max(near, key=lambda one: preference(one.sensor))
    return Choice(tuple(candidates), best)


@dataclass(frozen=True)
class Step:
    """A way back from the recommended sensor: one parameter as the thesis has it.

    Attributes
    ----------
    label : str
    firm, soft : Performance
        Under 1 N and under the light touch.
    stress_MPa : float
        Under `OVERLOAD` times 1 N.
    """

    label: str
    firm: Performance
    soft: Performance
    stress_MPa: float


@dataclass(frozen=True)
class Recommendation:
    """The choices in their order, and the recommended sensor with each of them undone."""

    count: Choice
    ring: Choice
    poling: Choice
    thickness: Choice
    temperature: Choice
    steps: tuple[Step, ...]

    @property
    def sensor(self) -> Sensor:
        """The recommended one."""
        return self.steps[0].firm.sensor


def recommend(study: Study, solve: Callable[[Sequence[Sensor]], None]) -> Recommendation:
    """Decide; `solve` solves more sensors for the study.

    Number, place and size of the electrodes and the poling are chosen on the thesis's film under
    1 N, thickness and then pretension with the thesis's electrodes under both forces.
    """
    count = choose([_best_of(study, n) for n in study.axes.counts])
    sized = [
        Candidate(ring_label(one), one, study.performance(one).position_mm)
        for one in rings(study, count.taken.sensor.count)
    ]
    ring = choose(sized, lambda one: study.performance(one).sensitivity_pC_N)
    biaxial = ring.taken.sensor
    uniaxial = drawn(biaxial)
    solve([uniaxial])
    poled = {"biaxial": biaxial, "uniaxial": uniaxial}
    poling = choose(
        [Candidate(name, one, study.performance(one).position_mm) for name, one in poled.items()],
        lambda one: float(one.is_biaxial),
    )
    thickness = choose([_film(study, one) for one in thicknesses(study.axes)])
    h = thickness.taken.sensor.thickness_um
    tight = pretensions(study.axes, h)
    solve([one for some in tight for one in (some, light(some))])
    temperature = choose(
        [_film(study, one) for one in tight], lambda one: -one.temperature_change_K
    )
    sensor = replace(
        poling.taken.sensor,
        thickness_um=h,
        temperature_change_K=temperature.taken.sensor.temperature_change_K,
    )
    wanted = {"recommended": sensor, **_undone(study, sensor), "the thesis's": THESIS}
    solve([one for some in wanted.values() for one in (some, light(some))])
    steps = tuple(_step(study, label, one) for label, one in wanted.items())
    return Recommendation(count, ring, poling, thickness, temperature, steps)


def worst_mm(study: Study, sensor: Sensor) -> float:
    """The larger position error of the two forces."""
    return float(np.max([study.performance(one).position_mm for one in (sensor, light(sensor))]))


def ring_label(sensor: Sensor) -> str:
    """Spacing and size of the electrodes."""
    return f"{sensor.spacing_mm:g} mm, side {sensor.width_mm:g} mm"


def _best_of(study: Study, count: int) -> Candidate:
    """The best place for so many of the thesis's electrodes.

    More electrodes average more noise, which alone lowers the error by the root of their number;
    what is judged is what they gain beyond that.
    """
    some = [one for one in rings(study, count) if one.width_mm == THESIS.width_mm]
    best = study.best(some)
    return Candidate(str(count), best.sensor, best.position_mm * np.sqrt(count))


def _film(study: Study, sensor: Sensor) -> Candidate:
    merit, stress = worst_mm(study, sensor), study.stress_MPa(sensor, OVERLOAD)
    label = f"{sensor.thickness_um:g} µm, {sensor.temperature_change_K:g} K"
    return Candidate(label, sensor, merit, stress <= STRENGTH_MPA)


def _undone(study: Study, sensor: Sensor) -> dict[str, Sensor]:
    """The sensor with one choice as the thesis has it, where that is another and has room."""
    n = THESIS.count
    found = {
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
    return {label: one for label, one in found.items() if one != sensor and study.is_possible(one)}


def _step(study: Study, label: str, sensor: Sensor) -> Step:
    firm, soft = study.performance(sensor), study.performance(light(sensor))
    return Step(label, firm, soft, study.stress_MPa(sensor, OVERLOAD))

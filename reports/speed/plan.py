"""How much the report on error against run time measures."""

from __future__ import annotations

from dataclasses import dataclass

from reports.speed.cases import CASES, ROUND_CASES, Case
from reports.speed.growth import FACTORS
from reports.speed.peers import CalculixPlan


@dataclass(frozen=True)
class Plan:
    """How much is measured: size factors and tolerances by order, repetitions, sizes, sweeps."""

    cases: tuple[Case, ...]
    round_cases: tuple[Case, ...]
    factors: dict[int, tuple[float, ...]]
    tolerances: dict[int, tuple[float, ...]]
    ngsolve: dict[int, tuple[float, ...]]
    calculix: CalculixPlan
    rounds: int
    budget: float
    sizes: tuple[float, ...]
    sweeps: tuple[float, ...]
    places: int


FULL = Plan(
    CASES,
    ROUND_CASES,
    {1: (1.0, 0.5, 0.25, 0.125), 2: (2.0, 1.4, 1.0, 0.7, 0.5, 0.35), 3: (3.0, 2.0, 1.4, 1.0, 0.7)},
    {1: (3e-2, 1e-2), 2: (1e-2, 1e-3, 1e-4, 1e-5), 3: (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)},
    {2: (2.0, 1.0, 0.7, 0.5, 0.35), 3: (3.0, 2.0, 1.4, 1.0, 0.7), 4: (3.0, 2.0, 1.4, 1.0)},
    CalculixPlan(
        everywhere=(("M3D3", 3.0), ("S6", 6.0)),
        closely=(("M3D3", 6.0), ("M3D3", 1.0), ("M3D6", 6.0), ("M3D6", 3.0), ("S6", 3.0)),
        limit=300.0,
    ),
    rounds=5,
    budget=2.0,
    sizes=FACTORS,
    sweeps=(1e-3, 1e-4),
    places=8,
)
QUICK = Plan(
    CASES[:1],
    ROUND_CASES[1:],
    {2: (2.0, 1.0)},
    {3: (1e-2, 1e-4)},
    {3: (2.0,)},
    CalculixPlan(everywhere=(("M3D3", 12.0),), closely=(), limit=60.0),
    rounds=1,
    budget=1.0,
    sizes=(2.0, 1.0),
    sweeps=(1e-2,),
    places=2,
)

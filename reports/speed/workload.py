"""How much the report on error against run time measures."""

from __future__ import annotations

from dataclasses import dataclass

from reports.speed.cases import CASES, ROUND_CASES, BenchmarkCase
from reports.speed.peers import CalculixWorkload


@dataclass(frozen=True)
class Workload:
    """How much the report measures.

    Attributes
    ----------
    cases, round_cases : tuple of BenchmarkCase
        Fixed scenes, and scenes with a closed form.
    factors, tolerances : dict
        Factors of the uniform element sizes, and tolerances, by order.
    ngsolve : dict
        Factors of NGSolve's element sizes by order.
    calculix : CalculixWorkload
    rounds : int
        Largest number of runs of a job.
    budget : float
        Seconds within which a job is repeated.
    sizes : tuple of float
        Factors of the element sizes for the growth with the unknowns.
    sweeps : tuple of float
        Tolerances of the sweeps.
    places : int
        Number of places in a sweep.
    stage_tolerances : tuple of float
        Tolerances at which the stages of a solve are timed.
    """

    cases: tuple[BenchmarkCase, ...]
    round_cases: tuple[BenchmarkCase, ...]
    factors: dict[int, tuple[float, ...]]
    tolerances: dict[int, tuple[float, ...]]
    ngsolve: dict[int, tuple[float, ...]]
    calculix: CalculixWorkload
    rounds: int
    budget: float
    sizes: tuple[float, ...]
    sweeps: tuple[float, ...]
    places: int
    stage_tolerances: tuple[float, ...] = (1e-3, 1e-5)


FULL = Workload(
    CASES,
    ROUND_CASES,
    {1: (1.0, 0.5, 0.25, 0.125), 2: (2.0, 1.4, 1.0, 0.7, 0.5, 0.35), 3: (3.0, 2.0, 1.4, 1.0, 0.7)},
    {1: (3e-2, 1e-2), 2: (1e-2, 1e-3, 1e-4, 1e-5), 3: (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)},
    {2: (2.0, 1.0, 0.7, 0.5, 0.35), 3: (3.0, 2.0, 1.4, 1.0, 0.7), 4: (3.0, 2.0, 1.4, 1.0)},
    CalculixWorkload(
        everywhere=(("M3D3", 3.0), ("S6", 6.0)),
        closely=(("M3D3", 6.0), ("M3D3", 1.0), ("M3D6", 6.0), ("M3D6", 3.0), ("S6", 3.0)),
        limit=300.0,
    ),
    rounds=5,
    budget=2.0,
    sizes=(1.0, 0.56, 0.32, 0.18, 0.104, 0.06),  # unknowns grow threefold from 2 thousand on
    sweeps=(1e-3, 1e-4),
    places=8,
)
QUICK = Workload(
    CASES[:1],
    ROUND_CASES[1:],
    {2: (2.0, 1.0)},
    {3: (1e-2, 1e-4)},
    {3: (2.0,)},
    CalculixWorkload(everywhere=(("M3D3", 12.0),), closely=(), limit=60.0),
    rounds=1,
    budget=1.0,
    sizes=(2.0, 1.0),
    sweeps=(1e-2,),
    places=2,
)

"""Where the time of a solve goes: mesh, assembly, factorisation, estimate."""

from __future__ import annotations

import cProfile
import pstats

from pvdf_fem import Scene, solve
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.solvers.newton import factorise
from pvdf_fem.solvers.status import Status

#: In the order of a solve; ``other`` is what remains of solving and refining.
STAGES = ("mesh", "assembly", "factorisation", "other", "estimate")


def stages(scene: Scene) -> dict[str, float]:
    """Seconds of a solve by stage of `STAGES`, with ``total``; empty if it did not converge.

    Assembly and factorisation are those of the tangents; a profiler counts them, which slows the
    rest of a solve by a few percent.
    """
    profiler = cProfile.Profile()
    solution = profiler.runcall(solve, scene)
    if solution.status is not Status.CONVERGED:
        return {}
    spent = pstats.Stats(profiler).stats  # type: ignore[attr-defined]
    seconds = {
        "mesh": solution.seconds["mesh"],
        "assembly": _cumulative(spent, Equilibrium.tangent),
        "factorisation": _cumulative(spent, factorise),
        "estimate": solution.seconds.get("estimate", 0.0),
    }
    total = solution.seconds["total"]
    return {**seconds, "other": total - sum(seconds.values()), "total": total}


def _cumulative(spent: dict[tuple[str, int, str], tuple[float, ...]], function: object) -> float:
    code = function.__code__  # type: ignore[attr-defined]
    row = spent.get((code.co_filename, code.co_firstlineno, code.co_name))
    return row[3] if row else 0.0

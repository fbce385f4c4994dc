"""Seconds and memory of one solve against its unknowns, each in a process of its own.

    python -m reports.speed.growth FACTOR ORDER

prints one JSON object for the off-centre triangle on a uniform mesh of that factor.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from reports.speed.cases import cases_named
from reports.speed.runs import solve_uniform

#: Factor of the element sizes that gives about a million unknowns at order 2.
LARGE_FACTOR = 0.045


@dataclass(frozen=True)
class Size:
    """Cost of one solve in a process of its own.

    Attributes
    ----------
    status : str
        ``converged``, or why there are no charges.
    factor : float
        Factor of the element sizes.
    unknowns : int
    seconds : dict, optional
        Seconds by stage; None without charges.
    memory_MiB, idle_MiB : float
        Largest memory of the process, and its memory after the imports.
    """

    status: str
    factor: float
    unknowns: int = 0
    seconds: dict[str, float] | None = None
    memory_MiB: float = 0.0
    idle_MiB: float = 0.0


def measure(factor: float, order: int = 2, time_limit: float = 1800.0) -> Size:
    """Solve in a new process; if it dies or takes more than `time_limit` s, the status says so."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "reports.speed.growth", str(factor), str(order)]
    try:
        ended = subprocess.run(
            command,
            capture_output=True,
            text=True,
            env=environment,
            timeout=time_limit,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return Size(f"longer than {time_limit:g} s", factor)
    if ended.returncode != 0:
        last = ended.stderr.strip().splitlines()[-1:] or [f"exit code {ended.returncode}"]
        return Size(f"crashed: {last[0]}", factor)
    return Size(**json.loads(ended.stdout))


def main() -> int:
    """Solve once and print what it took."""
    factor, order = float(sys.argv[1]), int(sys.argv[2])
    idle = _memory_MiB()
    [case] = cases_named(["triangle"])
    outcome = solve_uniform(case.scene, order, factor)
    size = {
        "status": outcome.status,
        "factor": factor,
        "unknowns": outcome.unknowns,
        "seconds": outcome.seconds or None,
        "memory_MiB": _memory_MiB(),
        "idle_MiB": idle,
    }
    print(json.dumps(size))
    return 0


def _memory_MiB() -> float:
    """Largest resident memory so far; `getrusage` would count the parent's, before exec, too."""
    status = Path("/proc/self/status")
    for line in status.read_text().splitlines() if status.exists() else []:
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) / 1024  # the file counts KiB
    per_MiB = 1024**2 if sys.platform == "darwin" else 1024  # bytes on macOS, KiB elsewhere
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / per_MiB


if __name__ == "__main__":
    sys.exit(main())

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

KIBI, MEBI = 2**10, 2**20
ORDER = 2
#: Order-2 unknowns from 2 thousand on, each time three times as many.
FACTORS = (1.0, 0.56, 0.32, 0.18, 0.104, 0.06)
#: About a million.
LARGE_FACTOR = 0.045
TIME_LIMIT = 1800.0


@dataclass(frozen=True)
class Size:
    """One solve: `unknowns`, `seconds` by stage, and the process's largest `memory_MiB`.

    `idle_MiB` is the memory after the imports; `status` is ``converged`` or why there is nothing.
    """

    status: str
    factor: float
    unknowns: int = 0
    seconds: dict[str, float] | None = None
    memory_MiB: float = 0.0
    idle_MiB: float = 0.0


def measure(factor: float, order: int = ORDER) -> Size:
    """Solve in a new process; a process that dies or takes too long is a status."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "reports.speed.growth", str(factor), str(order)]
    try:
        ended = subprocess.run(
            command,
            capture_output=True,
            text=True,
            env=environment,
            timeout=TIME_LIMIT,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return Size(f"longer than {TIME_LIMIT:g} s", factor)
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
            return int(line.split()[1]) * KIBI / MEBI
    # ru_maxrss counts bytes on macOS, KiB elsewhere
    unit = 1 if sys.platform == "darwin" else KIBI
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / MEBI


if __name__ == "__main__":
    sys.exit(main())

"""Each scene solved once in a process that may be ended: whatever happens is a row."""

from __future__ import annotations

import multiprocessing
import signal
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import islice
from multiprocessing.connection import Connection, wait
from typing import Any, cast

import numpy as np

from pvdf_fem import Scene, solve

#: A solve that takes longer is ended.
TIME_LIMIT = 120.0
HUNG, DIED, CRASHED = "hung", "died", "crashed"


@dataclass(frozen=True)
class Row:
    """What became of one scene.

    Attributes
    ----------
    status, reason : str
        Of the solution, or ``hung``, ``died``, ``crashed`` with the traceback.
    iterations, unknowns : int
    seconds : float
        Of this process's own time.
    charges_pC, errors_pC : tuple of float
    deflection_mm, force_balance, residual : float
    warnings : tuple of str
    """

    status: str
    reason: str = ""
    iterations: int = 0
    unknowns: int = 0
    seconds: float = 0.0
    charges_pC: tuple[float, ...] = ()
    errors_pC: tuple[float, ...] = ()
    deflection_mm: float = np.nan
    force_balance: float = np.nan
    residual: float = np.nan
    warnings: tuple[str, ...] = ()

    @property
    def converged(self) -> bool:
        """Whether there are charges."""
        return self.status == "converged"


def row_of(scene: Scene) -> Row:
    """Solve; an exception is a row too."""
    start = time.process_time()
    try:
        solution = solve(scene)
        seconds = time.process_time() - start
        row: dict[str, Any] = {
            "status": str(solution.status),
            "reason": solution.reason,
            "iterations": solution.newton_iterations,
            "unknowns": solution.unknowns,
            "seconds": seconds,
            "warnings": solution.warnings,
        }
        if row["status"] != "converged":
            return Row(**row)
        fields = solution.fields
        residual = fields.equilibrium.residual(fields.state)
        return Row(
            **row,
            charges_pC=tuple(solution.charges_pC.values()),
            errors_pC=tuple(solution.charge_errors_pC.values()),
            deflection_mm=solution.deflection_max_mm,
            force_balance=solution.force_balance,
            residual=float(np.linalg.norm(residual)) / scene.load.force,
        )
    except Exception:
        return Row(CRASHED, traceback.format_exc(), seconds=time.process_time() - start)


def rows(
    scenes: Sequence[Scene],
    progress: Callable[[int, Row], None] = lambda number, row: None,
    time_limit: float = TIME_LIMIT,
    processes: int = 1,
) -> list[Row]:
    """Rows of scenes, in their order; `progress` is told of each as it ends."""
    waiting = iter(enumerate(scenes))
    idle: list[_Worker] = []
    busy: dict[Connection, tuple[_Worker, int]] = {}
    found: dict[int, Row] = {}
    while len(found) < len(scenes):
        for number, scene in islice(waiting, processes - len(busy)):
            worker = idle.pop() if idle else _Worker()
            worker.begin(scene, time_limit)
            busy[worker.connection] = worker, number
        for ended in wait(list(busy)):
            worker, number = busy.pop(cast(Connection, ended))
            row = found[number] = worker.row(time_limit)
            if row.status not in (HUNG, DIED):
                idle.append(worker)
            progress(number, row)
    for worker in idle:
        worker.end()
    return [found[number] for number in range(len(scenes))]


class _Worker:
    """A process that solves scenes until it is ended."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, there = context.Pipe()
        self._process = context.Process(target=_serve, args=(there,), daemon=True)
        self._process.start()
        there.close()

    def begin(self, scene: Scene, time_limit: float) -> None:
        self.connection.send((scene, time_limit))

    def row(self, time_limit: float) -> Row:
        try:
            row: Row = self.connection.recv()
        except EOFError:
            self._process.join()
            if self._process.exitcode == -signal.SIGPROF:
                return Row(HUNG, f"longer than {time_limit:g} s", seconds=time_limit)
            return Row(DIED, f"exit code {self._process.exitcode}")
        return row

    def end(self) -> None:
        self._process.terminate()
        self._process.join()


def _serve(connection: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that asks
    while True:
        scene, time_limit = connection.recv()
        # the processor's time, since other processes may be busy; the signal ends this one
        signal.setitimer(signal.ITIMER_PROF, time_limit)
        connection.send(row_of(scene))

"""Each scene is solved once in a process that may be ended; whatever happens is an `Ending`."""

from __future__ import annotations

import json
import multiprocessing
import signal
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from itertools import islice
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any, cast

import numpy as np

from pvdf_fem import Scene, solve

#: Processor time in s after which a solve is ended.
TIME_LIMIT = 120.0
HUNG = "hung"
DIED = "died"
CRASHED = "crashed"


@dataclass(frozen=True)
class Ending:
    """What became of one scene.

    Attributes
    ----------
    status, reason : str
        Status and reason of the solution, or ``hung``, ``died``, or ``crashed`` with the traceback.
    iterations, unknowns : int
        Newton iterations and unknowns of the last mesh.
    seconds : float
        Processor time of the solve.
    charges_pC, errors_pC : tuple of float
        Charges and their estimated errors, in the order of the electrodes.
    deflection_mm, force_balance : float
        Largest deflection, and relative difference of the rim's force from the load.
    residual : float
        Norm of the residual over the load.
    warnings : tuple of str
        Warnings of the solution.
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
        """Whether the solve gave charges."""
        return self.status == "converged"


def ending_of(scene: Scene) -> Ending:
    """Solve a scene in this process; an exception is an ending too."""
    start = time.process_time()
    try:
        solution = solve(scene)
        seconds = time.process_time() - start
        values: dict[str, Any] = {
            "status": str(solution.status),
            "reason": solution.reason,
            "iterations": solution.newton_iterations,
            "unknowns": solution.unknowns,
            "seconds": seconds,
            "warnings": solution.warnings,
        }
        if values["status"] != "converged":
            return Ending(**values)
        fields = solution.fields
        residual = fields.equilibrium.residual(fields.state)
        return Ending(
            **values,
            charges_pC=tuple(solution.charges_pC.values()),
            errors_pC=tuple(solution.charge_errors_pC.values()),
            deflection_mm=solution.deflection_max_mm,
            force_balance=solution.force_balance,
            residual=float(np.linalg.norm(residual)) / scene.load.force,
        )
    except Exception:
        return Ending(CRASHED, traceback.format_exc(), seconds=time.process_time() - start)


def endings_of(
    scenes: Sequence[Scene],
    progress: Callable[[int, Ending], None] = lambda number, ending: None,
    time_limit: float = TIME_LIMIT,
    processes: int = 1,
) -> list[Ending]:
    """Solve scenes in processes of their own.

    Parameters
    ----------
    scenes : sequence of Scene
    progress : callable
        Called with the number of a scene and its ending, as soon as it has ended.
    time_limit : float
        Processor time in s after which a solve is ended.
    processes : int
        Number of scenes that are solved at the same time.

    Returns
    -------
    list of Ending
        In the order of the scenes.
    """
    waiting = iter(enumerate(scenes))
    idle: list[_Worker] = []
    busy: dict[Connection, tuple[_Worker, int]] = {}
    endings: dict[int, Ending] = {}
    while len(endings) < len(scenes):
        for number, scene in islice(waiting, processes - len(busy)):
            worker = idle.pop() if idle else _Worker()
            worker.begin(scene, time_limit)
            busy[worker.connection] = worker, number
        for ended in wait(list(busy)):
            worker, number = busy.pop(cast(Connection, ended))
            ending = endings[number] = worker.ending(time_limit)
            if ending.status not in (HUNG, DIED):
                idle.append(worker)
            progress(number, ending)
    for worker in idle:
        worker.end()
    return [endings[number] for number in range(len(scenes))]


def kept_endings(
    path: Path, scenes: Sequence[Scene], time_limit: float = TIME_LIMIT, processes: int = 1
) -> list[Ending]:
    """`endings_of` scenes, except those whose endings an earlier run has kept in a file.

    Each ending joins the file as soon as it is made.
    """
    endings = _read(path)
    keys = [scene.model_dump_json() for scene in scenes]
    missing = [number for number, key in enumerate(keys) if key not in endings]
    with path.open("a", encoding="utf-8") as stream:

        def keep(index: int, ending: Ending) -> None:
            key = keys[missing[index]]
            endings[key] = ending
            stream.write("\n" + json.dumps({"scene": key, "row": asdict(ending)}))
            stream.flush()
            progress = f"{path.stem} {index + 1}/{len(missing)}"
            print(f"{progress} {ending.status} {ending.seconds:.1f} s", flush=True)

        endings_of([scenes[number] for number in missing], keep, time_limit, processes)
    return [endings[key] for key in keys]


def _read(path: Path) -> dict[str, Ending]:
    """Endings by their scenes; a line that an interrupted run left half written is passed over."""
    endings: dict[str, Ending] = {}
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else []:
        try:
            entry = json.loads(line)
        except ValueError:
            continue
        values: dict[str, Any] = entry["row"]
        values |= {key: tuple(value) for key, value in values.items() if isinstance(value, list)}
        endings[entry["scene"]] = Ending(**values)
    return endings


class _Worker:
    """A process that solves scenes until it is ended."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, far_end = context.Pipe()
        self._process = context.Process(target=_serve, args=(far_end,), daemon=True)
        self._process.start()
        far_end.close()

    def begin(self, scene: Scene, time_limit: float) -> None:
        self.connection.send((scene, time_limit))

    def ending(self, time_limit: float) -> Ending:
        try:
            ending: Ending = self.connection.recv()
        except EOFError:
            self._process.join()
            if self._process.exitcode == -signal.SIGPROF:
                return Ending(HUNG, f"longer than {time_limit:g} s", seconds=time_limit)
            return Ending(DIED, f"exit code {self._process.exitcode}")
        return ending

    def end(self) -> None:
        self._process.terminate()
        self._process.join()


def _serve(connection: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent process handles Ctrl-C
    while True:
        scene, time_limit = connection.recv()
        # The timer counts processor time, since other processes may keep this one waiting.
        # Its signal ends this process.
        signal.setitimer(signal.ITIMER_PROF, time_limit)
        connection.send(ending_of(scene))

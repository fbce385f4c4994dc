"""Damaged inputs by the thousand, none of which may be taken for a valid one.

    python -m reports.fuzz [--count N] [--seed N] [--processes N]

Gives every program damaged scene and sweep files, changes, measurements, stores and command lines
(`reports/fuzz_inputs.py`), in this process and stopped where work on a valid input would begin; a
sample also as processes of their own. Prints counts by corpus and every input that was handled
badly: an exception, another exit code than 2, a complaint that does not name key and value, is not
printable or is longer than a screen, a file left behind, more than `SECONDS`, or acceptance of what
is invalid (`reports/fuzz_oracle.py`). Returns 1 if there was one.
"""

from __future__ import annotations

import argparse
import io
import os
import random
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
import tomllib
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any
from unittest import mock

from pvdf_fem.cli import main as cli
from pvdf_fem.cli.program import (
    BAD_INPUT,
    LONGEST_LINE,
    MOST_LINES,
    ArgumentParser,
    run_program,
)
from pvdf_fem.scene.scene import Scene
from pvdf_fem.sweeps.store import Record, Store, StoreError
from reports import benchmark, compare, error_vs_time, thesis
from reports.common.options import number_of
from reports.robustness.damage import decayed
from reports.robustness.inputs import CORPORA, FILE, Input
from reports.robustness.oracle import (
    lost_values,
    spread,
    wrong_grid,
    wrong_measurement,
    wrong_scene,
)

#: A refusal takes less of processor time, and no input more than `HANG` before it is stopped.
SECONDS, HANG = 1.0, 20


class Accepted(BaseException):
    """A valid input reached the work; the argument is what the work was given."""


@dataclass(frozen=True)
class Program:
    """A program: its main function, the words before its arguments, and where its work begins."""

    main: Callable[[Sequence[str]], int]
    command: tuple[str, ...]
    begins: tuple[str, ...]


def _store(arguments: Sequence[str]) -> int:
    """Read and write a damaged store; `Accepted` with a record that was not kept in it."""
    path, seed = Path(arguments[0]), int(arguments[1])
    scenes, records, data = _kept()
    path.write_bytes(decayed(random.Random(seed), data))

    def use() -> int:
        with Store(path) as store:
            for scene, record in zip(scenes, records, strict=True):
                if (found := store.get(scene)) not in (None, record):
                    raise Accepted(found)
            store.put([(scenes[0], records[1])])
            if store.get(scenes[0]) != records[1]:
                raise StoreError(f"{path}: keeps nothing")
        raise Accepted(None)

    try:
        return run_program("store", use)
    finally:
        for side in path.parent.glob(f"{path.name}-*"):
            side.unlink()


@cache
def _kept() -> tuple[list[Scene], list[Record], bytes]:
    """Scenes, their records and the bytes of their store."""
    scenes = [Scene().with_(**{"load.force_N": 0.1 * i}) for i in range(40)]
    forces = {"material": [[0.123456789, 9.87654321]] * 4}
    records = [
        Record("converged", "", tuple("ABCD"), forces, forces, 1.0 + i, 99, 9, (), 0.1)
        for i in range(len(scenes))
    ]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "store.db"
        with Store(path) as store:
            for scene, record in zip(scenes, records, strict=True):
                store.put([(scene, record)])
        with sqlite3.connect(path) as rows:
            rows.execute("PRAGMA journal_mode = DELETE")
        rows.close()
        return scenes, records, path.read_bytes()


PROGRAMS = {
    "solve": Program(cli.main, ("solve",), ("pvdf_fem.solution.solution.solve",)),
    "mesh": Program(cli.main, ("mesh",), ("pvdf_fem.mesh.gmsh_mesh.mesh_scene",)),
    "modes": Program(cli.main, ("modes",), ("pvdf_fem.solution.modes.modes",)),
    "sweep": Program(cli.main, ("sweep",), ("pvdf_fem.sweeps.sweep.planned",)),
    "locate": Program(cli.main, ("locate",), ("pvdf_fem.cli.locate.model_of",)),
    "compare": Program(compare.main, (), ("reports.compare._scenes",)),
    "thesis": Program(thesis.main, (), ("reports.thesis.Thesis.read",)),
    "benchmark": Program(benchmark.main, (), ("reports.benchmark.yardstick",)),
    "error_vs_time": Program(error_vs_time.main, (), ("reports.error_vs_time.Peers",)),
    "store": Program(_store, (), ()),
}


@dataclass
class Outcome:
    """What became of an input: refused or accepted, and what was wrong with that."""

    accepted: bool
    faults: list[str]
    seconds: float


def outcome(given: Input, folder: Path) -> Outcome:
    """Give a program an input in this process."""
    program, path = PROGRAMS[given.program], folder / "input.dat"
    path.unlink(missing_ok=True)  # rewriting a file in place waits for the disk
    path.write_bytes(given.data)
    arguments = [*program.command, *_filled(given.arguments, path)]
    out, err = io.StringIO(), io.StringIO()
    faults: list[str] = []
    code: int | None = None
    taken: Any = None
    start = time.process_time()
    try:
        with _stopped(program), _limited(), redirect_stdout(out), redirect_stderr(err):
            code = program.main(arguments)
    except Accepted as accepted:
        (taken,) = accepted.args
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1
    except TimeoutError:
        faults.append(f"hangs for {HANG} s")
        code = BAD_INPUT
    except Exception:
        faults.append("traceback: " + traceback.format_exc(limit=-2))
        code = BAD_INPUT
    seconds = time.process_time() - start
    if code is None:
        faults += _accepted_faults(given, taken)
    else:
        faults += _refusal_faults(given, code, out.getvalue(), err.getvalue())
        if seconds > SECONDS:
            faults.append(f"refused after {seconds:.1f} s")
    left = [file for file in folder.iterdir() if file != path and file.name != "out"]
    faults += [f"left {file.name} behind" for file in left]
    return Outcome(code is None, faults, seconds)


def _filled(arguments: Sequence[str], path: Path) -> list[str]:
    return [a.replace(FILE, str(path)).replace("{folder}", str(path.parent)) for a in arguments]


@contextmanager
def _stopped(program: Program) -> Iterator[None]:
    """What begins the work raises `Accepted` instead."""

    def begin(*given: object, **_: object) -> None:
        raise Accepted(given[0] if given else None)

    with ExitStack() as stack:
        for place in program.begins:
            stack.enter_context(mock.patch(place, begin))
        yield


@contextmanager
def _limited() -> Iterator[None]:
    def stop(*_: object) -> None:
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(HANG)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def _refusal_faults(given: Input, code: int, out: str, err: str) -> list[str]:
    lines = err.removesuffix("\n").split("\n")
    faults = []
    if code != BAD_INPUT:
        faults.append(f"exit code {code}")
    if out:
        faults.append(f"standard output: {out[:80]!r}")
    usage = lines[0].startswith("usage: ")
    if not err or len(lines) > MOST_LINES + (40 if usage else 1):
        faults.append(f"{len(lines)} lines of complaint")
    # usage may be followed by a line of the same length as others, after the program's name
    if any(not line.isprintable() or len(line) > LONGEST_LINE + 100 for line in lines):
        faults.append(f"not printable or too long: {err[:80]!r}")
    if "Traceback" in err:
        faults.append("a traceback in the complaint")
    named = [line for line in lines if line.startswith(given.named) or f"{given.named}" in line]
    if not named:
        faults.append(f"does not name {given.named!r}: {err[:200]!r}")
    return faults


def _accepted_faults(given: Input, taken: Any) -> list[str]:
    if given.invalid:
        return [f"accepted, though invalid: {given.named or given.arguments!r:.80}"]
    if isinstance(taken, Scene):
        tables = tomllib.loads(taken.to_toml())
        found = [wrong_scene(tables)]
        if not any(argument == "--set" for argument in given.arguments):
            written = tomllib.loads(given.data.decode("utf-8-sig"))
            found += [wrong_scene(written), lost_values(written, tables)]
        return [f"accepted: {text}" for text in found if text]
    if given.program == "sweep":
        scenes = [tomllib.loads(scene.to_toml()) for scene in spread(taken)]
        written = tomllib.loads(given.data.decode("utf-8-sig"))
        found = [*map(wrong_scene, scenes), wrong_grid(written, scenes, len(taken))]
        return [f"accepted: {text}" for text in found if text]
    if isinstance(taken, list):
        return [f"accepted: {text}" for row in taken if (text := wrong_measurement(row))]
    return [f"accepted: {taken!r:.80}"] if isinstance(taken, Record) else []


# ---------------------------------------------------------------------- processes of their own


def process_faults(given: Input, folder: Path) -> list[str]:
    """Give ``pvdf-fem`` an input that it refuses, as a process."""
    path = folder / "input.dat"
    path.unlink(missing_ok=True)  # rewriting a file in place waits for the disk
    path.write_bytes(given.data)
    words = [*PROGRAMS[given.program].command, *_filled(given.arguments, path)]
    command = [sys.executable, "-m", "pvdf_fem", *words]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).resolve().parents[1])}
    try:
        run = subprocess.run(
            command,
            capture_output=True,
            timeout=HANG,
            env=environment,
            cwd=folder,
            check=False,
            encoding="utf-8",
            errors="replace",
        )
    except subprocess.TimeoutExpired:
        return [f"hangs for {HANG} s as a process"]
    faults = _refusal_faults(given, run.returncode, run.stdout, run.stderr)
    return [f"as a process: {fault}" for fault in faults]


# -------------------------------------------------------------------------------------- counts


@dataclass
class Counts:
    """What became of the inputs, by corpus."""

    inputs: Counter[str] = field(default_factory=Counter)
    refused: Counter[str] = field(default_factory=Counter)
    accepted: Counter[str] = field(default_factory=Counter)
    faults: Counter[str] = field(default_factory=Counter)
    slowest: dict[str, float] = field(default_factory=dict)
    told: list[str] = field(default_factory=list)

    def add(self, corpus: str, given: Input, found: Outcome) -> None:
        """Count an input."""
        self.inputs[corpus] += 1
        (self.accepted if found.accepted else self.refused)[corpus] += 1
        self.slowest[corpus] = max(self.slowest.get(corpus, 0.0), found.seconds)
        self.add_faults(corpus, given, found.faults)

    def add_faults(self, corpus: str, given: Input, faults: Sequence[str]) -> None:
        """Count what was wrong."""
        self.faults[corpus] += bool(faults)
        self.told += [f"{corpus}: {fault}\n    {given!r:.300}" for fault in faults]

    def lines(self) -> list[str]:
        """A table."""
        rows = [f"{'corpus':<22}{'inputs':>8}{'refused':>9}{'valid':>7}{'bad':>5}{'slowest':>10}"]
        for name in sorted(self.inputs):
            rows.append(self._row(name, name, self.slowest[name]))
        return [*rows, self._row("all", "", max(self.slowest.values()))]

    def _row(self, label: str, name: str, slowest: float) -> str:
        counters = (self.inputs, self.refused, self.accepted, self.faults)
        n, refused, accepted, bad = (c[name] if name else c.total() for c in counters)
        return f"{label:<22}{n:>8}{refused:>9}{accepted:>7}{bad:>5}{slowest:>8.3f} s"


def fuzz(count: int, seed: int, processes: int = 0) -> Counts:
    """Run inputs of all corpora, the last refused ones of ``pvdf-fem`` as processes too."""
    rng, counts = random.Random(seed), Counts()
    every = max(1, count // processes) if processes else 0
    due = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        corpora = rng.choices(list(CORPORA), list(CORPORA.values()), k=count)
        for number, corpus in enumerate(corpora):
            given = corpus(rng)
            found = outcome(given, folder)
            counts.add(corpus.__name__, given, found)
            due += bool(every) and number % every == 0
            if due and not found.accepted and PROGRAMS[given.program].main is cli.main:
                due -= 1
                counts.add_faults(corpus.__name__, given, process_faults(given, folder))
    return counts


def main(arguments: Sequence[str] | None = None) -> int:
    """Run and print; returns 1 if an input was handled badly."""
    options = _options(arguments)
    start = time.perf_counter()
    counts = fuzz(options.count, options.seed, options.processes)
    print(*counts.told[:50], *counts.lines(), sep="\n")
    print(f"{counts.faults.total()} handled badly, {time.perf_counter() - start:.0f} s")
    return 1 if counts.told else 0


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = ArgumentParser(prog="reports.fuzz", description="Damaged inputs by the thousand.")
    number = number_of("inputs", 10_000_000)
    parser.add_argument("--count", type=number, default=20_000, metavar="N", help="default: 20000")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="default: 1")
    parser.add_argument(
        "--processes",
        type=number_of("processes"),
        default=100,
        metavar="N",
        help="how many are given to a process of their own too (default: 100)",
    )
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())

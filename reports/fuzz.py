"""Thousands of damaged inputs, none of which may be accepted as valid.

    python -m reports.fuzz [--count N] [--seed N] [--processes N] [--corpus NAME ...]

Gives every program damaged scene and sweep files, changes, charges, stores, response
models and command lines (`reports.robustness.corpora`), in this process and stopped where work on a
valid input would begin.
Some inputs are given to processes of their own too. Prints counts by corpus and every input that
was handled badly: an exception, another exit code than 2, a complaint that does not name key and
value, is not printable or is longer than a screen, a file left behind, more than `REFUSAL_SECONDS`,
or acceptance of what is invalid (`reports.robustness.oracle`). Returns 1 if there was one.
"""

from __future__ import annotations

import argparse
import io
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
import traceback
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import ExitStack, contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest import mock

from pvdf_fem.cli import main as cli
from pvdf_fem.cli.program import (
    LONGEST_LINE,
    MOST_LINES,
    ArgumentParser,
    ExitCode,
)
from pvdf_fem.scene.scene import Scene
from pvdf_fem.sweeps.store import Record
from reports.common.options import number_of
from reports.robustness import kept
from reports.robustness.charge_inputs import wrong_charge_list
from reports.robustness.corpora import CORPORA
from reports.robustness.inputs import FILE, Input
from reports.robustness.kept import Accepted
from reports.robustness.oracle import (
    lost_values,
    spread,
    wrong_grid,
    wrong_scene,
)

#: Processor time in s that a refusal may take.
REFUSAL_SECONDS = 1.0
#: Seconds after which a program that still works on an input is stopped.
HANG_SECONDS = 20


@dataclass(frozen=True)
class Program:
    """A program.

    Attributes
    ----------
    main : callable
        Its main function.
    command : tuple of str
        Words before its arguments.
    begins : tuple of str
        Functions with which the work on a valid input begins.
    """

    main: Callable[[Sequence[str]], int]
    command: tuple[str, ...]
    begins: tuple[str, ...]


PROGRAMS = {
    "solve": Program(cli.main, ("solve",), ("pvdf_fem.solution.solve.solve",)),
    "mesh": Program(cli.main, ("mesh",), ("pvdf_fem.mesh.gmsh_mesh.mesh_scene",)),
    "modes": Program(cli.main, ("modes",), ("pvdf_fem.dynamics.modes.modes",)),
    "sweep": Program(cli.main, ("sweep",), ("pvdf_fem.sweeps.sweep.planned",)),
    "locate": Program(cli.main, ("locate",), ("pvdf_fem.cli.locate.model_of",)),
    "locate_model": Program(cli.main, ("locate",), ("pvdf_fem.touch.locate.weigh",)),
    "response": Program(kept.load_response, (), ()),
    "store": Program(kept.use_store, (), ()),
}


@dataclass
class Verdict:
    """Whether an input was accepted, the faults of that, and the processor time."""

    accepted: bool
    faults: list[str]
    seconds: float


def verdict(sample: Input, folder: Path) -> Verdict:
    """Give a program an input in this process and judge what it does."""
    program, path = PROGRAMS[sample.program], folder / "input.dat"
    arguments = _prepared(sample, path)
    out, err = io.StringIO(), io.StringIO()
    faults: list[str] = []
    code: int | None = None
    accepted_value: Any = None
    start = time.process_time()
    try:
        with _stopped(program), _limited(), redirect_stdout(out), redirect_stderr(err):
            code = program.main(arguments)
    except Accepted as accepted:
        (accepted_value,) = accepted.args
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1
    except TimeoutError:
        faults.append(f"hangs for {HANG_SECONDS} s")
        code = ExitCode.BAD_INPUT
    except Exception:
        faults.append("traceback: " + traceback.format_exc(limit=-2))
        code = ExitCode.BAD_INPUT
    seconds = time.process_time() - start
    if code is None:
        faults += _accepted_faults(sample, accepted_value)
    else:
        faults += _refusal_faults(sample, code, out.getvalue(), err.getvalue())
        if seconds > REFUSAL_SECONDS:
            faults.append(f"refused after {seconds:.1f} s")
    leftovers = [file for file in folder.iterdir() if file != path and file.name != "out"]
    faults += [f"left {file.name} behind" for file in leftovers]
    return Verdict(code is None, faults, seconds)


def _prepared(sample: Input, path: Path) -> list[str]:
    """Write an input's file; the program's command line with the file's path in it."""
    path.unlink(missing_ok=True)  # rewriting a file in place waits for the disk
    path.write_bytes(sample.data)
    words = [*PROGRAMS[sample.program].command, *sample.arguments]
    return [word.replace(FILE, str(path)).replace("{folder}", str(path.parent)) for word in words]


@contextmanager
def _stopped(program: Program) -> Iterator[None]:
    """Let the functions with which the work begins raise `Accepted` instead."""

    def begin(*values: object, **_: object) -> None:
        raise Accepted(values[0] if values else None)

    with ExitStack() as stack:
        for place in program.begins:
            stack.enter_context(mock.patch(place, begin))
        yield


@contextmanager
def _limited() -> Iterator[None]:
    def stop(*_: object) -> None:
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(HANG_SECONDS)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def _refusal_faults(sample: Input, code: int, out: str, err: str) -> list[str]:
    lines = err.removesuffix("\n").split("\n")
    faults = []
    if code != ExitCode.BAD_INPUT:
        faults.append(f"exit code {code}")
    if out:
        faults.append(f"standard output: {out[:80]!r}")
    usage = lines[0].startswith("usage: ")
    if not err or len(lines) > MOST_LINES + (40 if usage else 1):
        faults.append(f"{len(lines)} lines of complaint")
    # After a usage text the complaint follows the program's name in its line.
    if any(not line.isprintable() or len(line) > LONGEST_LINE + 100 for line in lines):
        faults.append(f"not printable or too long: {err[:80]!r}")
    if "Traceback" in err:
        faults.append("a traceback in the complaint")
    naming_lines = [
        line for line in lines if line.startswith(sample.named) or f"{sample.named}" in line
    ]
    if not naming_lines:
        faults.append(f"does not name {sample.named!r}: {err[:200]!r}")
    return faults


def _accepted_faults(sample: Input, value: Any) -> list[str]:
    if sample.invalid:
        return [f"accepted, though invalid: {sample.named or sample.arguments!r:.80}"]
    if sample.program in ("locate_model", "response"):
        text = kept.changed_response(value)
        return [f"accepted: {text}"] if text else []
    if isinstance(value, Scene):
        tables = tomllib.loads(value.to_toml())
        mistakes = [wrong_scene(tables)]
        if not any(argument == "--set" for argument in sample.arguments):
            written = tomllib.loads(sample.data.decode("utf-8-sig"))
            mistakes += [wrong_scene(written), lost_values(written, tables)]
        if sample.program == "locate":
            mistakes += [wrong_charge_list(a.partition("=")[2]) for a in sample.arguments[1:2]]
        return [f"accepted: {text}" for text in mistakes if text]
    if sample.program == "sweep":
        scenes = [tomllib.loads(scene.to_toml()) for scene in spread(value)]
        written = tomllib.loads(sample.data.decode("utf-8-sig"))
        mistakes = [*map(wrong_scene, scenes), wrong_grid(written, scenes, len(value))]
        return [f"accepted: {text}" for text in mistakes if text]
    return [f"accepted: {value!r:.80}"] if isinstance(value, Record) else []


# ---------------------------------------------------------------------- processes of their own


def process_faults(sample: Input, folder: Path) -> list[str]:
    """Give ``pvdf-fem`` an input that it refuses, as a process."""
    words = _prepared(sample, folder / "input.dat")
    command = [sys.executable, "-m", "pvdf_fem", *words]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).resolve().parents[1])}
    try:
        run = subprocess.run(
            command,
            capture_output=True,
            timeout=HANG_SECONDS,
            env=environment,
            cwd=folder,
            check=False,
            encoding="utf-8",
            errors="replace",
        )
    except subprocess.TimeoutExpired:
        return [f"hangs for {HANG_SECONDS} s as a process"]
    faults = _refusal_faults(sample, run.returncode, run.stdout, run.stderr)
    return [f"as a process: {fault}" for fault in faults]


# -------------------------------------------------------------------------------------- counts


@dataclass
class Counts:
    """Numbers of inputs, refusals, acceptances and faults by corpus, and the complaints."""

    inputs: Counter[str] = field(default_factory=Counter)
    refused: Counter[str] = field(default_factory=Counter)
    accepted: Counter[str] = field(default_factory=Counter)
    faults: Counter[str] = field(default_factory=Counter)
    slowest: dict[str, float] = field(default_factory=dict)
    complaints: list[str] = field(default_factory=list)

    def add(self, corpus: str, sample: Input, verdict: Verdict) -> None:
        """Count an input."""
        self.inputs[corpus] += 1
        (self.accepted if verdict.accepted else self.refused)[corpus] += 1
        self.slowest[corpus] = max(self.slowest.get(corpus, 0.0), verdict.seconds)
        self.add_faults(corpus, sample, verdict.faults)

    def add_faults(self, corpus: str, sample: Input, faults: Sequence[str]) -> None:
        """Count what was wrong."""
        self.faults[corpus] += bool(faults)
        self.complaints += [f"{corpus}: {fault}\n    {sample!r:.300}" for fault in faults]

    def lines(self) -> list[str]:
        """A table."""
        rows = [f"{'corpus':<22}{'inputs':>8}{'refused':>9}{'valid':>7}{'bad':>5}{'slowest':>10}"]
        for name in sorted(self.inputs):
            rows.append(self._row(name, name, self.slowest[name]))
        return [*rows, self._row("all", "", max(self.slowest.values()))]

    def _row(self, label: str, name: str, slowest: float) -> str:
        counters = (self.inputs, self.refused, self.accepted, self.faults)
        n, refused, accepted, faulty = (c[name] if name else c.total() for c in counters)
        return f"{label:<22}{n:>8}{refused:>9}{accepted:>7}{faulty:>5}{slowest:>8.3f} s"


def fuzz(count: int, seed: int, processes: int = 0, names: Collection[str] = ()) -> Counts:
    """Give inputs of corpora to their programs.

    Parameters
    ----------
    count : int
        Number of inputs.
    seed : int
    processes : int
        About as many refused inputs of ``pvdf-fem`` are given to processes of their own too.
    names : collection of str
        Names of the corpora, all if there are none.
    """
    chosen = {c: share for c, share in CORPORA.items() if not names or c.__name__ in names}
    rng, counts = random.Random(seed), Counts()
    interval = max(1, count // processes) if processes else 0
    due = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        corpora = rng.choices(list(chosen), list(chosen.values()), k=count)
        for number, corpus in enumerate(corpora):
            sample = corpus(rng)
            result = verdict(sample, folder)
            counts.add(corpus.__name__, sample, result)
            due += bool(interval) and number % interval == 0
            if due and not result.accepted and PROGRAMS[sample.program].main is cli.main:
                due -= 1
                counts.add_faults(corpus.__name__, sample, process_faults(sample, folder))
    return counts


def main(arguments: Sequence[str] | None = None) -> int:
    """Run and print; returns 1 if an input was handled badly."""
    options = _options(arguments)
    start = time.perf_counter()
    counts = fuzz(options.count, options.seed, options.processes, options.corpus)
    print(*counts.complaints[:50], *counts.lines(), sep="\n")
    print(f"{counts.faults.total()} handled badly, {time.perf_counter() - start:.0f} s")
    return 1 if counts.complaints else 0


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
    names = [corpus.__name__ for corpus in CORPORA]
    parser.add_argument(
        "--corpus",
        action="append",
        default=[],
        choices=names,
        metavar="NAME",
        help=f"only this one; may be given several times: {', '.join(names)}",
    )
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())

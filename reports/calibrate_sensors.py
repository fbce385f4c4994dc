"""Made-up sensors calibrated from touches, and wrong files of touches.

    python -m reports.calibrate_sensors [--count N] [--touches N] [--seed N] [--out DIR]
                                        [--processes N]

Each sensor has gains, piezoelectric coefficients, a pretension and a place under the stage of its
own; its touches are solved at a tolerance of 1e-5, and their places and readings have errors. The
page tells how far calibrated parameters are off, over their stated deviations, and how well new
touches are located. Results are kept in the output folder, so that a run goes on where it was. A
hundred sensors take an hour and a half of one core.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import joblib
import numpy as np

from pvdf_fem import Scene
from pvdf_fem.cli.program import ArgumentParser, run_program
from reports.common.options import add_out, add_processes, number_of
from reports.common.page import Cell, Column, Page, Section, Table
from reports.sensors.trials import trial
from reports.sensors.wrong_files import WRONG_FILES, wrong_file

SCENE = Path(__file__).resolve().parents[1] / "geometry" / "triangle.toml"
#: The seed of the sensors in the README.
SEED = 20261123


def main(arguments: Sequence[str] | None = None) -> int:
    """Calibrate and write the page."""
    options = _options(arguments)
    return run_program("reports.calibrate_sensors", lambda: _report(options))


def _report(options: argparse.Namespace) -> int:
    options.out.mkdir(parents=True, exist_ok=True)
    scene = Scene.load(SCENE)
    stem = f"{options.seed}-{options.touches}"
    job = partial(trial, scene, options.seed, touches=options.touches, new=options.new)
    keys = list(range(options.count))
    results = _kept(options.out / f"sensors-{stem}.jsonl", job, keys, options.processes)
    files = partial(wrong_file, scene, options.seed, options.touches)
    wrong = _kept(
        options.out / f"wrong-{stem}.jsonl",
        files,
        list(WRONG_FILES)[: options.files],
        options.processes,
    )
    sections = [
        Section("parameters", "Parameters", _summary(results), [_parameters(results)]),
        Section("wrong", "Wrong files", (), [_wrong_files(wrong)]),
    ]
    for section in sections:
        section.write_tables(options.out)
        for text in section.paragraphs:
            print(text)
    text = f"{options.count} sensors, each with {options.touches} touches; seed {options.seed}."
    print(Page("Calibrated sensors", [text], sections).write(options.out))
    return 0


def _kept(
    path: Path, job: Callable[[Any], dict[str, Any]], keys: Sequence[Any], processes: int
) -> list[dict[str, Any]]:
    """Results by key, which are stored as they come."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    kept = {result["number"]: result for result in map(_parsed, lines) if result}
    missing = [key for key in keys if key not in kept]
    tasks = (joblib.delayed(job)(key) for key in missing)
    with open(path, "a", encoding="utf-8") as file:
        for result in joblib.Parallel(processes, return_as="generator")(tasks):
            kept[result["number"]] = result
            file.write(json.dumps(result) + "\n")
            file.flush()
    return [kept[key] for key in keys]


def _parsed(line: str) -> dict[str, Any] | None:
    try:  # a killed run may leave half a line
        result: dict[str, Any] = json.loads(line)
    except json.JSONDecodeError:
        return None
    return result


def _summary(results: Sequence[dict[str, Any]]) -> list[str]:
    calibrated = [r for r in results if r["status"] == "calibrated"]
    if not calibrated:
        return ["No sensor was calibrated."]
    told = np.array(
        [[z for k, z in r["parameters"].items() if k.startswith("told:")] for r in calibrated]
    )
    every = np.array(
        [[z for k, z in r["parameters"].items() if k[:5] != "told:"] for r in calibrated]
    )
    seconds = np.array([r["seconds"] for r in results])
    located = {
        label: np.concatenate([np.array(r["located"][label]) for r in calibrated])
        for label in ("true", "calibrated")
    }
    ratios = []
    for columns in ([0, 1], [2]):
        true, ours = (np.linalg.norm(of[:, columns], axis=1) for of in located.values())
        ratios += [np.median(ours) / np.median(true), np.sqrt((ours**2).mean() / (true**2).mean())]
    size = [np.median(np.hypot(*e[:, :2].T)) for e in located.values()]
    over = np.mean([r["chi_square"] / r["degrees_of_freedom"] for r in calibrated])
    return [
        f"{len(calibrated)} of {len(results)} sensors are calibrated;"
        f" {sum(bool(r['remarks']) for r in calibrated)} of them have remarks or touches left out.",
        f"Parameters that can be told: {100 * (np.abs(told) <= 3).mean():.1f} % within 3 stated"
        f" deviations, {100 * (np.abs(told) <= 1).mean():.1f} % within one"
        f" ({told.size} of them, which depend on each other; z-scores have the deviation"
        f" {told.std():.2f}). All parameters: {100 * (np.abs(every) <= 3).mean():.1f} % and"
        f" {100 * (np.abs(every) <= 1).mean():.1f} %.",
        f"New touches: the median error of the place is {size[1]:.2f} mm, {size[0]:.2f} mm with the"
        f" true parameters: {ratios[0]:.2f} times as large (root mean squares: {ratios[1]:.2f});"
        f" that of the force is {ratios[2]:.2f} times as large ({ratios[3]:.2f}).",
        f"A calibration takes {np.median(seconds):.1f} s of processor time in the median,"
        f" {seconds.max():.1f} s at most.",
        f"Chi-square over its degrees of freedom: {over:.2f} in the mean.",
    ]


def _parameters(results: Sequence[dict[str, Any]]) -> Table:
    columns = [
        Column("parameter", "parameter"),
        Column("within_1", "within 1 stated deviation (%)", 0),
        Column("within_3", "within 3 (%)", 1),
        Column("mean", "mean error over the deviation", 2, signed=True),
        Column("rms", "root mean square", 2),
    ]
    scores = [r["parameters"] for r in results if r["status"] == "calibrated"]
    rows: list[list[Cell]] = []
    for name in scores[0] if scores else ():
        z = np.array([score[name] for score in scores])
        within = [100.0 * float((np.abs(z) <= limit).mean()) for limit in (1.0, 3.0)]
        rows.append([name, *within, float(z.mean()), float(np.sqrt((z**2).mean()))])
    return Table("parameters", "Errors of parameters over their stated deviations.", columns, rows)


def _wrong_files(results: Sequence[dict[str, Any]]) -> Table:
    columns = [
        Column("file", "what is wrong"),
        Column("status", "status"),
        Column("said", "what was said"),
        Column("seconds", "processor seconds", 0),
    ]
    rows = [[r["number"], r["status"], r["said"], r["seconds"]] for r in results]
    return Table("wrong-files", "Files with a mistake, and what is said of them.", columns, rows)


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = ArgumentParser(
        prog="reports.calibrate_sensors", description="Made-up sensors calibrated from touches."
    )
    for name, default, text in (
        ("count", 100, "sensors"),
        ("touches", 24, "touches of each sensor"),
        ("new", 4, "new touches of each sensor, which are located"),
        ("files", len(WRONG_FILES), "wrong files"),
    ):
        parser.add_argument(
            f"--{name}",
            type=number_of(text, 10_000),
            default=default,
            metavar="N",
            help=f"number of {text} (default: {default})",
        )
    parser.add_argument("--seed", type=number_of("seed", 10**9), default=SEED, metavar="N")
    add_out(parser, "calibrate_sensors")
    add_processes(parser)
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())

"""What "how good is it" shows: our numbers beside those of others, computed while it is built."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import nullcontext
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from pvdf_fem import solve
from pvdf_fem.batch.batch import plan_scenes, solve_scenes
from pvdf_fem.batch.store import Store
from pvdf_fem.report.registry import load_kinds
from pvdf_fem.report.report import STORE, Report
from pvdf_fem.report.results import ReportResults
from pvdf_fem.solver.nonlinear.status import Status
from reports.accuracy.drawn import draw_scenes

ROOT = Path(__file__).parents[2]
OUT = ROOT / "reports" / "out"
THESIS = ROOT / "reports" / "thesis"
#: Solves that building the guide may make for the comparison with the thesis.
FEW_SOLVES = 8
#: Kinds of random scenes that are solved fast; the others bend, wrinkle or have a tip.
QUICK = ("pressure", "punch")
#: Reports beside the one on the thesis.
OTHERS = ("accuracy", "stability", "locating", "design")


class Markdown(NamedTuple):
    """A text that notebooks show."""

    text: str

    def _repr_markdown_(self) -> str:
        return self.text


def table(heads: Iterable[str], rows: Iterable[Iterable[object]]) -> Markdown:
    """A table that notebooks show."""
    heads = list(heads)
    lines = [heads, ["---"] * len(heads), *([str(cell) for cell in row] for row in rows)]
    return Markdown("\n".join(f"| {' | '.join(line)} |" for line in lines))


def proofs() -> Markdown:
    """A table for each proof of the tests, its numbers computed now."""
    # not an import statement, since tests have no types
    found = import_module("tests.validation.proofs").PROOFS
    heads = "number", "ours", "theirs", "difference", "allowed"
    texts = []
    for proof in found:
        rows = []
        for n in proof.numbers():
            sizes = f"{n.ours:.6g}", f"{n.theirs:.6g}"
            rows.append([n.quantity, *sizes, f"{n.difference:+.1e}", f"{n.tolerance:.0e}"])
        told = f"Source: {proof.source}. Allowed: {proof.why}."
        texts.append(f"**{proof.problem}.** {told}\n\n{table(heads, rows).text}")
    return Markdown("\n\n".join(texts))


def stated_and_true(seed: int = 1, count: int = 3) -> Markdown:
    """Stated errors of random scenes beside the differences from solves that are finer."""
    rows = []
    for scene in (scene for kind in QUICK for scene in draw_scenes(kind, count, seed)):
        probe = scene.single_probe
        kind = f"{scene.load.kind}, {probe.shape if probe else ''}"
        found = solve(scene)
        if found.status is not Status.CONVERGED:
            rows.append([kind, scene.numerics.tolerance, found.status, ""])
            continue
        finer = solve(scene.with_(**{"numerics.tolerance": scene.numerics.tolerance / 10.0}))
        pairs = zip(found.charges_pC.values(), finer.charges_pC.values(), strict=True)
        true = [abs(q - better) / abs(better) for q, better in pairs]
        errors = zip(found.charge_errors_pC.values(), finer.charges_pC.values(), strict=True)
        stated = [error / abs(better) for error, better in errors]
        rows.append([kind, scene.numerics.tolerance, f"{max(stated):.1e}", f"{max(true):.1e}"])
    return table(("load", "tolerance", "worst stated error", "worst true error"), rows)


def with_the_thesis() -> tuple[str, pd.DataFrame]:
    """Printed charges beside ours: all, where the report's solves are stored, or a few."""
    report = Report.load(THESIS / "report.toml", load_kinds(THESIS / "special.py"))
    inputs, needed = report.plan.collect_requirements()
    item, scenes, _ = next(asked for asked in needed if asked.item.name == "charges")
    where = "all printed charges, from the solves of `./run report`"
    store = OUT / STORE
    with Store(store) if store.is_file() else nullcontext() as kept:
        if len(plan_scenes(scenes, kept).blocks) > FEW_SOLVES:
            few = inputs.data["charges"]
            rows = few.frame[few.frame.source == "Table 3.4"].reset_index(drop=True)
            inputs = replace(inputs, data={"charges": replace(few, frame=rows)})
            scenes = item.kind.list_scenes(inputs)
            where = "Table 3.4 only, solved for this page; `./run report` compares all charges"
        records = solve_scenes(scenes, kept, processes=1)
    results = ReportResults(dict(zip(scenes, records, strict=True)))
    return where, item.kind.compose(inputs, results).frame


def long_runs() -> Markdown:
    """Verdicts of the reports that were made here."""
    lines = []
    for name in OTHERS:
        file = OUT / name / "verdict.txt"
        told = file.read_text("utf-8") if file.is_file() else "not made here"
        lines.append(f"- `./run report {name}`: {told.strip()}")
    return Markdown("\n".join(lines))

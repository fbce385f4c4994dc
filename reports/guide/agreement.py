"""Tables of the guide's page "How good is it?", computed while the page is built."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import nullcontext
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from pvdf_fem import Scene, solve
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
#: Largest number of solves of the comparison with the thesis while the guide is built.
MAX_SOLVES = 8
#: Kinds of random scenes that are solved fast; the others bend, wrinkle or have a tip.
QUICK_KINDS = ("pressure", "punch")
#: Reports besides the one on the thesis.
OTHER_REPORTS = ("accuracy", "stability", "locating", "design")


class Markdown(NamedTuple):
    """A text in Markdown that notebooks render."""

    text: str

    def _repr_markdown_(self) -> str:
        return self.text


def make_table(heads: Iterable[str], rows: Iterable[Iterable[object]]) -> Markdown:
    """Make a table that notebooks render."""
    heads = list(heads)
    lines = [heads, ["---"] * len(heads)]
    for row in rows:
        lines.append([str(cell) for cell in row])
    return Markdown("\n".join(f"| {' | '.join(line)} |" for line in lines))


def make_proof_tables() -> Markdown:
    """Compute the numbers of every proof in `tests/validation/`, and make a table of each proof."""
    # not an import statement, since tests have no types
    proofs = import_module("tests.validation.proofs").PROOFS
    texts = []
    for proof in proofs:
        rows = []
        for number in proof.numbers():
            row = [number.quantity, f"{number.ours:.6g}", f"{number.theirs:.6g}"]
            row += [f"{number.difference:+.1e}", f"{number.tolerance:.0e}"]
            rows.append(row)
        table = make_table(("number", "computed", "published", "difference", "allowed"), rows)
        source = f"Source: {proof.source}. Allowed: {proof.why}."
        texts.append(f"**{proof.problem}.** {source}\n\n{table.text}")
    return Markdown("\n\n".join(texts))


def compare_stated_with_true_errors(seed: int = 1, count: int = 3) -> Markdown:
    """Compare stated errors of random scenes with differences from finer solves.

    Parameters
    ----------
    seed : int
        Seed of the random scenes.
    count : int
        Number of scenes of each kind.

    Returns
    -------
    Markdown
        A table with a row for each scene.
    """
    rows: list[list[object]] = []
    for kind in QUICK_KINDS:
        for scene in draw_scenes(kind, count, seed):
            rows.append(_compare_errors(scene))
    return make_table(("load", "tolerance", "largest stated error", "largest true error"), rows)


def _compare_errors(scene: Scene) -> list[object]:
    """Return load, tolerance, largest stated and largest true error, relative to the charges."""
    tolerance = scene.numerics.tolerance
    probe = scene.single_probe
    load = f"{scene.load.kind}, {probe.shape if probe else ''}"
    solution = solve(scene)
    if solution.status is not Status.CONVERGED:
        return [load, tolerance, solution.status, ""]
    finer = solve(scene.with_(**{"numerics.tolerance": tolerance / 10.0}))
    stated = []
    true = []
    for name, charge in finer.charges_pC.items():
        stated.append(solution.charge_errors_pC[name] / abs(charge))
        true.append(abs(solution.charges_pC[name] - charge) / abs(charge))
    return [load, tolerance, f"{max(stated):.1e}", f"{max(true):.1e}"]


def compare_with_the_thesis() -> tuple[str, pd.DataFrame]:
    """Compare the printed charges of the thesis with computed ones.

    Returns
    -------
    str
        Which charges are compared: all, if the solves of the report are stored, or a few.
    pandas.DataFrame
        A row for each charge.
    """
    report = Report.load(THESIS / "report.toml", load_kinds(THESIS / "special.py"))
    inputs, requirements = report.plan.collect_requirements()
    charges = next(needed for needed in requirements if needed.item.name == "charges")
    kind = charges.item.kind
    scenes = charges.scenes
    text = "all printed charges, from the solves of `./run report`"
    path = OUT / STORE
    with Store(path) if path.is_file() else nullcontext() as store:
        if len(plan_scenes(scenes, store).blocks) > MAX_SOLVES:
            data = inputs.data["charges"]
            frame = data.frame[data.frame.source == "Table 3.4"].reset_index(drop=True)
            inputs = replace(inputs, data={"charges": replace(data, frame=frame)})
            scenes = kind.list_scenes(inputs)
            text = "Table 3.4 only, solved for this page; `./run report` compares all charges"
        records = solve_scenes(scenes, store, processes=1)
    results = ReportResults(dict(zip(scenes, records, strict=True)))
    return text, kind.compose(inputs, results).frame


def list_verdicts() -> Markdown:
    """List the verdicts of the reports that were made in this checkout."""
    lines = []
    for name in OTHER_REPORTS:
        file = OUT / name / "verdict.txt"
        verdict = file.read_text("utf-8").strip() if file.is_file() else "not made here"
        lines.append(f"- `./run report {name}`: {verdict}")
    return Markdown("\n".join(lines))

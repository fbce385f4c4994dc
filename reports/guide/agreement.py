"""What "how good is it" shows: our numbers beside those of others, computed while it is built."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import nullcontext
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from pvdf_fem import Scene, modes, solve
from pvdf_fem.reporting.registry import kinds_of
from pvdf_fem.reporting.report import STORE, Report
from pvdf_fem.reporting.solved import Solved
from pvdf_fem.solvers.status import Status
from pvdf_fem.sweeps.store import Store
from pvdf_fem.sweeps.sweep import planned, solve_all
from reports.accuracy.drawn import drawn_scenes
from reports.reference.axisymmetric import axisymmetric_membrane
from reports.reference.closed_form import disc_frequencies, linear_patch_deflection

ROOT = Path(__file__).parents[2]
OUT = ROOT / "reports" / "out"
THESIS = ROOT / "reports" / "thesis"
#: Solves that building the guide may make for the comparison with the thesis.
FEW_SOLVES = 8
#: Kinds of random scenes that are solved fast; the others bend, wrinkle or have a tip.
QUICK = ("pressure", "punch")
#: Reports beside the one on the thesis.
OTHERS = ("accuracy", "stability", "locating", "design")


LOADS: dict[str, dict[str, Any]] = {
    "a pressure": {"kind": "dead"},
    "a follower pressure": {"kind": "follower"},
    "a stuck punch": {"kind": "rigid", "contact": "stuck"},
}


class Markdown(NamedTuple):
    """A text that notebooks show."""

    text: str

    def _repr_markdown_(self) -> str:
        return self.text


class Agreement(NamedTuple):
    """A number of ours beside the same number of a source."""

    what: str
    source: str
    ours: float
    theirs: float

    @property
    def difference(self) -> float:
        """Relative difference."""
        return self.ours / self.theirs - 1.0


def table(heads: Iterable[str], rows: Iterable[Iterable[object]]) -> Markdown:
    """A table that notebooks show."""
    heads = list(heads)
    lines = [heads, ["---"] * len(heads), *([str(cell) for cell in row] for row in rows)]
    return Markdown("\n".join(f"| {' | '.join(line)} |" for line in lines))


def agreement_table(rows: Iterable[Agreement]) -> Markdown:
    """A line for each number, with the relative difference."""
    heads = "compared", "with", "ours", "theirs", "difference"
    return table(
        heads,
        (
            [r.what, r.source, f"{r.ours:.6g}", f"{r.theirs:.6g}", f"{r.difference:+.1e}"]
            for r in rows
        ),
    )


def other_codes(tolerance: float) -> Iterator[Agreement]:
    """Charges beside those of two other codes that agree to 1e-7, as the tests have them."""
    # not an import statement, since tests have no types
    dead = import_module("tests.validation.test_agreement").DEAD
    for name, (scene, charges, _) in dead.items():
        found = solve(scene.with_(**{"numerics.tolerance": tolerance})).charges_pC
        for electrode, theirs in charges.items():
            yield Agreement(f"{name}, {electrode} (pC)", "two codes", found[electrode], theirs)


def exact_solutions(tolerance: float = 1e-4) -> Iterator[Agreement]:
    """Deflections and frequencies beside closed forms and problems in one dimension."""
    film = Scene().film
    a, h, rho = film.radius, film.thickness, film.density
    N0, fine = float(film.stress_at_rest[0]) * h, Scene().with_(**{"numerics.tolerance": tolerance})
    yield _tight(fine)
    for kind, load in LOADS.items():
        yield _in_one_dimension(fine, kind, load)
    drum = disc_frequencies(4, radius=a, tension=N0, areal_density=rho * h)
    names = "j01", "j11", "j11", "j21"
    for name, ours, theirs in zip(names, modes(fine, 4).frequencies_Hz, drum, strict=True):
        yield Agreement(f"frequency {name} (Hz)", "zeros of Bessel functions", ours, theirs)


def _tight(fine: Scene) -> Agreement:
    """The deflection of a tight film under a disc off its centre."""
    place, force, tension = np.array([12.0, -8.0]), 1e-3, 1e3
    probe = {"shape": "circle", "radius_mm": 5.0, "x_mm": 12.0, "y_mm": -8.0}
    scene = fine.with_(film={"pretension_N_m": tension}, probe=probe, load={"force_N": force})
    exact_mm = 1e3 * linear_patch_deflection(
        place, centre=place, patch_radius=5.0, film_radius=45.0, force=force, tension=tension
    )
    ours_mm = float(solve(scene).at(*place).deflection_mm)
    return Agreement("deflection, tight film (mm)", "Green's function", ours_mm, float(exact_mm))


def _in_one_dimension(fine: Scene, kind: str, load: dict[str, Any]) -> Agreement:
    """The deflection under a disc of 5 mm at the centre, 1 N."""
    film = fine.film
    stiffness = float(film.youngs_modulus_GPa) * 1e9 * film.thickness  # type: ignore[arg-type]
    pretension = float(film.stress_at_rest[0]) * film.thickness / stiffness
    exact = axisymmetric_membrane(
        1.0 / (stiffness * film.radius),
        poisson_ratio=film.poisson_ratio,
        patch_radius=5.0 / 45.0,
        pretension=pretension,
        **load,
    )
    scene = fine.with_(probe={"shape": "circle", "radius_mm": 5.0}, load={**load, "force_N": 1.0})
    ours_mm, theirs_mm = solve(scene).deflection_max_mm, 1e3 * film.radius * exact.centre_deflection
    return Agreement(f"deflection under {kind} (mm)", "one dimension", ours_mm, theirs_mm)


def stated_and_true(seed: int = 1, count: int = 3) -> Markdown:
    """Stated errors of random scenes beside the differences from solves that are finer."""
    rows = []
    for scene in (scene for kind in QUICK for scene in drawn_scenes(kind, count, seed)):
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
    report = Report.load(THESIS / "report.toml", kinds_of(THESIS / "special.py"))
    inputs, needed = report.plan.needs()
    item, scenes, _ = next(asked for asked in needed if asked.item.name == "charges")
    where = "all printed charges, from the solves of `./run report`"
    store = OUT / STORE
    with Store(store) if store.is_file() else nullcontext() as kept:
        if len(planned(scenes, kept).blocks) > FEW_SOLVES:
            few = inputs.data["charges"]
            rows = [i for i, text in enumerate(few.frame.source) if text == "Table 3.4"]
            inputs = replace(inputs, data={"charges": few.taken(rows)})
            scenes = item.kind.scenes(inputs)
            where = "Table 3.4 only, solved for this page; `./run report` compares all charges"
        records = solve_all(scenes, kept, processes=1)
    solved = Solved(dict(zip(scenes, records, strict=True)))
    return where, item.kind.compose(inputs, solved).frame


def long_runs() -> Markdown:
    """Verdicts of the reports that were made here."""
    lines = []
    for name in OTHERS:
        file = OUT / name / "verdict.txt"
        told = file.read_text("utf-8") if file.is_file() else "not made here"
        lines.append(f"- `./run report {name}`: {told.strip()}")
    return Markdown("\n".join(lines))

"""Estimates of effects that a solve leaves out, beside what these effects change.

    python -m reports.stated_effects [--seed N] [--scenes N] [--only EFFECT] [--processes N]

Draws scenes for each effect, reads its size in `Solution.left_out`, and solves with and without it
on one mesh. Bending of films with a layer on one side is held against an axisymmetric solution.
Prints the estimate over the largest change of a charge, and which scenes have it below 1/3 or above
30; returns 1 if one does. 100 scenes of each effect take half an hour of one core.
"""

from __future__ import annotations

import argparse
import math
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from joblib import Parallel, delayed

from pvdf_fem import Scene, SceneError, solve
from pvdf_fem.arrays import Array
from pvdf_fem.charges.forces import goal_gradients
from pvdf_fem.charges.goals import goals_of
from pvdf_fem.charges.thickness import thickness_remarks
from pvdf_fem.cli.program import ArgumentParser, run_program
from pvdf_fem.derivatives.adjoint import factorised
from pvdf_fem.film.electric.coupling import Coupling, coupled
from pvdf_fem.film.loads.heat import heat_remarks
from pvdf_fem.solution.solution import Solution
from pvdf_fem.solvers.status import Status
from reports.common.options import add_processes, number_of
from reports.reference.laminated_disc import LaminatedDisc, Ply
from reports.robustness.scenes import log_uniform
from reports.robustness.usual_scenes import (
    SEED,
    draw_film,
    draw_odd_electrodes,
    draw_probe,
    draw_squares,
)

#: Least and largest ratio of an estimate to the effect.
LEAST, MOST = 1.0 / 3.0, 30.0
#: Changes of a charge below this part of it are the solver's own.
NOISE = 1e-6

Random = np.random.Generator
Tables = dict[str, Any]
STUCK: Tables = {"load.kind": "rigid", "load.contact": "stuck"}
KINDS: tuple[Tables, ...] = ({}, {"load.kind": "follower"}, {"load.kind": "rigid"}, STUCK)
#: Estimate, effect, and whether it is above what a solve leaves; None of a scene without a result.
Pair = tuple[float, float, bool] | None


@dataclass(frozen=True)
class Effect:
    """How scenes without an effect are drawn, and what it does to one."""

    draw: Callable[[Random], Tables]
    compare: Callable[[Scene], Pair]


def drawn(random: Random, effect: Effect) -> Scene:
    """A scene of usual proportions, drawn again until it is a valid one."""
    while True:
        film = draw_film(random)
        probe = draw_probe(random, film["film.radius_mm"])
        electrodes = (draw_squares, draw_odd_electrodes)[int(random.integers(2))](random, probe)
        tables = {
            **film,
            **KINDS[int(random.integers(len(KINDS)))],
            "film.thickness_um": log_uniform(random, 6.0, 200.0),
            "load.force_N": log_uniform(random, 0.05, 5.0),
            "probe": probe,
            "electrodes": electrodes,
            "numerics.tolerance": 3e-3,
        }
        try:
            return Scene().with_(**{**tables, **effect.draw(random)})
        except SceneError:
            continue


def said(solution: Solution, begins: str) -> float | None:
    """The size in the text of `left_out` that begins so; None where there is none."""
    texts = [text for text in solution.left_out if text.startswith(begins)]
    if not texts:
        return None
    sizes = re.findall(r"(?:up to|about) (-?[\d.]+(?:e[+-]?\d+)?)( %)?", texts[0])
    size, percent = sizes[-1]
    return float(size) / (100.0 if percent else 1.0)


def changes(scene: Scene, without: Tables) -> tuple[Solution, Array, Array] | None:
    """The solution without an effect, what it adds to the charges, and these without cancellation,
    in pC; None where one of both has no result."""
    full = solve(scene)
    if full.status is not Status.CONVERGED:
        return None
    order = full.fields.equilibrium.space.order
    bare = solve(scene.with_(**without), mesh=full.mesh, order=order)
    if bare.status is not Status.CONVERGED:
        return None
    charges, more = (np.array(list(s.charges_pC.values())) for s in (bare, full))
    film = scene.film
    parts = 1e12 * np.abs(bare.fields.forces.values) @ np.abs([film.d31, film.d32])
    return bare, more - charges, np.maximum(np.abs(charges), 0.05 * parts)


def relative(begins: str, without: Tables, noise: float) -> Callable[[Scene], Pair]:
    """Compare an estimate of the part of a charge."""

    def compare(scene: Scene) -> Pair:
        found = changes(scene, without)
        estimate = said(found[0], begins) if found else None
        if found is None or estimate is None:
            return None
        effect = float(np.abs(found[1] / found[2]).max())
        return estimate, effect, effect > noise

    return compare


def absolute(begins: str, without: Tables) -> Callable[[Scene], Pair]:
    """Compare an estimate in pC."""

    def compare(scene: Scene) -> Pair:
        remarks = (*thickness_remarks(scene), *heat_remarks(scene))
        if not any(text.startswith(begins) for _, text in remarks):
            return None
        found = changes(scene, without)
        estimate = said(found[0], begins) if found else None
        if found is None or estimate is None:
            return None
        effect = float(np.abs(found[1]).max())
        return abs(estimate), effect, effect > NOISE * found[2].max()

    return compare


# ---------------------------------------------------------------------------------- the effects


def _patches(random: Random, radius_mm: float = 20.0) -> Tables:
    """Two layers anywhere, in every third film."""
    if random.random() > 1.0 / 3.0:
        return {}
    places = random.uniform(-radius_mm, radius_mm, (2, 2)).tolist()
    return {"film.patches": [{"x_mm": x, "y_mm": y, **_layer(random)} for x, y in places]}


def _layer(random: Random) -> Tables:
    return {
        "shape": "circle",
        "radius_mm": log_uniform(random, 1.0, 8.0),
        "thickness_um": log_uniform(random, 5.0, 80.0),
        "youngs_modulus_GPa": log_uniform(random, 0.1, 10.0),
        "poisson_ratio": 0.3,
    }


_PYRO: Tables = {"film.pyroelectric_uC_m2K": 25.0}


def _coupling(random: Random) -> Tables:
    coefficients = random.uniform(3.0, 30.0, 2).tolist()
    changed: Tables = dict(zip(("film.d31_pC_N", "film.d32_pC_N"), coefficients, strict=True))
    changed["readout.kind"] = "voltage"
    if random.random() < 0.5:
        changed["readout.cable_capacitance_pF"] = log_uniform(random, 1.0, 300.0)
    return {**changed, "film.coupling": True, **_patches(random)}


def _bending(random: Random) -> Tables:
    return {"film.bending": True, "numerics.tolerance": 1e-3}


def _warming(random: Random) -> Tables:
    return {"film.warming_K": float(random.uniform(-10.0, 10.0)), **_PYRO, **_patches(random)}


def _touch_heat(random: Random) -> Tables:
    seconds = log_uniform(random, 0.3, 100.0)
    heat = {"probe.temperature_K": log_uniform(random, 1.0, 30.0), "probe.contact_time_s": seconds}
    return {**heat, **_PYRO, "numerics.tolerance": 3e-2}


def _across(random: Random) -> Tables:
    return {"film.d33_pC_N": -15.0, **_patches(random)}


def _layered(random: Random) -> Tables:
    """A layer, a probe and an electrode that a disc's axisymmetric solution knows."""
    layer = {**_layer(random), "x_mm": 0.0, "y_mm": 0.0}
    if random.random() < 0.3:
        layer["bonded"] = "before stretching"
    electrodes = []
    for name, angle in zip("ABC", (0.0, 2.1, 4.2), strict=True):
        r = float(random.uniform(2.0, 15.0))
        place = {"x_mm": r * math.cos(angle), "y_mm": r * math.sin(angle)}
        radius = float(random.uniform(0.5, 0.8 * min(r, 5.0)))
        electrodes.append({"name": name, "shape": "circle", "radius_mm": radius, **place})
    return {
        "film.youngs_modulus_GPa": log_uniform(random, 1.0, 6.0),
        "film.patches": [layer],
        "probe": {"shape": "circle", "radius_mm": log_uniform(random, 1.0, 10.0)},
        "load.kind": "dead",
        "electrodes": electrodes,
    }


def _bent_layer(scene: Scene) -> Pair:
    """The estimate for a film with a layer beside the larger change of both sides of the film."""
    estimate, d = said(solve(scene), "bending"), (scene.film.d31, scene.film.d32)
    sides = [_laminated(scene, side) for side in (1.0, -1.0)]
    flat = sides[0].as_membrane().charges(*d)
    effects = [np.abs(disc.charges(*d) / flat - 1.0).max() for disc in sides]
    return None if estimate is None else (estimate, max(effects), max(effects) > 1e-4)


def _laminated(scene: Scene, side: float) -> LaminatedDisc:
    film, (layer,), (probe,) = scene.film, scene.film.layers.values(), scene.loaded_probes
    height = side * 0.5 * (film.thickness + layer.patch.thickness)
    rest, above = float(film.strain_at_rest[0]), float(layer.strain_at_rest[0])
    plies = (
        Ply(film.stiffness[:2, :2], film.thickness, 0.0, rest, film.radius),
        Ply(layer.stiffness[:2, :2], layer.patch.thickness, height, above, _radius(layer.patch)),
    )
    electrodes = [
        [math.hypot(x, y), math.atan2(y, x), _radius(e)]
        for e in scene.electrode_list
        for x, y in [e.outline.centroid]
    ]
    return LaminatedDisc(plies, _radius(probe), scene.load.force_N, np.array(electrodes))


def _radius(shape: Any) -> float:
    return float(np.sqrt(shape.outline.area / np.pi))


def _pressed_and_open(random: Random) -> Tables:
    return {**_coupling(random), "film.d33_pC_N": -15.0}


def _voltage_across(scene: Scene) -> Pair:
    """What the charge by d33 does on electrodes without amplifiers, to first order."""
    whole = solve(scene)
    estimate = said(whole, "coupling by the charge of film.d33")
    short = scene.with_(**{"film.coupling": False})
    found = changes(short, {"film.d33_pC_N": None}) if estimate else None
    if estimate is None or found is None:
        return None
    equilibrium, q, factors = factorised(found[0])
    state, total = equilibrium.state(q), np.zeros(len(found[1]))
    rates = goal_gradients(goals_of(found[0].scene), equilibrium.membrane, state.dofs)
    for i, electrode in enumerate(coupled(scene)):
        volts = 1e-12 * found[1][i] / electrode.capacitance
        slope = Coupling(electrode, equilibrium.space).slope(state)
        moved = factors.solve(equilibrium.on_unknowns(state, volts * slope))
        total -= 1e12 * equilibrium.on_unknowns(state, rates).T @ moved
        total[i] += np.trace(electrode.share) * found[1][i]
    effect = float(np.abs(total).max())
    return estimate, effect, effect > 0.0


_UNHEATED = {"film.pyroelectric_uC_m2K": None}
EFFECTS = {
    "bending": Effect(_bending, relative("bending", {"film.bending": False}, 1e-4)),
    "bending of a layer on one side": Effect(_layered, _bent_layer),
    "coupling": Effect(_coupling, relative("coupling", {"film.coupling": False}, NOISE)),
    "coupling by d33": Effect(_pressed_and_open, _voltage_across),
    "thickness direction": Effect(_across, absolute("thickness", {"film.d33_pC_N": None})),
    "pyroelectricity, film": Effect(_warming, absolute("pyro", _UNHEATED)),
    "pyroelectricity, touch": Effect(_touch_heat, absolute("pyro", _UNHEATED)),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Solve, compare and print; returns 1 if an estimate is wrong."""
    options = _options(arguments)
    return run_program("reports.stated_effects", lambda: _report(options))


def _report(options: argparse.Namespace) -> int:
    wrong = 0
    print(f"{'effect':<32}{'scenes':>7}{'told':>6}{'least':>7}{'median':>7}{'most':>7}  wrong")
    for name in options.only or EFFECTS:
        pairs = compared(name, options.seed, options.scenes, options.processes)
        ratios = [estimate / effect for estimate, effect, tells in pairs.values() if tells]
        numbers = [n for n, (a, b, tells) in pairs.items() if tells and not LEAST <= a / b <= MOST]
        spread = np.quantile(ratios or [np.nan], [0.0, 0.5, 1.0])
        print(
            f"{name:<32}{len(pairs):7d}{len(ratios):6d}",
            "".join(f"{ratio:7.2f}" for ratio in spread),
            f" {len(numbers)} {numbers or ''}",
            sep="",
            flush=True,
        )
        wrong += len(numbers)
    return int(wrong > 0)


def compared(
    name: str, seed: int, count: int, processes: int = 1
) -> dict[int, tuple[float, float, bool]]:
    """Estimate and effect, by the number that draws the scene, of as many scenes that have both."""
    pairs: dict[int, tuple[float, float, bool]] = {}
    first = 0
    with Parallel(processes) as parallel:
        while len(pairs) < count and first < 20 * count:
            numbers = range(first, first + count)
            found = parallel(delayed(_pair)(name, seed, number) for number in numbers)
            pairs |= {n: pair for n, pair in zip(numbers, found, strict=True) if pair}
            first += count
    return dict(list(pairs.items())[:count])


def _pair(name: str, seed: int, number: int) -> Pair:
    effect = EFFECTS[name]
    return effect.compare(drawn(np.random.default_rng([seed, number]), effect))


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = ArgumentParser(prog="reports.stated_effects", description="Estimates beside effects.")
    parser.add_argument("--seed", type=number_of("seed", 10**9), default=SEED, metavar="N")
    parser.add_argument(
        "--scenes",
        type=number_of("scenes", 100_000),
        default=100,
        metavar="N",
        help="scenes of each effect that have a result (default: 100)",
    )
    parser.add_argument("--only", action="append", choices=EFFECTS, help="this effect alone")
    add_processes(parser)
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())

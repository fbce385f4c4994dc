"""Changes of charges by a small further force about a solution, by frequency or by time.

Both kinds share the solution that they start from, the channels of the readout, and the effects
that they neglect.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from pvdf_fem.dynamics.air import SOUND_SPEED
from pvdf_fem.dynamics.modes import describe_missing_air
from pvdf_fem.electrodes.channel import Channel, make_channels
from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.arguments import SceneLike, as_scene
from pvdf_fem.scene.scene_file import SceneError
from pvdf_fem.solver.adaptive import solve_problem
from pvdf_fem.solver.solution import Solution
from pvdf_fem.summary import Summary, TabularResult, TextTable


class ChargeChanges(TabularResult):
    """Changes of charges and readings against a solution, by frequency or by time."""

    neglected: tuple[str, ...]

    def summary(self) -> Summary:
        """Return the range, the first and the last rows, and the neglected effects."""
        columns = {k: column for k, column in self.columns().items() if "error" not in k}
        name = next(iter(columns))
        values = columns[name]
        span = f"{name} {values.min():g} to {values.max():g}" if values.size else "none"
        table = TextTable.from_columns(columns)
        notes = [f"neglected: {text}" for text in self.neglected]
        return Summary("changes by the force", [span], tables=[table], notes=notes)

    def to_json(self) -> dict[str, Any]:
        """Return the columns and the neglected effects."""
        return {**super().to_json(), "neglected": list(self.neglected)}


class LoadedSolution(NamedTuple):
    """A solution with a force that can change."""

    solution: Solution
    channels: Sequence[Channel]  #: Those of the readout; empty without ``[readout]``.


def resolve_loaded_solution(solution: Solution | SceneLike) -> LoadedSolution:
    """Return a solution whose force can change, after solving a scene.

    Raises
    ------
    SceneError
        For a scene without a single probe, with a tip, or with charges that are not those of the
        stress alone.
    """
    scene = as_scene(solution)
    scene.require_no_tips("oscillations about the load")
    scene.require_plain_charges("oscillations", "warming_K", "temperature_K")
    if scene.single_probe is None:
        raise SceneError(["probe = (nothing): is required; add the probe whose force changes"])
    if not isinstance(solution, Solution):
        solution = solve_problem(Problem.from_scene(scene))
    return LoadedSolution(solution, make_channels(scene) if scene.readout is not None else ())


def label_in_pC(solution: Solution, charges: Any) -> dict[str, Any]:
    """Return charges in C, (electrodes, n), as charges in pC by electrode name."""
    names = [electrode.name for electrode in solution.scene.electrode_list]
    return dict(zip(names, 1e12 * charges, strict=True))


def describe_neglected_effects(solution: Solution) -> tuple[str, ...]:
    """Describe the effects that oscillations about a solution neglect.

    Notes
    -----
    A disc without a baffle radiates 0.03 (k a)^2 times the power with a baffle, where k is the
    wavenumber of sound (rigid disc, to leading order).
    """
    scene = solution.scene
    effects = list(solution.neglected)
    if scene.air is None:
        effects.append(describe_missing_air(scene))
    if scene.film.loss_tangent is None:
        effects.append(
            "damping by the film: resonances are too high; to include it give film.loss_tangent"
        )
    if scene.air is not None and not scene.air.baffle:
        share = 0.03 * (2e3 * np.pi * scene.film.radius / SOUND_SPEED) ** 2
        effects.append(
            f"damping by sound: {100.0 * share:.1g} % of that with air.baffle = true at 1 kHz"
        )
    return tuple(effects)

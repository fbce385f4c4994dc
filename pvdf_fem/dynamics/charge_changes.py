"""Changes of charges by a small further force about a solution."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from pvdf_fem.dynamics.air import SOUND_SPEED
from pvdf_fem.dynamics.modes import format_air_note
from pvdf_fem.electrodes.channel import Channel, make_channels
from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.arguments import SceneLike, as_scene
from pvdf_fem.scene.scene_file import SceneError
from pvdf_fem.solver.adaptive import solve_problem
from pvdf_fem.solver.solution import Solution
from pvdf_fem.summary import Summary, TabularResult, TextTable

if TYPE_CHECKING:
    pass


class ChargeChanges(TabularResult):
    """Changes of charges and readings against a solution, by frequency or by time."""

    neglected: tuple[str, ...]

    def summary(self) -> Summary:
        """The span, the first and the last rows, and what is left out."""
        (name, along), *others = self.columns().items()
        shown = {name: along} | {key: column for key, column in others if "error" not in key}
        span = f"{name} {along.min():g} to {along.max():g}" if along.size else "none"
        notes = [f"left out: {text}" for text in self.neglected]
        table = TextTable.from_columns(shown)
        return Summary("changes by the force", [span], tables=[table], notes=notes)

    def to_json(self) -> dict[str, Any]:
        """The columns, and what is left out."""
        return {**super().to_json(), "neglected": list(self.neglected)}


def resolve_loaded_solution(solution: Solution | SceneLike) -> tuple[Solution, Sequence[Channel]]:
    """The solution for a scene with a force that can change, and the readout's channels."""
    scene = as_scene(solution)
    scene.require_no_tips("oscillations about the load")
    scene.require_plain_charges("oscillations", "warming_K", "temperature_K")
    if scene.single_probe is None:
        raise SceneError(["probe = (nothing): is required; add the one whose force changes"])
    solution = (
        solution if isinstance(solution, Solution) else solve_problem(Problem.from_scene(scene))
    )
    return solution, make_channels(scene) if scene.readout is not None else ()


def label_in_pC(solution: Solution, charges: Any) -> dict[str, Any]:
    """Charges in C, (electrodes, n), by the names of the electrodes."""
    names = [electrode.name for electrode in solution.scene.electrode_list]
    return dict(zip(names, 1e12 * charges, strict=True))


def list_neglected_effects(solution: Solution) -> tuple[str, ...]:
    """What oscillations about a solution neglect. A disc without a baffle radiates 0.03 (k a)^2
    times the power with a baffle (rigid disc, to leading order)."""
    scene = solution.scene
    losses = "damping by the film: resonances are too high; to include it give film.loss_tangent"
    share = 0.03 * (2e3 * np.pi * scene.film.radius / SOUND_SPEED) ** 2
    sound = f"damping by sound: {100.0 * share:.1g} % of that with air.baffle = true at 1 kHz"
    remarks = {format_air_note(scene): scene.air is None, losses: scene.film.loss_tangent is None}
    remarks[sound] = scene.air is not None and not scene.air.baffle
    return (*solution.neglected, *(text for text, told in remarks.items() if told))

"""Changes of the charges due to a small additional force, as functions of frequency or time.

Both share this module: the solution about which the motion is linearised, the channels of the
readout, the neglected effects, and the printed summary.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from pvdf_fem.dynamics.air import SOUND_SPEED
from pvdf_fem.dynamics.modes import describe_missing_air
from pvdf_fem.dynamics.one_sided import require_pressed_backings
from pvdf_fem.electrodes.channel import Channel, make_channels
from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.arguments import SceneLike, as_scene
from pvdf_fem.scene.scene_file import SceneError
from pvdf_fem.solver.adaptive import solve_problem
from pvdf_fem.solver.solution import Solution
from pvdf_fem.summary import Summary, TabularResult, TextTable


class ChargeChanges(TabularResult):
    """Changes of charges and readings relative to a solution, by frequency or time."""

    neglected: tuple[str, ...]  #: Descriptions of the neglected effects.

    def summary(self) -> Summary:
        """Summarize the range of frequency or time and the values, without their errors."""
        columns = {}
        for key, column in self.columns().items():
            if "error" not in key:
                columns[key] = column
        name = next(iter(columns))
        values = columns[name]
        span = f"{name} {values.min():g} to {values.max():g}" if values.size else "none"
        table = TextTable.from_columns(columns)
        notes = [f"neglected: {text}" for text in self.neglected]
        return Summary("changes due to the force", [span], tables=[table], notes=notes)

    def to_json(self) -> dict[str, Any]:
        """Return the columns by name, and the neglected effects."""
        return {**super().to_json(), "neglected": list(self.neglected)}


class LoadedSolution(NamedTuple):
    """Solution about which the motion is linearised, with its readout channels."""

    solution: Solution
    channels: Sequence[Channel]  #: Channels of the readout; empty without ``[readout]``.


def resolve_loaded_solution(solution: Solution | SceneLike) -> LoadedSolution:
    """Return the solution about which the motion is linearised, and its readout channels.

    A scene is solved first. A scene about which the motion cannot be linearised raises an error.

    Parameters
    ----------
    solution : Solution, Scene, or anything that `solve` accepts as a scene
        Solution, or a scene to solve.

    Raises
    ------
    SceneError
        If the scene does not have a single probe, has a tip, has a one-sided backing that no load
        presses, or has charges that do not follow from the stress alone.
    """
    scene = as_scene(solution)
    scene.require_no_tips("oscillations about the load")
    require_pressed_backings(scene)
    scene.require_plain_charges("oscillations", "warming_K", "temperature_K")
    if scene.single_probe is None:
        raise SceneError(["probe: is required; add the [probe] whose force changes"])
    if not isinstance(solution, Solution):
        solution = solve_problem(Problem.from_scene(scene))
    return LoadedSolution(solution, make_channels(scene) if scene.readout is not None else ())


def label_charges_pC(solution: Solution, charges: Any) -> dict[str, Any]:
    """Convert charges from C to pC, and return them by the name of the electrode.

    Parameters
    ----------
    solution : Solution
        Solution with the electrodes.
    charges : ndarray, shape (electrodes, n)
        Charges in C, which may be complex.
    """
    names = [electrode.name for electrode in solution.scene.electrode_list]
    return dict(zip(names, 1e12 * charges, strict=True))


def describe_neglected_effects(solution: Solution) -> tuple[str, ...]:
    """Describe the effects that a solution and the linearised motion about it neglect.

    For the motion these are the mass of air, the damping by the film and the damping by sound.

    Notes
    -----
    A disc of radius a without a baffle radiates about 0.03 (k a)^2 times the power that it radiates
    in a baffle, where k is the wavenumber of sound (rigid disc, leading order in k a).
    """
    scene = solution.scene
    effects = list(solution.neglected)
    if scene.air is None:
        effects.append(describe_missing_air(scene))
    if scene.film.loss_tangent is None:
        effects.append(
            "damping by the film: resonant amplitudes are too large; to include it, set"
            " film.loss_tangent"
        )
    if scene.air is not None and not scene.air.baffle:
        fraction = 0.03 * (2e3 * np.pi * scene.film.radius / SOUND_SPEED) ** 2
        effects.append(
            f"damping by sound: {100.0 * fraction:.1g} % of that with air.baffle = true at 1 kHz"
        )
    return tuple(effects)

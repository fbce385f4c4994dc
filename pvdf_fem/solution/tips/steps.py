"""Steps to a load in which film comes to stick to tips, and what is uncertain of that.

All loads grow together. At each step the edge of the contact, and how the film outside of it is
stretched, are iterated with what sticks. A tip that is pushed sideways moves after the last step.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from pvdf_fem.charges.forces import goal_forces
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.loads.contact import Edge
from pvdf_fem.film.loads.sticking import Sticking
from pvdf_fem.scene.outlines.tip import DiscTip
from pvdf_fem.scene.scene import Scene, Step
from pvdf_fem.solution.attempt import Attempt
from pvdf_fem.solution.solution import Solution
from pvdf_fem.solvers.status import Status

#: Steps to the load.
STEPS = 6
#: Third root of the first step's part: widths of contacts are about as the third root of the force.
FIRST = 0.25
#: Change of what sticks, over its largest value, at which a step ends.
SETTLED = 1e-2
#: Most solves of a step.
MOST_SOLVES = 4
#: Factor of what the last power of the polynomial changes, for the errors of the steps' meshes.
SAFETY = 3.0
#: Relative error of a step's charges over that of the last one.
LOOSER = 3.0


def sticks(scene: Scene) -> bool:
    """Whether film sticks to a tip, and it is not known yet how."""
    loads = (touch for touch in scene.loaded_probes if touch.load.friction == "stuck")
    return any(touch.held is None for touch in loads)


def stuck(scene: Scene, solve: Callable[[Scene], Solution]) -> Scene | Solution:
    """The scene with what sticks to its tips, or the last step if that has no solution."""
    coarse = scene.with_(**{"numerics.tolerance": min(LOOSER * scene.numerics.tolerance, 0.1)})
    touches = [touch for touch in scene.loaded_probes if touch.load.friction == "stuck"]
    known: dict[str, list[Edge]] = {touch.patch: [] for touch in touches}
    tips = {touch.patch: touch.tip for touch in touches}
    # the scene refuses others
    held = {name: Sticking(tip) for name, tip in tips.items() if isinstance(tip, DiscTip)}
    for root in np.linspace(FIRST, 1.0, scene.numerics.load_steps or STEPS):
        for _ in range(MOST_SOLVES):
            still = {name: replace(sticking, lower=None) for name, sticking in held.items()}
            solution = solve(coarse.at(Step(float(root) ** 3, 0.0, still)))
            if solution.status is not Status.CONVERGED:
                break  # too light a touch, perhaps
            edges, last = _edges(solution, held), held
            held = {name: held[name].fitted([*known[name], edges[name]]) for name in held}
            if all(held[name].change(last[name]) < SETTLED for name in held):
                break
        if solution.status is Status.CONVERGED:
            known = {name: [*known[name], edges[name]] for name in known}
    if solution.status is not Status.CONVERGED:
        return replace(solution, scene=scene)
    return scene.at(Step(held=held))


def _edges(solution: Solution, held: Mapping[str, Sticking]) -> dict[str, Edge]:
    equilibrium, state = solution.fields.solved, solution.fields.solved_state
    edges = zip(equilibrium.contacts, equilibrium.edges(state), strict=True)
    return {c.touch.patch: edge for c, edge in edges if c.touch.patch in held}


def with_errors(attempt: Attempt) -> Attempt:
    """The attempt with what a polynomial of one degree less for what sticks changes as errors."""
    problem, old, factors = attempt.problem, attempt.equilibrium, attempt.result.factors
    lower = {t.patch: t.held.lower for t in problem.scene.loaded_probes if t.held is not None}
    if factors is None or not any(lower.values()):
        return attempt
    scene = problem.scene.at(Step(held=lower))
    other = Equilibrium(scene, old.space.mesh, old.space.order, old.part)
    q = attempt.result.q
    q = q - factors.solve(other.residual(other.state(q)))
    forces = attempt.fields.forces
    found = goal_forces(problem.goals, other.membrane, other.dofs(q), other.part)
    changes = np.where(forces.errors < 0.0, -SAFETY, SAFETY) * np.abs(found - forces.values)
    forces = replace(forces, errors=forces.errors + changes)
    return replace(attempt, fields=replace(attempt.fields, forces=forces))

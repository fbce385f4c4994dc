"""Steps to a load in which film sticks to tips or slides against friction, and their errors.

All loads grow together. Where film sticks, the edge of the contact and how the film outside of it
is stretched are iterated at each step. A tip that is pushed sideways moves after the last step.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from pvdf_fem.charges.forces import charges_of, goal_forces
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.loads.contact import Edge
from pvdf_fem.film.loads.coulomb import Displacement, Untouched
from pvdf_fem.film.loads.sticking import Sticking
from pvdf_fem.scene.outlines.tip import DiscTip
from pvdf_fem.scene.scene import Scene, Step
from pvdf_fem.solution.attempt import Attempt, force_errors
from pvdf_fem.solution.solution import Solution
from pvdf_fem.solvers.ladder import equilibrate
from pvdf_fem.solvers.status import Status

#: Steps to the load.
STEPS = 6
#: The same against Coulomb's friction, where the film forgets its way.
SLIDING_STEPS = 4
#: Third root of the first step's part: widths of contacts are about as the third root of the force.
FIRST = 0.25
#: Change of what sticks, over its largest value, at which a step ends.
SETTLED = 1e-2
#: Most solves of a step.
MOST_SOLVES = 4


def takes_steps(scene: Scene) -> bool:
    """Whether film sticks to a tip or slides against friction, and the way there is unknown."""
    loads = (touch for touch in scene.loaded_probes if touch.load.friction)
    return any(touch.held is None for touch in loads)


def stepped(scene: Scene, solve: Callable[[Scene], Solution]) -> Scene | Solution:
    """The scene with what its steps left behind, or the last step if that has no solution."""
    stuck = any(touch.load.friction == "stuck" for touch in scene.loaded_probes)
    return (_stuck if stuck else _slid)(scene, solve)


def _slid(scene: Scene, solve: Callable[[Scene], Solution]) -> Scene | Solution:
    """With the displacement from which film slides in the last step."""
    rubbed = [touch.patch for touch in scene.loaded_probes if touch.load.friction]
    last: Displacement | Untouched = Untouched()
    roots = np.linspace(FIRST, 1.0, scene.numerics.load_steps or SLIDING_STEPS)
    for root in roots[:-1]:
        solution = solve(scene.at(Step(float(root) ** 3, held=dict.fromkeys(rubbed, last))))
        if solution.status is Status.CONVERGED:
            fields, others = solution.fields, 1.0 / (len(roots) - 1)
            last = Displacement(fields.solved.space, fields.solved_dofs, others)
    if isinstance(last, Displacement):
        last = replace(last, less_exact=Untouched())
    return scene.at(Step(held=dict.fromkeys(rubbed, last)))


def _stuck(scene: Scene, solve: Callable[[Scene], Solution]) -> Scene | Solution:
    touches = [touch for touch in scene.loaded_probes if touch.load.friction == "stuck"]
    known: dict[str, list[Edge]] = {touch.patch: [] for touch in touches}
    tips = {touch.patch: touch.tip for touch in touches}
    # the scene refuses others
    held = {name: Sticking(tip) for name, tip in tips.items() if isinstance(tip, DiscTip)}
    for root in np.linspace(FIRST, 1.0, scene.numerics.load_steps or STEPS):
        for _ in range(MOST_SOLVES):
            still = {name: replace(sticking, less_exact=None) for name, sticking in held.items()}
            solution = solve(scene.at(Step(float(root) ** 3, 0.0, still)))
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
    """The attempt with errors of the steps: of what is held, the change by what is less exact."""
    problem, old = attempt.problem, attempt.equilibrium
    known = {t.patch: t.held for t in problem.scene.loaded_probes if t.held is not None}
    less = {patch: held.less_exact for patch, held in known.items()}
    if attempt.status is not Status.CONVERGED or not any(less.values()):
        return attempt
    scene = problem.scene.at(Step(held=less))
    other = Equilibrium(scene, old.space.mesh, old.space.order, old.part)
    result = equilibrate(other, attempt.result.q, budget=problem.budget)
    forces = attempt.fields.forces
    found = goal_forces(problem.goals, other.membrane, other.dofs(result.q), other.part)
    share = max(held.share for held in known.values())
    changes = share * np.abs(charges_of(problem.goals, found - forces.values))
    changes[charges_of(problem.goals, forces.errors) < 0.0] *= -1.0
    changes = force_errors(changes, forces.values, problem.goals)
    forces = replace(forces, errors=forces.errors + changes)
    return replace(attempt, fields=replace(attempt.fields, forces=forces))

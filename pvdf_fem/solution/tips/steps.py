"""Steps to a load in which film sticks to tips or slides against friction, and their errors.

All loads grow together. Where film sticks, the edge of the contact and how the film outside of it
is stretched are iterated at each step. A tip that is pushed sideways moves after the last step.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.charges.forces import charges_of, force_errors, goal_forces
from pvdf_fem.film.loads.contact_edge import Edge
from pvdf_fem.film.loads.coulomb import Displacement
from pvdf_fem.film.loads.posed import Held
from pvdf_fem.film.loads.sticking import Sticking
from pvdf_fem.film.loads.touchdown import edges_of, tips_of
from pvdf_fem.scene.outlines.tip import DiscTip
from pvdf_fem.scene.scene import LoadedProbe, Scene
from pvdf_fem.solution.attempt import Attempt
from pvdf_fem.solution.solution import Solution
from pvdf_fem.solvers.ladder import equilibrate
from pvdf_fem.solvers.status import Status

#: Steps to the load.
STEPS = 6
#: The same against Coulomb's friction, where the film forgets its way.
SLIDING_STEPS = 4
#: Third root of the first step's part: widths of contacts are about as the third root of the force.
FIRST = 0.25
#: The same of the parts of a load that sticks, as a power of the part of the steps that are done.
GROWTH = 1.5
#: Tolerance of the load steps of sticking film. The error by the steps is independent of the
#: scene's tolerance, and a scene's tolerance above the error is met.
FINE = 1e-3
#: Change of what sticks, over its largest value, at which a step ends.
SETTLED = 1e-2
#: Most solves of a step.
MOST_SOLVES = 4
#: Most solves that seek where a tip has moved sideways.
MOST_SOLVES_SIDEWAYS = 15

#: Solves a scene with what its tips hold, by patch.
Solve: TypeAlias = Callable[[Scene, Mapping[str, Held]], Solution]


def stepped(scene: Scene, solve: Solve) -> Solution:
    """The solution after all steps that friction needs, or of the step that has no result."""
    frictions = [touch.load.friction for touch in _rubbed(scene)]
    if not frictions:
        return solve(scene, {})
    return (_stuck if "stuck" in frictions else _slid)(scene, solve)


def _at(scene: Scene, part: float) -> Scene:
    """The scene with a part of its forces along z, and tips that nothing pushes sideways."""
    touches = scene.loaded_probes
    return scene.loaded([replace(t, load=t.load.times(part)) for t in touches])


def _rubbed(scene: Scene) -> list[LoadedProbe]:
    return [touch for touch in scene.loaded_probes if touch.load.friction]


def _slid(scene: Scene, solve: Solve) -> Solution:
    """With the displacement from which film slides in the last step."""
    patches = [touch.patch for touch in _rubbed(scene)]
    last: Displacement | None = None
    roots = np.linspace(FIRST, 1.0, scene.numerics.load_steps or SLIDING_STEPS)
    for width in roots[:-1]:
        solution = solve(_at(scene, float(width) ** 3), dict.fromkeys(patches, last))
        if solution.status is Status.CONVERGED:
            last = _displacement(solution)
    if last is None or solution.status is not Status.CONVERGED:
        return solution
    last = replace(last, share=1.0 / (len(roots) - 1))
    solution = solve(_at(scene, 1.0), dict.fromkeys(patches, last))
    pushed = [touch for touch in _rubbed(scene) if touch.load.tangential_N]
    return _pushed(scene, pushed, solution, solve) if pushed else solution


def _displacement(solution: Solution) -> Displacement:
    return Displacement(solution.fields.solved.space, solution.fields.solved_dofs, share=0.0)


def _pushed(scene: Scene, touches: list[LoadedProbe], solution: Solution, solve: Solve) -> Solution:
    """With tips that have moved from where they are guided, until friction bears what pushes."""
    wanted: Array = np.array([touch.load.components[:2] for touch in touches])
    film, guided = scene.film, _at(scene, 1.0)
    if solution.status is not Status.CONVERGED:
        return solution
    last = _displacement(solution)

    def borne(solution: Solution) -> Array:
        return np.array([-solution.contacts[touch.patch].lateral_N for touch in touches])

    def solved(moves: Array) -> Solution:
        """With tips that have moved by these ways in m."""
        ways = dict.fromkeys((touch.patch for touch in scene.loaded_probes), np.zeros(2))
        ways |= zip((touch.patch for touch in touches), moves, strict=True)
        held = {touch.patch: replace(last, moved=ways[touch.patch]) for touch in _rubbed(scene)}
        there = [_moved(touch, ways[touch.patch]) for touch in guided.loaded_probes]
        return solve(guided.loaded(there), held)

    contacts = [solution.contacts[touch.patch] for touch in touches]
    least = min(float(t.load.friction) * c.force_N for t, c in zip(touches, contacts, strict=True))
    narrowest = 1e-3 * min(np.sqrt(c.area_mm2 / np.pi) for c in contacts)
    stiffness = np.eye(wanted.size) * film.stiffness.max() * film.thickness
    lacking = (borne(solution) - wanted).ravel()
    moves = np.zeros(wanted.shape)
    for solves in range(MOST_SOLVES_SIDEWAYS):
        step = -np.linalg.solve(stiffness, lacking)
        moves = moves + step.reshape(moves.shape)
        if np.hypot(*moves.T).max() > narrowest:
            break
        solution = solved(moves)
        if solution.status is not Status.CONVERGED:
            return solution
        lacking = (borne(solution) - wanted).ravel()
        if np.linalg.norm(lacking) < scene.numerics.tolerance * least:
            return solution
        if solves:  # Broyden's update after a full step
            stiffness += np.outer(lacking, step) / (step @ step)
    return replace(solution, status=Status.SLIDES, reason=Status.SLIDES.advice)


def _moved(touch: LoadedProbe, way: Array) -> LoadedProbe:
    """A probe that has moved by a way in m, (2,)."""
    probe = touch.probe
    x_mm, y_mm = (1e3 * way + [probe.x_mm, probe.y_mm]).tolist()
    return replace(touch, probe=probe.model_copy(update={"x_mm": x_mm, "y_mm": y_mm}))


def _stuck(scene: Scene, solve: Solve) -> Solution:
    fine = scene.numerics.model_copy(update={"tolerance": FINE})
    stepping = scene.model_copy(update={"numerics": fine})
    touches = [touch for touch in _rubbed(scene) if touch.load.friction == "stuck"]
    known: dict[str, list[Edge]] = {touch.patch: [] for touch in touches}
    tips = {touch.patch: touch.tip for touch in touches}
    # the scene refuses others
    held = {name: Sticking(tip) for name, tip in tips.items() if isinstance(tip, DiscTip)}
    count = scene.numerics.load_steps or STEPS
    for width in (np.arange(1, count + 1) / count) ** GROWTH:
        for _ in range(MOST_SOLVES):
            still = {name: replace(sticking, less_exact=None) for name, sticking in held.items()}
            solution = solve(_at(stepping, float(width) ** 3), still)
            if solution.status is not Status.CONVERGED:
                break  # too light a touch, perhaps
            edges, last = _edges(solution, held), held
            held = {name: held[name].fitted([*known[name], edges[name]]) for name in held}
            if all(held[name].change(last[name]) < SETTLED for name in held):
                break
        if solution.status is Status.CONVERGED:
            known = {name: [*known[name], edges[name]] for name in known}
    return solve(scene, held) if solution.status is Status.CONVERGED else solution


def _edges(solution: Solution, held: Mapping[str, Sticking]) -> dict[str, Edge]:
    equilibrium, state = solution.fields.solved, solution.fields.solved_state
    edges = zip(tips_of(equilibrium), edges_of(equilibrium, state), strict=True)
    return {c.touch.patch: edge for c, edge in edges if c.touch.patch in held}


def with_errors(attempt: Attempt) -> Attempt:
    """The attempt with errors of the steps: of what is held, the change by what is less exact."""
    problem, known = attempt.problem, attempt.problem.posed.held
    share = max((held.share for held in known.values() if held), default=0.0)
    if attempt.status is not Status.CONVERGED or not share:
        return attempt
    less = {patch: held and held.less_exact for patch, held in known.items()}
    other = attempt.equilibrium.with_(posed=replace(problem.posed, held=less))
    result = equilibrate(other, attempt.result.q, budget=problem.budget)
    forces = attempt.fields.forces
    found = goal_forces(problem.goals, other.membrane, other.dofs(result.q), other.part)
    changes = share * np.abs(charges_of(problem.goals, found - forces.values))
    changes[charges_of(problem.goals, forces.errors) < 0.0] *= -1.0
    changes = force_errors(changes, forces.values, problem.goals)
    forces = replace(forces, errors=forces.errors + changes)
    return replace(attempt, fields=replace(attempt.fields, forces=forces))

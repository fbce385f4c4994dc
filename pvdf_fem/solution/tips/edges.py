"""Edges of contacts with tips: where a mesh should have them, and what it changes that they are not
there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.sparse.linalg import SuperLU

from pvdf_fem.arrays import Array
from pvdf_fem.charges.forces import charges_of, force_errors, goal_gradients
from pvdf_fem.charges.goals import Goal
from pvdf_fem.film.loads.contact_edge import LARGEST, PENETRATION
from pvdf_fem.film.loads.contact_guess import faces, first_contacts
from pvdf_fem.film.loads.touchdown import edges_of, overlap_at, tips_of
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solution.fields import Fields
from pvdf_fem.solvers.status import Status

#: A mesh whose edge of a contact has more than this part of the overlap before is not moved again.
NEARER = 0.5
#: Edges with charge errors below this part of the tolerance are not moved again.
MATTERS = 0.1
#: Reach of a contact over the film's radius from which a tip meets the clamped rim.
NEAR_RIM = 0.99


def outlines_of(scene: Scene, fields: Fields | None = None) -> dict[str, Outline]:
    """Where the film leaves the tips, by patch name: as guessed, or as a solution found."""
    if fields is None:
        return first_contacts(scene) | faces(scene)
    tips, x = tips_of(fields.solved), fields.solved_dofs
    pairs = zip(tips, fields.edges, strict=True)
    outlines = {contact.touch.patch: edge.fitted for contact, edge in pairs}
    return outlines | {k: v for contact in tips for k, v in contact.face(x).items()}


def with_edges(fields: Fields) -> Fields:
    """The fields with the edges of their contacts."""
    return replace(fields, edges=edges_of(fields.solved, fields.solved_state))


def errors_by_edges(fields: Fields, factors: SuperLU, goals: Sequence[Goal]) -> Array:
    """Errors of the forces (goals, 2) by edges that are not where they should be, from the
    tangent's factors."""
    equilibrium, state = fields.solved, fields.solved_state
    gradients = goal_gradients(goals, equilibrium.membrane, state.dofs)
    duals = factors.solve(equilibrium.on_unknowns(state, gradients), "T")
    by_dof = np.stack([equilibrium.step(state, dual) for dual in duals.T], axis=-1)
    errors = np.sum([edge.errors(by_dof) for edge in fields.edges], axis=0)
    return force_errors(errors, fields.forces.values, goals)


def status_of(
    fields: Fields, moved: Fields | None, factors: SuperLU, goals: Sequence[Goal], sizes: Array
) -> Status | None:
    """The status of a solution whose edges are elsewhere than in the mesh; None where that is good
    enough.

    Edges move at first, and after they `moved` while that still takes away a good part of an error
    that matters of charges of these `sizes` in C, (goals,).
    """
    scene, edges = fields.solved.scene, fields.edges
    if any(edge.fitted.reach > NEAR_RIM * scene.film.radius for edge in edges):
        return Status.RIM
    overlap = overlap_at(fields.solved, fields.solved_dofs, edges)
    if moved is not None and PENETRATION < overlap <= LARGEST:
        errors = charges_of(goals, errors_by_edges(fields, factors, goals)) / sizes
        matters = np.abs(errors).max(initial=0.0) > MATTERS * scene.numerics.tolerance
        before = overlap_at(moved.solved, moved.solved_dofs, moved.edges)
        return Status.MISPLACED if matters and overlap < NEARER * before else None
    return Status.MISPLACED if overlap > PENETRATION else None

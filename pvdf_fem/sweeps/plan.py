"""Which solves a set of scenes needs: one for all scenes whose films deform alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pvdf_fem.scene.scene import Scene
from pvdf_fem.sweeps.equivalence import mechanics

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Block:
    """Scenes that one solve serves.

    Attributes
    ----------
    indices : tuple of int
        Which scenes of the plan.
    frames : (n, 2, 2)
        For each of them, the orthogonal matrix from its axes to those of the first.
    """

    indices: tuple[int, ...]
    frames: Array


@dataclass(frozen=True, eq=False)
class Plan:
    """What there is to do for some scenes.

    Attributes
    ----------
    scenes : sequence of Scene
    first : (n,) int
        For each scene the first one that equals it.
    stored : frozenset of int
        The distinct scenes that need no solve.
    blocks : tuple of Block
        The solves that the others need.
    steps : (int, int, int)
        How many solves would be needed if only electrodes and piezoelectric coefficients were
        known not to touch the film; turns and mirror images too; thickness and force too.
    """

    scenes: Sequence[Scene]
    first: NDArray[np.int64]
    stored: frozenset[int]
    blocks: tuple[Block, ...]
    steps: tuple[int, int, int]

    @property
    def missing(self) -> int:
        """Number of distinct scenes that are to be solved."""
        return sum(len(block.indices) for block in self.blocks)

    def __str__(self) -> str:
        distinct = self.missing + len(self.stored)
        given, turned, scaled = self.steps
        rows = [
            (len(self.scenes), "scenes"),
            (distinct, "different ones") if distinct < len(self.scenes) else None,
            (self.missing, "not in the store") if self.stored else None,
            (given, "films to deform: electrodes and d31, d32 only read the stress"),
            (turned, "after turns and mirror images") if turned < given else None,
            (scaled, "after force over thickness: a membrane knows no other size")
            if scaled < turned
            else None,
            (len(self.blocks), "solves"),
        ]
        return "\n".join(f"{row[0]:>8} {row[1]}" for row in rows if row)


def plan(scenes: Sequence[Scene], stored: Sequence[bool] | None = None) -> Plan:
    """The plan for scenes, of which some may be `stored` already, in order of their first scene."""
    position: dict[Scene, int] = {}
    first = np.array([position.setdefault(scene, i) for i, scene in enumerate(scenes)], int)
    known = frozenset(i for i in position.values() if stored is not None and stored[i])
    given, turned = set(), set()
    groups: dict[str, tuple[list[int], list[Array]]] = {}
    for scene, index in position.items():
        if index in known:
            continue
        found = mechanics(scene)
        given.add(found.given)
        turned.add(found.turned)
        indices, frames = groups.setdefault(found.scaled, ([], []))
        indices.append(index)
        frames.append(found.frame)
    blocks = tuple(
        Block(tuple(indices), _relative(np.array(frames))) for indices, frames in groups.values()
    )
    return Plan(scenes, first, known, blocks, (len(given), len(turned), len(blocks)))


def _relative(frames: Array) -> Array:
    """Frames with respect to the first, quarter turns and mirror images exact."""
    relative = frames[0].T @ frames
    exact = np.round(relative)
    near = np.isclose(relative, exact, rtol=0.0, atol=1e-12).all(axis=(1, 2), keepdims=True)
    return np.where(near, exact + 0.0, relative)

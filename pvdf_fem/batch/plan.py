"""Plan of solves for scenes: scenes with equally deforming films share a solve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pvdf_fem.arrays import Array
from pvdf_fem.film.loads.profiles import pin_profile_files
from pvdf_fem.problem.equivalence import compute_mechanical_key
from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class Block:
    """Scenes that one solve serves."""

    compute_mechanical_key: str  #: What the solve depends on.
    indices: tuple[int, ...]  #: The scenes' indices in the plan.
    #: Orthogonal matrices from the scenes' axes to the first scene's axes, (n, 2, 2).
    frames: Array


@dataclass(frozen=True, eq=False)
class SweepPlan:
    """The solves that scenes need; ``print`` shows it."""

    scenes: Sequence[Scene]
    first: NDArray[np.int64]  #: For each scene the index of the first one that equals it, (n,).
    stored: frozenset[int]  #: Indices of the distinct scenes that need no solve.
    blocks: tuple[Block, ...]  #: The solves that the other distinct scenes need.

    @property
    def missing(self) -> int:
        """Number of distinct scenes to solve."""
        return sum(len(block.indices) for block in self.blocks)

    def scenes_of(self, block: int) -> list[Scene]:
        """The scenes of a block."""
        return [self.scenes[i] for i in self.blocks[block].indices]

    def __str__(self) -> str:
        distinct = self.missing + len(self.stored)
        rows = [
            (True, len(self.scenes), "scenes"),
            (distinct < len(self.scenes), distinct, "different ones"),
            (self.stored, self.missing, "not in the store"),
            (True, len(self.blocks), "solves: one for all scenes whose films deform alike"),
        ]
        return "\n".join(f"{count:>8} {text}" for shown, count, text in rows if shown)


def plan_solves(scenes: Sequence[Scene], stored: Sequence[bool] | None = None) -> SweepPlan:
    """The plan for scenes, its blocks in the order of their first scenes. Scenes need no solve
    where `stored` says that their records are known."""
    scenes, index_of = pin_profile_files(scenes), dict[Scene, int]()
    first = np.array([index_of.setdefault(scene, i) for i, scene in enumerate(scenes)], int)
    known = frozenset(i for i in index_of.values() if stored is not None and stored[i])
    alike: dict[str, tuple[list[int], list[Array]]] = {}
    for scene, index in index_of.items():
        if index in known:
            continue
        text, frame = compute_mechanical_key(Problem.from_scene(scene))
        indices, frames = alike.setdefault(text, ([], []))
        indices.append(index)
        frames.append(frame)
    blocks = tuple(
        Block(text, tuple(indices), _relative(np.array(frames)))
        for text, (indices, frames) in alike.items()
    )
    return SweepPlan(scenes, first, known, blocks)


def _relative(frames: Array) -> Array:
    """Frames with respect to the first, quarter turns and mirror images exact."""
    relative = frames[0].T @ frames
    exact = np.round(relative)
    near = np.isclose(relative, exact, rtol=0.0, atol=1e-12).all(axis=(1, 2), keepdims=True)
    return np.where(near, exact + 0.0, relative)

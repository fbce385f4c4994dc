"""The plan of many solves: scenes whose films have the same deformation share a solve."""

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
    """Scenes whose films have the same deformation up to a rotation or reflection."""

    mechanical_key: str  #: Text that is equal for all scenes with this deformation.
    indices: tuple[int, ...]  #: The scenes' indices in the plan.
    #: Orthogonal matrices from the scenes' axes to the first scene's axes, (n, 2, 2).
    frames: Array


@dataclass(frozen=True, eq=False)
class SweepPlan:
    """The solves that scenes need; ``print`` shows the numbers of scenes and solves."""

    scenes: Sequence[Scene]  #: All scenes; names of profile files are paths with digests.
    first: NDArray[np.int64]  #: For each scene the index of the first one that equals it, (n,).
    stored: frozenset[int]  #: Indices of the distinct scenes that have a stored record.
    blocks: tuple[Block, ...]  #: The other distinct scenes, by the solve that they share.

    @property
    def missing(self) -> int:
        """Number of distinct scenes to solve."""
        return sum(len(block.indices) for block in self.blocks)

    def scenes_of(self, block: int) -> list[Scene]:
        """Return the distinct scenes of the block with this index in `blocks`."""
        return [self.scenes[i] for i in self.blocks[block].indices]

    def __str__(self) -> str:
        """Return a line for each number: of scenes, distinct ones, missing ones and solves."""
        distinct = self.missing + len(self.stored)
        rows = [(len(self.scenes), "scenes")]
        if distinct < len(self.scenes):
            rows.append((distinct, "different ones"))
        if self.stored:
            rows.append((self.missing, "not in the store"))
        rows.append((len(self.blocks), "solves: one for all scenes whose films deform alike"))
        return "\n".join(f"{count:>8} {text}" for count, text in rows)


def plan_solves(scenes: Sequence[Scene], is_stored: Sequence[bool] | None = None) -> SweepPlan:
    """Group the distinct scenes without a stored record into blocks that share a solve.

    Parameters
    ----------
    scenes : sequence of Scene
        Scenes to solve; some may be equal.
    is_stored : sequence of bool, optional
        Whether each scene has a stored record; by default none has.

    Returns
    -------
    SweepPlan
        The blocks are in the order of their first scenes.

    Raises
    ------
    SceneError
        If a profile file cannot be used, or if a scene without a record has charges from effects
        other than stress.
    """
    scenes = pin_profile_files(scenes)
    first_index: dict[Scene, int] = {}
    first = [first_index.setdefault(scene, i) for i, scene in enumerate(scenes)]
    stored: set[int] = set()
    if is_stored is not None:
        stored = {index for index in first_index.values() if is_stored[index]}
    indices: dict[str, list[int]] = {}
    frames: dict[str, list[Array]] = {}
    for scene, index in first_index.items():
        if index in stored:
            continue
        key = compute_mechanical_key(Problem.from_scene(scene))
        indices.setdefault(key.text, []).append(index)
        frames.setdefault(key.text, []).append(key.frame)
    blocks = []
    for text, members in indices.items():
        relative = _compute_relative_frames(np.array(frames[text]))
        blocks.append(Block(text, tuple(members), frames=relative))
    return SweepPlan(
        scenes, np.array(first, dtype=int), stored=frozenset(stored), blocks=tuple(blocks)
    )


def _compute_relative_frames(frames: Array) -> Array:
    """Return matrices from the axes of each scene to those of the first, shape (n, 2, 2).

    `frames` are matrices from the scenes' axes to common axes. Entries of quarter turns and of
    reflections at the axes are rounded to -1, 0 and 1.
    """
    relative = frames[0].T @ frames
    exact = np.round(relative)
    is_close = np.isclose(relative, exact, rtol=0.0, atol=1e-12)
    is_exact = is_close.all(axis=(1, 2), keepdims=True)
    exact = exact + 0.0  # turns -0 into 0
    return np.where(is_exact, exact, relative)

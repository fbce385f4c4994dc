"""A membrane PVDF tactile sensor: charges of its electrodes under a probe, by finite elements."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pvdf_fem.scene import Scene, SceneError

if TYPE_CHECKING:
    from pvdf_fem.solution import NotConvergedError, Solution, solve

__all__ = ["NotConvergedError", "Scene", "SceneError", "Solution", "solve"]
__version__ = "0.1.0"


def __getattr__(name: str) -> Any:
    # gmsh, scikit-fem and scipy take a second to import; reading scenes does without them.
    if name in __all__:
        from pvdf_fem import solution

        return getattr(solution, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

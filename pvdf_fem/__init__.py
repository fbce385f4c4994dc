"""A membrane PVDF tactile sensor: charges of its electrodes under a probe, by finite elements."""

from __future__ import annotations

from importlib import import_module

TYPE_CHECKING = False  # as in `typing`, whose import is as slow as Python's own start
if TYPE_CHECKING:
    from typing import Any

    from pvdf_fem.scene import Scene, SceneError
    from pvdf_fem.solution import NotConvergedError, Solution, solve

__all__ = ["NotConvergedError", "Scene", "SceneError", "Solution", "solve"]
__version__ = "0.1.0"


def __getattr__(name: str) -> Any:
    # What is asked for is imported then: the command line's help waits for nothing, and reading
    # scenes does without gmsh, scikit-fem and scipy.
    if name in __all__:
        module = "scene" if name.startswith("Scene") else "solution"
        return getattr(import_module(f"pvdf_fem.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

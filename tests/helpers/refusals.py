"""What refusals name: a key with its value in each complaint, not how the complaint is worded."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from pvdf_fem import Scene, SceneError


def refused(make: Callable[..., Any], *arguments: Any, **named: Any) -> list[str]:
    """The ``key = value`` of each complaint of the `SceneError` that a call raises."""
    with pytest.raises(SceneError) as caught:
        make(*arguments, **named)
    return [problem.partition(": ")[0] for problem in caught.value.problems]


def refused_text(text: str) -> list[str]:
    """What the refusal of a scene file's text names."""
    return refused(Scene.parse, text)


def keys(complaints: list[str]) -> list[str]:
    """The keys alone."""
    return [complaint.partition(" = ")[0] for complaint in complaints]


def scene_or_mistakes(tables: dict[str, Any]) -> Scene | tuple[str, ...]:
    """The scene of some tables, or the complaints of its refusal."""
    try:
        return Scene(**tables)
    except SceneError as error:
        return error.problems

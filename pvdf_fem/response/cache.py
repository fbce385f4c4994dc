"""The name under which a response is kept in a file, so that a stale one is never loaded."""

from __future__ import annotations

import hashlib

from pvdf_fem.response.model import Domain
from pvdf_fem.scene.scene import Scene
from pvdf_fem.sweeps.store import NUMERICAL_FOLDERS, key


def response_key(scene: Scene, domain: Domain) -> str:
    """Hash of all that a response depends on: scene, domain, and the code that builds it."""
    folders = (*NUMERICAL_FOLDERS, "response")
    text = f"{key(scene, folders)} {domain.reach_mm} {domain.force_N}"
    return hashlib.sha256(text.encode()).hexdigest()

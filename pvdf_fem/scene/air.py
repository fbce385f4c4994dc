"""The table ``[air]`` of a scene."""

from __future__ import annotations

from typing import Annotated

from pvdf_fem.scene.keys import Key, Section


class Air(Section):
    """The air on both sides of the film."""

    density_kg_m3: Annotated[float, Key("kg/m³", (0.0, 1e5))] = 1.204
    """Density of the air."""
    baffle: Annotated[bool, Key()] = True
    """true: the rim is set in an infinite rigid wall. false: air flows around the rim."""

"""A probe together with the load that it exerts on the film."""

from __future__ import annotations

from dataclasses import dataclass

from pvdf_fem.scene.load import Load
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.outlines.tip import Tip, make_tip
from pvdf_fem.scene.placed.probe import Probe


@dataclass(frozen=True)
class LoadedProbe:
    """A probe of a scene with its load.

    Parameters
    ----------
    key : str
        Key of the probe in the scene file: ``probe``, or ``probe[0]`` in a list.
    patch : str
        Name of its subdomain in a mesh: ``probe``, or ``probe 1`` for ``probe[0]``.
    probe : Probe
        The shape with its position.
    load : Load
        The scene's load with the keys that the probe overrides.
    """

    key: str
    patch: str
    probe: Probe
    load: Load

    @property
    def outline(self) -> Outline:
        """Outline of the probe in m."""
        return self.probe.outline

    @property
    def tip(self) -> Tip:
        """The probe as a rigid tip; raises `ValueError` if it cannot be one (see `make_tip`)."""
        return make_tip(self.probe.outline, self.probe.rounding_mm)

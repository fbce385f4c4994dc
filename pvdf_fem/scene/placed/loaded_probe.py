"""A probe together with the load that acts on it."""

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
        Its key in the scene file, ``probe`` or ``probe[0]``.
    patch : str
        Its name in a mesh, ``probe`` or ``probe 1``.
    probe : Probe
        The probe.
    load : Load
        The load that acts on it, resolved from its own and the scene's keys.
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
        """The probe as a rigid tip; raises `ValueError` for a probe with a sharp edge."""
        return make_tip(self.probe.outline, self.probe.rounding_mm)

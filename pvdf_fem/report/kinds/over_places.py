"""Common parts of kinds that map charges over the film."""

from __future__ import annotations

import numpy as np

from pvdf_fem.report.charge_map import ChargeMap, MapPlaces, choose_pitch_mm
from pvdf_fem.report.kind import ElectrodeKind, Inputs
from pvdf_fem.report.results import NothingToShowError, ReportResults
from pvdf_fem.scene.keys import Length
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import SceneError, format_error
from pvdf_fem.surrogate.touch_domain import choose_default_reach_mm

PREVIEW = 1.5  #: Pitch of a preview over the pitch.
MOST_RINGS = 40  #: Of a map: some 5000 places.


class Mapped(ElectrodeKind):
    """Keys for a map: places within `reach_mm` of the film's centre, `pitch_mm` apart."""

    reach_mm: Length | None = None
    pitch_mm: Length | None = None

    def places(self, scene: Scene, inputs: Inputs) -> MapPlaces:
        """Places in a scene's map."""
        reach = choose_default_reach_mm(scene) if self.reach_mm is None else self.reach_mm
        pitch = (self.pitch_mm or choose_pitch_mm(scene)) * (PREVIEW if inputs.quick else 1.0)
        if reach > MOST_RINGS * pitch:
            reason = f"makes more than {MOST_RINGS} rings of places; give a longer one"
            raise SceneError([format_error("pitch_mm", pitch, reason)])
        return MapPlaces(scene, reach, pitch)

    def charge_map(self, places: MapPlaces, solved: ReportResults) -> ChargeMap:
        """The map of total charges; raises `NothingToShowError` without enough of them."""
        names = [electrode.name for electrode in places.scene.electrode_list]
        try:
            return ChargeMap.of(places, solved.charges(places.scenes, names, "total"))
        except (ValueError, np.linalg.LinAlgError) as error:
            raise NothingToShowError(str(error)) from None

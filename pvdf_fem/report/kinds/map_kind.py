"""The common part of kinds that map charges over the film."""

from __future__ import annotations

import numpy as np

from pvdf_fem.report.charge_map import ChargeMap, MapPlaces, choose_pitch_mm
from pvdf_fem.report.kind import ElectrodeKind, Inputs
from pvdf_fem.report.results import NothingToShowError, ReportResults
from pvdf_fem.scene.keys import Length
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import SceneError, format_error
from pvdf_fem.surrogate.touch_domain import choose_default_reach_mm

PREVIEW_PITCH = 1.5  #: Distance of places in a preview over the distance in a full map.
MAX_RINGS = 40  #: Largest number of rings of a map: about 5000 places.


class MapKind(ElectrodeKind):
    """Keys of a map: places within `reach_mm` of the film's centre, `pitch_mm` apart."""

    reach_mm: Length | None = None
    pitch_mm: Length | None = None

    def choose_places(self, scene: Scene, inputs: Inputs) -> MapPlaces:
        """Return the places of the probe for the map of a scene."""
        reach_mm = choose_default_reach_mm(scene) if self.reach_mm is None else self.reach_mm
        pitch_mm = choose_pitch_mm(scene) if self.pitch_mm is None else self.pitch_mm
        if inputs.quick:
            pitch_mm *= PREVIEW_PITCH
        if reach_mm > MAX_RINGS * pitch_mm:
            reason = f"makes more than {MAX_RINGS} rings of places; give a longer one"
            raise SceneError([format_error("pitch_mm", pitch_mm, reason)])
        return MapPlaces(scene, reach_mm, pitch_mm)

    def fit_map(self, places: MapPlaces, results: ReportResults) -> ChargeMap:
        """Return the map of total charges; `NothingToShowError` where too many are missing."""
        names = [electrode.name for electrode in places.scene.electrode_list]
        charges = results.get_charges(places.scenes, names, "total")
        try:
            return ChargeMap.fit(places, charges)
        except (ValueError, np.linalg.LinAlgError) as error:
            raise NothingToShowError(str(error)) from None

"""The base class of kinds that map charges by the probe's position."""

from __future__ import annotations

import numpy as np

from pvdf_fem.report.charge_map import ChargeMap, MapPoints, choose_pitch_mm
from pvdf_fem.report.kind import ElectrodeKind, Inputs
from pvdf_fem.report.results import NothingToShowError, ReportResults
from pvdf_fem.scene.keys import Length
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import SceneError, format_error
from pvdf_fem.surrogate.touch_domain import choose_default_reach_mm

PREVIEW_PITCH = 1.5  #: Pitch of the points in a preview divided by that in a full map.
MAX_RINGS = 40  #: Maximum number of rings of a map: about 5000 points.


class MapKind(ElectrodeKind):
    """Base class with the keys of a map.

    `reach_mm` is the maximum distance of the probe from the film's centre, `pitch_mm` the maximum
    distance between neighbouring points.
    """

    reach_mm: Length | None = None
    pitch_mm: Length | None = None

    def choose_map_points(self, scene: Scene, inputs: Inputs) -> MapPoints:
        """Choose the points at which the charges of a scene's map are solved.

        Raises
        ------
        SceneError
            If the map would have more than `MAX_RINGS` rings.
        """
        reach_mm = choose_default_reach_mm(scene) if self.reach_mm is None else self.reach_mm
        pitch_mm = choose_pitch_mm(scene) if self.pitch_mm is None else self.pitch_mm
        if inputs.quick:
            pitch_mm *= PREVIEW_PITCH
        if reach_mm > MAX_RINGS * pitch_mm:
            reason = f"gives more than {MAX_RINGS} rings of points; use a larger pitch"
            raise SceneError([format_error("pitch_mm", pitch_mm, reason)])
        return MapPoints(scene, reach_mm, pitch_mm)

    def fit_map(self, points: MapPoints, results: ReportResults) -> ChargeMap:
        """Fit the map of total charges to the solved charges.

        Parameters
        ----------
        points : MapPoints
            Scene and points of the map.
        results : ReportResults
            Charges by scene.

        Raises
        ------
        NothingToShowError
            If too many of the scenes have no charges.
        """
        names = [electrode.name for electrode in points.scene.electrode_list]
        charges = results.get_charges(points.scenes, names, "total")
        try:
            return ChargeMap.fit(points, charges)
        except (ValueError, np.linalg.LinAlgError) as error:
            raise NothingToShowError(str(error)) from None

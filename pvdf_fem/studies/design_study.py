"""The designs of a study: scenes over a grid of keys, grouped by the response that they share."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

from pvdf_fem.inverse.touch.validation import as_float
from pvdf_fem.scene.changes import normalize_key, parse_key
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import SceneError, format_error
from pvdf_fem.studies.request_errors import find_noise_and_response_errors
from pvdf_fem.studies.scene_grid import SceneGrid
from pvdf_fem.surrogate.response_key import make_mechanical_key
from pvdf_fem.surrogate.touch_domain import TOUCH_SCENE_KEYS, Domain, TouchColumn

#: Keys of the probe's position, which a design cannot vary.
POSITION_KEYS = TOUCH_SCENE_KEYS[: TouchColumn.ROTATION]
#: Dimensions of the grid of positions at which a design is assessed.
POSITION_DIMS = ("y_mm", "x_mm")


class ResponseGroup(NamedTuple):
    """Designs whose films deform in the same way, so that they share a response."""

    scene: Scene  #: Scene that the response is built for.
    indices: list[int]  #: Indices of the designs in `DesignStudy.scenes`.


@dataclass(frozen=True, eq=False)
class DesignStudy:
    """Scenes of the designs; ``print`` shows the numbers of designs and of responses."""

    grid: SceneGrid  #: Base scene and the keys that vary.
    scenes: Sequence[Scene]  #: Scenes of the designs in the order of the grid.
    groups: Sequence[ResponseGroup]  #: Every design is in one of these groups.
    #: Readout keys whose values by electrode are replaced by their defaults, since the designs have
    #: different electrodes.
    dropped: Sequence[str] = ()

    @classmethod
    def from_scene(cls, scene: Scene, vary: Mapping[str, Any]) -> Self:
        """Make the designs with all combinations of the values of some keys.

        The stage of the scene is removed. Readout values by electrode are replaced by their
        defaults if the names of the electrodes vary.

        Parameters
        ----------
        scene : Scene
            Base design, with the probe and the force.
        vary : mapping of str to sequence
            Keys of the scene with their values.

        Raises
        ------
        SceneError
            If keys or values are wrong, or a scene cannot have a response; the exception lists the
            errors.
        """
        errors = []
        for key in vary:
            if normalize_key(key) in POSITION_KEYS:
                reason = "cannot vary, since touches are at all positions in the reach; remove it"
                errors.append(format_error(key, vary[key], reason))
        if errors:
            raise SceneError(errors)
        tables = _make_axis_tables(vary)
        scene, dropped = _reset_readout_values(scene.with_(stage=None, calibration=None), tables)
        grid = _make_grid(scene, tables)
        scenes = grid.scenes()
        try:
            groups = _group_scenes(scene, scenes)
        except ValueError as error:
            raise SceneError([str(error)]) from None
        return cls(grid, scenes, groups, dropped)

    def __str__(self) -> str:
        """Return the numbers of designs and responses, and the readout keys that are reset."""
        lines = [
            f"{len(self.scenes):>8} designs",
            f"{len(self.groups):>8} responses, one for all films that deform in the same way",
        ]
        reason = "has a value for each electrode; its default is used for the designs"
        lines += [f"{key}: {reason}" for key in self.dropped]
        return "\n".join(lines)

    def find_errors(
        self, domain: Domain, step_mm: float, tolerance: float, sigma: float, noise_pC: float | None
    ) -> Iterator[str]:
        """Yield error messages about the positions, the noise, the forces and the responses.

        A message may be yielded several times, once for each design.

        Parameters
        ----------
        domain : Domain
            Reach and forces of the responses.
        step_mm : float
            Distance between neighbouring positions.
        tolerance : float
            Maximum error bound of the responses.
        sigma : float
            Relative standard deviation of the readings.
        noise_pC : float, optional
            Absolute standard deviation of the readings in pC.
        """
        lowest_N, highest_N = domain.force_N
        if not 0.0 < as_float(step_mm) <= domain.reach_mm:
            limit = f"must be above 0 and at most the reach, {domain.reach_mm:g} mm"
            yield f"step_mm = {step_mm}: {limit}"
        if not sigma and not noise_pC:
            reason = "must be positive, since readings have noise"
            yield f"sigma = {sigma}: {reason}; give sigma or noise_pC"
        for scene in self.scenes:
            force_N = scene.load.force_N
            if not lowest_N <= force_N <= highest_N:
                limits = f"{lowest_N:g} to {highest_N:g} N"
                reason = f"must be within the forces of the response, {limits}; change either"
                yield f"load.force_N = {force_N:g}: {reason}"
            yield from find_noise_and_response_errors(scene, domain, tolerance, sigma, noise_pC)


def _make_axis_tables(vary: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Make the table of an axis for each key that varies.

    The name of an axis is the last part of its key, or the whole key if another key has the same
    last part or if it is the name of one of `POSITION_DIMS`.
    """
    last_parts = {key: key.rpartition(".")[2] for key in vary}
    counts = Counter([*last_parts.values(), *POSITION_DIMS])
    tables = []
    for key, last_part in last_parts.items():
        name = last_part if counts[last_part] == 1 else key
        tables.append({"name": name, key: vary[key]})
    return tables


def _make_grid(scene: Scene, tables: Sequence[Mapping[str, Any]]) -> SceneGrid:
    """Make the grid of designs; without tables of axes the base scene is the only design."""
    return SceneGrid.from_tables(scene, tables) if tables else SceneGrid(scene, ())


def _group_scenes(scene: Scene, scenes: Sequence[Scene]) -> list[ResponseGroup]:
    """Group designs whose films deform in the same way, that is with equal mechanical keys.

    The response of a group is built for its first design. If the base scene has the mechanical key
    of the group, it is built for the base scene instead, whose response may already be cached.

    Parameters
    ----------
    scene : Scene
        Base scene.
    scenes : sequence of Scene
        Scenes of the designs.

    Raises
    ------
    ValueError
        If there can be no response of a scene, see `make_mechanical_key`.
    """
    indices_by_key: dict[str, list[int]] = {}
    for index, design in enumerate(scenes):
        indices_by_key.setdefault(make_mechanical_key(design), []).append(index)
    base_key = make_mechanical_key(scene)
    groups = []
    for key, indices in indices_by_key.items():
        first = scene if key == base_key else scenes[indices[0]]
        groups.append(ResponseGroup(first, indices))
    return groups


def _reset_readout_values(
    scene: Scene, tables: Sequence[Mapping[str, Any]]
) -> tuple[Scene, Sequence[str]]:
    """Replace readout values by electrode by their defaults if the names of the electrodes vary.

    Parameters
    ----------
    scene : Scene
        Base scene.
    tables : sequence of mapping
        Tables of the axes.

    Returns
    -------
    scene : Scene
        Copy of the base scene with the defaults, or the base scene itself if nothing is replaced.
    dropped : sequence of str
        Readout keys whose values are replaced; empty if nothing is replaced.
    """
    varied_sections = set()  # such as `electrodes` for the key `electrodes.count`
    for table in tables:
        varied_sections |= {parse_key(key)[0] for key in table}
    readout = scene.readout
    if readout is None or "electrodes" not in varied_sections:
        return scene, ()
    defaults = {}
    for name, field in type(readout).model_fields.items():
        if isinstance(getattr(readout, name), Mapping):
            defaults[f"readout.{name}"] = field.default
    if not defaults:
        return scene, ()
    changed = scene.with_(**defaults)
    names = set()
    for design in (scene, *_make_grid(changed, tables).scenes()):
        names.add(tuple(electrode.name for electrode in design.electrode_list))
    if len(names) == 1:
        return scene, ()
    return changed, list(defaults)

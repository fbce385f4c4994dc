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

#: Keys of the probe's place, which no design sets.
PLACE_KEYS = TOUCH_SCENE_KEYS[: TouchColumn.ROTATION]
#: Dimensions of the places at which a design is assessed.
PLACE_DIMS = ("y_mm", "x_mm")


class ResponseGroup(NamedTuple):
    """Designs whose films deform alike, so that they share a response."""

    scene: Scene  #: The scene that the response is built for.
    indices: list[int]  #: Indices of the designs.


@dataclass(frozen=True, eq=False)
class DesignStudy:
    """Scenes of the designs; ``print`` shows how many there are."""

    grid: SceneGrid
    scenes: Sequence[Scene]  #: In the order of the grid.
    groups: Sequence[ResponseGroup]
    #: Readout keys with values by electrode, which have their defaults because the designs have
    #: different electrodes.
    dropped: Sequence[str] = ()

    @classmethod
    def from_scene(cls, scene: Scene, vary: Mapping[str, Any]) -> Self:
        """Make all combinations of values of the scene's keys.

        Parameters
        ----------
        scene : Scene
            The sensor, its probe and force.
        vary : mapping of str to sequence
            Keys of the scene with their values.

        Raises
        ------
        SceneError
            If keys or values are wrong, with all errors.
        """
        errors = []
        for key in vary:
            if normalize_key(key) in PLACE_KEYS:
                reason = "is at every place of the reach anyhow; remove it"
                errors.append(format_error(key, vary[key], reason))
        if errors:
            raise SceneError(errors)
        tables = _make_axis_tables(vary)
        scene, dropped = _drop_readout_values(scene.with_(stage=None), tables)
        grid = _make_grid(scene, tables)
        scenes = grid.scenes()
        try:
            groups = _group_scenes(scene, scenes)
        except ValueError as error:
            raise SceneError([str(error)]) from None
        return cls(grid, scenes, groups, dropped)

    def __str__(self) -> str:
        lines = [
            f"{len(self.scenes):>8} designs",
            f"{len(self.groups):>8} models of the charges: one for all films that deform alike",
        ]
        reason = "has values by electrode; designs with other electrodes have its default"
        lines += [f"{key}: {reason}" for key in self.dropped]
        return "\n".join(lines)

    def find_errors(
        self, domain: Domain, step_mm: float, tolerance: float, sigma: float, noise_pC: float | None
    ) -> Iterator[str]:
        """Find errors in places, noise, forces and scenes.

        Parameters
        ----------
        domain : Domain
            Reach and forces of the responses.
        step_mm : float
            Distance of neighbouring places.
        tolerance : float
            Error bound of the responses.
        sigma : float
            Relative standard deviation of a reading.
        noise_pC : float, optional
            Absolute standard deviation of a reading in pC.
        """
        lowest_N, highest_N = domain.force_N
        if not 0.0 < as_float(step_mm) <= domain.reach_mm:
            limit = f"must be above 0 and at most the reach, {domain.reach_mm:g} mm"
            yield f"step_mm = {step_mm}: {limit}"
        if not sigma and not noise_pC:
            yield f"sigma = {sigma}: readings have errors; give a positive one, or noise_pC"
        for scene in self.scenes:
            force_N = scene.load.force_N
            if not lowest_N <= force_N <= highest_N:
                limits = f"{lowest_N:g} to {highest_N:g} N"
                yield f"load.force_N = {force_N:g}: is out of the response's {limits}; change one"
            yield from find_noise_and_response_errors(scene, domain, tolerance, sigma, noise_pC)


def _make_axis_tables(vary: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Make the table of an axis for each key, named by its last part where that is unique."""
    last_parts = {key: key.rpartition(".")[2] for key in vary}
    counts = Counter([*last_parts.values(), *PLACE_DIMS])
    tables = []
    for key, last_part in last_parts.items():
        name = last_part if counts[last_part] == 1 else key
        tables.append({"name": name, key: vary[key]})
    return tables


def _make_grid(scene: Scene, tables: Sequence[Mapping[str, Any]]) -> SceneGrid:
    """Make the grid of designs; without axes the scene is the only one."""
    return SceneGrid.from_tables(scene, tables) if tables else SceneGrid(scene, ())


def _group_scenes(scene: Scene, scenes: Sequence[Scene]) -> list[ResponseGroup]:
    """Group scenes by their mechanical key.

    The response of a group is built for its first scene, but for the base scene if that is among
    them, as its response serves further purposes.
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


def _drop_readout_values(
    scene: Scene, tables: Sequence[Mapping[str, Any]]
) -> tuple[Scene, Sequence[str]]:
    """Replace readout values by electrode by their defaults, and return these keys.

    Nothing is replaced where every design has the scene's electrode names.
    """
    tables_of_keys = set()
    for table in tables:
        tables_of_keys |= {parse_key(key)[0] for key in table}
    readout = scene.readout
    if readout is None or "electrodes" not in tables_of_keys:
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

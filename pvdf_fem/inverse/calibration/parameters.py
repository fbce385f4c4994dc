"""What a calibration seeks: parameters with start values and priors, and scenes that have them.

A prior is a normal distribution about the scene's value. The prior decides parameters that the
readings leave undetermined, and hardly moves parameters that the readings determine better.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.changes import get_number
from pvdf_fem.scene.readout import Readout
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import suggest
from pvdf_fem.solver.sensitivity.parameters import (
    COEFFICIENTS,
    PRETENSION,
    expand_pair_key,
    list_parameters,
    prescribe_pretension,
)

GAIN = "gain."
OFFSET = "offset."
READOUT_KEYS = {"gain": "gain", "offset": "offset_V"}
SHIFT = ("stage.x_mm", "stage.y_mm")
TURN = "stage.rotation_deg"
#: Relative standard deviations of priors; other film parameters have the one of ``film``.
RELATIVE_PRIORS = {"gain": 0.1, PRETENSION: 0.3, "film": 0.2}
#: Standard deviations of priors in mm, degrees and V.
ABSOLUTE_PRIORS = {"stage.x_mm": 1.0, "stage.y_mm": 1.0, TURN: 3.0, "offset": 0.1}


@dataclass(frozen=True, eq=False)
class CalibrationParameters:
    """Parameters that are sought."""

    scene: Scene  #: Which has the other parameters.
    names: tuple[str, ...]  #: Of all parameters.
    #: Start values, which are the priors' means, and the priors' deviations, (parameters,).
    start: Array
    priors: Array

    @cached_property
    def film_keys(self) -> tuple[str, ...]:
        """Those that change the film's stress."""
        return tuple(n for n in self.names if n.startswith("film.") and n not in COEFFICIENTS)

    @cached_property
    def film(self) -> Indices:
        """Where these are."""
        return np.array([self.names.index(key) for key in self.film_keys], dtype=np.int64)

    def value(self, key: str, values: Array) -> Array:
        """One parameter (...) among `values` (..., parameters), or the scene's if not sought."""
        if key in self.names:
            return values[..., self.names.index(key)]
        return np.full(values.shape[:-1], read_parameter(self.scene, key))

    def scene_at(self, values: Array, reading: str | None = None) -> Scene:
        """The scene with the parameters, and with a reading if one is given."""
        changes: dict[str, Any] = {"readout.reading": reading} if reading else {}
        readout = self.scene.readout or Readout()
        for name, value in zip(self.names, map(float, values), strict=True):
            kind, _, channel = name.partition(".")
            if key := READOUT_KEYS.get(kind):
                table = {e.name: readout.of(key, e.name) for e in self.scene.electrode_list}
                changes.setdefault(f"readout.{key}", table)[channel] = value
            else:
                changes[name] = value
        return self.scene.with_(**changes)


def read_parameter(scene: Scene, key: str) -> float:
    """The scene's value of a parameter."""
    section, _, name = key.partition(".")
    if section in READOUT_KEYS:
        return float((scene.readout or Readout()).of(READOUT_KEYS[section], name))
    return get_number(scene if scene.stage else scene.with_(stage={}), key)


def select_parameters(
    scene: Scene, words: Sequence[str], priors: Mapping[str, float]
) -> CalibrationParameters:
    """The parameters that words name, of which some stand for several, with their priors. Raises
    ValueError with a line for each mistake."""
    if any(word.startswith(PRETENSION) for word in words):
        scene = prescribe_pretension(scene)
    known, names, mistakes = _known(scene), [], []
    for word in words:
        if word in known:
            names += known[word]
        else:
            mistakes.append(f"unknown {word[:60]}: {suggest(word, list(known))}")
    if not words:
        mistakes.append(f"unknown: nothing is sought; choose from {', '.join(known)}")
    given = {name: sd for word, sd in priors.items() for name in known.get(word, ())}
    for word, sd in priors.items():
        if word not in known:
            mistakes.append(f"prior {word[:60]}: {suggest(word, list(known))}")
        elif not set(known[word]) & set(names):
            mistakes.append(f"prior {word}: is not sought; add it to the unknown ones")
        elif not 0.0 < sd < np.inf:
            mistakes.append(f"prior {word} = {sd:g}: give a positive standard deviation")
    volts = [scene.readout and scene.readout.of("kind", e.name) for e in scene.electrode_list]
    if "voltage" in volts and "film.thickness_um" in names:
        reason = 'changes the capacitance of a channel of kind "voltage", too; seek gains instead'
        mistakes.append(f"unknown film.thickness_um: {reason}")
    if mistakes:
        raise ValueError("\n".join(mistakes))
    names = list(dict.fromkeys(names))
    start = np.array([read_parameter(scene, name) for name in names])
    deviations = [_prior(name, value, given) for name, value in zip(names, start, strict=True)]
    return CalibrationParameters(scene, tuple(names), start, np.array(deviations))


def _prior(name: str, value: float, given: Mapping[str, float]) -> float:
    kind = name.split(".")[0]
    kind = kind if kind in READOUT_KEYS else name
    if kind in ABSOLUTE_PRIORS:
        return given.get(name, ABSOLUTE_PRIORS[kind])
    share = RELATIVE_PRIORS.get(kind.removesuffix(".0").removesuffix(".1"), RELATIVE_PRIORS["film"])
    return given.get(name, share) * (abs(value) or 1.0)


def _known(scene: Scene) -> dict[str, list[str]]:
    """The parameters that each word names."""
    electrodes = [electrode.name for electrode in scene.electrode_list]
    film = [key for key in list_parameters(Problem.from_scene(scene)) if key.startswith("film.")]
    groups = {
        "gains": [f"{GAIN}{name}" for name in electrodes],
        "offsets": [f"{OFFSET}{name}" for name in electrodes],
        "shift": list(SHIFT),
        "turn": [TURN],
    }
    groups |= {key[:-2]: expand_pair_key(key[:-2], film) for key in film if key.endswith(".0")}
    single = [*film, *groups["gains"], *groups["offsets"], *SHIFT, TURN]
    return {**groups, **{name: [name] for name in single}}

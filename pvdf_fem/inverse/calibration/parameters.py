"""Unknown parameters of a calibration, with their priors, and scenes that have their values.

The prior of a parameter is a normal distribution about the scene's value. It decides parameters
that the readings leave undetermined, and hardly moves parameters that the readings determine
better.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
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
    """Unknown parameters of a calibration, in the units of their names."""

    scene: Scene  #: Has the values of all other parameters.
    names: tuple[str, ...]
    initial: Array  #: The scene's values, which are the means of the priors, (parameters,).
    prior_deviations: Array  #: Standard deviations of the priors, (parameters,).

    def __len__(self) -> int:
        return len(self.names)

    @cached_property
    def film_keys(self) -> tuple[str, ...]:
        """Keys of the parameters that change the film's stress."""
        return tuple(n for n in self.names if n.startswith("film.") and n not in COEFFICIENTS)

    @cached_property
    def film_indices(self) -> Indices:
        """Indices of the parameters that change the film's stress."""
        return np.array([self.names.index(key) for key in self.film_keys], dtype=np.int64)

    def extract(self, key: str, values: Array) -> Array:
        """Return one parameter, or the scene's value if it is not unknown.

        Parameters
        ----------
        key : str
            Name of the parameter.
        values : array, (..., parameters)
            Values of the unknown parameters.

        Returns
        -------
        array, (...)
        """
        if key in self.names:
            return values[..., self.names.index(key)]
        return np.full(values.shape[:-1], get_parameter(self.scene, key))

    def apply(self, values: Array, reading: str | None = None) -> Scene:
        """Return the scene with values of the parameters, (parameters,), and another reading."""
        changes: dict[str, Any] = {}
        if reading is not None:
            changes["readout.reading"] = reading
        readout = self.scene.readout or Readout()
        electrodes = [electrode.name for electrode in self.scene.electrode_list]
        for name, value in zip(self.names, values.tolist(), strict=True):
            section, _, channel = name.partition(".")
            if section not in READOUT_KEYS:
                changes[name] = value
                continue
            key = READOUT_KEYS[section]
            if f"readout.{key}" not in changes:
                by_electrode = {
                    electrode: readout.get_value(key, electrode) for electrode in electrodes
                }
                changes[f"readout.{key}"] = by_electrode
            changes[f"readout.{key}"][channel] = value
        return self.scene.with_(**changes)


def get_parameter(scene: Scene, key: str) -> float:
    """Return the scene's value of a parameter."""
    section, _, name = key.partition(".")
    if section in READOUT_KEYS:
        readout = scene.readout or Readout()
        return float(readout.get_value(READOUT_KEYS[section], name))
    return get_number(scene if scene.stage else scene.with_(stage={}), key)


def select_parameters(
    scene: Scene, words: Sequence[str], priors: Mapping[str, float]
) -> CalibrationParameters:
    """Select the unknown parameters, with their priors.

    Parameters
    ----------
    scene : Scene
        The sensor, whose values are the means of the priors.
    words : sequence of str
        Names of parameters, or of groups of them such as ``gains``.
    priors : mapping of str to float
        Standard deviations of priors by the same words.

    Raises
    ------
    ValueError
        If words are unknown or deviations are not positive, with a line for each error.
    """
    if any(word.startswith(PRETENSION) for word in words):
        scene = prescribe_pretension(scene)
    groups = _list_groups(scene)
    names: list[str] = []
    for word in words:
        names += groups.get(word, [])
    names = list(dict.fromkeys(names))
    errors = [
        *_find_word_errors(words, groups),
        *_find_prior_errors(priors, groups, names),
        *_find_thickness_errors(scene, names),
    ]
    if errors:
        raise ValueError("\n".join(errors))
    deviations: dict[str, float] = {}
    for word, deviation in priors.items():
        deviations |= dict.fromkeys(groups[word], deviation)
    initial = [get_parameter(scene, name) for name in names]
    prior_deviations = []
    for name, value in zip(names, initial, strict=True):
        prior_deviations.append(_compute_prior_deviation(name, value, deviations))
    return CalibrationParameters(
        scene, tuple(names), initial=np.array(initial), prior_deviations=np.array(prior_deviations)
    )


def _list_groups(scene: Scene) -> dict[str, list[str]]:
    """Return the parameters that each word names; a parameter's name stands for itself."""
    electrodes = [electrode.name for electrode in scene.electrode_list]
    film = [key for key in list_parameters(Problem.from_scene(scene)) if key.startswith("film.")]
    groups = {
        "gains": [f"{GAIN}{name}" for name in electrodes],
        "offsets": [f"{OFFSET}{name}" for name in electrodes],
        "shift": list(SHIFT),
        "turn": [TURN],
    }
    for key in film:
        if key.endswith(".0"):
            stem = key.removesuffix(".0")
            groups[stem] = expand_pair_key(stem, film)
    single = [*film, *groups["gains"], *groups["offsets"], *SHIFT, TURN]
    return {**groups, **{name: [name] for name in single}}


def _find_word_errors(words: Sequence[str], groups: Mapping[str, Sequence[str]]) -> Iterator[str]:
    """Find unknown words among the unknown parameters."""
    for word in words:
        if word not in groups:
            yield f"unknown {word[:60]}: {suggest(word, list(groups))}"
    if not words:
        yield f"unknown: no parameter; choose from {', '.join(groups)}"


def _find_prior_errors(
    priors: Mapping[str, float], groups: Mapping[str, Sequence[str]], names: Sequence[str]
) -> Iterator[str]:
    """Find priors of unknown words, of parameters that are not fitted, and without width.

    Parameters
    ----------
    priors : mapping of str to float
        Standard deviations by word.
    groups : mapping of str to sequence of str
        Parameters that each word names.
    names : sequence of str
        Parameters that are fitted.
    """
    for word, deviation in priors.items():
        if word not in groups:
            yield f"prior {word[:60]}: {suggest(word, list(groups))}"
        elif not set(groups[word]) & set(names):
            yield f"prior {word}: is not fitted; add it to the unknown parameters"
        elif not 0.0 < deviation < np.inf:
            yield f"prior {word} = {deviation:g}: give a positive standard deviation"


def _find_thickness_errors(scene: Scene, names: Sequence[str]) -> Iterator[str]:
    """Find an unknown thickness that would also change the capacitance of a channel."""
    if scene.readout is None or "film.thickness_um" not in names:
        return
    kinds = [scene.readout.get_value("kind", electrode.name) for electrode in scene.electrode_list]
    if "voltage" in kinds:
        reason = 'also changes the capacitance of a channel of kind "voltage"; fit gains instead'
        yield f"unknown film.thickness_um: {reason}"


def _compute_prior_deviation(name: str, value: float, deviations: Mapping[str, float]) -> float:
    """Return the standard deviation of a parameter's prior in the parameter's unit.

    Parameters
    ----------
    name : str
        Name of the parameter.
    value : float
        The scene's value.
    deviations : mapping of str to float
        Standard deviations by name that replace the default; relative but for `ABSOLUTE_PRIORS`.
    """
    section = name.partition(".")[0]
    kind = section if section in READOUT_KEYS else name
    if kind in ABSOLUTE_PRIORS:
        return deviations.get(name, ABSOLUTE_PRIORS[kind])
    stem = kind.removesuffix(".0").removesuffix(".1")
    share = deviations.get(name, RELATIVE_PRIORS.get(stem, RELATIVE_PRIORS["film"]))
    return share * (abs(value) if value else 1.0)

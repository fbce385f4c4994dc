"""Unknown parameters of a calibration and their priors.

The prior of a parameter is a normal distribution about the scene's value. It determines parameters
on which the readings hardly depend, and has little influence on parameters that the readings
determine more precisely.
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
STAGE_ROTATION = "stage.rotation_deg"
#: Relative standard deviations of the priors; ``film`` is for the film parameters not named here.
RELATIVE_PRIORS = {"gain": 0.1, PRETENSION: 0.3, "film": 0.2}
#: Absolute standard deviations of the priors in mm, degrees and V.
ABSOLUTE_PRIORS = {"stage.x_mm": 1.0, "stage.y_mm": 1.0, STAGE_ROTATION: 3.0, "offset": 0.1}


@dataclass(frozen=True, eq=False)
class CalibrationParameters:
    """Unknown parameters of a calibration with their priors.

    All values are in the unit at the end of the parameter's name; offsets are in V.
    """

    scene: Scene  #: Nominal scene, from which all other parameters are taken.
    names: tuple[str, ...]
    #: Means of the priors and initial guess: the scene's values, shape (parameters,).
    initial: Array
    prior_deviations: Array  #: Standard deviations of the priors, shape (parameters,).

    def __len__(self) -> int:
        return len(self.names)

    @cached_property
    def film_keys(self) -> tuple[str, ...]:
        """Keys of the parameters that change the stress of the film (not d31 and d32)."""
        keys = [name for name in self.names if name.startswith("film.")]
        return tuple(key for key in keys if key not in COEFFICIENTS)

    @cached_property
    def film_indices(self) -> Indices:
        """Indices of `film_keys` in `names`."""
        return np.array([self.names.index(key) for key in self.film_keys], dtype=np.int64)

    def extract(self, key: str, values: Array) -> Array:
        """Return the values of one parameter; if it is not an unknown, repeat the scene's value.

        Parameters
        ----------
        key : str
            Name of the parameter.
        values : ndarray, shape (..., parameters)
            Values of the unknown parameters.

        Returns
        -------
        ndarray, shape (...)
        """
        if key in self.names:
            return values[..., self.names.index(key)]
        return np.full(values.shape[:-1], get_parameter(self.scene, key))

    def apply(self, values: Array, reading: str | None = None) -> Scene:
        """Return a copy of the scene with other values of the unknown parameters.

        If a gain or an offset is unknown, the copy has a value for each electrode, with the nominal
        value for those that are not unknown.

        Parameters
        ----------
        values : ndarray, shape (parameters,)
            Values of the unknown parameters.
        reading : {"change", "total"}, optional
            Value of ``readout.reading``. Default: the scene's.
        """
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


def find_scene_key(name: str) -> str:
    """Return the key of a parameter in the scene: ``readout.gain.A`` for ``gain.A``."""
    section, dot, rest = name.partition(".")
    if section in READOUT_KEYS:
        return f"readout.{READOUT_KEYS[section]}{dot}{rest}"
    return name


def get_parameter(scene: Scene, key: str) -> float:
    """Return a parameter of a scene; without a stage or readout, its default value is returned."""
    section, _, name = key.partition(".")
    if section in READOUT_KEYS:
        readout = scene.readout or Readout()
        return float(readout.get_value(READOUT_KEYS[section], name))
    return get_number(scene if scene.stage else scene.with_(stage={}), key)


def select_parameters(
    scene: Scene, words: Sequence[str], priors: Mapping[str, float]
) -> CalibrationParameters:
    """Select the parameters that words stand for, with priors about the scene's values.

    If the pretension is one of them and the film is stretched by cooling, the scene of the result
    has a prescribed pretension in N/m instead, see `prescribe_pretension`.

    Parameters
    ----------
    scene : Scene
        Nominal sensor, whose values are the means of the priors.
    words : sequence of str
        Names of parameters, or of groups of parameters such as ``gains``.
    priors : mapping of str to float
        Standard deviations of the priors by parameter or group, relative except for the kinds
        of parameters in `ABSOLUTE_PRIORS`. A later entry for the same parameter replaces an earlier
        one. Parameters without an entry have the default.

    Raises
    ------
    ValueError
        If a word or a prior is not valid, or if the thickness is to be fitted with a channel of the
        kind "voltage"; the message has a line for each error.
    """
    if any(word.startswith(PRETENSION) for word in words):
        scene = prescribe_pretension(scene)
    groups = _list_groups(scene)
    names: list[str] = []
    for word in words:
        names += groups.get(word, [])
    names = list(dict.fromkeys(names))
    errors = [
        *_find_parameter_word_errors(words, groups),
        *_find_prior_errors(priors, groups, names),
        *_find_thickness_conflict(scene, names),
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
    """Return the parameters that each word stands for; a parameter's name stands for itself."""
    electrodes = [electrode.name for electrode in scene.electrode_list]
    film = [key for key in list_parameters(Problem.from_scene(scene)) if key.startswith("film.")]
    groups = {
        "gains": [f"{GAIN}{name}" for name in electrodes],
        "offsets": [f"{OFFSET}{name}" for name in electrodes],
        "shift": list(SHIFT),
        "turn": [STAGE_ROTATION],
    }
    for key in film:
        if key.endswith(".0"):
            stem = key.removesuffix(".0")
            groups[stem] = expand_pair_key(stem, film)
    single = [*film, *groups["gains"], *groups["offsets"], *SHIFT, STAGE_ROTATION]
    return {**groups, **{name: [name] for name in single}}


def _find_parameter_word_errors(
    words: Sequence[str], groups: Mapping[str, Sequence[str]]
) -> Iterator[str]:
    """Yield a message for each word that names no parameter or group, or if there are no words."""
    for word in words:
        if word not in groups:
            yield f"unknown {word[:60]}: {suggest(word, list(groups))}"
    if not words:
        yield f"unknown: is empty; choose from {', '.join(groups)}"


def _find_prior_errors(
    priors: Mapping[str, float], groups: Mapping[str, Sequence[str]], names: Sequence[str]
) -> Iterator[str]:
    """Yield a message for each prior with an unknown name, without a fitted parameter, or invalid.

    A standard deviation is valid if it is positive and finite.

    Parameters
    ----------
    priors : mapping of str to float
        Standard deviations by parameter or group.
    groups : mapping of str to sequence of str
        Parameters that each word stands for.
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


def _find_thickness_conflict(scene: Scene, names: Sequence[str]) -> Iterator[str]:
    """Yield a message if the thickness is to be fitted with a channel of the kind "voltage".

    The capacitance of such a channel depends on the thickness, too.
    """
    if scene.readout is None or "film.thickness_um" not in names:
        return
    kinds = [scene.readout.get_value("kind", electrode.name) for electrode in scene.electrode_list]
    if "voltage" in kinds:
        reason = 'also changes the capacitance of a channel of kind "voltage"; fit gains instead'
        yield f"unknown film.thickness_um: {reason}"


def _compute_prior_deviation(name: str, value: float, deviations: Mapping[str, float]) -> float:
    """Compute the standard deviation of the prior of a parameter, in the parameter's unit.

    Parameters
    ----------
    name : str
        Name of the parameter.
    value : float
        Value in the scene. Relative deviations are multiplied by its magnitude, or by 1 if it is 0.
    deviations : mapping of str to float
        Standard deviations by name that replace the defaults; absolute for the kinds of parameters
        in `ABSOLUTE_PRIORS`, relative for others.
    """
    section = name.partition(".")[0]
    kind = section if section in READOUT_KEYS else name
    if kind in ABSOLUTE_PRIORS:
        return deviations.get(name, ABSOLUTE_PRIORS[kind])
    stem = kind.removesuffix(".0").removesuffix(".1")
    relative = deviations.get(name, RELATIVE_PRIORS.get(stem, RELATIVE_PRIORS["film"]))
    return relative * (abs(value) if value else 1.0)

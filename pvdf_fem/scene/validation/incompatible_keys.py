"""Rules for keys of a scene that exclude each other.

Both settings of a rule are valid by themselves, but no model of the package combines them. To add
a rule, add a line to `RULES`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain
from typing import Any, NamedTuple

from pvdf_fem.scene.air import Air
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.load import Load
from pvdf_fem.scene.outlines.outline import has_overlap
from pvdf_fem.scene.placed.probe import ListedProbe, Probe, find_load_key
from pvdf_fem.scene.placed.support_keys import find_support_keys
from pvdf_fem.scene.scene_file import format_error


class SceneTables(NamedTuple):
    """The tables of a scene that the rules compare."""

    film: Film
    air: Air | None
    observable: str  #: The value of ``numerics.observable``.
    load: Load
    probes: Mapping[str, Probe]  #: By their keys, ``probe`` or ``probe[0]``.

    def get_kind(self, key: str) -> str:
        """Return the ``kind`` of the load of the probe with a key: its own or the scene's."""
        probe = self.probes[key]
        own = probe.load if isinstance(probe, ListedProbe) else None
        return (own.kind if own else None) or self.load.kind


class Occurrence(NamedTuple):
    """A key with a value by which a scene has a setting."""

    key: str
    value: Any
    probe: str = ""  #: Key of the probe that has the setting; empty for settings of the film.


@dataclass(frozen=True, eq=False)
class Setting:
    """A setting that excludes others."""

    words: str  #: The setting in messages; ``{key}`` stands for the key of the occurrence.
    find: Callable[[SceneTables], Iterable[Occurrence]]  #: Finds the setting in a scene.


@dataclass(frozen=True)
class IncompatibleKeys:
    """A rule that a scene has at most one of two settings.

    If a scene has both, the error is reported under the key of the first one.
    """

    first: Setting
    second: Setting
    reason: str
    advice: str = ""  #: By default, to change the first setting or to remove the second one.

    def find_errors(self, found: Mapping[Setting, Sequence[Occurrence]]) -> Iterator[str]:
        """Yield an error message for each pair of keys that violates the rule.

        A setting of one probe is compatible with a setting of another probe.

        Parameters
        ----------
        found : mapping of Setting to sequence of Occurrence
            For each setting, the keys and values by which the scene has it.

        Yields
        ------
        str
            ``key = value: reason; advice`` for each pair.
        """
        for refused in found[self.first]:
            for other in found[self.second]:
                if refused.probe and other.probe and refused.probe != other.probe:
                    continue
                words = self.second.words.format(key=other.key)
                advice = self.advice or f"change it or remove {words}"
                reason = f"is incompatible with {words}: {self.reason}; {advice}"
                yield format_error(refused.key, refused.value, reason)


def _find_film_key(tables: SceneTables, name: str, value: Any = None) -> Iterable[Occurrence]:
    """Return the occurrence of a key of the film if the key has a given value.

    Parameters
    ----------
    tables : SceneTables
        The scene's tables, of which only the film is used.
    name : str
        Name of the key in the table ``film``.
    value : object, optional
        The value that the key must have. By default, any value except None, zero and false.

    Returns
    -------
    iterable of Occurrence
        A tuple of one occurrence, or an empty tuple.
    """
    found = getattr(tables.film, name)
    is_set = bool(found) if value is None else found == value
    return (Occurrence(f"film.{name}", found),) if is_set else ()


def _make_film_setting(name: str, value: Any = None) -> Setting:
    """Make the setting that a key of the film has a value; by default any but None, 0 and false."""
    words = f"film.{name}"
    if value is not None:
        words += f' = "{value}"' if isinstance(value, str) else f" = {str(value).lower()}"
    return Setting(words, partial(_find_film_key, name=name, value=value))


def _find_other_shapes(tables: SceneTables) -> Iterator[Occurrence]:
    """Yield the key of the film's shape unless the film is a disc."""
    if not tables.film.is_disc:
        yield Occurrence("film.shape", tables.film.shape)


def _find_air(tables: SceneTables) -> Iterator[Occurrence]:
    """Yield the key of the air if the scene has it."""
    if tables.air is not None:
        yield Occurrence("air", {})


def _find_thesis_edges(tables: SceneTables) -> Iterator[Occurrence]:
    """Yield the key of the observable if it is ``"thesis-edge"``."""
    if tables.observable == "thesis-edge":
        yield Occurrence("numerics.observable", tables.observable)


def _find_orthotropy(tables: SceneTables) -> Iterator[Occurrence]:
    """Yield the key that makes the film orthotropic: a pair of moduli, or else a shear modulus."""
    film = tables.film
    if isinstance(film.youngs_modulus_GPa, tuple):
        yield Occurrence("film.youngs_modulus_GPa", film.youngs_modulus_GPa)
    elif film.shear_modulus_GPa is not None:
        yield Occurrence("film.shear_modulus_GPa", film.shear_modulus_GPa)


def _find_backings(tables: SceneTables) -> Iterator[Occurrence]:
    """Yield the key of each backing, below the film or below a patch."""
    for found in find_support_keys(tables.film):
        yield Occurrence(found.key, found.value)


def _find_layers(tables: SceneTables) -> Iterator[Occurrence]:
    """Yield the key ``film.patches`` if any patch is a layer, not only a backing."""
    if tables.film.layers:
        yield Occurrence("film.patches", tables.film.patches)


def _find_stretched_patches(tables: SceneTables) -> Iterator[Occurrence]:
    """Yield ``bonded`` of the first patch that is not bonded at rest, if there is one."""
    for number, patch in enumerate(tables.film.patches or ()):
        if patch.bonded != "at rest":
            yield Occurrence(f"film.patches[{number}].bonded", patch.bonded)
            return


def _find_stretched_patches_on_rubber(tables: SceneTables) -> Iterator[Occurrence]:
    """Yield the occurrence of `_find_stretched_patches` if the film is rubber."""
    if tables.film.law == "neo-hookean":
        yield from _find_stretched_patches(tables)


def _find_patches_under_probes(tables: SceneTables) -> Iterator[Occurrence]:
    """Yield the key ``film.patches`` once if any layer overlaps any probe."""
    outlines = [layer.patch.outline for layer in tables.film.layers.values()]
    for probe in tables.probes.values():
        if any(has_overlap(outline, probe.outline) for outline in outlines):
            yield Occurrence("film.patches", tables.film.patches)
            return


def _find_tips(tables: SceneTables) -> Iterator[Occurrence]:
    """Yield the key of the kind of each probe whose load is a contact."""
    for key, probe in tables.probes.items():
        if tables.get_kind(key) == "contact":
            yield Occurrence(find_load_key(key, probe, "kind"), "contact", probe=key)


def _find_warm_probes(tables: SceneTables) -> Iterator[Occurrence]:
    """Yield the key of each probe's temperature that differs from the film's."""
    for key, probe in tables.probes.items():
        if probe.temperature_K:
            yield Occurrence(f"{key}.temperature_K", probe.temperature_K, probe=key)


BENDING = _make_film_setting("bending")
CERTAIN_BENDING = _make_film_setting("bending", value=True)
COUPLING = _make_film_setting("coupling")
D33 = _make_film_setting("d33_pC_N")
GRAVITY = _make_film_setting("gravity_m_s2")
NEO_HOOKEAN = _make_film_setting("law", "neo-hookean")
PRESSURE = _make_film_setting("pressure_Pa")
PRETENSION = _make_film_setting("pretension_N_m")
RIM_DISPLACEMENT = _make_film_setting("rim_displacement_um")
TENSION_FIELD = _make_film_setting("compression", "tension-field")
WARMING = _make_film_setting("warming_K")
AIR = Setting("air", _find_air)
OTHER_SHAPE = Setting("film.shape other than a circle", _find_other_shapes)
BACKING = Setting("{key}", _find_backings)
PATCHES = Setting("film.patches", _find_layers)
ORTHOTROPY = Setting("{key}", _find_orthotropy)
PATCHES_UNDER_PROBES = Setting("film.patches under a probe", _find_patches_under_probes)
STRETCHED_PATCHES = Setting('film.patches bonded "before stretching"', _find_stretched_patches)
STRETCHED_RUBBER_PATCHES = Setting(
    'film.patches bonded "before stretching" with film.law = "neo-hookean"',
    _find_stretched_patches_on_rubber,
)
THESIS_EDGES = Setting('numerics.observable = "thesis-edge"', _find_thesis_edges)
TIP = Setting("a tip", _find_tips)
WARM_PROBE = Setting("{key}", _find_warm_probes)

NO_MODEL = "no film model has both"
#: All pairs of settings that a scene cannot combine.
RULES = (
    IncompatibleKeys(TENSION_FIELD, BENDING, "a tension field has no bending stiffness"),
    IncompatibleKeys(TENSION_FIELD, COUPLING, NO_MODEL),
    IncompatibleKeys(TENSION_FIELD, PATCHES, NO_MODEL),
    IncompatibleKeys(TENSION_FIELD, RIM_DISPLACEMENT, NO_MODEL),
    IncompatibleKeys(TENSION_FIELD, NEO_HOOKEAN, NO_MODEL),
    IncompatibleKeys(TENSION_FIELD, WARM_PROBE, NO_MODEL),
    IncompatibleKeys(BENDING, PATCHES, NO_MODEL),
    IncompatibleKeys(BENDING, NEO_HOOKEAN, NO_MODEL),
    IncompatibleKeys(
        CERTAIN_BENDING,
        TIP,
        "contacts are found on a membrane",
        advice='give "auto" or false, and the effect of bending is estimated',
    ),
    IncompatibleKeys(
        AIR,
        OTHER_SHAPE,
        "its added mass is that of a disc",
        advice='remove [air], or give film.shape = "circle"',
    ),
    IncompatibleKeys(
        RIM_DISPLACEMENT,
        OTHER_SHAPE,
        "its coefficients are those of a circle",
        advice='remove it, or give film.shape = "circle"',
    ),
    IncompatibleKeys(
        AIR,
        BACKING,
        "its added mass is that of air on both sides of the film",
        advice="remove one of the two",
    ),
    IncompatibleKeys(WARM_PROBE, BACKING, "a backing carries the heat of a probe away"),
    IncompatibleKeys(COUPLING, STRETCHED_PATCHES, NO_MODEL),
    IncompatibleKeys(COUPLING, RIM_DISPLACEMENT, NO_MODEL),
    IncompatibleKeys(COUPLING, WARMING, NO_MODEL),
    IncompatibleKeys(COUPLING, NEO_HOOKEAN, NO_MODEL),
    IncompatibleKeys(COUPLING, WARM_PROBE, NO_MODEL),
    IncompatibleKeys(D33, PATCHES_UNDER_PROBES, "patches spread the pressure of the probe"),
    IncompatibleKeys(NEO_HOOKEAN, ORTHOTROPY, "rubber is isotropic"),
    IncompatibleKeys(PRETENSION, STRETCHED_RUBBER_PATCHES, NO_MODEL),
    IncompatibleKeys(THESIS_EDGES, RIM_DISPLACEMENT, "the means are of a homogeneous film"),
    IncompatibleKeys(THESIS_EDGES, COUPLING, "the means are of a film at zero voltage"),
    IncompatibleKeys(THESIS_EDGES, WARM_PROBE, "the means are of a homogeneous film"),
    IncompatibleKeys(TIP, PRESSURE, "contacts are found without loads on the whole film"),
    IncompatibleKeys(TIP, GRAVITY, "contacts are found without loads on the whole film"),
    IncompatibleKeys(TIP, WARM_PROBE, "the heat of a probe is computed for a fixed outline"),
)
SETTINGS = {*(rule.first for rule in RULES), *(rule.second for rule in RULES)}


def find_incompatible_keys(tables: SceneTables) -> Iterator[str]:
    """Yield an error message for each pair of keys of a scene that `RULES` do not allow.

    If `Film.coupling` is set, the permittivity at constant strain is checked, too: it must be
    positive.

    Parameters
    ----------
    tables : SceneTables
        The tables of the scene, each of them valid by itself.

    Yields
    ------
    str
        ``key = value: reason; advice`` for each error; equal messages are yielded once.
    """
    found = {setting: tuple(setting.find(tables)) for setting in SETTINGS}
    broken = [rule for rule in RULES if found[rule.first] and found[rule.second]]
    lines = chain.from_iterable(rule.find_errors(found) for rule in broken)
    # probes that share the scene's load cause the same line several times
    yield from dict.fromkeys(lines)
    film = tables.film
    if film.coupling and film.clamped_permittivity <= 0.0:
        reason = "is impossible, since d31 and d32 are too large for film.permittivity"
        advice = "correct them or remove it"
        yield format_error("film.coupling", film.coupling, f"{reason}; {advice}")

"""Keys of a scene that exclude each other, as one table of rules.

Each setting is valid by itself, and no model of the package has both. A further rule is a line in
`RULES`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain
from typing import Any, NamedTuple

from pvdf_fem.scene.film import Film
from pvdf_fem.scene.load import Load
from pvdf_fem.scene.outlines.outline import has_overlap
from pvdf_fem.scene.placed.probe import ListedProbe, Probe, find_load_key
from pvdf_fem.scene.scene_file import format_error


class SceneTables(NamedTuple):
    """The tables of a scene that the rules compare."""

    film: Film
    observable: str
    load: Load
    probes: Mapping[str, Probe]  #: By their keys.

    def get_kind(self, key: str) -> str:
        """Return the kind of the load of a probe."""
        probe = self.probes[key]
        own = probe.load if isinstance(probe, ListedProbe) else None
        return (own.kind if own else None) or self.load.kind


class Occurrence(NamedTuple):
    """A key of a scene where a setting is in force."""

    key: str
    value: Any
    probe: str = ""  #: Key of the probe that has the setting; empty for settings of the film.


@dataclass(frozen=True, eq=False)
class Setting:
    """A setting that excludes others: its words in messages, and where a scene has it."""

    words: str
    find: Callable[[SceneTables], Iterable[Occurrence]]


@dataclass(frozen=True)
class IncompatibleKeys:
    """A rule: a scene has one of two settings at most. The key of the first one is refused."""

    first: Setting
    second: Setting
    reason: str
    advice: str = ""  #: By default to change the first setting or to remove the second one.

    def find_errors(self, found: Mapping[Setting, Sequence[Occurrence]]) -> Iterator[str]:
        """Find the pairs of keys that break the rule.

        Parameters
        ----------
        found : mapping of Setting to sequence of Occurrence
            Where a scene has each setting.

        Yields
        ------
        str
            ``key = value: reason; advice``.
        """
        for refused in found[self.first]:
            for other in found[self.second]:
                if refused.probe and other.probe and refused.probe != other.probe:
                    continue
                words = self.second.words.format(key=other.key)
                advice = self.advice or f"change it or remove {words}"
                reason = f"is incompatible with {words}: {self.reason}; {advice}"
                yield format_error(refused.key, refused.value, reason)


def _find_in_film(tables: SceneTables, name: str, value: Any = None) -> Iterable[Occurrence]:
    """Find a key of the film that has a value; without one any value but None, zero and false."""
    found = getattr(tables.film, name)
    is_set = bool(found) if value is None else found == value
    return (Occurrence(f"film.{name}", found),) if is_set else ()


def _set_film(name: str, value: Any = None) -> Setting:
    """Make the setting of a key of the film; see `_find_in_film`."""
    words = f"film.{name}"
    if value is not None:
        words += f' = "{value}"' if isinstance(value, str) else f" = {str(value).lower()}"
    return Setting(words, partial(_find_in_film, name=name, value=value))


def _find_thesis_edges(tables: SceneTables) -> Iterator[Occurrence]:
    if tables.observable == "thesis-edge":
        yield Occurrence("numerics.observable", tables.observable)


def _find_orthotropy(tables: SceneTables) -> Iterator[Occurrence]:
    film = tables.film
    if isinstance(film.youngs_modulus_GPa, tuple):
        yield Occurrence("film.youngs_modulus_GPa", film.youngs_modulus_GPa)
    elif film.shear_modulus_GPa is not None:
        yield Occurrence("film.shear_modulus_GPa", film.shear_modulus_GPa)


def _find_stretched_patches(tables: SceneTables) -> Iterator[Occurrence]:
    for number, patch in enumerate(tables.film.patches or ()):
        if patch.bonded != "at rest":
            yield Occurrence(f"film.patches[{number}].bonded", patch.bonded)
            return


def _find_stretched_rubber_patches(tables: SceneTables) -> Iterator[Occurrence]:
    if tables.film.law == "neo-hookean":
        yield from _find_stretched_patches(tables)


def _find_patches_under_probes(tables: SceneTables) -> Iterator[Occurrence]:
    outlines = [patch.outline for patch in tables.film.patches or ()]
    for probe in tables.probes.values():
        if any(has_overlap(outline, probe.outline) for outline in outlines):
            yield Occurrence("film.patches", tables.film.patches)
            return


def _find_tips(tables: SceneTables) -> Iterator[Occurrence]:
    for key, probe in tables.probes.items():
        if tables.get_kind(key) == "contact":
            yield Occurrence(find_load_key(key, probe, "kind"), "contact", probe=key)


def _find_warm_probes(tables: SceneTables) -> Iterator[Occurrence]:
    for key, probe in tables.probes.items():
        if probe.temperature_K:
            yield Occurrence(f"{key}.temperature_K", probe.temperature_K, probe=key)


BENDING = _set_film("bending")
CERTAIN_BENDING = _set_film("bending", value=True)
COUPLING = _set_film("coupling")
D33 = _set_film("d33_pC_N")
GRAVITY = _set_film("gravity_m_s2")
NEO_HOOKEAN = _set_film("law", "neo-hookean")
PATCHES = _set_film("patches")
PRESSURE = _set_film("pressure_Pa")
PRETENSION = _set_film("pretension_N_m")
RIM_DISPLACEMENT = _set_film("rim_displacement_um")
TENSION_FIELD = _set_film("compression", "tension-field")
WARMING = _set_film("warming_K")
ORTHOTROPY = Setting("{key}", _find_orthotropy)
PATCHES_UNDER_PROBES = Setting("film.patches under a probe", _find_patches_under_probes)
STRETCHED_PATCHES = Setting('film.patches bonded "before stretching"', _find_stretched_patches)
STRETCHED_RUBBER_PATCHES = Setting(
    'film.patches bonded "before stretching" with film.law = "neo-hookean"',
    _find_stretched_rubber_patches,
)
THESIS_EDGES = Setting('numerics.observable = "thesis-edge"', _find_thesis_edges)
TIP = Setting("a tip", _find_tips)
WARM_PROBE = Setting("{key}", _find_warm_probes)

NO_MODEL = "no film model has both"
#: All pairs of settings that a scene cannot have together.
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
    """Find settings of a scene that no model has together.

    Parameters
    ----------
    tables : SceneTables
        The tables of a scene.

    Yields
    ------
    str
        ``key = value: reason; advice``.
    """
    found = {setting: tuple(setting.find(tables)) for setting in SETTINGS}
    broken = [rule for rule in RULES if found[rule.first] and found[rule.second]]
    lines = chain.from_iterable(rule.find_errors(found) for rule in broken)
    yield from dict.fromkeys(lines)  # several probes may have the scene's load
    film = tables.film
    if film.coupling and film.clamped_permittivity <= 0.0:
        reason = "is impossible with d31 and d32 as large at film.permittivity"
        advice = "change those or remove it"
        yield format_error("film.coupling", film.coupling, f"{reason}; {advice}")

"""The loads, pressure profiles and observables that a scene may name, and the table ``[load]``.

A further one is a class in a file of its own and its line here. Classes are given as
``module:Class``: scenes are read without solver modules.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

from pydantic import (
    Field,
    SerializerFunctionWrapHandler,
    ValidationInfo,
    create_model,
    field_validator,
    model_serializer,
)

from pvdf_fem.scene.keys import Affects, Key, Section, make_validation_error
from pvdf_fem.scene.readout import Readout
from pvdf_fem.scene.scene_file import suggest

#: Class of each ``load.kind``.
LOAD_CLASSES = {
    "dead": "pvdf_fem.film.loads.probe_load:DeadPressure",
    "follower": "pvdf_fem.film.loads.probe_load:FollowerPressure",
    "rigid": "pvdf_fem.film.loads.punch:Punch",
    "contact": "pvdf_fem.film.loads.rigid_tip:RigidTip",
}


#: Classes of loads on the whole film, by the film's keys.
FILM_LOAD_CLASSES = {
    "pressure_Pa": "pvdf_fem.film.loads.film_load:FilmPressure",
    "gravity_m_s2": "pvdf_fem.film.loads.weight:Weight",
}
#: Class of each ``film.law``.
LAW_CLASSES = {
    "hooke": "pvdf_fem.film.laws.law:Hooke",
    "neo-hookean": "pvdf_fem.film.laws.neo_hookean:NeoHookean",
}


class ProfileEntry(NamedTuple):
    """Class of a pressure profile; whether it needs an ellipse, and has its outline's symmetry."""

    path: str
    needs_ellipse: bool = False
    is_symmetric: bool = True


#: Named ``load.profile`` values, and the class for files.
PROFILE_ENTRIES = {
    "uniform": ProfileEntry("pvdf_fem.film.loads.profiles:Uniform"),
    "hertz": ProfileEntry("pvdf_fem.film.loads.profiles:Hertz", needs_ellipse=True),
    "gaussian": ProfileEntry("pvdf_fem.film.loads.profiles:Gaussian"),
}
#: Mark between a profile file's path and the SHA-256 of its content.
DIGEST_MARK = "#sha256="
TABLE_ENTRY = ProfileEntry("pvdf_fem.film.loads.profiles:TableProfile", is_symmetric=False)


class ObservableEntry(NamedTuple):
    """The class of an observable, and whether its electrodes have to be upright rectangles."""

    path: str
    needs_edges: bool = False


#: Each ``numerics.observable``.
OBSERVABLE_ENTRIES = {
    "material": ObservableEntry("pvdf_fem.electrodes.observables:Material"),
    "thesis-edge": ObservableEntry("pvdf_fem.electrodes.observables:ThesisEdge", needs_edges=True),
}

#: Pairs of keys of a table; a key with a value removes its rival.
ALTERNATIVE_KEYS = {"depth_mm": "force_N", "temperature_change_K": "pretension_N_m"}
ALTERNATIVE_KEYS |= {rival: key for key, rival in ALTERNATIVE_KEYS.items()}
#: Load keys that a listed probe has beside its shape; a file may have them in `load`, too.
FORCE_KEYS = ("depth_mm", "force_N", "tangential_N")
#: Forces and depths of loads; listed probes have them, too.
DEPTH = Key("mm", (1e-6, 1e3), needs=("kind", "contact"), example=3.0)
FORCE = Key(
    "N",
    (0.0, 1e6),
    Affects.SCALE,
    usual_limits=(0.0, 99.9),
    likely_units={"grams": 9.81e-3},
    example=0.6,
)
TANGENTIAL = Key("N", (-1e6, 1e6), example=[0.5, 0.0])


class Load(Section):
    """The force of a probe on the film."""

    kind: Annotated[str, Key(words=LOAD_CLASSES)] = "dead"
    """dead: a traction along z on the reference area. follower: a pressure normal to the deformed
    film. rigid: a flat punch. contact: a rigid tip, a sphere or a probe with edge_radius_mm, on
    which the film slides where it touches."""
    depth_mm: Annotated[float | None, DEPTH] = None
    """Depth of a tip, in place of force_N."""
    force_N: Annotated[float, FORCE] = 1.0
    """Force along z."""
    contact: Annotated[
        Literal["sliding", "stuck"] | None,
        Field(validate_default=True),
        Key(needs=("kind", "rigid"), example="sliding"),
    ] = None
    """A flat punch is sliding in the plane, or stuck, held by its guide unless tangential_N pushes
    it; sliding where it is not given."""
    tilt: Annotated[Literal["held", "free"], Key(needs=("kind", "rigid"), neutral="held")] = "held"
    """held: the guide of a punch keeps it horizontal by moments. free: it leans as the film lets
    it, by small angles about x and y."""
    tangential_N: Annotated[tuple[float, float] | None, TANGENTIAL] = None
    """Force along x and y, of a dead load or a stuck punch."""
    profile: Annotated[str, Key(needs=("kind", "dead"), neutral="uniform")] = "uniform"
    """How a dead load is spread: uniform, hertz (discs and ellipses), gaussian, or the path, from
    the working directory, of a CSV or NetCDF file with x_mm, y_mm and pressure on a grid in the
    probe's own axes, whose total is the force. A path that ends in #sha256= and a digest refuses
    any other content of the file."""
    profile_width_mm: Annotated[
        float | None, Key("mm", (1e-4, 1e5), needs=("profile", "gaussian"), example=2.0)
    ] = None
    """Where a gaussian is 1/e² of its largest value; by default the radius of a disc of the same
    area."""

    @field_validator("contact")
    @classmethod
    def _slides(cls, value: str | None, info: ValidationInfo) -> str | None:
        return value or ("sliding" if info.data.get("kind") == "rigid" else None)

    @field_validator("profile")
    @classmethod
    def _is_a_profile(cls, value: str) -> str:
        if value not in PROFILE_ENTRIES and not value.partition(DIGEST_MARK)[0].endswith(
            (".csv", ".nc")
        ):
            known = suggest(value, list(PROFILE_ENTRIES))
            raise make_validation_error(
                f"is no path that ends in .csv or .nc and no profile; {known}"
            )
        return value

    @field_validator("tangential_N")
    @classmethod
    def _is_borne(cls, value: Any, info: ValidationInfo) -> Any:
        if value is not None and info.data.get("kind") == "follower":
            raise make_validation_error(
                'is not of a pressure normal to the film; remove it or give kind "dead"'
            )
        if value is not None and info.data.get("kind") == "contact":
            raise make_validation_error(
                "is not of a tip, which a guide holds and the film slides on; remove it"
            )
        if value is not None and info.data.get("contact") == "sliding":
            raise make_validation_error(
                'slides off without friction; remove it or give contact = "stuck"'
            )
        return value

    @field_validator("force_N")
    @classmethod
    def _is_not_given_twice(cls, value: float, info: ValidationInfo) -> float:
        if info.data.get("depth_mm") is not None:
            raise make_validation_error("follows from depth_mm; remove one of the two")
        if value == 0.0 and info.data.get("kind") == "contact":
            raise make_validation_error("presses no tip on the film; give more, or remove [probe]")
        return value

    @model_serializer(mode="wrap")
    def _say_once(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """The table, without None and without a force that follows from the depth."""
        left_out = "force_N" if self.depth_mm is not None else ""
        table = handler(self).items()
        return {key: value for key, value in table if value is not None and key != left_out}

    @property
    def depth(self) -> float | None:
        """Depth of a tip in m, where given instead of a force."""
        return None if self.depth_mm is None else self.depth_mm / 1e3

    @property
    def unloaded(self) -> Load:
        """The load without any force."""
        pushed = self.tangential_N and (0.0, 0.0)
        return self.model_copy(update={"tangential_N": pushed, "force_N": 0.0})

    @property
    def force(self) -> float:
        """Force along z in N."""
        return self.force_N

    @property
    def components(self) -> tuple[float, float, float]:
        """Force along x, y and z in N."""
        return (*(self.tangential_N or (0.0, 0.0)), self.force_N)

    @property
    def profile_entry(self) -> ProfileEntry:
        """What the profile's name stands for."""
        return PROFILE_ENTRIES.get(self.profile, TABLE_ENTRY)


if TYPE_CHECKING:

    class LoadOverrides(Load):
        """The load of a listed probe. What it does not say is None."""
else:
    _own: Any = {
        key: (Annotated[(field.annotation | None, Field(), *field.metadata)], None)
        for key, field in Load.model_fields.items()
    }
    LoadOverrides = create_model("LoadOverrides", __base__=Load, __module__=__name__, **_own)
#: Needs of load and channel keys: a key and its value.
_NEEDS = {
    name: needs
    for table in (Load, Readout)
    for name in table.model_fields
    if (needs := table.key_of(name).needs)
}


def set_key(table: dict[str, Any], key: str, value: Any, rival: Any = None) -> None:
    """Change a key of a scene's table. Keys that need a different value are left behind, and the
    rival, too. Where a value of the `rival` is given, too, both stay and are refused."""
    if isinstance(value, dict):  # a value by channel leaves nothing behind
        table[key] = value
        return
    for other, (decider, needed) in _NEEDS.items():
        if other in table and decider == key and value != needed:
            set_key(table, other, None)
            del table[other]
    if value is not None and rival is None:
        table.pop(ALTERNATIVE_KEYS.get(key, ""), None)
    table[key] = value


def find_load_key(where: str, probe: Any, key: str) -> str:
    """The key for a load's value at the probe `where`: the probe's key or the scene's key."""
    if key not in getattr(probe, "said", ()):
        return f"load.{key}"
    return f"{where}.{key}" if key in FORCE_KEYS else f"{where}.load.{key}"

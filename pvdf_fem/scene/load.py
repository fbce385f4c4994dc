"""The table ``[load]`` of a scene, and the keys of it that a listed probe overrides."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import (
    Field,
    SerializerFunctionWrapHandler,
    ValidationInfo,
    field_validator,
    model_serializer,
)

from pvdf_fem.scene.keys import Affects, Key, Section, make_validation_error
from pvdf_fem.scene.registry import (
    DIGEST_MARK,
    LOAD_CLASSES,
    PROFILE_ENTRIES,
    TABLE_ENTRY,
    ProfileEntry,
)
from pvdf_fem.scene.scene_file import suggest

#: Load keys that a listed probe stores in its own table; a file may have them in `load`, too.
FORCE_KEYS = ("depth_mm", "force_N", "tangential_N")

KIND = Key(words=LOAD_CLASSES)
DEPTH = Key("mm", (1e-6, 1e3), needs=("kind", "contact"), example=3.0)
FORCE = Key(
    "N",
    (0.0, 1e6),
    Affects.SCALE,
    usual_limits=(0.0, 99.9),
    likely_units={"grams": 9.81e-3},
    example=0.6,
)
CONTACT = Key(needs=("kind", "rigid"), example="sliding")
TILT = Key(needs=("kind", "rigid"), neutral="held")
TANGENTIAL = Key("N", (-1e6, 1e6), example=[0.5, 0.0])
PROFILE = Key(needs=("kind", "dead"), neutral="uniform")


class LoadOverrides(Section):
    """The keys of the scene's load that a listed probe overrides; None stands for the scene's."""

    kind: Annotated[str | None, KIND] = None
    """dead: a traction along z on the undeformed area. follower: a pressure normal to the deformed
    film. rigid: a flat punch. contact: a rigid tip (a sphere, or a probe with edge_radius_mm),
    whose contact area with the sliding film is computed."""
    depth_mm: Annotated[float | None, DEPTH] = None
    """Depth of a tip, in place of force_N."""
    force_N: Annotated[float | None, FORCE] = None
    """Force along z."""
    contact: Annotated[Literal["sliding", "stuck"] | None, CONTACT] = None
    """sliding: the film slides under a flat punch without friction. stuck: the film sticks to the
    punch, whose guide lets it move along x and y only under tangential_N. By default sliding."""
    tilt: Annotated[Literal["held", "free"] | None, TILT] = None
    """held: a guide keeps the punch horizontal. free: the punch tilts by small angles about x and y
    until no moment acts on it."""
    tangential_N: Annotated[tuple[float, float] | None, TANGENTIAL] = None
    """Force along x and y, of a dead load or a stuck punch."""
    profile: Annotated[str | None, PROFILE] = None
    """Pressure distribution of a dead load: uniform, hertz (circles and ellipses), gaussian, or the
    path (relative to the working directory) of a CSV or NetCDF file with x_mm, y_mm and pressure on
    a grid in the probe's own axes. The pressure is scaled to the force. If the path ends in
    #sha256= and a digest, a file with other content is refused."""
    profile_width_mm: Annotated[
        float | None, Key("mm", (1e-4, 1e5), needs=("profile", "gaussian"), example=2.0)
    ] = None
    """Radius at which a gaussian falls to 1/e² of its maximum; by default the radius of a circle
    with the probe's area."""

    @field_validator("profile")
    @classmethod
    def _reject_unknown_profile(cls, value: str | None) -> str | None:
        """Refuse a profile that is neither a name nor a path that ends in .csv or .nc."""
        if value is None or value in PROFILE_ENTRIES:
            return value
        if value.partition(DIGEST_MARK)[0].endswith((".csv", ".nc")):
            return value
        advice = suggest(value, list(PROFILE_ENTRIES))
        reason = "is neither a profile nor a path that ends in .csv or .nc"
        raise make_validation_error(f"{reason}; {advice}")

    @field_validator("tangential_N")
    @classmethod
    def _reject_tangential_force(cls, value: Any, info: ValidationInfo) -> Any:
        """Refuse a tangential force that this kind of load or contact cannot transmit."""
        if value is None:
            return value
        kind = info.data.get("kind")
        if kind == "follower":
            reason = "is incompatible with a pressure normal to the film"
            raise make_validation_error(f'{reason}; remove it or give kind "dead"')
        if kind == "contact":
            reason = "is incompatible with a tip, on which the film slides without friction"
            raise make_validation_error(f"{reason}; remove it")
        if info.data.get("contact") == "sliding":
            reason = "cannot act on the film through a sliding punch, which has no friction"
            raise make_validation_error(f'{reason}; remove it or give contact = "stuck"')
        if kind not in (None, "dead", "rigid"):  # None stands for the kind of the scene's load
            reason = 'requires load.kind = "dead" or "rigid"'
            raise make_validation_error(f"{reason}; remove it or give one of these")
        return value

    @field_validator("force_N")
    @classmethod
    def _reject_invalid_force(cls, value: float | None, info: ValidationInfo) -> float | None:
        """Refuse a force if a depth is given, too, and a zero force on a tip."""
        if info.data.get("depth_mm") is not None:
            reason = "is incompatible with depth_mm, from which the force is computed"
            raise make_validation_error(f"{reason}; remove one of the two")
        if value == 0.0 and info.data.get("kind") == "contact":
            reason = "does not press the tip on the film"
            raise make_validation_error(f"{reason}; give a larger force or remove [probe]")
        return value

    @model_serializer(mode="wrap")
    def _omit_unset_keys(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Serialize the load without keys that are None, and without force if a depth is given."""
        table = {key: value for key, value in handler(self).items() if value is not None}
        if self.depth_mm is not None:
            table.pop("force_N", None)
        return table


class Load(LoadOverrides):
    """The load of the scene's probe, or the common load of listed probes."""

    kind: Annotated[str, KIND] = "dead"
    force_N: Annotated[float, FORCE] = 1.0
    contact: Annotated[
        Literal["sliding", "stuck"] | None, Field(validate_default=True), CONTACT
    ] = None
    tilt: Annotated[Literal["held", "free"], TILT] = "held"
    profile: Annotated[str, PROFILE] = "uniform"

    @field_validator("contact")
    @classmethod
    def _set_default_contact(cls, value: str | None, info: ValidationInfo) -> str | None:
        """Return ``"sliding"`` for a flat punch without a contact, otherwise the value."""
        if value is None and info.data.get("kind") == "rigid":
            return "sliding"
        return value

    @property
    def depth(self) -> float | None:
        """Depth of a tip in m; None if the force is given."""
        return None if self.depth_mm is None else self.depth_mm / 1e3

    @property
    def unloaded(self) -> Load:
        """A copy of the load with zero force along x, y and z; a depth is not changed."""
        tangential = None if self.tangential_N is None else (0.0, 0.0)
        return self.model_copy(update={"tangential_N": tangential, "force_N": 0.0})

    @property
    def force(self) -> float:
        """Force along z in N; meaningless if the depth is given."""
        return self.force_N

    @property
    def components(self) -> tuple[float, float, float]:
        """Force along x, y and z in N; the one along z has no meaning if the depth is given."""
        along_x, along_y = self.tangential_N or (0.0, 0.0)
        return along_x, along_y, self.force_N

    @property
    def profile_entry(self) -> ProfileEntry:
        """The registry entry of the pressure profile; all profiles in files have the same one."""
        return PROFILE_ENTRIES.get(self.profile, TABLE_ENTRY)

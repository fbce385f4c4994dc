"""The table ``[load]`` of a scene, and the load that a listed probe has for itself."""

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

#: Load keys that a listed probe has beside its shape; a file may have them in `load`, too.
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
    """Keys of a load, which are None where they are not given.

    A listed probe overrides the scene's load by them.
    """

    kind: Annotated[str | None, KIND] = None
    """dead: a traction along z on the undeformed area. follower: a pressure normal to the deformed
    film. rigid: a flat punch. contact: a rigid tip, a sphere or a probe with edge_radius_mm, whose
    contact with the sliding film is found."""
    depth_mm: Annotated[float | None, DEPTH] = None
    """Depth of a tip, in place of force_N."""
    force_N: Annotated[float | None, FORCE] = None
    """Force along z."""
    contact: Annotated[Literal["sliding", "stuck"] | None, CONTACT] = None
    """sliding: film slides under a flat punch without friction. stuck: film sticks to the punch,
    which its guide holds unless tangential_N pushes it. By default sliding."""
    tilt: Annotated[Literal["held", "free"] | None, TILT] = None
    """held: the guide of a punch keeps it horizontal by moments. free: the punch leans without
    moments, by small angles about x and y."""
    tangential_N: Annotated[tuple[float, float] | None, TANGENTIAL] = None
    """Force along x and y, of a dead load or a stuck punch."""
    profile: Annotated[str | None, PROFILE] = None
    """Distribution of a dead load: uniform, hertz (discs and ellipses), gaussian, or the path, from
    the working directory, of a CSV or NetCDF file with x_mm, y_mm and pressure on a grid in the
    probe's own axes, scaled to the force. With a path that ends in #sha256= and a digest, a file of
    other content is refused."""
    profile_width_mm: Annotated[
        float | None, Key("mm", (1e-4, 1e5), needs=("profile", "gaussian"), example=2.0)
    ] = None
    """Radius at which a gaussian is 1/e² of its largest value; by default the radius of a disc of
    the same area."""

    @field_validator("profile")
    @classmethod
    def _reject_unknown_profile(cls, value: str | None) -> str | None:
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
        """Refuse a tangential force that the kind of load or contact cannot transmit."""
        if value is None:
            return value
        kind = info.data.get("kind")
        if kind == "follower":
            reason = "is incompatible with a pressure normal to the film"
            raise make_validation_error(f'{reason}; remove it or give kind "dead"')
        if kind == "contact":
            reason = "is incompatible with a tip, which a guide holds and the film slides on"
            raise make_validation_error(f"{reason}; remove it")
        if info.data.get("contact") == "sliding":
            reason = "would move a sliding punch, which has no friction"
            raise make_validation_error(f'{reason}; remove it or give contact = "stuck"')
        if kind not in ("dead", "rigid"):
            reason = f'is a force of load.kind = "dead" or "rigid", here "{kind}"'
            raise make_validation_error(f"{reason}; remove it or give one of these")
        return value

    @field_validator("force_N")
    @classmethod
    def _reject_force(cls, value: float | None, info: ValidationInfo) -> float | None:
        """Refuse a force beside a depth, and a tip without a force."""
        if info.data.get("depth_mm") is not None:
            raise make_validation_error("follows from depth_mm; remove one of the two")
        if value == 0.0 and info.data.get("kind") == "contact":
            raise make_validation_error("presses no tip on the film; give more, or remove [probe]")
        return value

    @model_serializer(mode="wrap")
    def _omit_unset_keys(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Return the table without None, and without a force that follows from the depth."""
        table = {key: value for key, value in handler(self).items() if value is not None}
        if self.depth_mm is not None:
            table.pop("force_N", None)
        return table


class Load(LoadOverrides):
    """The force of a probe on the film."""

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
        if value is None and info.data.get("kind") == "rigid":
            return "sliding"
        return value

    @property
    def depth(self) -> float | None:
        """Depth of a tip in m, where given instead of a force."""
        return None if self.depth_mm is None else self.depth_mm / 1e3

    @property
    def unloaded(self) -> Load:
        """The load without any force."""
        tangential = None if self.tangential_N is None else (0.0, 0.0)
        return self.model_copy(update={"tangential_N": tangential, "force_N": 0.0})

    @property
    def force(self) -> float:
        """Force along z in N."""
        return self.force_N

    @property
    def components(self) -> tuple[float, float, float]:
        """Force along x, y and z in N."""
        along_x, along_y = self.tangential_N or (0.0, 0.0)
        return along_x, along_y, self.force_N

    @property
    def profile_entry(self) -> ProfileEntry:
        """The entry of the profile in the registry."""
        return PROFILE_ENTRIES.get(self.profile, TABLE_ENTRY)

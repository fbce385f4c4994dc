"""The registry of shapes: which tables a scene file may have for electrodes and for probes."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property, lru_cache
from string import ascii_uppercase
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias, Union

import numpy as np
from pydantic import (
    AfterValidator,
    Discriminator,
    Field,
    Tag,
    create_model,
    field_validator,
    model_validator,
)

from pvdf_fem.scene.keys import Affects, Key, Section, make_validation_error
from pvdf_fem.scene.outlines.circle import CircleShape
from pvdf_fem.scene.outlines.ellipse import EllipseShape
from pvdf_fem.scene.outlines.outline import rotate
from pvdf_fem.scene.outlines.polygon import PolygonShape, RectangleShape, SquareShape, TriangleShape
from pvdf_fem.scene.outlines.shape import HEAT_KEYS, SIZE, Shape, Touching
from pvdf_fem.scene.outlines.sphere import SphereShape
from pvdf_fem.scene.registry import (
    ALTERNATIVE_KEYS,
    DEPTH,
    FORCE,
    FORCE_KEYS,
    TANGENTIAL,
    Load,
    LoadOverrides,
    set_key,
)

#: Material keys for the film and its patches.
MODULUS = Key(
    "GPa", (1e-6, 1e4), usual_limits=(1e-6, 1500.0), likely_units={"MPa": 1e-3, "Pa": 1e-9}
)
EXPANSION = Key("1/K", (-0.1, 0.1), Affects.STRAIN_AT_REST)
#: Shapes of probes and electrodes. A new shape is named here.
_SHAPES: list[type[Shape]] = [RectangleShape, CircleShape, EllipseShape, PolygonShape]
_OF_PROBES_ONLY: list[type[Shape]] = [TriangleShape, SphereShape]
_OF_ELECTRODES_ONLY: list[type[Shape]] = [SquareShape]


def _is_name(name: str) -> str:
    if not name or name != name.strip() or not name.isprintable():
        raise make_validation_error(
            "is no name; give printable characters without blanks around them"
        )
    if len(name) > 40 or re.search(r'[/\\,="]', name):
        raise make_validation_error(
            'is too long or has one of / \\ , = " in it; choose a simpler name'
        )
    return name


class _Named(Section):
    """The name of an electrode."""

    name: Annotated[str, AfterValidator(_is_name), Key(example="A")]
    """A name that no other electrode has."""


class Bonded(Section):
    """A layer bonded to the film, as tape, ink or solder. Layers may overlap electrodes, probes and
    further layers, and reach over the rim. Their material is the film's where it is not given."""

    thickness_um: Annotated[float, Key("µm", (1e-3, 1e5), example=50.0)]
    """Thickness, of both layers together where the layer is on both sides."""
    both_sides: Annotated[bool, Key()] = False
    """The layer is half on the one side and half on the other."""
    youngs_modulus_GPa: Annotated[float | None, replace(MODULUS, example=3.0)] = None
    """Young's modulus, of an isotropic layer."""
    poisson_ratio: Annotated[
        float | None, Key("", (0.0, 0.4999), needs=("youngs_modulus_GPa", None), example=0.3)
    ] = None
    """Poisson's ratio."""
    density_kg_m3: Annotated[
        float | None, Key("kg/m³", (0.0, 1e5), Affects.DYNAMICS, example=1400.0)
    ] = None
    """Density."""
    bonded: Literal["at rest", "before stretching"] = "at rest"
    """at rest: to the stretched film, without stress of its own. before stretching: it is
    stretched, or cooled and clamped, together with the film."""
    thermal_expansion_per_K: Annotated[
        float | None, Key("1/K", (-0.1, 0.1), needs=("bonded", "before stretching"), example=1e-5)
    ] = None
    """Thermal expansion."""

    @property
    def thickness(self) -> float:
        """Thickness in m."""
        return self.thickness_um / 1e6


class Pressing(Section):
    """The load of a listed probe, merged over the scene's load: a new kind leaves behind keys that
    only the scene's kind bears."""

    depth_mm: Annotated[float | None, DEPTH] = None
    """Depth of the tip, in place of force_N."""
    force_N: Annotated[float | None, FORCE] = None
    """Force along z."""
    tangential_N: Annotated[tuple[float, float] | None, TANGENTIAL] = None
    """Force along x and y."""
    load: Annotated[LoadOverrides | None, Key(example={"kind": "rigid"})] = None
    """Other keys of [load] that the probe has for itself."""

    @model_validator(mode="before")
    @classmethod
    def _has_forces_beside(cls, table: Any) -> Any:
        own = table.get("load") if isinstance(table, Mapping) else None
        own = own.model_dump() if isinstance(own, Load) else own
        if not isinstance(own, Mapping):
            return table
        said = {key: value for key, value in own.items() if value is not None}
        forces = {
            key: said.pop(key) for key in FORCE_KEYS if key in said and table.get(key) is None
        }
        return {**table, **forces, "load": said or None}

    @field_validator("load")
    @classmethod
    def _is_said_once(cls, value: LoadOverrides | None) -> LoadOverrides | None:
        for key in FORCE_KEYS:
            if getattr(value, key, None) is not None:
                raise make_validation_error(
                    f"has {key}, which stands beside it too; remove one of the two"
                )
        return value

    @property
    def said(self) -> dict[str, Any]:
        """Keys of the load given by the probe itself, `kind` first."""
        forces = self.model_dump(include=set(Pressing.model_fields), exclude_none=True)
        return {**forces.pop("load", {}), **forces}

    def resolve_load(self, scene_load: Load) -> Load:
        """Its load in a scene; ValidationError for keys that its kind does not bear."""
        return _merged(scene_load, tuple(self.said.items()))

    def inherits_load_key(self, key: str) -> bool:
        """Whether its load has a key from the scene's load."""
        return key in _over({key: None}, self.said) and key not in self.said


@lru_cache(maxsize=1024)
def _merged(load: Load, said: tuple[tuple[str, Any], ...]) -> Load:
    return Load(**_over(load.model_dump(), dict(said)))


def _over(table: dict[str, Any], said: Mapping[str, Any]) -> dict[str, Any]:
    for key, value in said.items():
        set_key(table, key, value, said.get(ALTERNATIVE_KEYS.get(key, "")))
    return table


if TYPE_CHECKING:

    class Probe(Touching):
        """A probe, whatever its shape."""

    class PressingProbe(Probe, Pressing):
        """A probe of a list, whatever its shape."""

    class Electrode(Shape, _Named):
        """An electrode, whatever its shape."""

    class Patch(Shape, Bonded):
        """A patch of the film, whatever its shape."""


def _made(name: str, base: Any, doc: str | None, **fields: Any) -> Any:
    """A model in this module, where pickle finds it by name."""
    model = create_model(name, __base__=base, __module__=__name__, **fields)
    model.__doc__ = doc
    globals()[name] = model
    return model


def _probe(shape: type[Shape], kind: str, *bases: type[Section]) -> Any:
    """The model of probes of a shape."""
    name = shape.__name__.replace("Shape", kind)
    touching = () if issubclass(shape, Touching) else (Touching,)
    return _made(name, (shape, *touching, *bases), shape.__doc__)


def _flat(shape: type[Shape], base: type[Section], kind: str) -> Any:
    """The model of electrodes or patches of a shape, without default for place and sizes. A shape
    of probes has the sizes of the thesis's probe by default, so electrodes and patches must give
    their sizes; the square keeps its default, the size of the thesis's electrodes."""
    required = {"x_mm", "y_mm"}
    if shape not in _OF_ELECTRODES_ONLY:
        required |= shape.model_fields.keys() - Shape.model_fields.keys()
    fields: Any = {
        name: (Annotated[(field.annotation, *field.metadata)], ...)
        for name, field in shape.model_fields.items()
        if name in required and not field.is_required()
    }
    name = shape.__name__.replace("Shape", kind)
    return _made(name, (shape, base), shape.__doc__, **fields)


def _word(shape: type[Shape]) -> str:
    return str(shape.model_fields["shape"].default)


#: Models for probes, listed probes and electrodes, by shape.
_PROBES = _OF_PROBES_ONLY + _SHAPES
PROBES = {_word(shape): _probe(shape, "Probe") for shape in _PROBES}
LISTED_PROBES = {_word(shape): _probe(shape, "ListedProbe", Pressing) for shape in _PROBES}
_FLAT = _OF_ELECTRODES_ONLY + _SHAPES
ELECTRODES = {_word(shape): _flat(shape, _Named, "Electrode") for shape in _FLAT}
PATCHES = {_word(shape): _flat(shape, Bonded, "Patch") for shape in _FLAT}
#: Keys that shapes do not share. A change of shape drops these keys.
SIZES = {key for probe in PROBES.values() for key in probe.model_fields}
SIZES -= {*Shape.model_fields, *HEAT_KEYS}


def _one_of(models: Mapping[str, type[Section]], default: str) -> Any:
    """The type for a table with its model named by ``shape``."""

    def shape_of(value: Any) -> str | None:
        if isinstance(value, Mapping):
            value = value.get("shape", default)
            return f"<{value}>" if isinstance(value, str) else ""
        return f"<{value.shape}>" if isinstance(value, Shape | Layout) else None

    tagged = tuple(Annotated[model, Tag(f"<{shape}>")] for shape, model in models.items())
    return Annotated[Union[tagged], Discriminator(shape_of)]  # noqa: UP007


if not TYPE_CHECKING:
    Probe = _one_of(PROBES, "triangle")
    PressingProbe = _one_of(LISTED_PROBES, "triangle")
    Electrode = _one_of(ELECTRODES, "square")
    Patch = _one_of(PATCHES, "square")


class Layout(Section):
    """Equal electrodes, evenly on a ring: A, B, C, ... counter-clockwise. Electrodes are not
    turned: their axes are the film's, as in the thesis."""

    layout: Literal["four", "three", "ring"] = "four"
    """four: the thesis's squares, A on +x, B on +y, C on -x, D on -y. three: A at 270°, B at 30°,
    C at 150°. ring: any number of electrodes of any shape."""
    count: Annotated[
        int | None, Key("electrodes", (1, 25), needs=("layout", "ring"), example=6)
    ] = None
    """Number of electrodes on the ring; 4 where it is not given."""
    ring_radius_mm: Annotated[float, SIZE] = 10.0
    """From the film's centre to the centres of the electrodes."""
    first_angle_deg: Annotated[
        float | None, Key("degrees", (-3600.0, 3600.0), needs=("layout", "ring"), example=45.0)
    ] = None
    """From +x to A; 0 where it is not given."""
    centre: Annotated[bool, Key(needs=("layout", "ring"))] = False
    """One more electrode, the last, is on the film's centre."""
    shape: str
    """The shape of all electrodes, with its sizes."""

    @cached_property
    def electrodes(self) -> tuple[Electrode, ...]:
        """The electrodes on the ring, then the one on the centre."""
        count, first_deg = self.count or 4, self.first_angle_deg or 0.0
        if self.layout == "three":
            count, first_deg = 3, 270.0
        turns = 360.0 * np.arange(count) / count
        places = [rotate([self.ring_radius_mm, 0.0], first_deg + angle) for angle in turns]
        places += [np.zeros(2)] if self.centre else []
        sizes = {key: getattr(self, key) for key in type(self).model_fields.keys() & SIZES}
        return tuple(
            ELECTRODES[self.shape](name=name, x_mm=float(x), y_mm=float(y), **sizes)
            for name, (x, y) in zip(ascii_uppercase, places, strict=False)
        )


#: Keys that a layout's keys need.
RING = {key: needs for key in Layout.model_fields if (needs := Layout.key_of(key).needs)}
RING["shape"] = ("layout", "ring")


def _layout(electrode: type[Shape]) -> Any:
    """The model for a layout with a shape; its keys are the shape's keys except name and place."""
    fields: Any = {
        key: (field.annotation, field)
        for key, field in electrode.model_fields.items()
        if key not in Shape.model_fields | _Named.model_fields
    }
    shape = electrode.model_fields["shape"]
    said = Key(needs=RING["shape"], neutral="square")
    fields["shape"] = Annotated[shape.annotation, said], shape.default
    name = electrode.__name__.replace("Electrode", "Layout")
    return _made(name, Layout, electrode.__doc__, **fields)


#: Models for layouts, by the electrodes' shape.
LAYOUTS = {shape: _layout(electrode) for shape, electrode in ELECTRODES.items()}
#: Models by sections and union tags.
MODELS: dict[tuple[str, ...], type[Section]] = {
    **{("probe", "table", shape): model for shape, model in PROBES.items()},
    **{("probe", "list", shape): model for shape, model in LISTED_PROBES.items()},
    **{("probe", "list", shape, "load"): LoadOverrides for shape in LISTED_PROBES},
    **{("electrodes", "list", shape): model for shape, model in ELECTRODES.items()},
    **{("electrodes", "table", shape): model for shape, model in LAYOUTS.items()},
    **{("film", "patches", shape): model for shape, model in PATCHES.items()},
}
if TYPE_CHECKING:
    AnyLayout: TypeAlias = Layout
else:
    AnyLayout = _one_of(LAYOUTS, "square")


def _table_or_list(value: Any) -> str:
    return "<list>" if isinstance(value, list | tuple) else "<table>"


Probes: TypeAlias = Annotated[
    Annotated[Probe, Tag("<table>")]
    | Annotated[tuple[PressingProbe, ...], Field(min_length=1, max_length=20), Tag("<list>")],
    Discriminator(_table_or_list),
]
Electrodes: TypeAlias = Annotated[
    Annotated[AnyLayout, Tag("<table>")]
    | Annotated[tuple[Electrode, ...], Field(min_length=1, max_length=100), Tag("<list>")],
    Discriminator(_table_or_list),
]

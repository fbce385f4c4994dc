"""Electrodes: a list of arbitrary ones, or a layout of equal ones on a ring."""

from __future__ import annotations

import re
from functools import cached_property
from string import ascii_uppercase
from typing import Annotated, ClassVar, Literal, Self, TypeAlias

import numpy as np
from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from pvdf_fem.scene.keys import Key, make_validation_error
from pvdf_fem.scene.outlines.outline import rotate
from pvdf_fem.scene.placed.placed_shape import PlacedShape, ShapedTable, tag_table_or_list
from pvdf_fem.scene.shapes.shape import COORDINATE, SIZE


def _check_name(name: str) -> str:
    """Refuse a name that could not be used in tables, file names and commands."""
    if not name or name != name.strip() or not name.isprintable():
        reason = "is not a valid name; give printable characters without blanks around them"
        raise make_validation_error(reason)
    if len(name) > 40 or re.search(r'[/\\,="]', name):
        reason = 'has more than 40 characters or one of / \\ , = "; choose a simpler name'
        raise make_validation_error(reason)
    return name


class Electrode(PlacedShape):
    """An electrode with its own name, position and shape."""

    name: Annotated[str, AfterValidator(_check_name), Key(example="A")]
    """A name that no other electrode has."""
    x_mm: Annotated[float, COORDINATE]
    y_mm: Annotated[float, COORDINATE]


class Layout(ShapedTable):
    """Equal electrodes A, B, C, ..., evenly spaced counter-clockwise on a ring.

    The electrodes are not rotated: their axes are parallel to the film's, as in the thesis.
    """

    shape_key: ClassVar[Key] = Key(needs=("layout", "ring"), neutral="square")

    layout: Literal["four", "three", "ring"] = "four"
    """four: the thesis's squares, A on +x, B on +y, C on -x, D on -y. three: A at 270°, B at 30°,
    C at 150°. ring: any number of electrodes of any shape."""
    count: Annotated[
        int | None, Key("electrodes", (1, 25), needs=("layout", "ring"), example=6)
    ] = None
    """Number of electrodes on the ring, by default 4."""
    ring_radius_mm: Annotated[float, SIZE] = 10.0
    """Distance from the film's centre to the centres of the electrodes."""
    first_angle_deg: Annotated[
        float | None, Key("degrees", (-3600.0, 3600.0), needs=("layout", "ring"), example=45.0)
    ] = None
    """Angle from +x to A, by default 0."""
    centre: Annotated[bool, Key(needs=("layout", "ring"))] = False
    """true: there is one more electrode, the last one, at the film's centre."""

    @model_validator(mode="after")
    def _reject_shape_in_thesis_layout(self) -> Self:
        """Refuse shapes other than squares in the thesis's layouts."""
        if self.layout != "ring" and self.shape != "square":
            reason = 'requires layout = "ring"; remove it or change layout'
            raise make_validation_error(reason, key="shape", value=self.shape)
        return self

    @cached_property
    def electrodes(self) -> tuple[Electrode, ...]:
        """The electrodes on the ring, counter-clockwise, then the one at the centre if any."""
        count = self.count or 4
        first_deg = self.first_angle_deg or 0.0
        if self.layout == "three":
            count = 3
            first_deg = 270.0
        angles_deg = first_deg + 360.0 * np.arange(count) / count
        centres_mm = [rotate([self.ring_radius_mm, 0.0], angle) for angle in angles_deg]
        if self.centre:
            centres_mm.append(np.zeros(2))
        # there are more letters than electrodes
        return tuple(
            Electrode.model_validate(
                {"name": name, "x_mm": float(x), "y_mm": float(y), "shape": self.geometry}
            )
            for name, (x, y) in zip(ascii_uppercase, centres_mm, strict=False)
        )

    @classmethod
    def list_common_keys(cls) -> set[str]:
        """Return the names of the keys, other than ``shape``, that every ``layout`` may have."""
        own = {name for name in cls.model_fields if cls.key_of(name).needs is None}
        return own - {"geometry"} | set(cls.shapes[cls.default_shape].list_sizes())


Electrodes: TypeAlias = Annotated[
    Annotated[Layout, Tag("<table>")]
    | Annotated[tuple[Electrode, ...], Field(min_length=1, max_length=100), Tag("<list>")],
    Discriminator(tag_table_or_list),
]

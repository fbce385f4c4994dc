"""What is special to the report on the thesis: numbers in texts, effects left out, and shear.

    pvdf-fem report reports/thesis/report.toml --kinds reports/thesis/special.py

Texts are CSV files beside this one, with places for numbers in braces. Each function of `NUMBERS`
gives some of the numbers, from what the thesis prints and from the charges of scenes.
"""

from __future__ import annotations

import math
import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd
from markupsafe import Markup, escape
from pydantic import Field

from pvdf_fem import Scene, modes, respond, solve
from pvdf_fem.derivatives.rates import force_rates
from pvdf_fem.output.figures import COLOURS, GREY, new_figure
from pvdf_fem.reporting.data import Changes
from pvdf_fem.reporting.drawing import RING, WIDTH_MM, signed
from pvdf_fem.reporting.kind import PLACE, Content, Inputs, Kind
from pvdf_fem.reporting.solved import Solved
from pvdf_fem.scene.quantity import Section
from pvdf_fem.scene.scene import Replaced
from pvdf_fem.scene.scene_file import SceneError

HERE = Path(__file__).parent
#: Places of section 3.1.2, beside electrode A, on a part and on the whole of A, and of 3.4.3.
BESIDE, ON_PART, ON_WHOLE, NEAR = (
    dict(zip(PLACE, place_mm, strict=True))
    for place_mm in ((5.0714, 0.8757), (6.0, 0.0), (10.0, 0.0), (2.0, 12.0**0.5 - 10.0))
)
RECTANGLE = {"shape": "rectangle", "width_mm": 14.0, "height_mm": 7.0}
PRINTED_TOLERANCE = 3e-4  #: Of scenes beside printed numbers.
EFFECT_TOLERANCE = 1e-4  #: A small part of the smallest effect.
NOISE = 0.01  #: Relative standard deviation of a charge.
EXCITATION_HZ = 20.0
LINK = r"\[([^]]+)\]\(([^)]+)\)"
Numbers = dict[str, Any]


class Charges:
    """Charges of scenes, NaN while the scenes are collected."""

    def __init__(self, inputs: Inputs, solved: Solved | None = None) -> None:
        precise = {"electrodes.layout": "four", "numerics.tolerance": PRINTED_TOLERANCE}
        self.base, self.solved, self.inputs = inputs.scene.with_(**precise), solved, inputs
        self.scenes: list[Scene] = []

    def of(self, changes: Changes, reading: str = "total") -> dict[str, float]:
        """Charges in pC of the thesis's scene of four electrodes with changes."""
        scene = self.scene(changes)
        names = [electrode.name for electrode in scene.electrode_list]
        try:
            scene.require_plain_charges("records of sweeps")
            self.scenes.append(scene)
        except SceneError:
            return dict.fromkeys(names, math.nan) if self.solved is None else _changes_pC(scene)
        if self.solved is None:
            return dict.fromkeys(names, math.nan)
        values = self.solved.charges([scene], names, reading)[0].tolist()
        return dict(zip(names, values, strict=True))

    def scene(self, changes: Changes) -> Scene:
        """The scene of four electrodes with changes, coarse in a preview."""
        return replace(self.inputs, scene=self.base).scene_of(changes)


@cache
def _changes_pC(scene: Scene) -> dict[str, float]:
    return solve(scene).charge_changes_pC


def _contact(charges: Charges) -> Numbers:
    """Contrast of A over B in percent, by how the centred rectangle presses, and of a sphere 1 mm
    off the centre; charges are the area's."""
    area = {"probe": RECTANGLE, "numerics.observable": "material"}
    rigid = [{"load.kind": "rigid", "load.contact": of} for of in ("sliding", "stuck")]
    found = [_contrast(charges.of({**area, **way})) for way in ({}, *rigid)]
    sphere = {"shape": "sphere", "radius_mm": 5.0, "x_mm": 1.0}
    load = Replaced({"kind": "contact", "force_N": 1.0})
    beside = _contrast(charges.of({**area, "probe": Replaced(sphere), "load": load}))
    return {"contrast": found, "faked_mm": abs(found[0] / beside)}


def _contrast(charges: dict[str, float]) -> float:
    return 100.0 * (charges["A"] / charges["B"] - 1.0)


def _plates(charges: Charges) -> Numbers:
    """Charges of A, B and C at 1 N and the place of section 3.4.3: plate of 1 mm, film of 25 µm."""
    place = {**NEAR, "electrodes.layout": "three"}
    plate = {"film.thickness_um": 1000.0, "film.bending": True}
    return {
        "plate": [*charges.of({**place, **plate}).values()],
        "thin": [*charges.of(place).values()],
    }


def _heat(charges: Charges) -> Numbers:
    """Charge of A in percent by a finger 10 K warmer than the film: after 1 s on the whole of A, on
    a part of A and beside A, and after 10 ms beside A."""
    finger = {"probe.temperature_K": 10.0, "film.pyroelectric_uC_m2K": -25.0}
    cases = [(ON_WHOLE, 1.0), (ON_PART, 1.0), (BESIDE, 1.0), (BESIDE, 0.01)]
    percents = [
        _percents(charges, place, {**finger, "probe.contact_time_s": seconds})
        for place, seconds in cases
    ]
    return {"heat": [signed(of[0], 0 if i < 3 else 1) for i, of in enumerate(percents)]}


def _percents(
    charges: Charges, place: Changes, keys: Changes, film: Changes | None = None
) -> list[float]:
    """Percent by which keys change the charges of the triangle at a place; as changes by the touch,
    which a zeroed amplifier reads."""
    plain = {**place, "numerics.observable": "material", "numerics.tolerance": EFFECT_TOLERANCE}
    plain |= film or {}
    before, after = (charges.of({**plain, **more}, "change") for more in ({}, keys))
    return [100.0 * (after[name] / before[name] - 1.0) for name in before]


def _air(charges: Charges) -> Numbers:
    """First modes in Hz of the untouched film in a vacuum, in free air and with a baffle, and with
    the baffle under 1 N; and excess in percent of a charge at 20 Hz then."""
    keys = {**BESIDE, "load.kind": "dead", "numerics.observable": "material"}
    keys["numerics.tolerance"] = 1e-3
    charges.of(keys)  # so that this waits for its turn
    if charges.solved is None:
        return {}
    air = [charges.scene({**keys, "air": {"baffle": is_in}}) for is_in in (False, True)]
    found = [modes(scene, count=1, loaded=False) for scene in air]
    found.append(modes(air[1], count=1, loaded=True))
    ratio = np.abs([*respond(air[1], [0.0, EXCITATION_HZ]).charges_pC_N.values()])
    first = [float(np.asarray(result.frequencies_in_air_Hz)[0]) for result in found]
    excess = 100.0 * float((ratio[:, 1] / ratio[:, 0] - 1.0).max())
    return {"modes": [found[0].frequencies_Hz[0], *first], "excess": excess}


def _shear(charges: Charges) -> Numbers:
    """Deviations in N of the tangential force, root mean square of x and y, under the triangle of
    section 3.1.2 and 1 N: of four electrodes with the place known, of eight with it unknown."""
    ring = {"layout": "ring", "shape": "square", "ring_radius_mm": 10.0, "side_mm": 3.0}
    keys = ("load.force_N", "load.tangential_N[0]", "load.tangential_N[1]", *PLACE)
    found = []
    for count, unknowns in ((4, 3), (8, 5)):
        touch = {"electrodes": Replaced({**ring, "count": count}), **BESIDE}
        touch["load"] = Replaced({"force_N": 1.0, "tangential_N": [0.0, 0.0]})
        touch["numerics"] = Replaced({})
        known = np.array([*charges.of(touch).values()])
        if charges.solved is None:
            continue
        rates = force_rates(solve(charges.scenes[-1]), keys[:unknowns]) @ [8.0, 8.0]
        slopes = rates.T / (NOISE * known[:, None])
        found.append(np.sqrt(np.diag(np.linalg.inv(slopes.T @ slopes)))[1:3].tolist())
    return {"shear": found}


NUMBERS = {of.__name__[1:]: of for of in (_contact, _plates, _heat, _air, _shear)}


class Told(Kind):
    """The table of the texts in a file, with the numbers of some functions in their places."""

    kind: Literal["told"]
    file: str
    numbers: tuple[Literal["contact", "plates", "heat", "air", "shear"], ...] = ()

    def scenes(self, inputs: Inputs) -> list[Scene]:
        """The scenes of the numbers."""
        return self._asked(inputs)[1].scenes

    def compose(self, inputs: Inputs, solved: Solved) -> Content:
        """Numbers in their places, and links."""
        numbers, _ = self._asked(inputs, solved)
        texts = pd.read_csv(HERE / self.file, dtype=str, keep_default_na=False)
        filled = texts.map(lambda text: text.format(**numbers))
        plain = filled.replace(LINK, r"\1", regex=True)
        return Content("", plain, shown=filled.map(_linked))

    def _asked(self, inputs: Inputs, solved: Solved | None = None) -> tuple[Numbers, Charges]:
        charges, found = Charges(inputs, solved), Numbers()
        for name in self.numbers:
            found |= NUMBERS[name](charges)
        return found, charges


class Effect(Section):
    """Keys in `set`, and keys in `film` of both scenes, with the effect and without."""

    name: str
    set: Changes
    film: Changes = Field(default_factory=dict)


class Effects(Kind):
    """How much each of some effects changes the charges of a touch, beside A and on a part of A."""

    kind: Literal["effects"]
    effects: tuple[Effect, ...]
    stated_percent: float

    stem = "effects"

    def scenes(self, inputs: Inputs) -> list[Scene]:
        """Two scenes for each effect and place."""
        charges = Charges(inputs)
        self._percents(charges)
        return charges.scenes

    def _percents(self, charges: Charges) -> pd.DataFrame:
        places = {"beside A": BESIDE, "on a part of A": ON_PART}
        rows = [
            (where, effect.name, *_percents(charges, place, effect.set, effect.film))
            for where, place in places.items()
            for effect in self.effects
        ]
        return pd.DataFrame(rows, columns=["probe", "effect", *(f"{n}_percent" for n in "ABCD")])

    def compose(self, inputs: Inputs, solved: Solved) -> Content:
        """Bars and rings of the largest changes."""
        frame = self._percents(Charges(inputs, solved))
        figure = new_figure(WIDTH_MM, 8.0 * len(self.effects) + 24.0)
        ax = figure.subplots()
        names, largest = frame.effect, frame.iloc[:, 2:].abs().max(axis=1)
        first, ring = len(self.effects), {**RING, "markeredgecolor": COLOURS[1], "zorder": 3}
        bars: dict[str, Any] = {"color": COLOURS[0], "height": 0.6, "zorder": 2}
        ax.barh(names[:first], largest[:first], **bars, label="probe beside A")
        ax.plot(largest[first:], names[first:], **ring, label="probe on a part of A")
        ax.axvline(self.stated_percent, color=GREY, linestyle="--", linewidth=0.8)
        ax.set(xscale="log", xlabel="largest change of a charge (%)")
        ax.invert_yaxis()
        figure.legend(loc="outside upper left", ncols=2)
        caption = (
            f"Dashed: the {self.stated_percent:g} % between theory and experiment that the thesis "
            "states. Charges are changes by the touch, of the electrodes' area."
        )
        return Content(caption, frame, figure)


def _linked(text: str) -> str:
    """A text whose [words](#place) are links."""
    return Markup(re.sub(LINK, r'<a href="\2">\1</a>', str(escape(text))))

"""What is special to the report on the thesis: numbers in texts, effects left out, and shear.

    pvdf-fem report reports/thesis/report.toml --kinds reports/thesis/special.py

Texts are CSV files beside this one, with places for numbers in braces, which `NUMBERS` fills.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd
from markupsafe import Markup, escape
from pydantic import Field

from pvdf_fem import Scene, modes, respond, solve
from pvdf_fem.report.data import Changes
from pvdf_fem.report.kind import PLACE, Content, Inputs, Kind
from pvdf_fem.report.results import ReportResults
from pvdf_fem.report.task import Rows, Task
from pvdf_fem.scene.keys import Section
from pvdf_fem.scene.scene import Replaced
from pvdf_fem.solver.sensitivity.rates import compute_integral_rates
from pvdf_fem.view.curves import RING
from pvdf_fem.view.figures import COLOURS, GREY, WIDTH_MM, make_figure
from pvdf_fem.view.labels import format_signed

HERE = Path(__file__).parent
#: Places of section 3.1.2, beside electrode A, on a part and on the whole of A, and of 3.4.3.
BESIDE, ON_PART, ON_WHOLE, NEAR = (
    dict(zip(PLACE, place_mm, strict=True))
    for place_mm in ((5.0714, 0.8757), (6.0, 0.0), (10.0, 0.0), (2.0, 12.0**0.5 - 10.0))
)
PRINTED_TOLERANCE = 3e-4  #: Of scenes beside printed numbers.
#: Charges of areas, to a small part of the smallest effect.
EFFECT = {"numerics.observable": "material", "numerics.tolerance": 1e-4}
#: The centred rectangle, charges of areas, and what presses: pressure, rigid plates, a sphere.
AREA = {
    "probe": {"shape": "rectangle", "width_mm": 14.0, "height_mm": 7.0},
    "numerics.observable": "material",
}
SPHERE = Replaced({"shape": "sphere", "radius_mm": 5.0, "x_mm": 1.0})
PRESSED: tuple[Changes, ...] = (
    {},
    {"load.kind": "rigid", "load.contact": "sliding"},
    {"load.kind": "rigid", "load.contact": "stuck"},
    {"probe": SPHERE, "load": Replaced({"kind": "contact", "force_N": 1.0})},
)
NEAR |= {"electrodes.layout": "three", "film.bending": True}
HEATED = ((ON_WHOLE, 1.0), (ON_PART, 1.0), (BESIDE, 1.0), (BESIDE, 0.01))
VIBRATING = {**EFFECT, "numerics.tolerance": 1e-3, "load.kind": "dead", "air": {"baffle": True}}
SHEARED = ("load.force_N", "load.tangential_N[0]", "load.tangential_N[1]", *PLACE)
NOISE = 0.01  #: Relative standard deviation of a charge.
EXCITATION_HZ = 20.0
LINK = r"\[([^]]+)\]\(([^)]+)\)"
Numbers = dict[str, Any]


@dataclass(frozen=True)
class Touch(Task):
    """Charges in pC of a touch by electrode, and their changes by the touch."""

    scene: Scene

    def run(self) -> Rows:
        """One row."""
        solution = solve(self.scene)
        return [{"total": solution.charges_pC, "change": solution.charge_changes_pC}]


class Rates(Touch):
    """Charges in pC of a touch, and their rates by the force, and the place, of the touch."""

    def run(self) -> Rows:
        """A row for each electrode; rates are per unit of `SHEARED`."""
        solution = solve(self.scene)
        rates = compute_integral_rates(solution, SHEARED) @ [8.0, 8.0]
        pairs = zip(solution.charges_pC.values(), rates.T.tolist(), strict=True)
        return [{"charge_pC": charge, "rates": of} for charge, of in pairs]


class FirstModes(Touch):
    """First modes in Hz of a film with a baffle, and the excess in percent of a charge at 20 Hz."""

    def run(self) -> Rows:
        """One row: without a load in a vacuum, in free air and with the baffle, and under the load
        with the baffle."""
        free = self.scene.with_(air={"baffle": False})
        found = [modes(scene, count=1, loaded=False) for scene in (free, self.scene)]
        found.append(modes(self.scene, count=1, loaded=True))
        charges = respond(self.scene, [0.0, EXCITATION_HZ]).charges_pC_N
        ratio = np.abs([*charges.values()])
        first = [float(np.asarray(result.frequencies_in_air_Hz)[0]) for result in found]
        excess = 100.0 * float((ratio[:, 1] / ratio[:, 0] - 1.0).max())
        return [{"modes": [float(found[0].frequencies_Hz[0]), *first], "excess": excess}]


def _contact(*touches: Rows) -> Numbers:
    """Contrast of A over B in percent, by how the centred rectangle presses, and of a sphere 1 mm
    off the centre."""
    *found, beside = (100.0 * (row["total"]["A"] / row["total"]["B"] - 1.0) for [row] in touches)
    return {"contrast": found, "faked_mm": abs(found[0] / beside)}


def _plates(*touches: Rows) -> Numbers:
    """Charges of A, B and C at 1 N and the place of section 3.4.3: plate of 1 mm, film of 25 µm."""
    plate, thin = ([*row["total"].values()] for [row] in touches)
    return {"plate": plate, "thin": thin}


def _heat(*touches: Rows) -> Numbers:
    """Charge of A in percent by a finger 10 K warmer than the film: after 1 s on the whole of A, on
    a part of A and beside A, and after 10 ms beside A."""
    percents = [_percents(*touches[i : i + 2])[0] for i in range(0, len(touches), 2)]
    return {"heat": [format_signed(of, 0 if i < 3 else 1) for i, of in enumerate(percents)]}


def _percents(before: Rows, after: Rows) -> list[float]:
    """Percent by which charges differ, as changes by the touch, which a zeroed amplifier reads."""
    pairs = zip(before[0]["change"].values(), after[0]["change"].values(), strict=True)
    return [100.0 * (changed / plain - 1.0) for plain, changed in pairs]


def _shear(*touches: Rows) -> Numbers:
    """Deviations in N of the tangential force, root mean square of x and y: of four electrodes with
    the place known, of eight with it unknown."""
    found = []
    for rows, unknowns in zip(touches, (3, 5), strict=True):
        slopes = np.array([np.divide(row["rates"], NOISE * row["charge_pC"]) for row in rows])
        information = slopes[:, :unknowns].T @ slopes[:, :unknowns]
        found.append(np.sqrt(np.diag(np.linalg.inv(information)))[1:3].tolist())
    return {"shear": found}


def _heated(place: Changes, seconds: float) -> tuple[Changes, Changes]:
    finger = {"temperature_K": 10.0, "contact_time_s": seconds}
    warm = {f"probe.{key}": value for key, value in finger.items()}
    return {**EFFECT, **place}, {**EFFECT, **place, **warm, "film.pyroelectric_uC_m2K": -25.0}


def _ring(count: int) -> Changes:
    ring = {"layout": "ring", "shape": "square", "ring_radius_mm": 10.0, "side_mm": 3.0}
    load = Replaced({"force_N": 1.0, "tangential_N": [0.0, 0.0]})
    electrodes = Replaced({**ring, "count": count})
    return {"electrodes": electrodes, **BESIDE, "load": load, "numerics": Replaced({})}


#: Numbers of texts: what is computed of each of some scenes, and the numbers that it gives.
NUMBERS: dict[str, tuple[type[Touch], Sequence[Changes], Callable[..., Numbers]]] = {
    "contact": (Touch, [{**AREA, **way} for way in PRESSED], _contact),
    "plates": (Touch, [{**NEAR, "film.thickness_um": 1000.0}, NEAR], _plates),
    "heat": (Touch, [of for case in HEATED for of in _heated(*case)], _heat),
    "air": (FirstModes, [{**BESIDE, **VIBRATING}], lambda rows: dict(*rows)),
    "shear": (Rates, [_ring(4), _ring(8)], _shear),
}


def scene_of(inputs: Inputs, changes: Changes) -> Scene:
    """The thesis's scene of four electrodes with changes, coarse in a preview."""
    precise = {"electrodes.layout": "four", "numerics.tolerance": PRINTED_TOLERANCE}
    return replace(inputs, scene=inputs.scene.with_(**precise)).change_scene(changes)


class Told(Kind):
    """The table of the texts in a file, with some numbers in their places."""

    kind: Literal["told"]
    file: str
    numbers: tuple[Literal["contact", "plates", "heat", "air", "shear"], ...] = ()

    def list_tasks(self, inputs: Inputs) -> list[Task]:
        """What the numbers need."""
        return [task for name in self.numbers for task in self._of(name, inputs)]

    def _of(self, name: str, inputs: Inputs) -> list[Task]:
        kind, scenes, _ = NUMBERS[name]
        return [kind(scene_of(inputs, changes)) for changes in scenes]

    def compose(self, inputs: Inputs, results: ReportResults) -> Content:
        """Numbers in their places, and links."""
        numbers: Numbers = {}
        for name in self.numbers:
            numbers |= NUMBERS[name][-1](*map(results.get_rows, self._of(name, inputs)))
        texts = pd.read_csv(HERE / self.file, dtype=str, keep_default_na=False)
        filled = texts.map(lambda text: text.format(**numbers))
        plain = filled.replace(LINK, r"\1", regex=True)
        return Content("", plain, table=filled.map(_linked))


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

    def list_tasks(self, inputs: Inputs) -> list[Task]:
        """Two touches for each effect and place."""
        return [task for _, _, pair in self._pairs(inputs) for task in pair]

    def _pairs(self, inputs: Inputs) -> Iterator[tuple[str, str, list[Touch]]]:
        """A place and an effect, with the touches without the effect and with it."""
        for where, place in {"beside A": BESIDE, "on a part of A": ON_PART}.items():
            for effect in self.effects:
                plain = {**EFFECT, **place, **effect.film}
                both = (plain, {**plain, **effect.set})
                yield where, effect.name, [Touch(scene_of(inputs, changes)) for changes in both]

    def compose(self, inputs: Inputs, results: ReportResults) -> Content:
        """Dots and rings of the largest changes."""
        rows = [
            (where, name, *_percents(*map(results.get_rows, pair)))
            for where, name, pair in self._pairs(inputs)
        ]
        frame = pd.DataFrame(rows, columns=["probe", "effect", *(f"{n}_percent" for n in "ABCD")])
        figure = make_figure(WIDTH_MM, 8.0 * len(self.effects) + 24.0)
        ax = figure.subplots()
        names, largest = frame.effect, frame.iloc[:, 2:].abs().max(axis=1)
        first, ring = len(self.effects), {**RING, "markeredgecolor": COLOURS[1], "zorder": 3}
        ax.plot(largest[:first], names[:first], "o", label="probe beside A")
        ax.plot(largest[first:], names[first:], **ring, label="probe on a part of A")
        ax.axvline(self.stated_percent, color=GREY, linestyle="--", linewidth=0.8)
        ax.set(xscale="log", xlabel="largest change of a charge (%)")
        ax.xaxis.set_major_formatter("{x:g}")
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

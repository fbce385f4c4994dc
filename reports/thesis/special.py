"""Kinds of the report on the thesis: texts with computed numbers, and effects it neglects.

    pvdf-fem report reports/thesis/report.toml --kinds reports/thesis/special.py

The texts are CSV files beside this one. `NUMBERS` computes the numbers for the places in braces.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
import pandas as pd
from markupsafe import Markup, escape
from matplotlib.axes import Axes
from pydantic import Field

from pvdf_fem import Scene, modes, respond, solve
from pvdf_fem.report.data import Changes
from pvdf_fem.report.kind import Content, FigureKind, Inputs, Kind
from pvdf_fem.report.results import ReportResults
from pvdf_fem.report.task import Rows, Task
from pvdf_fem.scene.keys import Section
from pvdf_fem.scene.scene import Replaced
from pvdf_fem.solver.sensitivity.rates import differentiate_stress_integrals
from pvdf_fem.view.curves import RING
from pvdf_fem.view.figures import COLOURS, GREY, WIDTH_MM, get_figure, make_figure
from pvdf_fem.view.labels import format_signed

HERE = Path(__file__).parent

# Places of the probe.
BESIDE_A: Changes = {"probe.x_mm": 5.0714, "probe.y_mm": 0.8757}  #: Section 3.1.2.
ON_PART_OF_A: Changes = {"probe.x_mm": 6.0, "probe.y_mm": 0.0}
ON_WHOLE_OF_A: Changes = {"probe.x_mm": 10.0, "probe.y_mm": 0.0}
NEAR_A: Changes = {"probe.x_mm": 2.0, "probe.y_mm": 12.0**0.5 - 10.0}  #: Section 3.4.3.

D_PC_N = 8.0  #: d31 and d32 of the thesis's film in pC/N.
SIGMA = 0.01  #: Relative standard deviation of a charge.
EXCITATION_HZ = 20.0
PRINTED_TOLERANCE = 3e-4  #: Tolerance of charges that stand beside printed numbers.
#: Charges of the electrodes' areas, to a small part of the smallest effect.
PRECISE: Changes = {"numerics.observable": "material", "numerics.tolerance": 1e-4}
#: A link in a text: [words](#place).
LINK = r"\[([^]]+)\]\(([^)]+)\)"
#: Numbers by name, as texts refer to them.
Numbers = dict[str, Any]


@dataclass(frozen=True)
class Charges(Task):
    """Charges of a probe load in pC, in total and as changes by the touch."""

    scene: Scene

    def run(self) -> Rows:
        """Return one row, of charges by electrode."""
        solution = solve(self.scene)
        return [{"total": solution.charges_pC, "change": solution.charge_changes_pC}]


class ChargeRates(Charges):
    """Charges of a probe load in pC, and their derivatives by its force and place."""

    #: Force across the film and along it, and the place.
    KEYS: ClassVar[tuple[str, ...]] = (
        "load.force_N",
        "load.tangential_N[0]",
        "load.tangential_N[1]",
        "probe.x_mm",
        "probe.y_mm",
    )

    def run(self) -> Rows:
        """Return a row for each electrode, with the derivatives by `KEYS`."""
        solution = solve(self.scene)
        rates = differentiate_stress_integrals(solution, self.KEYS) @ [D_PC_N, D_PC_N]
        rows = []
        for charge, row in zip(solution.charges_pC.values(), rates.T.tolist(), strict=True):
            rows.append({"charge_pC": charge, "rates": row})
        return rows


class FirstModes(Charges):
    """The first modes of a film with a baffle, and the dynamic excess of its charges."""

    def run(self) -> Rows:
        """Return one row.

        ``modes`` has frequencies in Hz: without a load in a vacuum, in free air and with the
        baffle; and under the load with the baffle. ``excess`` is the largest relative difference
        of a charge at `EXCITATION_HZ` from the static charge, in percent.
        """
        free_air = modes(self.scene.with_(air={"baffle": False}), count=1, loaded=False)
        baffle = modes(self.scene, count=1, loaded=False)
        loaded = modes(self.scene, count=1, loaded=True)
        frequencies = [float(free_air.frequencies_Hz[0])]
        for result in (free_air, baffle, loaded):
            frequencies.append(float(np.asarray(result.frequencies_in_air_Hz)[0]))
        charges = respond(self.scene, [0.0, EXCITATION_HZ]).charges_pC_N
        amplitudes = np.abs(list(charges.values()))
        excess = 100.0 * float((amplitudes[:, 1] / amplitudes[:, 0] - 1.0).max())
        return [{"modes": frequencies, "excess": excess}]


def compute_contact_numbers(results: Sequence[Rows]) -> Numbers:
    """Compute how much larger the charge of A is than that of B.

    Parameters
    ----------
    results : sequence of rows
        Charges of the centred rectangle under a pressure, as a sliding and a sticking rigid plate,
        and of a sphere 1 mm beside the centre.

    Returns
    -------
    dict
        ``contrast``: the contrasts A/B - 1 of the rectangle in percent. ``faked_mm``: the distance
        from the centre at which the sphere has the contrast under a pressure.
    """
    contrasts = []
    for rows in results:
        charges = rows[0]["total"]
        contrasts.append(100.0 * (charges["A"] / charges["B"] - 1.0))
    *plates, sphere = contrasts
    return {"contrast": plates, "faked_mm": abs(plates[0] / sphere)}


def compute_plate_numbers(results: Sequence[Rows]) -> Numbers:
    """Return the charges of A, B and C in pC of a 1 mm plate and of a 25 µm film."""
    plate, thin = results
    return {
        "plate": list(plate[0]["total"].values()),
        "thin": list(thin[0]["total"].values()),
    }


def compute_heat_numbers(results: Sequence[Rows]) -> Numbers:
    """Compute how much a warm finger changes the charge of A.

    Parameters
    ----------
    results : sequence of rows
        Pairs of charges with a finger of the film's temperature and with a warmer one.

    Returns
    -------
    dict
        ``heat``: the changes in percent, as texts.
    """
    texts: list[str] = []
    for cold, warm in zip(results[::2], results[1::2], strict=True):
        percent, *_ = compare_charges(cold, warm)
        is_first_second = len(texts) < 3  # the last pair is of the first 10 ms
        texts.append(format_signed(percent, 0 if is_first_second else 1))
    return {"heat": texts}


def compare_charges(before: Rows, after: Rows) -> list[float]:
    """Return the differences of charges in percent, as a zeroed amplifier reads them."""
    percents = []
    for name, charge in before[0]["change"].items():
        percents.append(100.0 * (after[0]["change"][name] / charge - 1.0))
    return percents


def compute_shear_numbers(results: Sequence[Rows]) -> Numbers:
    """Compute how well a force along the film is found from noisy charges.

    Parameters
    ----------
    results : sequence of rows
        Charges with their rates of four electrodes, where the place is known, and of eight, where
        it is not.

    Returns
    -------
    dict
        ``shear``: standard deviations in N of the force along x and y for both.

    Notes
    -----
    The covariance is the inverse of the Fisher information JᵀJ, where J are the derivatives of the
    charges over their standard deviations.
    """
    deviations = []
    for rows, unknowns in zip(results, (3, 5), strict=True):
        slopes = []
        for row in rows:
            slopes.append(np.array(row["rates"][:unknowns]) / (SIGMA * row["charge_pC"]))
        information = np.transpose(slopes) @ np.array(slopes)
        covariance = np.linalg.inv(information)
        deviations.append(np.sqrt(np.diag(covariance))[1:3].tolist())
    return {"shear": deviations}


def get_air_numbers(results: Sequence[Rows]) -> Numbers:
    """Return the row of `FirstModes`."""
    [rows] = results
    return rows[0]


def list_contact_changes() -> list[Changes]:
    """Return the scenes of `compute_contact_numbers`."""
    rectangle: Changes = {
        "probe": {"shape": "rectangle", "width_mm": 14.0, "height_mm": 7.0},
        "numerics.observable": "material",
    }
    return [
        rectangle,
        {**rectangle, "load.kind": "rigid", "load.contact": "sliding"},
        {**rectangle, "load.kind": "rigid", "load.contact": "stuck"},
        {
            **rectangle,
            "probe": Replaced({"shape": "sphere", "radius_mm": 5.0, "x_mm": 1.0}),
            "load": Replaced({"kind": "contact", "force_N": 1.0}),
        },
    ]


def list_plate_changes() -> list[Changes]:
    """Return the scenes of `compute_plate_numbers`."""
    thin: Changes = {**NEAR_A, "electrodes.layout": "three", "film.bending": True}
    return [{**thin, "film.thickness_um": 1000.0}, thin]


def list_heat_changes() -> list[Changes]:
    """Return the scenes of `compute_heat_numbers`."""
    changes: list[Changes] = []
    cases = ((ON_WHOLE_OF_A, 1.0), (ON_PART_OF_A, 1.0), (BESIDE_A, 1.0), (BESIDE_A, 0.01))
    for place, seconds in cases:
        cold = {**PRECISE, **place}
        changes.append(cold)
        changes.append(
            {
                **cold,
                "probe.temperature_K": 10.0,
                "probe.contact_time_s": seconds,
                "film.pyroelectric_uC_m2K": -25.0,
            }
        )
    return changes


def list_air_changes() -> list[Changes]:
    """Return the scene of `FirstModes`."""
    return [
        {
            **BESIDE_A,
            **PRECISE,
            "numerics.tolerance": 1e-3,
            "load.kind": "dead",
            "air": {"baffle": True},
        }
    ]


def list_shear_changes() -> list[Changes]:
    """Return the scenes of `compute_shear_numbers`."""
    changes: list[Changes] = []
    for count in (4, 8):
        electrodes = {
            "layout": "ring",
            "shape": "square",
            "ring_radius_mm": 10.0,
            "side_mm": 3.0,
            "count": count,
        }
        changes.append(
            {
                "electrodes": Replaced(electrodes),
                **BESIDE_A,
                "load": Replaced({"force_N": 1.0, "tangential_N": [0.0, 0.0]}),
                "numerics": Replaced({}),
            }
        )
    return changes


@dataclass(frozen=True)
class NumberGroup:
    """Numbers of a text: the scenes, their tasks, and how numbers follow from the rows."""

    list_changes: Callable[[], list[Changes]]
    task: type[Charges]
    compute: Callable[[Sequence[Rows]], Numbers]


NUMBERS: Mapping[str, NumberGroup] = {
    "contact": NumberGroup(list_contact_changes, Charges, compute_contact_numbers),
    "plates": NumberGroup(list_plate_changes, Charges, compute_plate_numbers),
    "heat": NumberGroup(list_heat_changes, Charges, compute_heat_numbers),
    "air": NumberGroup(list_air_changes, FirstModes, get_air_numbers),
    "shear": NumberGroup(list_shear_changes, ChargeRates, compute_shear_numbers),
}


def make_scene(inputs: Inputs, changes: Changes) -> Scene:
    """Return the thesis's scene of four electrodes with changes, coarse in a preview."""
    four = inputs.scene.with_(
        **{"electrodes.layout": "four", "numerics.tolerance": PRINTED_TOLERANCE}
    )
    return replace(inputs, scene=four).change_scene(changes)


class Texts(Kind):
    """A table of the texts in a CSV file, with computed `numbers` in the places in braces."""

    kind: Literal["texts"]
    file: str
    numbers: tuple[Literal["contact", "plates", "heat", "air", "shear"], ...] = ()

    def list_tasks(self, inputs: Inputs) -> list[Task]:
        """Return the tasks of all numbers."""
        tasks: list[Task] = []
        for name in self.numbers:
            tasks += _list_group_tasks(name, inputs)
        return tasks

    def collect_data(self, inputs: Inputs, results: ReportResults) -> pd.DataFrame:
        """Return the texts with their numbers, and with links."""
        numbers: Numbers = {}
        for name in self.numbers:
            rows = [results.get_rows(task) for task in _list_group_tasks(name, inputs)]
            numbers |= NUMBERS[name].compute(rows)
        texts = pd.read_csv(HERE / self.file, dtype=str, keep_default_na=False)
        return texts.map(lambda text: text.format(**numbers))

    def compose(self, inputs: Inputs, results: ReportResults) -> Content:
        """Return the table, and texts without links for the CSV file."""
        content = super().compose(inputs, results)
        return replace(content, frame=content.frame.replace(LINK, r"\1", regex=True))

    def make_caption(self, data: pd.DataFrame) -> str:
        """Return no text."""
        return ""

    def make_table(self, data: pd.DataFrame) -> pd.DataFrame:
        """Return the texts with links as HTML."""
        return data.map(_format_links)


def _list_group_tasks(name: str, inputs: Inputs) -> list[Charges]:
    """Return the tasks of a group of numbers, in the order of its scenes."""
    group = NUMBERS[name]
    return [group.task(make_scene(inputs, changes)) for changes in group.list_changes()]


def _format_links(text: str) -> Markup:
    """Return a text as HTML, its [words](#place) as links."""
    return Markup(re.sub(LINK, r'<a href="\2">\1</a>', str(escape(text))))


class Effect(Section):
    """An effect: keys in `set` that switch it on, and keys in `film` with and without it."""

    name: str
    set: Changes
    film: Changes = Field(default_factory=dict)


@dataclass(frozen=True)
class EffectCase:
    """The charges of a probe at a place, without and with an effect."""

    place: str
    effect: str
    without: Charges
    including: Charges


class Effects(FigureKind):
    """How much each of some effects changes the charges of a touch, beside A and on a part of A."""

    kind: Literal["effects"]
    effects: tuple[Effect, ...]
    stated_percent: float

    stem: ClassVar[str] = "effects"

    def list_tasks(self, inputs: Inputs) -> list[Task]:
        """Return two solves for each place and effect."""
        tasks: list[Task] = []
        for case in self._list_cases(inputs):
            tasks += [case.without, case.including]
        return tasks

    def collect_data(self, inputs: Inputs, results: ReportResults) -> pd.DataFrame:
        """Return the changes of the charges in percent, a row for each place and effect."""
        rows = []
        for case in self._list_cases(inputs):
            without = results.get_rows(case.without)
            including = results.get_rows(case.including)
            percents = compare_charges(without, including)
            rows.append((case.place, case.effect, *percents))
        columns = ["probe", "effect", "A_percent", "B_percent", "C_percent", "D_percent"]
        return pd.DataFrame(rows, columns=columns)

    def make_axes(self, data: pd.DataFrame) -> Axes:
        """Return axes with a line for each effect."""
        return make_figure(WIDTH_MM, 8.0 * len(self.effects) + 24.0).subplots()

    def draw(self, data: pd.DataFrame, axes: Axes) -> None:
        """Draw the largest changes: dots beside A, and rings on a part of A."""
        largest = data.filter(like="_percent").abs().max(axis=1)
        count = len(self.effects)
        axes.plot(largest[:count], data.effect[:count], "o", label="probe beside A")
        ring = {**RING, "markeredgecolor": COLOURS[1], "zorder": 3}
        axes.plot(largest[count:], data.effect[count:], **ring, label="probe on a part of A")
        axes.axvline(self.stated_percent, color=GREY, linestyle="--", linewidth=0.8)
        axes.set(xscale="log", xlabel="largest change of a charge (%)")
        axes.xaxis.set_major_formatter("{x:g}")
        axes.invert_yaxis()
        get_figure(axes).legend(loc="outside upper left", ncols=2)

    def make_caption(self, data: pd.DataFrame) -> str:
        """Return the meaning of the dashed line and of the charges."""
        return (
            f"Dashed: the difference of {self.stated_percent:g} % between theory and experiment "
            "that the thesis states. Charges are changes by the touch, on the electrodes' areas."
        )

    def _list_cases(self, inputs: Inputs) -> list[EffectCase]:
        """Return the cases, all effects beside A and then all on a part of A."""
        cases = []
        for place, position in (("beside A", BESIDE_A), ("on a part of A", ON_PART_OF_A)):
            for effect in self.effects:
                without = {**PRECISE, **position, **effect.film}
                including = {**without, **effect.set}
                case = EffectCase(
                    place,
                    effect.name,
                    without=Charges(make_scene(inputs, without)),
                    including=Charges(make_scene(inputs, including)),
                )
                cases.append(case)
        return cases

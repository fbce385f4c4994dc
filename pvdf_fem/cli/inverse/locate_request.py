"""What ``pvdf-fem locate`` is asked for, read from its options, and what is wrong with it."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from pvdf_fem.cli.program import find_plot_errors
from pvdf_fem.cli.response_choice import ResponseChoice, parse_number, read_number

if TYPE_CHECKING:
    from pvdf_fem.scene.scene import Scene

#: What may be sought, as on the command line.
NAMES = {"x": "x_mm", "y": "y_mm", "force": "force_N", "rotation": "rotation_deg"}
#: What full solves find besides.
BY_SOLVES = {**NAMES, "tangential": "tangential_N", "temperature": "temperature_K"}
SOUGHT = f"what is sought, of {', '.join(BY_SOLVES)}"


@dataclass(frozen=True)
class Request:
    """What was asked for, read from the options."""

    readings: dict[str, float]  #: By electrode in the unit; none for a table.
    unit: str  #: ``pC`` or ``V``.
    reading: str | None  #: Of `pvdf_fem.inverse.touch.measurement.READINGS`; None is the scene's.
    sigma: float
    noise: float | None  #: In the unit; None is the scene's.
    unknown: tuple[str, ...]  #: Of the quantities of a touch.
    touches: int  #: Number of probes that touch at once.
    model: ResponseChoice  #: The model that is wanted.
    #: What is wrong with the options; the other values count only if nothing is.
    mistakes: tuple[str, ...]

    @classmethod
    def of(cls, options: argparse.Namespace) -> Request:
        """The request of a command line."""
        readings, reading, wrong = {}, options.reading, _misplaced(options)
        for word, text in (("total", options.charges), ("change", options.changes)):
            if text is not None:
                option = "--charges" if word == "total" else "--changes"
                readings, reading = _charges(option, text, wrong), word
        sigma, noise = parse_number("--sigma", options.sigma, wrong, zero=True), options.noise
        if noise is not None:
            noise = parse_number("--noise", noise, wrong, zero=True)
        unknown = parse_unknowns(options.unknown, wrong)
        if needs_solves(options.touches, unknown):
            solves = "is not for --touches 2, --unknown tangential or temperature; leave it out"
            table = options.csv is not None  # which is not for single touches' options either
            used = {"--csv": True} if table else _singles(options)
            wrong += [f"{name}: {solves}" for name, given in used.items() if given]
        wrong += find_plot_errors(options, options.scene)
        if options.plot and not {"x_mm", "y_mm"} <= set(unknown):
            wrong.append("--plot: draws places; have x and y among --unknown")
        model = ResponseChoice.of(options, wrong)
        if options.model and options.others:
            wrong.append("--model: is of one scene; leave it out with --or")
        asked = readings, options.unit, reading, sigma, noise, unknown, options.touches
        return cls(*asked, model, tuple(wrong))

    @property
    def by_solves(self) -> bool:
        """Whether no model of a single touch serves it."""
        return needs_solves(self.touches, self.unknown)

    def readings_pC(self, scene: Scene) -> dict[str, float]:
        """The readings in nominal pC, by electrode."""
        from pvdf_fem.inverse.touch.measurement import get_units_pC

        units = get_units_pC(scene, self.unit)
        return {name: units.get(name, 1.0) * value for name, value in self.readings.items()}

    def noise_pC(self, scene: Scene) -> dict[str, float] | None:
        """The noise in nominal pC, by electrode; None is the noise of the readout."""
        from pvdf_fem.inverse.touch.measurement import get_units_pC

        if self.noise is None:
            return None
        return {name: unit * self.noise for name, unit in get_units_pC(scene, self.unit).items()}


def needs_solves(touches: int, unknown: Sequence[str]) -> bool:
    """Whether no model of a single touch finds that many touches and these unknowns."""
    return touches > 1 or not set(unknown) <= {*NAMES.values()}


def _misplaced(options: argparse.Namespace) -> list[str]:
    """Options that are not for what was given."""
    table, single = options.csv is not None, "is of a table; leave it out, or give --csv"
    wrong = [f"--{name}: {single}" for name in ("quick", "reading") if getattr(options, name)]
    if options.output != "-":
        wrong.append(f"--output: {single}")
    if not table:
        return wrong
    each = _singles(options).items()
    return [f"{name}: is for single touches; leave it out" for name, used in each if used]


def _singles(options: argparse.Namespace) -> dict[str, Any]:
    """Options for single touches, and whether they were given."""
    return {"--or": options.others, "--plot": options.plot}


def _charges(option: str, text: str, mistakes: list[str]) -> dict[str, float]:
    charges: dict[str, float] = {}
    for item in text.split(","):
        name, equals, value = (part.strip() for part in item.partition("="))
        number = read_number(value)
        if not (name and equals) or number is None:
            mistakes.append(f"{option} {item.strip()}: write NAME=CHARGE, such as A=905.1")
        elif name in charges:
            mistakes.append(f"{option} {name}: given twice; remove one")
        else:
            charges[name] = number
    return charges


def parse_unknowns(text: str, mistakes: list[str]) -> tuple[str, ...]:
    """The quantities that are named as sought; what is wrong is added to `mistakes`."""
    known = BY_SOLVES | {name: name for name in BY_SOLVES.values()}
    items = [item.strip() for item in text.split(",")]
    names = ", ".join(BY_SOLVES)
    mistakes += [f"--unknown {item}: choose from {names}" for item in items if item not in known]
    return tuple(dict.fromkeys(known[item] for item in items if item in known))


def check_request(
    scenes: Mapping[str, Scene],
    request: Request,
    readings_pC: Mapping[str, float],
    known: Mapping[str, float],
) -> None:
    """Refuse before anything is built what cannot be located with the scenes."""
    from pvdf_fem.inverse.touch.measurement import (
        find_quantity_errors,
        find_reading_errors,
        get_centre_mm,
    )

    mistakes: list[str] = []
    for name, scene in scenes.items():
        mistakes += find_reading_errors(scene, readings_pC, request.sigma, request.noise_pC(scene))
        if request.unit == "V" and scene.readout is None:
            mistakes.append(f"--unit V: {name} has no [readout]; add one, or give pC")
    for name, scene in scenes.items():
        mistakes += request.model.mistakes(scene, name)
    if not (request.model.file and request.model.file.exists()):
        first = next(iter(scenes.values()))
        (domain, _), centre = request.model.wanted(first), get_centre_mm(first)
        mistakes += find_quantity_errors(domain, request.unknown, {}, known, centre)
    if mistakes:
        raise ValueError("\n".join(dict.fromkeys(mistakes)))

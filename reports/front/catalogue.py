"""All reports that ``./run report NAME`` makes: their titles, modules and pages."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Report:
    """A report and how it is made.

    Attributes
    ----------
    title : str
        Title of its page.
    tells : str
        The question that it answers, in a sentence.
    module : str
        The module whose `main` makes it.
    page : str
        Path of its page within the directory of all reports.
    arguments : tuple of str
        What `main` is given before the user's arguments.
    """

    title: str
    tells: str
    module: str
    page: str
    arguments: tuple[str, ...] = ()


#: The report that is made when none is named.
DEFAULT = "thesis"

#: Reports by their names, in the order of the landing page.
REPORTS = {
    "thesis": Report(
        "A membrane PVDF tactile sensor: this work beside the thesis",
        "Every figure and table of the thesis, computed again and shown beside its numbers.",
        "reports.thesis",
        "thesis.html",
    ),
    "locate": Report(
        "Position, force and rotation from charges",
        "How well the thesis's triangulation and maximum likelihood find a touch, with exact and "
        "with noisy charges, and which bound no method can beat.",
        "reports.locate",
        "locate/index.html",
    ),
    "design": Report(
        "What a sensor's design does",
        "What position, force and charge a sensor resolves, by number, size and spacing of its "
        "electrodes, by thickness, pretension and poling of its film; a recommended design.",
        "reports.design",
        "design/index.html",
    ),
    "experiment": Report(
        "The thesis's experiments, errors and their causes",
        "Which of the sources of error that the thesis names explain its measured positions.",
        "reports.experiment",
        "experiment/index.html",
    ),
    "shear": Report(
        "Chapter 6: can it feel shear?",
        "How small a force along the film the four charges can tell.",
        "reports.thesis",
        "shear.html",
        ("--section", "shear"),
    ),
    "transducer": Report(
        "Chapter 6: what the thesis left out of the transducer",
        "What pressure through the film, heat, air, mass and tapes change in the charges.",
        "reports.thesis",
        "transducer.html",
        ("--section", "transducer"),
    ),
    "extremes": Report(
        "Scenes of extreme proportions",
        "Whether random scenes from the ends of every range are solved, and whether the stated "
        "errors of their charges hold.",
        "reports.extremes",
        "extremes/index.html",
    ),
    "error_vs_time": Report(
        "Error against run time",
        "How long a charge takes at which error, beside two other finite-element codes.",
        "reports.error_vs_time",
        "error_vs_time/index.html",
    ),
}


def command(name: str) -> str:
    """What one types in the root of the checkout to make a report."""
    return "./run report" if name == DEFAULT else f"./run report {name}"

"""README's pictures, with the scenes and charges written into them, and its sample output."""

from __future__ import annotations

import json
import re
import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from PIL import Image, PngImagePlugin

from pvdf_fem import Scene, Solution, solve
from pvdf_fem.batch.batch import solve_scenes
from pvdf_fem.report.kind import Inputs
from pvdf_fem.report.registry import load_kinds
from pvdf_fem.report.report import Report
from pvdf_fem.report.results import ReportResults
from pvdf_fem.report.script import Requirements
from pvdf_fem.view.figures import save_figure, use_style

#: Key of the text in a PNG file.
KEY = "pvdf_fem"
MAX_LINE = 96  #: Letters of the longest line of the sample output.
THESIS = Path(__file__).parents[1] / "thesis"
README = Path(__file__).parents[2] / "README.md"
#: README's sample output.
SAMPLE = re.compile(r"(?<=^```text\n).*?(?=^```)", re.M | re.S)
#: Scenes and charges of a picture, by name.
Content = dict[str, Any]


def draw_deflection() -> tuple[Figure, Content]:
    """Draw the deflected film under the example's triangle."""
    solution = solve(Scene.example("triangle"))
    return solution.plot(), describe_solutions([solution])


def draw_rotation() -> tuple[Figure, Content]:
    """Draw the charges of A and B against the rotation of the rectangle, beside those printed.

    This is a figure of the report on the thesis.
    """
    inputs, needed = plan_rotation()
    scenes = needed.scenes
    records = dict(zip(scenes, solve_scenes(scenes, processes=1), strict=True))
    with use_style():
        figure = needed.item.kind.compose(inputs, ReportResults(records)).figure
    assert figure is not None
    return figure, describe_solutions([solve(scenes[0])])


#: Functions that draw the pictures, by the names of the files.
PICTURES: dict[str, Callable[[], tuple[Figure, Content]]] = {
    "deflection": draw_deflection,
    "rotation": draw_rotation,
}


def plan_rotation() -> tuple[Inputs, Requirements]:
    """Return the inputs of the thesis's report, and the figure of the rotation with its scenes."""
    report = Report.load(THESIS / "report.toml", load_kinds(THESIS / "special.py"))
    inputs, requirements = report.plan.collect_requirements()
    for needed in requirements:
        if needed.item.name == "rotation":
            return inputs, needed
    raise LookupError("the report has no figure of the rotation")


def describe_solutions(solutions: Sequence[Solution]) -> Content:
    """Return scenes and charges in pC, in the order of the solutions."""
    return {
        "scenes": [solution.scene.to_toml() for solution in solutions],
        "charges_pC": [solution.charges_pC for solution in solutions],
    }


def write_picture(name: str, folder: Path) -> Path:
    """Draw a picture and write it together with its scenes and charges."""
    figure, content = PICTURES[name]()
    path = folder / f"{name}.png"
    save_figure(figure, path)
    text = PngImagePlugin.PngInfo()
    text.add_text(KEY, json.dumps(content))
    with Image.open(path) as image:
        image.load()
        image.save(path, pnginfo=text, dpi=image.info.get("dpi"), optimize=True)
    return path


def read_content(path: Path) -> Content:
    """Return the scenes and charges that `write_picture` wrote into a picture."""
    with Image.open(path) as image:
        content: Content = json.loads(image.info[KEY])
    return content


def make_sample() -> str:
    """Return what `print` shows of the example's solution, with long notes cut short."""
    lines = []
    for line in str(solve(Scene.example("triangle"))).splitlines():
        if len(line) > MAX_LINE:
            line = textwrap.shorten(line, MAX_LINE)
        lines.append(f"{line}\n")
    return "".join(lines)

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
THESIS = Path(__file__).parents[1] / "thesis"
README = Path(__file__).parents[2] / "README.md"
#: README's sample output.
SAMPLE = re.compile(r"(?<=^```text\n).*?(?=^```)", re.M | re.S)
#: Values by name that a picture shows, with the scene that they are of.
Shown = dict[str, Any]


def deflection() -> tuple[Figure, Shown]:
    """The deflected film under the example's triangle."""
    solution = solve(Scene.example("triangle"))
    return solution.plot(), shown([solution])


def rotation() -> tuple[Figure, Shown]:
    """Charges of A and B against the rotation of the rectangle, beside the thesis's: a figure of
    the report on the thesis."""
    inputs, asked = turned()
    scenes = asked.scenes
    solved = dict(zip(scenes, solve_scenes(scenes, processes=1), strict=True))
    with use_style():
        figure = asked.item.kind.compose(inputs, ReportResults(solved)).figure
    assert figure is not None
    return figure, shown([solve(scenes[0])])


#: What makes a picture, by the name of its file.
PICTURES: dict[str, Callable[[], tuple[Figure, Shown]]] = {
    "deflection": deflection,
    "rotation": rotation,
}


def turned() -> tuple[Inputs, Requirements]:
    """The figure of the rotation, with what it is made of and its scenes."""
    report = Report.load(THESIS / "report.toml", load_kinds(THESIS / "special.py"))
    inputs, needed = report.plan.collect_requirements()
    return inputs, next(asked for asked in needed if asked.item.name == "rotation")


def shown(solutions: Sequence[Solution]) -> Shown:
    """Scenes and charges in pC, in the order of the solutions."""
    return {
        "scenes": [solution.scene.to_toml() for solution in solutions],
        "charges_pC": [solution.charges_pC for solution in solutions],
    }


def write(name: str, folder: Path) -> Path:
    """Draw a picture and write it with what it shows."""
    figure, content = PICTURES[name]()
    path = folder / f"{name}.png"
    save_figure(figure, path)
    text = PngImagePlugin.PngInfo()
    text.add_text(KEY, json.dumps(content))
    with Image.open(path) as image:
        image.load()
        image.save(path, pnginfo=text, dpi=image.info.get("dpi"), optimize=True)
    return path


def read(path: Path) -> Shown:
    """What a picture shows, as `write` wrote it."""
    with Image.open(path) as image:
        content: Shown = json.loads(image.info[KEY])
    return content


def sample() -> str:
    """What `print` shows of the example's solution, long remarks cut short."""
    lines = str(solve(Scene.example("triangle"))).splitlines()
    return "".join(f"{textwrap.shorten(line, 96) if len(line) > 96 else line}\n" for line in lines)

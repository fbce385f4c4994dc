"""README's pictures, and the scenes and charges that are written into them."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from PIL import Image, PngImagePlugin

from pvdf_fem import Scene, Solution, solve
from pvdf_fem.output.figures import new_figure, save, style
from reports.common.charge_figures import Series, charge_against_rotation
from reports.common.thesis_data import Thesis
from reports.common.thesis_scene import thesis_scene

#: Key of the text in a PNG file.
KEY = "pvdf_fem"
STEP_DEG = 2.5  #: Step of the rotation from 0 to 90 degrees; the rest follows by symmetry.
#: Values by name that a picture shows, with the scene that they are of.
Shown = dict[str, Any]


def deflection() -> tuple[Figure, Shown]:
    """The deflected film under the example's triangle."""
    solution = solve(Scene.example("triangle"))
    return solution.plot(), shown([solution])


def rotation() -> tuple[Figure, Shown]:
    """Charges of A and B against the rotation of the rectangle, beside the thesis's."""
    angles = np.arange(0.0, 90.0 + STEP_DEG, STEP_DEG)
    solutions = [solve(turned(angle)) for angle in angles.tolist()]
    of_a, of_b = ([s.charges_pC[name] for s in solutions] for name in "AB")
    whole = np.concatenate([angles, 180.0 - angles[-2::-1]])
    ours = [
        Series(name, whole, np.array([*charge, *charge[-2::-1]]))
        for name, charge in (("A", of_a), ("B", of_b))
    ]
    with style():
        figure = new_figure(120.0, 75.0)
        charge_against_rotation(figure.subplots(), ours, printed())
    return figure, shown(solutions)


#: What makes a picture, by the name of its file.
PICTURES: dict[str, Callable[[], tuple[Figure, Shown]]] = {
    "deflection": deflection,
    "rotation": rotation,
}


def turned(angle_deg: float) -> Scene:
    """The thesis's rectangle at the centre, turned, with 1 N."""
    return thesis_scene("4", "rect14x7", rotation_deg=angle_deg)


def printed() -> list[Series]:
    """The thesis's charges of A and B of `turned`."""
    table = Thesis.read().from_("Table 4.1")
    charges = [charge for charge in table if charge.force_N == 1.0 and not charge.defect]
    by_name = {n: [c for c in charges if c.electrode == n] for n in "AB"}
    return [
        Series(
            name,
            np.array([charge.rotation_deg for charge in of_name]),
            np.array([charge.charge_pC for charge in of_name]),
        )
        for name, of_name in by_name.items()
    ]


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
    save(figure, path)
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

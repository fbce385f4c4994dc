"""Finite elements of a membrane PVDF tactile sensor: from a load to charges, and back to the touch.

Scenes and solutions
    A `Scene` describes film, electrodes, probe and load; `Replaced` replaces a whole table of a
    scene in `Scene.with_`. `Problem` resolves a scene to what is solved, and printing it shows the
    film model, the symmetry and the neglected effects. `solve` returns a `Solution` with the
    charges and their errors. `SceneError` lists the errors of a scene; `NotConvergedError` and
    `Status` say why a solve has no charges. `materials` lists the real films of `film.material`
    with the sources of their values.
About one solution
    `gradients` computes the derivatives of the charges, and `uncertainty` their standard deviations
    due to uncertain values of the scene. `modes` computes the frequencies of the film, `respond`
    the charges of an oscillating force by frequency, and `transient` the charges by time of a force
    such as a `half_sine` or a `step`. `write_deck` writes a scene as an input deck of CalculiX or
    Abaqus, and `compare_deck` compares the results of CalculiX with the charges.
Many scenes
    `sweep` solves a grid of scenes. `Report` makes a page of figures and tables from a script.
From known touches to the sensor
    `calibrate` fits the film, the gains and offsets of the amplifiers, and the position of the film
    on the stage to readings of known touches.
From charges to touches
    `build_response` builds a `Response`, which evaluates the charges of any touch fast. `locate`
    and `locate_many` find the touches that explain readings, and a `Tracker` follows touches in a
    stream of readings. `design` compares how well different sensors locate touches, and `dataset`
    draws random touches with noisy readings.
To the workshop
    `draw` writes rim and electrodes at scale 1:1 as DXF, SVG or PDF.

``help(pvdf_fem.solve)`` describes `solve` with its parameters, and so on. Modules log to the logger
``pvdf_fem``, which is silent by default.
"""

from __future__ import annotations

from importlib import import_module

# Type checkers treat this name as `typing.TYPE_CHECKING`, whose import doubles the start of Python.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any

    from pvdf_fem.dynamics.force_history import half_sine, step
    from pvdf_fem.dynamics.frequency_response import respond
    from pvdf_fem.dynamics.modes import modes
    from pvdf_fem.dynamics.transient import transient
    from pvdf_fem.inverse.calibration.calibrate import calibrate
    from pvdf_fem.inverse.touch.locate import locate
    from pvdf_fem.inverse.touch.locate_many import locate_many
    from pvdf_fem.inverse.tracking.tracker import Tracker
    from pvdf_fem.problem.problem import Problem
    from pvdf_fem.report.report import Report
    from pvdf_fem.scene.materials.catalogue import materials
    from pvdf_fem.scene.scene import Replaced, Scene, SceneError
    from pvdf_fem.solver.nonlinear.status import NotConvergedError, Status
    from pvdf_fem.solver.sensitivity.gradients import gradients
    from pvdf_fem.solver.sensitivity.uncertainty import uncertainty
    from pvdf_fem.solver.solution import Solution
    from pvdf_fem.solver.solve import solve
    from pvdf_fem.studies.decks.compare_deck import compare_deck
    from pvdf_fem.studies.decks.write_deck import write_deck
    from pvdf_fem.studies.design import design
    from pvdf_fem.studies.sweep import sweep
    from pvdf_fem.studies.touch_dataset import dataset
    from pvdf_fem.surrogate.response import Response
    from pvdf_fem.surrogate.response_builder import build_response
    from pvdf_fem.view.drawings.draw import draw

__all__ = [
    "NotConvergedError",
    "Problem",
    "Replaced",
    "Report",
    "Response",
    "Scene",
    "SceneError",
    "Solution",
    "Status",
    "Tracker",
    "build_response",
    "calibrate",
    "compare_deck",
    "dataset",
    "design",
    "draw",
    "gradients",
    "half_sine",
    "locate",
    "locate_many",
    "materials",
    "modes",
    "respond",
    "solve",
    "step",
    "sweep",
    "transient",
    "uncertainty",
    "write_deck",
]
__version__ = "0.1.0"

# Where the public names are defined.
_MODULES = {
    "NotConvergedError": "solver.nonlinear.status",
    "Problem": "problem.problem",
    "Report": "report.report",
    "Replaced": "scene.scene",
    "Response": "surrogate.response",
    "Scene": "scene.scene",
    "SceneError": "scene.scene",
    "Solution": "solver.solution",
    "Status": "solver.nonlinear.status",
    "Tracker": "inverse.tracking.tracker",
    "build_response": "surrogate.response_builder",
    "calibrate": "inverse.calibration.calibrate",
    "compare_deck": "studies.decks.compare_deck",
    "dataset": "studies.touch_dataset",
    "design": "studies.design",
    "draw": "view.drawings.draw",
    "gradients": "solver.sensitivity.gradients",
    "half_sine": "dynamics.force_history",
    "locate": "inverse.touch.locate",
    "locate_many": "inverse.touch.locate_many",
    "materials": "scene.materials.catalogue",
    "modes": "dynamics.modes",
    "respond": "dynamics.frequency_response",
    "solve": "solver.solve",
    "step": "dynamics.force_history",
    "sweep": "studies.sweep",
    "transient": "dynamics.transient",
    "uncertainty": "solver.sensitivity.uncertainty",
    "write_deck": "studies.decks.write_deck",
}


def __getattr__(name: str) -> Any:
    # A public name is imported at its first use, so that the help of the command line appears at
    # once, and scenes can be read without gmsh, scikit-fem and SciPy.
    if name not in _MODULES:
        from pvdf_fem.scene.scene_file import suggest

        raise AttributeError(f"pvdf_fem has no {name}; {suggest(name, __all__)}")
    module = import_module(f"pvdf_fem.{_MODULES[name]}")
    value = getattr(module, name)
    return globals().setdefault(name, value)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})

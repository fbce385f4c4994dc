"""A membrane PVDF tactile sensor: charges of its electrodes under a probe, by finite elements.

Scene and solution
    `Scene` describes film, electrodes, probe and load; `solve` gives a `Solution` with the charges.
    `Problem` is a scene resolved to what is solved, and prints it without a solve.
    `SceneError` lists the mistakes of a scene; `NotConvergedError` and `Status` say why there are
    no charges.
    `Replaced` is a table that takes the place of a whole one in `Scene.with_`.
About one solution
    `gradients` differentiates the charges, `uncertainty` tells what uncertain values of the scene
    make of these; `modes` gives the frequencies of the film, `respond` the
    charges of an oscillating force by frequency, `transient` the charges of a `half_sine` or a
    `step` of force by time.
Many scenes
    `sweep` solves a grid of scenes; `Report` makes a page of a report script.
From known touches to the sensor
    `calibrate` finds film, gains, offsets and the film's place under the stage from readings.
From charges to touches
    `build_response` makes a `Response`, the charges as a fast function of the touch; `locate` and
    `locate_many` find the touches that explain measured charges; `Tracker` follows touches in a
    stream of readings. `design` tells how well different sensors would do so; `dataset` draws
    random touches with noisy readings.

``help(pvdf_fem.solve)`` describes `solve` with its arguments, and so on.
"""

from __future__ import annotations

from importlib import import_module

# Type checkers take this for `typing.TYPE_CHECKING`; its import doubles Python's start.
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
    from pvdf_fem.scene.scene import Replaced, Scene, SceneError
    from pvdf_fem.solver.nonlinear.status import NotConvergedError, Status
    from pvdf_fem.solver.sensitivity.gradients import gradients
    from pvdf_fem.solver.sensitivity.uncertainty import uncertainty
    from pvdf_fem.solver.solution import Solution
    from pvdf_fem.solver.solve import solve
    from pvdf_fem.studies.design import design
    from pvdf_fem.studies.sweep import sweep
    from pvdf_fem.studies.touch_dataset import dataset
    from pvdf_fem.surrogate.response import Response
    from pvdf_fem.surrogate.response_builder import build_response

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
    "dataset",
    "design",
    "gradients",
    "half_sine",
    "locate",
    "locate_many",
    "modes",
    "respond",
    "solve",
    "step",
    "sweep",
    "transient",
    "uncertainty",
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
    "dataset": "studies.touch_dataset",
    "design": "studies.design",
    "gradients": "solver.sensitivity.gradients",
    "half_sine": "dynamics.force_history",
    "locate": "inverse.touch.locate",
    "locate_many": "inverse.touch.locate_many",
    "modes": "dynamics.modes",
    "respond": "dynamics.frequency_response",
    "solve": "solver.solve",
    "step": "dynamics.force_history",
    "sweep": "studies.sweep",
    "transient": "dynamics.transient",
    "uncertainty": "solver.sensitivity.uncertainty",
}


def __getattr__(name: str) -> Any:
    # A public name is imported when it is first asked for, so that the command line's help comes at
    # once, and scenes can be read without gmsh, scikit-fem and scipy.
    if name not in _MODULES:
        from pvdf_fem.scene.scene_file import suggest

        raise AttributeError(f"pvdf_fem has no {name}; {suggest(name, __all__)}")
    module = import_module(f"pvdf_fem.{_MODULES[name]}")
    found = getattr(module, name)
    return globals().setdefault(name, found)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})

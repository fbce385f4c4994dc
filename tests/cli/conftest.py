"""A folder with scenes and tables in which commands run, and replacements for long work."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module

import pytest

from tests.helpers.bump_response import make_bump_response
from tests.helpers.streams import make_sensor

TOLERANCE = "[numerics]\ntolerance = 0.05\n"
READOUT = "[readout]\nfeedback_capacitance_pF = 500\n"
RESISTIVE = '[readout]\nkind = "voltage"\ninput_resistance_MOhm = 1.0\ncable_capacitance_pF = 100\n'
FILES = {
    "scene.toml": f'[probe]\nshape = "rectangle"\nx_mm = 3.0\n{TOLERANCE}',
    "disc.toml": f'[probe]\nshape = "circle"\n[readout]\n{TOLERANCE}',
    "wired.toml": f"[probe]\n{READOUT}",
    "sensor.toml": f'[probe]\nshape = "circle"\n{RESISTIVE}',
    "bare.toml": "",
    "two.toml": "[[probe]]\n[[probe]]\nx_mm = 12.0\n",
    "list.toml": '[[electrodes]]\nname = "A"\nx_mm = 9\ny_mm = 0\n',
    "wrong.toml": "[film]\nradius_mm = -45.0\n[load]\nforce = 2\n[numerics]\ntolerance = nan\n",
    "sweep.toml": 'scene = "disc.toml"\n[[axes]]\nload.force_N = [1.0, 2.0]\n',
    "readings.csv": "A,B,C,D\n905,731,600,640\n",
    "touches.csv": "x_mm,y_mm,rotation_deg,force_N,A,B,C,D\n1,1,0,1,905,731,600,640\n",
    "signals.csv": "t_s,A,B,C,D\n0,1,2,3,4\n",
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working directory of a test, with the files."""
    for name, text in FILES.items():
        tmp_path.joinpath(name).write_text(text)
    monkeypatch.chdir(tmp_path)
    return tmp_path


#: Where commands load or build the response of a scene, but for `track`.
RESPONSE_USERS = (
    "pvdf_fem.cli.inverse.locate.load_or_build_response",
    "pvdf_fem.cli.inverse.locate_table.load_or_build_response",
    "pvdf_fem.cli.studies.dataset.load_or_build_response",
    "pvdf_fem.cli.studies.design.load_or_build_response",
)


@pytest.fixture
def made_up_responses(monkeypatch):
    """Replace built responses by made-up ones; the list receives the scene of each."""
    scenes = []
    unloaded = make_sensor()

    def make_response(scene, *_, **__):
        scenes.append(scene)
        return make_bump_response(scene.single_probe.shape).for_scene(scene)

    def make_tracked_response(scene, *_, **__):
        return replace(unloaded, scene=scene)

    for place in RESPONSE_USERS:
        monkeypatch.setattr(place, make_response)
    place = "pvdf_fem.cli.inverse.track.load_or_build_response"
    monkeypatch.setattr(place, make_tracked_response)
    return scenes


class WorkBegun(BaseException):
    """Raised in place of the work on accepted input, with the arguments of the work."""


#: Functions that begin the work of commands.
WORK = (
    "pvdf_fem.solver.solve.solve",
    "pvdf_fem.mesh.gmsh_mesh.mesh_scene",
    "pvdf_fem.dynamics.modes.modes",
    "pvdf_fem.dynamics.charge_changes.solve_problem",
    "pvdf_fem.batch.batch.plan_scenes",
    "pvdf_fem.inverse.calibration.calibrate.ReadingModel",
    "pvdf_fem.surrogate.response_builder.build_response",
    "pvdf_fem.inverse.touch.locate.locate",
    "pvdf_fem.explore.server.serve",
    "pvdf_fem.report.report.Report.make",
    "pvdf_fem.studies.decks.write_deck.write_deck",
    "pvdf_fem.studies.decks.compare_deck.compare_deck",
)
#: Modules that hold such functions from their import on.
HOLDERS = (
    "pvdf_fem.studies.touch_dataset",
    "pvdf_fem.studies.design",
    "pvdf_fem.report.kinds.positions",
    "pvdf_fem.report.report",
    "pvdf_fem.surrogate.stress.probe_stress",
)


@pytest.fixture
def work_begun(monkeypatch):
    """Replace all work by an exception, which is returned."""
    for name in HOLDERS:
        import_module(name)

    def begin(*arguments, **_):
        raise WorkBegun(*arguments)

    for place in WORK:
        monkeypatch.setattr(place, begin)
    return WorkBegun

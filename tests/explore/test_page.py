"""The page in a real browser: what the mouse does to it, and what it says."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from http.client import HTTPConnection
from pathlib import Path
from typing import Any
from urllib.parse import urlparse

import pytest

from pvdf_fem.explore.picture import ORDER
from pvdf_fem.explore.state import View
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solution.solve import solve
from tests.helpers.browsers import browser_or_skip

page = pytest.importorskip("pvdf_fem.explore.page", reason="the extra `explore` is not installed")
pytest.importorskip("playwright.sync_api", reason="playwright is not installed")

#: Two electrodes tell no touch, and of charges with d33 there is no response: so `locate` says
#: what is missing, and takes no time.
SCENE = Scene(
    film={"d33_pC_N": -15.0},
    electrodes=[
        {"name": "A", "shape": "square", "x_mm": 10.0, "y_mm": 0.0, "side_mm": 3.0},
        {"name": "B", "shape": "circle", "x_mm": 0.0, "y_mm": 10.0, "radius_mm": 1.5},
    ],
    probe={"shape": "triangle", "x_mm": 5.0, "y_mm": 1.0},
    readout={"feedback_capacitance_pF": 500.0},
)
#: Where a point of the film, in mm, is on the screen.
PLACE = """([x, y]) => {
  const view = Bokeh.index.find_one(Bokeh.documents[0].get_model_by_name("film"))
  const box = view.el.getBoundingClientRect(), frame = view.frame
  return [box.left + frame.x_scale.compute(x), box.top + frame.y_scale.compute(y)]
}"""
#: The opacity of the picture.
OPACITY = """() => {
  const {renderers} = Bokeh.documents[0].get_model_by_name("film")
  const {global_alpha} = renderers.find((r) => r.glyph.type == "ImageRGBA").glyph
  return global_alpha.value ?? global_alpha
}"""
#: The numbers of some bars, unless they are dimmed as those of another scene.
BARS = """(name) => {
  const bars = Bokeh.documents[0].get_model_by_name(name)
  const {name: names, value} = bars.data
  return Object.fromEntries(Array.from(names, (n, i) => [n, value[i]]))
}"""


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    file = tmp_path_factory.mktemp("explore") / "two.toml"
    file.write_text(SCENE.to_toml(), encoding="utf-8")
    command = [sys.executable, "-m", "pvdf_fem", "explore", str(file), "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        try:
            yield server.stdout.readline().split()[0]
        finally:
            server.send_signal(signal.SIGINT)
            assert server.wait(30) == 0


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with browser_or_skip() as started:
        yield started


class Visit:
    """A visitor of the page."""

    def __init__(self, browser: Any, address: str) -> None:
        self.hosts: set[str | None] = set()
        self.errors: list[str] = []
        self.page = browser.new_page(viewport={"width": 1300, "height": 1000})
        self.page.set_default_timeout(60_000)
        self.page.on("request", lambda request: self.hosts.add(urlparse(request.url).hostname))
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.goto(address)
        self.sees("converged")

    def sees(self, text: str) -> None:
        self.page.get_by_text(text, exact=False).first.wait_for()

    def drags(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        mouse = self.page.mouse
        mouse.move(*self.page.evaluate(PLACE, start))
        mouse.down()
        mouse.move(*self.page.evaluate(PLACE, end), steps=4)
        mouse.up()

    def types(self, change: str) -> None:
        field = self.page.get_by_label("any value")
        field.fill(change)
        field.press("Enter")

    def clicks(self, name: str) -> None:
        self.page.get_by_text(name, exact=True).click()

    def reads(self, scene: Scene) -> None:
        """The bars come to show what `solve` says of a scene."""
        solution = solve(scene.with_(**{"numerics.tolerance": 1e-2}), order=ORDER)
        for name, values in (
            ("charges_pC", solution.charges_pC),
            ("readings_V", solution.readings_V),
        ):
            self.page.wait_for_function(
                f"([name, value]) => Math.abs(({BARS})(name).A / value - 1) < 1e-9",
                arg=[name, values["A"]],
            )
            assert self.page.evaluate(BARS, name) == pytest.approx(values, rel=1e-12)


@pytest.fixture
def visit(browser: Any, address: str) -> Iterator[Visit]:
    visit = Visit(browser, address)
    yield visit
    assert visit.errors == []
    assert visit.hosts <= {"127.0.0.1", None}  # data: and blob: have no host
    visit.page.close()


def test_a_dragged_and_turned_probe_gives_the_charges_of_solve(
    visit: Visit, browser: Any, address: str
) -> None:
    visit.reads(SCENE)
    visit.drags((5.0, 1.0), (-4.0, 3.0))
    visit.page.wait_for_url("**probe=**")
    data = "Bokeh.documents[0].get_model_by_name('dropped').data"
    x, y = visit.page.evaluate(f"{data}.value")
    assert (x, y) == pytest.approx((-4.0, 3.0), abs=0.2)
    moved = SCENE.with_(**{"probe.x_mm": x, "probe.y_mm": y})
    visit.reads(moved)
    knob = "Bokeh.documents[0].get_model_by_name('probes').data"
    start = visit.page.evaluate(f"[{knob}.knob_x[0], {knob}.knob_y[0]]")
    before = visit.page.url
    visit.drags(start, (x - 5.25, y))
    visit.page.wait_for_function("(before) => location.href != before", arg=before)
    query = urlparse(visit.page.url).query
    turned = View.of_query(SCENE, query).scene
    assert turned.single_probe is not None
    assert turned.single_probe.rotation_deg == pytest.approx(90.0, abs=3.0)
    visit.reads(turned)
    other = Visit(browser, f"{address}?{query}")
    other.reads(turned)
    other.page.close()
    visit.clicks("undo")
    visit.reads(moved)
    visit.clicks("undo")
    visit.reads(SCENE)
    visit.clicks("redo")
    visit.reads(moved)


def test_what_is_refused_or_fails_is_named(visit: Visit) -> None:
    visit.sees("film.d33_pC_N = -15.0")  # full solves have no derivatives with it
    visit.types("film.thickness_um=-1")
    visit.sees("film.thickness_um = -1")
    visit.reads(SCENE)
    visit.types("numerics.max_unknowns=100")
    visit.sees("tolerance_not_reached")
    visit.page.wait_for_function(f"() => Object.keys(({BARS})('charges_pC')).length == 0")
    field = "Bokeh.documents[0].get_model_by_name('image')"
    assert visit.page.evaluate(f"{field} !== null")
    assert visit.page.evaluate(OPACITY) == page.DIMMED  # the picture is that of the scene before
    visit.clicks("undo")
    visit.reads(SCENE)


def test_scene_and_picture_are_saved(visit: Visit, tmp_path: Path) -> None:
    visit.types("load.force_N=2")
    visit.reads(changed := SCENE.with_(**{"load.force_N": 2.0}))
    for name, file in (("save scene file", "scene.toml"), ("save picture", "film.png")):
        with visit.page.expect_download() as download:
            visit.clicks(name)
        download.value.save_as(tmp_path / file)
    assert Scene.load(tmp_path / "scene.toml") == changed
    assert (tmp_path / "film.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("path", ["/", "/?load.force_N=2", "/ws", "/static/js/bokeh.min.js"])
def test_a_name_that_leads_here_is_refused(address: str, path: str) -> None:
    """As of a site whose name was rebound to this machine, so that its scripts may read answers."""
    port = urlparse(address).port
    answers = {}
    for host in (f"rebound.example:{port}", "127.0.0.1.rebound.example", f"localhost:{port}"):
        request = HTTPConnection("127.0.0.1", port, timeout=60)
        request.request("GET", path, headers={"Host": host})
        answers[host] = request.getresponse().status
        request.close()
    *others, own = answers.values()
    assert others == [403, 403]
    assert own == (400 if path == "/ws" else 200)  # as no websocket is asked for


def test_it_is_served_on_this_machine_only(address: str) -> None:
    port = urlparse(address).port
    assert port is not None
    socket.create_connection(("127.0.0.1", port)).close()
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.2", port))

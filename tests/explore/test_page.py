"""The page in a real browser: what the mouse does to it, and what it says."""

import signal
import socket
import subprocess
import sys
from functools import partial
from http.client import HTTPConnection
from pathlib import Path
from urllib.parse import urlparse

import pytest

from pvdf_fem.explore.picture import ORDER
from pvdf_fem.explore.state import View
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solver.solve import solve
from tests.helpers.browsers import browser_or_skip

SCENE = Scene.example("triangle").with_(readout={"feedback_capacitance_pF": 500.0})
FILE = Path(__file__).parents[2] / "geometry" / "triangle.toml"
#: Where a point of the film, in mm, is on the screen.
PLACE = """([x, y]) => {
  const place = new DOMPoint(x, -y).matrixTransform(film.getScreenCTM())
  return [place.x, place.y]
}"""
#: Whether bars show the numbers of electrodes.
SHOWN = """([name, values]) => {
  const bars = [...document.querySelectorAll(`#${name} .bar`)]
  const near = (bar, value) => Math.abs(bar.dataset.value / value - 1) < 1e-9
  return bars.length == values.length && bars.every((bar, i) => near(bar, values[i]))
}"""


@pytest.fixture(scope="module")
def address(tmp_path_factory):
    file = tmp_path_factory.mktemp("explore") / "scene.toml"
    file.write_text(SCENE.to_toml(), encoding="utf-8")
    command = [sys.executable, "-m", "pvdf_fem", "explore", str(file), "--no-browser"]
    heeding = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)  # in the background, too
    how = {"stdout": subprocess.PIPE, "text": True, "preexec_fn": heeding}
    with subprocess.Popen(command, **how) as server:
        try:
            yield server.stdout.readline().split()[0]
            server.send_signal(signal.SIGINT)
            assert server.wait(30) == 0
        finally:
            server.kill()


@pytest.fixture(scope="module")
def browser():
    with browser_or_skip() as started:
        yield started


class Visit:
    """A visitor of the page."""

    def __init__(self, browser, address):
        self.hosts, self.errors = set(), []
        self.page = browser.new_page(viewport={"width": 1300, "height": 1000})
        self.page.set_default_timeout(60_000)
        self.page.on("request", lambda request: self.hosts.add(urlparse(request.url).hostname))
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.goto(address)
        self.page.wait_for_selector("#electrodes polygon")

    def drags(self, start, end):
        """Drag what is at a point in mm, and return the scene that comes of it."""
        mouse, before = self.page.mouse, self.page.url
        mouse.move(*self.page.evaluate(PLACE, start))
        mouse.down()
        mouse.move(*self.page.evaluate(PLACE, end), steps=4)
        mouse.up()
        self.page.wait_for_function("(before) => location.href != before", arg=before)
        return self.scene()

    def types(self, change):
        self.page.get_by_label("any value").fill(change)
        self.page.get_by_label("any value").press("Enter")

    def scene(self):
        """The scene that the address stands for."""
        return View.from_query(SCENE, urlparse(self.page.url).query).scene

    def reads(self, scene):
        """The bars come to show what `solve` says of a scene, and the address to stand for it."""
        solution = solve(scene.with_(**{"numerics.tolerance": 1e-2}), order=ORDER)
        bars = {"charges": solution.charges_pC, "readings": solution.readings_V}
        for name, values in bars.items():
            self.page.wait_for_function(SHOWN, arg=[name, [*values.values()]])
        assert self.scene() == scene


@pytest.fixture
def visit(browser, address):
    visit = Visit(browser, address)
    yield visit
    assert visit.errors == []
    assert visit.hosts <= {"127.0.0.1", None}  # data: and blob: have no host
    visit.page.close()


def test_a_dragged_and_turned_probe_gives_the_charges_of_solve(visit):
    visit.reads(SCENE)
    moved = visit.drags((5.0, 1.0), (-4.0, 3.0))
    x, y = moved.probe.x_mm, moved.probe.y_mm
    assert (x, y) == pytest.approx((-3.93, 2.88), abs=0.2)
    visit.reads(moved)
    knob = visit.page.locator(".knob")
    start = float(knob.get_attribute("cx")), -float(knob.get_attribute("cy"))
    turned = visit.drags(start, (x - 7.0, y))
    assert turned.probe.rotation_deg == pytest.approx(90.0, abs=3.0)
    visit.reads(turned)
    visit.page.reload()
    visit.reads(turned)
    for button, scene in (("undo", moved), ("undo", SCENE), ("redo", moved)):
        visit.page.get_by_role("button", name=button).click()
        visit.reads(scene)


def test_words_and_numbers_change_the_scene_which_can_be_saved(visit, tmp_path):
    visit.types("film.thickness_um=-1")
    visit.page.wait_for_selector("#refused:has-text('film.thickness_um = -1')")
    visit.reads(SCENE)
    visit.page.wait_for_selector("#ellipses polygon", state="attached")
    assert visit.page.locator("#certainty tbody tr").count() == 3
    visit.page.get_by_label("shape", exact=True).first.select_option("sphere")
    visit.page.get_by_label("radius (mm)", exact=True).first.fill("4")
    visit.page.get_by_label("radius (mm)", exact=True).first.press("Enter")
    changed = SCENE.with_(probe={"shape": "sphere", "radius_mm": 4.0}, load={"kind": "contact"})
    visit.reads(changed)
    assert visit.page.locator("#refused").text_content() == ""
    for name in ("save scene file", "save picture"):
        with visit.page.expect_download() as download:
            visit.page.get_by_text(name, exact=True).click()
        download.value.save_as(tmp_path / name)
    assert Scene.from_file(tmp_path / "save scene file") == changed
    assert "data:image/png" in (tmp_path / "save picture").read_text("utf-8")


def test_a_scene_without_a_solution_is_drawn_and_tells_why(visit):
    visit.types("numerics.max_unknowns=100 electrodes.ring_radius_mm=12")
    visit.page.wait_for_selector("#unsolved:has-text('numerics.max_unknowns')")
    assert visit.page.locator("#bars .bar").count() == 0
    assert visit.page.locator("#electrodes polygon").count() == 4
    assert not visit.page.locator("#field").is_visible()  # the last film was another one
    box = visit.page.locator("#film").get_attribute("viewBox")
    assert float(box.split()[2]) > 2.0 * SCENE.film.radius_mm


@pytest.mark.parametrize("path", ["/", "/view?change=load.force_N=2", "/picture", "/scene.toml"])
def test_a_name_that_leads_here_is_refused(address, path):
    """As of a site whose name was rebound to this machine, so that its scripts may read answers."""
    port = urlparse(address).port
    names = {f"rebound.example:{port}": 403, "127.0.0.1.rebound.example": 403}
    for host, status in {**names, f"localhost:{port}": 200}.items():
        request = HTTPConnection("127.0.0.1", port, timeout=60)
        request.request("GET", path, headers={"Host": host})
        assert request.getresponse().status == status
        request.close()
    with pytest.raises(ConnectionRefusedError):  # it is served on this machine only
        socket.create_connection(("127.0.0.2", port))


def test_bad_ports_are_refused(address, command):
    taken = f"--port {urlparse(address).port}"
    assert command("explore", FILE, "--no-browser", *taken.split()).error_keys == [taken]
    wrong = command("explore", FILE, "--port", "70000", "--set", "film.radius_mm=-1")
    assert wrong.error_keys == ["--port 70000", "film.radius_mm = -1"]

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

pytest.importorskip("playwright.sync_api", reason="playwright is not installed")

SCENE = Scene.example("triangle").with_(readout={"feedback_capacitance_pF": 500.0})
#: Where a point of the film, in mm, is on the screen.
PLACE = """([x, y]) => {
  const film = document.getElementById("film")
  const {x: left, y: top} = new DOMPoint(x, -y).matrixTransform(film.getScreenCTM())
  return [left, top]
}"""
#: The numbers of some bars.
BARS = """(name) => Object.fromEntries(Array.from(
  document.querySelectorAll(`#${name} .bar`),
  (bar) => [bar.querySelector("b").textContent, +bar.dataset.value]))"""


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    file = tmp_path_factory.mktemp("explore") / "scene.toml"
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

    def __init__(self, browser: Any, address: str, width: int = 1300) -> None:
        self.hosts: set[str | None] = set()
        self.errors: list[str] = []
        self.page = browser.new_page(viewport={"width": width, "height": 1000})
        self.page.set_default_timeout(60_000)
        self.page.on("request", lambda request: self.hosts.add(urlparse(request.url).hostname))
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.goto(address)
        self.page.wait_for_selector("#electrodes polygon")

    def drags(self, start: Any, end: Any) -> None:
        mouse = self.page.mouse
        mouse.move(*self.page.evaluate(PLACE, start))
        mouse.down()
        mouse.move(*self.page.evaluate(PLACE, end), steps=4)
        mouse.up()

    def types(self, change: str) -> None:
        field = self.page.get_by_label("any value")
        field.fill(change)
        field.press("Enter")

    def says(self, place: str, text: str) -> None:
        self.page.locator(f"#{place}", has_text=text).wait_for()

    def scene(self) -> Scene:
        """The scene that the address stands for."""
        return View.of_query(SCENE, urlparse(self.page.url).query).scene

    def reads(self, scene: Scene) -> None:
        """The bars come to show what `solve` says of a scene, and the address to stand for it."""
        solution = solve(scene.with_(**{"numerics.tolerance": 1e-2}), order=ORDER)
        for name, values in (
            ("charges", solution.charges_pC),
            ("readings", solution.readings_V),
        ):
            self.page.wait_for_function(
                f"([name, value]) => Math.abs(({BARS})(name).A / value - 1) < 1e-9",
                arg=[name, values["A"]],
            )
            assert self.page.evaluate(BARS, name) == pytest.approx(values, rel=1e-12)
        assert self.scene() == scene


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
    probe = (moved := visit.scene()).single_probe
    assert probe is not None
    assert (probe.x_mm, probe.y_mm) == pytest.approx((-3.93, 2.88), abs=0.2)
    visit.reads(moved)
    knob = visit.page.locator(".knob")
    start = [(1 if k == "cx" else -1) * float(knob.get_attribute(k)) for k in ("cx", "cy")]
    before = visit.page.url
    visit.drags(start, (probe.x_mm - 7.0, probe.y_mm))
    visit.page.wait_for_function("(before) => location.href != before", arg=before)
    turned = visit.scene()
    assert turned.single_probe is not None
    assert turned.single_probe.rotation_deg == pytest.approx(90.0, abs=3.0)
    visit.reads(turned)
    other = Visit(browser, visit.page.url)
    other.reads(turned)
    other.page.close()
    for button, scene in (("undo", moved), ("undo", SCENE), ("redo", moved)):
        visit.page.get_by_role("button", name=button).click()
        visit.reads(scene)
    assert visit.page.get_by_role("button", name="undo").is_enabled()


def test_what_is_refused_is_named_until_something_is_not(visit: Visit) -> None:
    visit.types("film.thickness_um=-1")
    visit.says("refused", "film.thickness_um = -1")
    visit.reads(SCENE)
    visit.types("load.force_N=2 load.kind=rigid")
    visit.reads(SCENE.with_(load={"force_N": 2.0, "kind": "rigid"}))
    assert visit.page.locator("#refused").text_content() == ""


def test_pickers_and_numbers_change_the_scene(visit: Visit) -> None:
    visit.page.get_by_label("shape", exact=True).first.select_option("sphere")
    sphere = SCENE.with_(**{"probe.shape": "sphere", "load.kind": "contact"})
    visit.reads(sphere)
    radius = visit.page.get_by_label("radius (mm)", exact=True).first
    radius.fill("4")
    radius.press("Enter")
    visit.reads(sphere.with_(**{"probe.radius_mm": 4.0}))


def test_a_touch_is_located_with_its_ellipse(visit: Visit) -> None:
    visit.page.wait_for_selector("#ellipses polygon", state="attached")
    assert visit.page.locator("#certainty tbody tr").count() == 3


def test_a_scene_without_a_solution_is_drawn_and_tells_why(visit: Visit) -> None:
    visit.types("numerics.max_unknowns=100 electrodes.ring_radius_mm=12")
    visit.says("unsolved", "numerics.max_unknowns")
    assert visit.page.locator("#bars .bar").count() == 0
    assert visit.page.locator("#electrodes polygon").count() == 4
    assert visit.page.locator("#probes polygon").count() > 0
    assert not visit.page.locator("#field").is_visible()  # the last film was another one
    box = visit.page.locator("#film").get_attribute("viewBox")
    assert float(box.split()[2]) > 2.0 * SCENE.film.radius_mm


def test_the_film_is_as_wide_as_a_phone(browser: Any, address: str) -> None:
    visit = Visit(browser, address, width=390)
    visit.types("electrodes.layout=ring electrodes.count=16 electrodes.side_mm=2")
    visit.page.wait_for_function(f"() => Object.keys(({BARS})('charges')).length == 16")
    assert visit.page.evaluate("document.documentElement.scrollWidth") == 390
    assert visit.page.locator("#film").bounding_box()["width"] > 360
    assert visit.page.locator("#rim").bounding_box()["width"] > 300
    bars, sliders = (visit.page.locator(k).bounding_box() for k in ("#charges", "#controls"))
    assert bars["y"] + bars["height"] <= sliders["y"]
    visit.page.close()


def test_scene_and_picture_are_saved(visit: Visit, tmp_path: Path) -> None:
    visit.types("load.force_N=2")
    visit.reads(changed := SCENE.with_(**{"load.force_N": 2.0}))
    for name, file in (("save scene file", "scene.toml"), ("save picture", "film.svg")):
        with visit.page.expect_download() as download:
            visit.page.get_by_text(name, exact=True).click()
        download.value.save_as(tmp_path / file)
    assert Scene.load(tmp_path / "scene.toml") == changed
    assert "data:image/png" in (tmp_path / "film.svg").read_text("utf-8")


@pytest.mark.parametrize("path", ["/", "/view?change=load.force_N=2", "/picture", "/scene.toml"])
def test_a_name_that_leads_here_is_refused(address: str, path: str) -> None:
    """As of a site whose name was rebound to this machine, so that its scripts may read answers."""
    port = urlparse(address).port
    answers = {}
    for host in (f"rebound.example:{port}", "127.0.0.1.rebound.example", f"localhost:{port}"):
        request = HTTPConnection("127.0.0.1", port, timeout=60)
        request.request("GET", path, headers={"Host": host})
        answers[host] = request.getresponse().status
        request.close()
    assert [*answers.values()] == [403, 403, 200]


def test_it_is_served_on_this_machine_only(address: str) -> None:
    port = urlparse(address).port
    assert port is not None
    socket.create_connection(("127.0.0.1", port)).close()
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.2", port))

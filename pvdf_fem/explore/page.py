"""The page: what is dragged, turned, pressed and typed, and what is shown of it."""

from __future__ import annotations

import io
import socket
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import panel as pn
from bokeh.models import ColumnDataSource, DataRange1d, FactorRange
from bokeh.plotting import curdoc, figure

from pvdf_fem.explore import finding
from pvdf_fem.explore.film_figure import DIMMED, FilmFigure, colour_of
from pvdf_fem.explore.finding import Found
from pvdf_fem.explore.picture import QUANTITIES, Picture, picture_of
from pvdf_fem.explore.state import History, View, noise_of, probe_keys, sliders_of, value_at
from pvdf_fem.explore.worker import Worker
from pvdf_fem.scene.scene import Scene, SceneError
from pvdf_fem.scene.scene_file import parse_change
from pvdf_fem.solution.summary import Grid, solution_html

ADDRESS = "127.0.0.1"  #: The page is served on this machine only.
DIGITS = 4  #: Digits after the point of places in mm and of angles that are dragged.
FOUND_PATIENCE = 30.0  #: Seconds for which touches of another view may still be sought.
WIDE = {"sizing_mode": "stretch_width"}


@dataclass(frozen=True)
class Service:
    """What all pages of a server share: the scene and its file, and who solves and locates."""

    start: Scene
    file: Path
    made: Path  #: Folder of the responses that are built.
    solver: Worker
    finder: Worker
    builder: Worker


def serve(scene: Scene, file: Path, port: int, browser: bool) -> None:
    """Serve the page of a scene until it is interrupted. Port 0 is any free one; OSError where the
    port is taken."""
    with socket.socket() as test:
        test.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        test.bind((ADDRESS, port))
        port = test.getsockname()[1]
    workers = (
        Worker(picture_of),
        Worker(finding.find, FOUND_PATIENCE, 5),
        Worker(finding.build, 0, 10),
    )
    with TemporaryDirectory() as made:
        service = Service(scene, file, Path(made), *workers)
        print(f"http://{ADDRESS}:{port}/ shows {file}; Ctrl-C ends it", flush=True)
        origins = [f"{name}:{port}" for name in (ADDRESS, "localhost")]
        where = {"port": port, "address": ADDRESS, "websocket_origin": origins}
        try:
            pages = {"/": lambda: Page(service, pn.state.location.search).layout()}
            pn.serve(pages, **where, show=browser, title=f"explore {file.name}", verbose=False)
        finally:
            for worker in workers:
                worker.close()


class Page:
    """One page in a browser."""

    def __init__(self, service: Service, query: str) -> None:
        self.service, self.document = service, curdoc()
        self.history = History(View(service.start))
        self.film, self.bars = FilmFigure(), [Bars(*bars) for bars in BARS]
        self.message, self.told, self.located, self.link = (
            pn.pane.HTML("", **WIDE) for _ in range(4)
        )
        quantities = {quantity.label: name for name, quantity in QUANTITIES.items()}
        self.quantity = pn.widgets.RadioButtonGroup(options=quantities)
        self.noise = pn.widgets.TextInput(name="noise of readings, relative to them", width=170)
        self.setting = pn.widgets.TextInput(name="any value of the scene", width=170)
        self.setting.placeholder = "film.poisson_ratio=0.3"
        self.undo, self.redo = (pn.widgets.Button(name=name) for name in ("undo", "redo"))
        self.sliders = pn.Column(**WIDE)
        self.results = pn.Column(*(bars.pane for bars in self.bars), self.told, **WIDE)
        self._react()
        self._show()
        self._change(lambda view: View.of_query(view.scene, query.removeprefix("?")))

    def _react(self) -> None:
        """Let the controls do something."""

        def on(control: Any, change: Callable[[View, Any], View]) -> None:
            control.param.watch(lambda e: self._change(lambda view: change(view, e.new)), "value")

        on(self.quantity, lambda view, name: replace(view, quantity=name))
        on(self.noise, lambda view, text: replace(view, noise=noise_of(text)))
        on(self.setting, lambda view, t: view.changed(dict([parse_change(t)])) if t else view)
        dropped = self.film.sources["dropped"]
        dropped.on_change("data", lambda attr, old, new: self._change(self._dropped))
        self.undo.on_click(lambda _: self._go(self.history.undone()))
        self.redo.on_click(lambda _: self._go(self.history.redone()))

    def layout(self) -> Any:
        """What is on the page."""
        name, picture = self.service.file.name, pn.widgets.Button(name="save picture")
        picture.js_on_click(args={"save": self.film.save}, code="save.do.emit('save')")
        scene = pn.widgets.FileDownload(
            callback=lambda: io.StringIO(self.history.view.scene.to_toml()),
            **{"filename": name, "label": "save scene file", "button_type": "default"},
        )
        buttons = pn.FlexBox(self.quantity, self.undo, self.redo, scene, picture, self.link)
        film = pn.pane.Bokeh(self.film.model, **WIDE)
        inputs = pn.FlexBox(self.setting, self.noise)
        left = pn.Column(buttons, film, self.located, styles={"flex": "1 1 320px"})
        right = pn.Column(self.sliders, inputs, self.message, self.results)
        right.styles = {"flex": "0 1 440px"}
        return pn.FlexBox(left, right, **WIDE)

    def _change(self, change: Callable[[View], View]) -> None:
        """Go to a changed view, or tell why there is none."""
        try:
            self._go(self.history.to(change(self.history.view)))
        except SceneError as error:
            told = "<br>".join(map(escape, error.problems))
            self.message.object = f'<b class="refused">refused</b>: {told}'
            self._show()

    def _dropped(self, view: View) -> View:
        """The view in which a probe is where it was dropped, or turned."""
        data = self.film.sources["dropped"].data
        i, x, y, turned = (data[name][0] for name in ("probe", "x", "y", "turned_deg"))
        key = probe_keys(view.scene)[i]
        if turned:
            rotation = value_at(view.scene, f"{key}.rotation_deg") + turned
            rotation = (rotation + 180.0) % 360.0 - 180.0
            return view.changed({f"{key}.rotation_deg": round(rotation, DIGITS)})
        return view.changed({f"{key}.x_mm": round(x, DIGITS), f"{key}.y_mm": round(y, DIGITS)})

    def _go(self, history: History) -> None:
        if history is not self.history:
            self.history, self.message.object = history, ""
            self._show()

    def _show(self) -> None:
        """Show the view, and ask for its picture."""
        history, view = self.history, self.history.view
        self.film.show_scene(view)
        self.undo.disabled, self.redo.disabled = not history.past, not history.future
        self.quantity.value, self.noise.value = view.quantity, f"{view.noise:g}"
        self.setting.value = ""
        self._show_sliders(view)
        query = view.query(self.service.start)
        self.link.object = f'<a href="?{escape(query)}">link to this</a>'
        if pn.state.location:
            pn.state.location.search = f"?{query}" if query else ""
        self.results.styles, self.located.object = {"opacity": str(DIMMED)}, "solving …"
        self._ask(self.service.solver, self._solved, view, view.scene, view.quantity)

    def _show_sliders(self, view: View) -> None:
        wanted, there = sliders_of(view.scene), list(self.sliders)
        if [slider.title for slider, _ in wanted] != [widget.name for widget in there]:
            there = [pn.widgets.FloatSlider(name=slider.title, **WIDE) for slider, _ in wanted]
            for (slider, _), widget in zip(wanted, there, strict=True):
                slid = partial(self._slid, slider.key)
                widget.param.watch(slid, "value_throttled")
            self.sliders.objects = there
        for (slider, value), widget in zip(wanted, there, strict=True):
            span = {"start": min(slider.low, value), "end": max(slider.high, value)}
            widget.param.update(**span, step=slider.step, value=value)

    def _slid(self, key: str, event: Any) -> None:
        self._change(lambda view: view.changed({key: event.new}))

    def _ask(self, worker: Worker, show: Callable[..., None], view: View, *request: Any) -> None:
        """Ask for what is shown of a view, unless another one is on the page by then."""

        def shown(answer: Any) -> None:
            if view is self.history.view:
                show(view, answer)

        worker.ask(self, lambda a: self.document.add_next_tick_callback(lambda: shown(a)), *request)

    def _solved(self, view: View, answer: Picture | Exception) -> None:
        if isinstance(answer, Exception):
            self.located.object = f"<b>failed</b>: {escape(str(answer))}"
            return
        self.results.styles = {}
        self.told.object = solution_html(answer.result)
        for bars in self.bars:
            bars.show(answer.result)
        self.located.object = ""
        if answer.image is not None:
            self.film.show_image(answer.image, view.scene.film.radius_mm)
            if view.scene.loaded_probes:
                self.located.object = "<b>locate</b>: computing …"
                self._find(view, answer)

    def _find(self, view: View, picture: Picture) -> None:
        """Ask for the touches by a response; until it is built, by solves."""
        file, service = (
            finding.response_file(view.scene, self.service.file, self.service.made),
            self.service,
        )
        known = file if file and file.exists() else None
        request = view.scene, picture.result, view.noise, known
        self._ask(service.finder, self._found, view, *request)
        if file and not known:
            again = partial(self._built, picture)
            self._ask(service.builder, again, view, view.scene, file)

    def _built(self, picture: Picture, view: View, answer: Path | Exception) -> None:
        if isinstance(answer, Path):
            self._find(view, picture)

    def _found(self, view: View, answer: Found | Exception) -> None:
        if isinstance(answer, Exception):
            self.located.object = f"<b>locate</b>: {escape(str(answer))}"
            return
        self.film.show_found(answer)
        told = "".join(f"<br>{escape(remark)}" for remark in answer.remarks)
        self.located.object = f"<b>locate</b>{told}{Grid(*answer.table).html()}"


#: Keys of a result whose numbers have bars, with the labels of these.
BARS = (("charges_pC", "charge (pC)"), ("readings_V", "reading (V)"))


class Bars:
    """Bars of the numbers that a result has by electrode."""

    def __init__(self, key: str, label: str) -> None:
        self.key, self.source = key, ColumnDataSource(name=key)
        look = {"height": 170, "tools": "", "toolbar_location": None, "y_axis_label": label}
        ranges = {"x_range": FactorRange(), "y_range": DataRange1d(range_padding=0.4)}
        self.plot = plot = figure(**ranges, **look)
        plot.vbar("name", top="value", width=0.6, color="colour", source=self.source)
        text = {"text_align": "center", "text_baseline": "bottom", "text_font_size": "12px"}
        plot.text("name", "value", "text", source=self.source, **text)
        self.pane = pn.pane.Bokeh(plot, **WIDE)
        self.show({})

    def show(self, result: dict[str, Any]) -> None:
        """Show the numbers of a result; nothing where it has none."""
        values = result.get(self.key, {})
        self.pane.visible, self.plot.x_range.factors = bool(values), [*values]
        columns = {"name": [*values], "value": [*values.values()]}
        columns["text"] = [f"{value:.5g}" for value in values.values()]
        self.source.data = {**columns, "colour": [colour_of(i) for i in range(len(values))]}

"""The page: what is dragged, turned, pressed and typed, and what is shown of it."""

from __future__ import annotations

import io
import logging
import re
import socket
from collections.abc import Callable
from functools import partial
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import panel as pn
from bokeh.document import without_document_lock
from bokeh.models import ColumnDataSource, DataRange1d, FactorRange
from bokeh.plotting import curdoc, figure
from matplotlib.ticker import MaxNLocator
from tornado.web import ErrorHandler

from pvdf_fem.explore.film_figure import FilmFigure, colour_of
from pvdf_fem.explore.finding import Found, build, find, response_file
from pvdf_fem.explore.picture import QUANTITIES, Picture, picture_of
from pvdf_fem.explore.state import History, View, sliders_of
from pvdf_fem.explore.worker import Worker
from pvdf_fem.scene.scene import Scene, SceneError
from pvdf_fem.scene.scene_file import parse_change
from pvdf_fem.solution.summary import solution_html

ADDRESS = "127.0.0.1"  #: The page is served on this machine only.
HOSTS = (ADDRESS, "localhost")  #: What the page may be called; another site's name may lead here.
DIMMED = 0.2  #: Opacity of results that are not those of the scene that is shown.
PATIENCE_MS = 300  #: After this time a scene is shown without its picture.
WIDE = {"sizing_mode": "stretch_width"}
#: Keys of a result whose numbers have bars, with the labels of these.
BARS = (("charges_pC", "charge (pC)"), ("readings_V", "reading (V)"))


def serve(scene: Scene, file: Path, port: int, browser: bool) -> None:
    """Serve the page of a scene until it is interrupted. Port 0 is any free one; OSError where the
    port is taken."""
    with socket.socket() as test:
        test.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        test.bind((ADDRESS, port))
        port = test.getsockname()[1]
    logging.getLogger("panel.util").setLevel("ERROR")  # Panel wonders about tables in links
    workers = Worker(picture_of), Worker(find, 5), Worker(build, 10)  # pictures come first
    with TemporaryDirectory() as folder:
        origins = [f"{name}:{port}" for name in HOSTS]
        where = {"port": port, "address": ADDRESS, "websocket_origin": origins, "verbose": False}
        try:
            pages = {"/": lambda: Page(scene, file.name, Path(folder), *workers).layout()}
            look = {"show": browser, "title": f"explore {file.name}", "start": False}
            server = pn.serve(pages, **look, **where)
            others = f"(?!({'|'.join(map(re.escape, HOSTS))})$).*"
            server._tornado.add_handlers(others, [(".*", ErrorHandler, {"status_code": 403})])
            print(f"http://{ADDRESS}:{port}/ shows {file}; Ctrl-C ends it", flush=True)
            server.run_until_shutdown()
        finally:
            for worker in workers:
                worker.close()


class Page:
    """One page in a browser, about a scene from a file; responses are kept in a folder."""

    def __init__(self, start: Scene, name: str, folder: Path, *workers: Worker) -> None:
        self.start, self.name, self.folder, self.document = start, name, folder, curdoc()
        self.solver, self.finder, self.builder = workers
        self.history = History(View(start))
        self.shown: View | None = None  # by the controls and the outlines
        self.film, self.bars = FilmFigure(), [Bars(*bars) for bars in BARS]
        panes = (pn.pane.HTML("", styles={"overflow-x": "auto"}, **WIDE) for _ in range(3))
        self.message, self.told, self.located = panes
        self.link = pn.pane.HTML("")
        self.quantity = pn.widgets.RadioButtonGroup(
            options={quantity.label: name for name, quantity in QUANTITIES.items()}
        )
        self.noise = pn.widgets.TextInput(name="noise of readings, relative to them", width=180)
        self.setting = pn.widgets.TextInput(name="any value: KEY=VALUE", width=180)
        self.undo, self.redo = (pn.widgets.Button(name=name) for name in ("undo", "redo"))
        self.sliders = pn.Column(**WIDE)
        self.results = pn.Column(*(bars.pane for bars in self.bars), self.told, **WIDE)
        query = pn.state.location.search[1:] if pn.state.location else ""
        self._react()
        pn.state.on_session_destroyed(lambda _: setattr(self, "history", History(View(start))))
        if query:
            self._go(lambda history: history.to(View.of_query(start, query)))
        else:
            self._solve()
        self._show()

    def _react(self) -> None:
        """Let the controls do something."""
        self._on(self.quantity, "value", lambda h, name: h.changed({"quantity": name}))
        self._on(self.noise, "value", lambda h, text: _typed(h, f"noise={text}"))
        self._on(self.setting, "value", _typed)
        self._on(self.undo, "clicks", lambda h, _: h.undone() if h.past else h)
        self._on(self.redo, "clicks", lambda h, _: h.redone() if h.future else h)

        def dropped(attr: str, old: Any, new: Any) -> None:
            self._go(lambda h: h.changed(dict(zip(new["key"], new["value"], strict=True))))

        self.film.sources["dropped"].on_change("data", dropped)

    def _on(self, control: Any, name: str, move: Callable[[History, Any], History]) -> None:
        """Let a control's value change the view."""

        def changed(event: Any) -> None:
            self._locked(self._go, lambda history: move(history, event.new))

        control.param.watch(changed, name)

    def _locked(self, act: Callable[..., None], *arguments: Any) -> None:
        """Act with the lock of Bokeh's document, which Panel does not take for events."""
        self.document.add_next_tick_callback(lambda: act(*arguments))

    def layout(self) -> Any:
        """What is on the page."""
        picture = pn.widgets.Button(name="save picture")
        picture.js_on_click(args={"save": self.film.save}, code="save.do.emit('save')")
        look = {"label": "save scene file", "button_type": "default", "filename": self.name}
        scene = pn.widgets.FileDownload(
            callback=lambda: io.StringIO(self.history.view.scene.to_toml()), **look
        )
        buttons = pn.FlexBox(self.quantity, self.undo, self.redo, scene, picture, self.link)
        film, inputs = pn.pane.Bokeh(self.film.model, **WIDE), pn.FlexBox(self.setting, self.noise)
        left = pn.Column(buttons, film, self.located, styles={"flex": "1 1 320px"})
        right = pn.Column(self.sliders, inputs, self.message, self.results)
        right.styles = {"flex": "0 1 440px"}
        return pn.FlexBox(left, right, **WIDE)

    def _go(self, move: Callable[[History], History]) -> None:
        """Show another view, or tell why there is none."""
        try:
            history, refused = move(self.history), ""
        except SceneError as error:
            told = "<br>".join(map(escape, error.problems))
            history, refused = self.history, f"<b>refused</b>: {told}"
        if refused or history is not self.history:
            self.history, self.message.object = history, refused
            self.shown = None
            self._solve()
            late = partial(self._late, history.view)
            self.document.add_timeout_callback(late, PATIENCE_MS)

    def _solve(self) -> None:
        """Have the view solved."""
        view = self.history.view
        self._ask(self.solver, self._solved, view, view.scene, view.quantity)

    def _late(self, view: View) -> None:
        """Show a view that has no picture yet, and dim that of another one."""
        if view is self.history.view and self.shown is not view:
            self._show()
            self._dim()
            self.located.object = "solving …"

    def _dim(self) -> None:
        """Dim picture and results, which are those of another view."""
        self.film.field.global_alpha = DIMMED
        if self.told.object:
            self.results.styles = {"opacity": str(DIMMED)}

    def _show(self) -> None:
        """Show the view by outlines and controls."""
        history, view = self.history, self.history.view
        self.shown = view
        self.film.show_scene(view)
        self.undo.disabled, self.redo.disabled = not history.past, not history.future
        self.quantity.value, self.noise.value = view.quantity, str(view.noise)
        self.setting.value = ""
        sliders = sliders_of(view.scene)
        if [*sliders] != [widget.name for widget in self.sliders]:
            self.sliders.objects = [pn.widgets.FloatSlider(name=key, **WIDE) for key in sliders]
            for key, widget in zip(sliders, self.sliders, strict=True):
                self._on(widget, "value_throttled", partial(_slid, key))
        for slider, widget in zip(sliders.values(), self.sliders, strict=True):
            widget.param.update(**slider)
        query = f"?{view.query(self.start)}".removesuffix("?")
        self.link.object = f'<a href="{escape(query or "?")}">link to this</a>'
        if pn.state.location:
            pn.state.location.search = query

    def _ask(self, worker: Worker, show: Callable[..., None], view: View, *request: Any) -> None:
        """Have an answer about a view shown, unless another one is on the page by then."""

        def newest() -> bool:
            return view is self.history.view

        def shown(answer: Any) -> None:
            if newest():
                show(view, answer)

        async def ask() -> None:
            answer = await worker.answer(newest, *request)
            if newest():
                self._locked(shown, answer)

        self.document.add_next_tick_callback(without_document_lock(ask))

    def _solved(self, view: View, picture: Picture | Exception) -> None:
        """Show the picture first, the rest of the page in a message of its own."""
        if isinstance(picture, Picture) and picture.image is not None:
            self.film.show_image(picture.image, view.scene.film.radius_mm, view.quantity)
            self.film.field.global_alpha = 1.0
        else:
            self._dim()
        self._locked(self._tell, view, picture)

    def _tell(self, view: View, picture: Picture | Exception) -> None:
        """Show what is known of a view."""
        if view is not self.history.view:
            return
        if self.shown is not view:
            self._show()
        if isinstance(picture, Exception):
            self.located.object = f"<b>failed</b>: {escape(str(picture))}"
            return
        if picture.image is not None:
            self.film.show_scale(view.quantity)
        self.told.object, self.located.object = solution_html(picture.result), ""
        self.results.styles = {"opacity": "1"}
        for bars in self.bars:
            bars.show(picture.result)
        if picture.image is not None and view.scene.loaded_probes:
            self.located.object = "<b>locate</b>: computing …"
            self._find(picture.result, view)

    def _find(self, result: dict[str, Any], view: View, built: Any = None) -> None:
        """Have the touch located by a response, and by solves until it is built."""
        if isinstance(built, Exception):
            return
        file = response_file(view.scene, self.folder)
        known = file if file and file.exists() else None
        self._ask(self.finder, self._found, view, view.scene, result, view.noise, known)
        if file and not known:
            self._ask(self.builder, partial(self._find, result), view, view.scene, file)

    def _found(self, view: View, found: Found | Exception) -> None:
        if isinstance(found, Exception):
            self.located.object = f"<b>locate</b>: {escape(str(found))}"
            return
        self.film.show_found(found)
        told = "".join(f"<br>{escape(remark)}" for remark in found.remarks)
        self.located.object = f"<b>locate</b>{told}{found.table.html()}"


def _slid(key: str, history: History, value: float) -> History:
    return history.changed({key: round(value, 6)})  # without the rounding of steps


def _typed(history: History, text: str) -> History:
    return history.changed(dict([parse_change(text)])) if text else history


class Bars:
    """Bars of the numbers that a result has by electrode."""

    def __init__(self, key: str, label: str) -> None:
        self.key, self.source = key, ColumnDataSource(name=key)
        look = {"height": 170, "tools": "", "toolbar_location": None, "y_axis_label": label}
        self.plot = figure(x_range=FactorRange(), y_range=DataRange1d(range_padding=0.6), **look)
        self.plot.vbar("name", top="value", width=0.6, color="colour", source=self.source)
        text = {"text_align": "center", "text_baseline": "middle", "text_font_size": "12px"}
        self.plot.text("name", "value", "text", source=self.source, y_offset="beyond", **text)
        self.pane = pn.pane.Bokeh(self.plot, **WIDE)
        self.show({})

    def show(self, result: dict[str, Any]) -> None:
        """Show the numbers of a result; nothing where it has none."""
        values = result.get(self.key) or {}
        self.pane.visible, self.plot.x_range.factors = bool(values), [*values]
        columns = {"name": [*values], "value": [*values.values()]}
        columns["text"] = [f"{value:.4g}" for value in values.values()]
        columns["beyond"] = [9.0 if value < 0.0 else -9.0 for value in values.values()]  # in pixels
        ends = min([0.0, *values.values()]), max([0.0, *values.values()])
        self.plot.yaxis.ticker = list(MaxNLocator(4).tick_values(*ends))  # enclose all bars
        self.source.data = {**columns, "colour": [colour_of(i) for i in range(len(values))]}

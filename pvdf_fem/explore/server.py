"""The server of the page. It keeps nothing: the browser's address is the view, and the browser's
history undoes and redoes.
"""

from __future__ import annotations

import json
import os
import webbrowser
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

from joblib.externals.loky import get_reusable_executor

from pvdf_fem.batch.workers import ONE_THREAD, exit_with_parent
from pvdf_fem.explore.certainty import estimate_certainty
from pvdf_fem.explore.controls import describe_controls, describe_outlines
from pvdf_fem.explore.results import collect_results
from pvdf_fem.explore.state import View
from pvdf_fem.scene.scene import Scene, SceneError

ADDRESS = "127.0.0.1"  #: The page is served on this machine only.
HOSTS = (ADDRESS, "localhost")  #: What the page may be called; another site's name may lead here.
FILES = {"/": ("page.html", "text/html"), "/page.js": ("page.js", "text/javascript")}


def serve(scene: Scene, file: Path, port: int, browser: bool) -> None:
    """Serve a scene's page until interrupted. Port 0 is any free one; OSError where the
    port is taken."""
    with Server((ADDRESS, port), partial(Handler, scene, file.name)) as server:
        address = f"http://{ADDRESS}:{server.server_port}/"
        print(f"{address} shows {file}; Ctrl-C ends it", flush=True)
        if browser:
            webbrowser.open(address)
        try:
            with suppress(KeyboardInterrupt):
                server.serve_forever()
        finally:
            _process().shutdown(wait=False, kill_workers=True)


def describe_view(start: Scene, at: str, change: str) -> dict[str, Any]:
    """Link, outlines and controls of the view with a link, after a change unless it is refused."""
    view, refused = View(start), tuple[str, ...]()
    try:
        view = View.of_query(start, at)
        view = view.typed(change) if change else view
    except SceneError as error:
        refused = error.problems
    link = {"query": view.query(start), "refused": refused}
    return {**link, **describe_outlines(view.scene), "controls": describe_controls(view)}


def _process() -> Any:
    """The solver process, replaced if dead; it ends with this process."""
    begin = {"initializer": exit_with_parent, "initargs": (os.getpid(),)}
    return get_reusable_executor(max_workers=1, timeout=None, env=ONE_THREAD, **begin)


def _worked(function: Callable[..., dict[str, Any]], *arguments: Any) -> dict[str, Any]:
    """What a function gives in the process, or the reason why it gives nothing."""
    try:
        return dict(_process().submit(function, *arguments).result())
    except (RuntimeError, ValueError) as error:  # the process died, among others
        return {"failed": str(error)}


class Server(ThreadingHTTPServer):
    """A server with a thread for each connection."""

    daemon_threads = True
    allow_reuse_address = os.name == "posix"  # elsewhere two servers would share a port


class Handler(BaseHTTPRequestHandler):
    """Answers a browser about a scene from a named file."""

    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True  # an answer would wait for the browser's acknowledgement

    def __init__(self, start: Scene, name: str, *connection: Any) -> None:
        self.start, self.name = start, name
        super().__init__(*connection)

    def do_GET(self) -> None:
        """Answer a browser that calls the page by this machine's name."""
        url = urlsplit(self.path)
        asked = {key: values[-1] for key, values in parse_qs(url.query).items()}
        if self.headers.get("Host", "").partition(":")[0] not in HOSTS:
            self.send_error(403)
        elif url.path in FILES:
            name, kind = FILES[url.path]
            self._send(Path(__file__).with_name(name).read_text("utf-8"), kind)
        elif url.path == "/view":
            answer = describe_view(self.start, asked.get("at", ""), asked.get("change", ""))
            self._send(json.dumps({"name": self.name, **answer}))
        else:
            self._send_of_view(url.path, asked.get("at", ""))

    def _send_of_view(self, path: str, at: str) -> None:
        """Send what is at a path about the view with a link."""
        try:
            view = View.of_query(self.start, at)
        except SceneError:
            return self.send_error(400)
        text = view.scene.to_toml()
        if path == "/picture":
            self._send(json.dumps(_worked(collect_results, text, view.quantity)))
        elif path == "/certainty":
            self._send(json.dumps(_worked(estimate_certainty, text, view.noise)))
        elif path == "/scene.toml":
            self._send(text, "application/toml")
        else:
            self.send_error(404)

    def _send(self, text: str, kind: str = "application/json") -> None:
        """Send a text."""
        body = text.encode()
        self.send_response(200)
        self.send_header("Content-Type", f"{kind}; charset=utf-8")
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *arguments: Any) -> None:
        """Nothing: the page shows what happens."""

"""The server of the page.

The server stores no state: the address in the browser contains the view, and the browser's history
undoes and redoes changes.
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
#: Host names in requests that are answered. Without this check, another site whose name resolves
#: to this machine could read the answers (DNS rebinding).
HOSTS = (ADDRESS, "localhost")
FILES = {"/": ("page.html", "text/html"), "/page.js": ("page.js", "text/javascript")}


def serve(scene: Scene, file: Path, port: int, browser: bool) -> None:
    """Serve the page of a scene until Ctrl-C, and print its address.

    Parameters
    ----------
    scene : Scene
        The scene with which the page starts.
    file : Path
        File of the scene, whose name the page shows.
    port : int
        Port of the page, or 0 for any free port.
    browser : bool
        Whether to open the page in a browser.

    Raises
    ------
    OSError
        If the port is in use.
    """
    with Server((ADDRESS, port), partial(Handler, scene, file.name)) as server:
        address = f"http://{ADDRESS}:{server.server_port}/"
        print(f"{address} shows {file}; Ctrl-C ends it", flush=True)
        if browser:
            webbrowser.open(address)
        try:
            with suppress(KeyboardInterrupt):
                server.serve_forever()
        finally:
            _get_executor().shutdown(wait=False, kill_workers=True)


def describe_view(start: Scene, query: str, change: str) -> dict[str, Any]:
    """Describe the parts of a view that the page shows before the solve.

    Parameters
    ----------
    start : Scene
        The scene of the scene file.
    query : str
        Query of the link to the view.
    change : str
        Changes of the view, such as ``KEY=VALUE KEY=VALUE``; empty for none.

    Returns
    -------
    dict
        `query` of the changed view; `refused`, the error messages of an invalid query or change;
        `controls`; and the outlines by `describe_outlines`. If the query is invalid, the view is
        that of the scene file; if the change is invalid, the view is unchanged.
    """
    view = View(start)
    errors: tuple[str, ...] = ()
    try:
        view = View.from_query(start, query)
        if change:
            view = view.with_typed_changes(change)
    except SceneError as error:
        errors = error.problems
    return {
        "query": view.format_query(start),
        "refused": errors,
        **describe_outlines(view.scene),
        "controls": describe_controls(view),
    }


def _get_executor() -> Any:
    """Return the executor of the one process in which scenes are solved.

    At the first call, or if the solver process has died, a new one is started. It ends with this
    process.
    """
    return get_reusable_executor(
        max_workers=1,
        timeout=None,
        env=ONE_THREAD,
        initializer=exit_with_parent,
        initargs=(os.getpid(),),
    )


def _run_in_solver(function: Callable[..., dict[str, Any]], *arguments: Any) -> dict[str, Any]:
    """Call a function in the solver process; return its dict, or the error message as `failed`."""
    try:
        return dict(_get_executor().submit(function, *arguments).result())
    except (RuntimeError, ValueError) as error:  # RuntimeError if the process died, among others
        return {"failed": str(error)}


class Server(ThreadingHTTPServer):
    """A server with a thread for each connection."""

    daemon_threads = True
    allow_reuse_address = os.name == "posix"  # elsewhere two servers would share a port


class Handler(BaseHTTPRequestHandler):
    """A handler of the browser's requests about one scene file."""

    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True  # else answers would wait for the browser's acknowledgement

    def __init__(self, start: Scene, name: str, *connection: Any) -> None:
        self.start = start
        self.name = name
        super().__init__(*connection)

    def do_GET(self) -> None:
        """Answer a request for the page, for a view or for its results.

        The answer is error 403 if the host that the request names is not in `HOSTS`.
        """
        url = urlsplit(self.path)
        parameters = {name: values[-1] for name, values in parse_qs(url.query).items()}
        host, _, _ = self.headers.get("Host", "").partition(":")
        if host not in HOSTS:
            self.send_error(403)
        elif url.path in FILES:
            name, media_type = FILES[url.path]
            self._send_text(Path(__file__).with_name(name).read_text("utf-8"), media_type)
        elif url.path == "/view":
            query = parameters.get("at", "")
            view = describe_view(self.start, query, change=parameters.get("change", ""))
            self._send_text(json.dumps({"name": self.name, **view}))
        else:
            self._answer_view_request(url.path, parameters.get("at", ""))

    def _answer_view_request(self, path: str, query: str) -> None:
        """Answer a request for the results, the certainty or the scene file of a view.

        The answer is error 400 if the query of the view is invalid, and 404 for another path.
        """
        try:
            view = View.from_query(self.start, query)
        except SceneError:
            return self.send_error(400)
        text = view.scene.to_toml()
        if path == "/picture":
            self._send_text(json.dumps(_run_in_solver(collect_results, text, view.quantity)))
        elif path == "/certainty":
            self._send_text(json.dumps(_run_in_solver(estimate_certainty, text, view.noise)))
        elif path == "/scene.toml":
            self._send_text(text, "application/toml")
        else:
            self.send_error(404)

    def _send_text(self, text: str, media_type: str = "application/json") -> None:
        """Send a text as the answer, with a header that forbids the browser to cache it."""
        body = text.encode()
        self.send_response(200)
        self.send_header("Content-Type", f"{media_type}; charset=utf-8")
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *arguments: Any) -> None:
        """Suppress the log of requests, because the page shows every result and error."""

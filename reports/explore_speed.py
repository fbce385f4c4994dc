"""Time from a drop of the probe to its picture in `pvdf-fem explore`, in a real browser.

    python -m reports.explore_speed [--drops 60] [--scene triangle]

The probe is dragged to random places within 12 mm. A drop is the pointer's release, and a picture
is there when the browser has painted the new image. Beside the median and the 95th percentile of
that time stands the time of processors that all processes spent on a drop, which is less at the
mercy of what else the machine does. The first drop waits until the response is built by which the
page locates touches; each touch is located after its picture, as for a visitor.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import sync_playwright

from pvdf_fem.scene.scene_file import example_text, examples

LOCATED = "by a response"  #: What the page says of a touch once the response is built.
#: Watches drops and pictures; a message comes after the frame that it was posted in is painted.
WATCH = """() => {
  window.drops = [], window.pictures = []
  document.addEventListener("pointerup", () => drops.push(performance.now()), true)
  Bokeh.documents[0].get_model_by_name("image").properties.data.change.connect(() =>
    requestAnimationFrame(() => {
      const channel = new MessageChannel()
      channel.port1.onmessage = () => pictures.push(performance.now())
      channel.port2.postMessage(0)
    }))
}"""
#: Where the first probe is, and a point of the film in mm, on the screen.
PLACES = """([x, y]) => {
  const view = Bokeh.index.find_one(Bokeh.documents[0].get_model_by_name("film"))
  const box = view.el.getBoundingClientRect(), {x_scale, y_scale} = view.frame
  const probe = Bokeh.documents[0].get_model_by_name("probes").data
  const at = (x, y) => [box.left + x_scale.compute(x), box.top + y_scale.compute(y)]
  return [at(probe.x[0], probe.y[0]), at(x, y)]
}"""


def processor_seconds(root: int) -> float:
    """Time that a process and those that it started have had, on Linux."""
    parents, seconds = {}, {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:  # it has ended
            continue
        parents[int(stat.parent.name)] = int(fields[1])
        seconds[int(stat.parent.name)] = (int(fields[11]) + int(fields[12])) / os.sysconf(
            "SC_CLK_TCK"
        )

    def of(process: int) -> float:
        children = [child for child, parent in parents.items() if parent == process]
        return seconds.get(process, 0.0) + sum(map(of, children))

    return of(root)


def measure(page: Any, drops: int) -> list[float]:
    """Milliseconds from drop to picture."""
    page.evaluate(WATCH)
    places, mouse, found = random.Random(1), page.mouse, []
    for _ in range(drops):
        radius, turn = 12.0 * math.sqrt(places.random()), math.tau * places.random()
        there = [radius * math.cos(turn), radius * math.sin(turn)]
        start, end = page.evaluate(PLACES, there)
        mouse.move(*start)
        mouse.down()
        mouse.move(*end, steps=5)
        count = page.evaluate("pictures.length")
        mouse.up()
        page.wait_for_function(f"pictures.length > {count}")
        found.append(page.evaluate("pictures.at(-1) - drops.at(-1)"))
        page.wait_for_timeout(300)
    return found


def main() -> None:
    """Run the measurement and print it as JSON."""
    parser = argparse.ArgumentParser("reports.explore_speed", description=__doc__)
    parser.add_argument("--drops", type=int, default=60)
    parser.add_argument("--scene", default="triangle", help="name of an example")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as driver:
        file = Path(folder, "scene.toml")
        file.write_text(example_text(options.scene, examples()), encoding="utf-8")
        command = [sys.executable, "-m", "pvdf_fem", "explore", str(file), "--no-browser"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
            assert server.stdout is not None
            path, flags = shutil.which("chromium"), ["--no-sandbox", "--disable-gpu"]
            try:
                browser = driver.chromium.launch(executable_path=path, args=flags)
                page = browser.new_page(viewport={"width": 1300, "height": 1000})
                page.set_default_timeout(300_000)
                page.goto(server.stdout.readline().split()[0])
                page.get_by_text(LOCATED).first.wait_for()
                before, load = processor_seconds(server.pid), os.getloadavg()[0]
                milliseconds = measure(page, options.drops)
                spent = (processor_seconds(server.pid) - before) / options.drops
                browser.close()
            finally:
                server.send_signal(signal.SIGINT)
    result = {
        "drops": options.drops,
        "median_ms": round(float(np.median(milliseconds))),
        "percentile_95_ms": round(float(np.percentile(milliseconds, 95.0))),
        "least_ms": round(min(milliseconds)),
        "server_processor_ms_a_drop": round(1e3 * spent),
        "load_average": [round(load, 1), round(os.getloadavg()[0], 1)],
        "cores": os.cpu_count(),
    }
    print(json.dumps(result))


if __name__ == "__main__":
    main()

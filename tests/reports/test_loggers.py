"""The guide's scripts for loggers, with a few lines in the place of their packages."""

import importlib
import io
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from pvdf_fem import Response
from tests.helpers.streams import Tap, make_sensor, make_stream

MODEL = make_sensor()
STREAM = make_stream(MODEL, [Tap(0.4, 0.1, (3.0, -2.0), 0.8)], 0.6, noise_V=2e-4)
SAMPLES = list(zip(*map(np.ndarray.tolist, STREAM), strict=True))


@pytest.fixture
def script(monkeypatch):
    """Imports a script with a package, for the made-up response."""

    def load(name, package, **members):
        monkeypatch.setitem(sys.modules, package, SimpleNamespace(**members))
        monkeypatch.setattr(Response, "load", lambda path: MODEL)
        return importlib.import_module(f"reports.guide.loggers.{name}")

    return load


def test_a_serial_port(script, capsys):
    lines = [f"{1e3 * t},{','.join(map(str, row))}" for t, row in SAMPLES]
    port = io.BytesIO("\n".join(["3,0.4", *lines]).encode())
    module = script("serial_port", "serial", Serial=lambda device, baud, timeout: port)
    module.main("sensor.response", "/dev/ttyACM0")
    assert len(capsys.readouterr().out.splitlines()) == 1  # of one touch


def test_a_lab_streaming_layer_stream(script):
    pulled, sent = iter([*((row, t) for t, row in SAMPLES), (None, None)]), []
    module = script(
        "lab_streaming_layer",
        "pylsl",
        resolve_byprop=lambda by, name, timeout: [SimpleNamespace(nominal_srate=lambda: 1e3)],
        StreamInlet=lambda found: SimpleNamespace(pull_sample=lambda timeout: next(pulled)),
        StreamInfo=lambda name, kind, channels, *more: channels,
        StreamOutlet=lambda channels: SimpleNamespace(push_sample=lambda *of: sent.append(of)),
    )
    module.main("sensor.response", "sensor")
    assert [t for _, t in sent] == [t for t, _ in SAMPLES]
    table = np.array([row for row, _ in sent])
    at = int(np.nanargmax(table[:, module.COLUMNS.index("force_N")]))
    assert table[at, :4] == pytest.approx([1.0, 3.0, -2.0, 0.8], abs=0.3)

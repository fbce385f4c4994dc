"""The guide's scripts for loggers, with fakes in the place of their packages."""

import importlib
import sys
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest

from pvdf_fem import Response
from tests.helpers.streams import Tap, sensor, stream

MODEL = sensor()
STREAM = stream(MODEL, [Tap(0.4, 0.1, (3.0, -2.0), 0.8)], 0.6, noise_V=2e-4)
SAMPLES = list(zip(*map(np.ndarray.tolist, STREAM), strict=True))


@pytest.fixture
def script(monkeypatch):
    """Imports a script afresh; its packages are fakes, and the response is the made-up one."""

    def load(name, **packages):
        for package, fake in packages.items():
            monkeypatch.setitem(sys.modules, package.replace("__", "."), fake)
        monkeypatch.setattr(Response, "load", lambda path: MODEL)
        monkeypatch.delitem(sys.modules, f"reports.guide.loggers.{name}", raising=False)
        return importlib.import_module(f"reports.guide.loggers.{name}")

    return load


def test_a_serial_port(script, capsys):
    port = MagicMock()
    port.__enter__.return_value = port
    lines = [f"{1e3 * t},{','.join(map(str, row))}\n" for t, row in SAMPLES]
    port.readline.side_effect = [b"3,0.4\n", *map(str.encode, lines), b""]
    fake = SimpleNamespace(Serial=lambda device, baud, timeout: port)
    script("serial_port", serial=fake).main("model.npz", "/dev/ttyACM0")
    assert len(capsys.readouterr().out.splitlines()) == 1  # of one touch


def test_a_lab_streaming_layer_stream(script):
    fake = MagicMock()
    fake.resolve_byprop.return_value = [MagicMock()]
    pulled = [(row, t) for t, row in SAMPLES]
    fake.StreamInlet.return_value.pull_sample.side_effect = [*pulled, (None, None)]
    module = script("lab_streaming_layer", pylsl=fake)
    module.main("model.npz", "sensor")
    sent = [call.args for call in fake.StreamOutlet.return_value.push_sample.call_args_list]
    assert [t for _, t in sent] == [t for t, _ in SAMPLES]
    table = np.array([row for row, _ in sent])
    assert fake.StreamInfo.call_args.args[2] == table.shape[1] == len(module.COLUMNS)
    at = int(np.nanargmax(table[:, module.COLUMNS.index("force_N")]))
    assert table[at, :4] == pytest.approx([1.0, 3.0, -2.0, 0.8], abs=0.3)


def test_a_ros_2_node(script):
    topics = ("force", "place", "place_covariance")
    node, published = MagicMock(), {topic: [] for topic in topics}

    def spin(node):
        (_, topic, on_readings, _) = node.create_subscription.call_args.args
        assert topic == "readings"
        for t, values in SAMPLES:
            node.get_clock.return_value.now.return_value.nanoseconds = round(1e9 * t)
            on_readings(SimpleNamespace(data=values))

    node.create_publisher = lambda kind, topic, _: SimpleNamespace(publish=published[topic].append)
    fakes = dict.fromkeys(("geometry_msgs", "std_msgs"), MagicMock())
    kinds = ("PointStamped", "WrenchStamped", "Float64MultiArray")
    messages = SimpleNamespace(**dict.fromkeys(kinds, MagicMock))
    fakes |= {f"{name}__msg": messages for name in fakes}
    rclpy = MagicMock(spin=spin, create_node=lambda name: node)
    script("ros2_node", rclpy=rclpy, **fakes).main("model.npz")
    forces, places, covariances = published.values()
    assert len(forces) == len(places) == len(covariances) > 50
    at = int(np.argmax([message.wrench.force.z for message in forces]))
    assert forces[at].wrench.force.z == pytest.approx(0.8, rel=0.1)
    assert (places[at].point.x, places[at].point.y) == pytest.approx((3e-3, -2e-3), abs=3e-4)
    variances = np.diag(np.reshape(covariances[at].data, (3, 3)))
    assert (0.0 < variances[0] < 1e-6, variances[2]) == (True, 0.0)

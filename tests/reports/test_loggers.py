"""The guide's scripts for loggers, with fakes in the place of their packages."""

import importlib
import sys
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest

from tests.helpers.streams import Tap, sensor, stream

TAP = Tap(0.4, 0.1, (3.0, -2.0), 0.8)
MODEL = sensor()


@pytest.fixture(scope="module")
def samples():
    t, readings = stream(MODEL, [TAP], 0.6, noise_V=2e-4)
    return list(zip(t.tolist(), readings.tolist(), strict=True))


def script(monkeypatch, name, **packages):
    """A fresh import of a script, whose response is the made-up one."""
    for package, fake in packages.items():
        monkeypatch.setitem(sys.modules, package.replace("__", "."), fake)
    monkeypatch.delitem(sys.modules, f"reports.guide.loggers.{name}", raising=False)
    module = importlib.import_module(f"reports.guide.loggers.{name}")
    monkeypatch.setattr(module, "Response", SimpleNamespace(load=lambda path: MODEL))
    return module


def test_a_serial_port(samples, monkeypatch, capsys):
    port = MagicMock()
    port.__enter__.return_value = port
    lines = [",".join(map(str, (1e3 * t, *values))) for t, values in samples]
    port.readline.side_effect = [b"3,0.4\n", *(f"{line}\n".encode() for line in lines), b""]
    fake = SimpleNamespace(Serial=MagicMock(return_value=port))
    script(monkeypatch, "serial_port", serial=fake).main("model.npz", "/dev/ttyACM0")
    assert fake.Serial.call_args.args[:2] == ("/dev/ttyACM0", 115_200)
    (line,) = capsys.readouterr().out.splitlines()
    assert line.startswith("touch 1: 0.39")


def test_a_lab_streaming_layer_stream(samples, monkeypatch):
    fake = MagicMock()
    fake.resolve_byprop.return_value = [MagicMock()]
    pulled = [(values, t) for t, values in samples]
    fake.StreamInlet.return_value.pull_sample.side_effect = [*pulled, (None, None)]
    module = script(monkeypatch, "lab_streaming_layer", pylsl=fake)
    module.main("model.npz", "sensor")
    sent = [call.args for call in fake.StreamOutlet.return_value.push_sample.call_args_list]
    assert [t for _, t in sent] == [t for t, _ in samples]
    table = np.array([row for row, _ in sent])
    assert fake.StreamInfo.call_args.args[2] == table.shape[1] == len(module.COLUMNS)
    at = int(np.nanargmax(table[:, module.COLUMNS.index("force_N")]))
    assert table[at, 0] == 1
    assert table[at, 1:4] == pytest.approx([3.0, -2.0, 0.8], abs=0.3)


def test_a_ros_2_node(samples, monkeypatch):
    node = MagicMock()

    def spin(node):
        (_, topic, on_readings, _) = node.create_subscription.call_args.args
        assert topic == "readings"
        for t, values in samples:
            node.get_clock.return_value.now.return_value.nanoseconds = round(1e9 * t)
            on_readings(SimpleNamespace(data=values))

    publishers = {of: MagicMock() for of in ("force", "place", "place_covariance")}
    node.create_publisher.side_effect = lambda kind, topic, depth: publishers[topic]
    rclpy = MagicMock(spin=spin, create_node=lambda name: node)
    kinds = SimpleNamespace(PointStamped=MagicMock, WrenchStamped=MagicMock)
    std = SimpleNamespace(Float64MultiArray=MagicMock)
    fakes = {"geometry_msgs": MagicMock(), "std_msgs": MagicMock()}
    fakes |= {"geometry_msgs__msg": kinds, "std_msgs__msg": std}
    script(monkeypatch, "ros2_node", rclpy=rclpy, **fakes).main("model.npz")
    forces, places, covariances = (
        [call.args[0] for call in publisher.publish.call_args_list]
        for publisher in publishers.values()
    )
    assert len(forces) == len(places) == len(covariances) > 50
    at = int(np.argmax([message.wrench.force.z for message in forces]))
    assert forces[at].wrench.force.z == pytest.approx(0.8, rel=0.1)
    assert forces[at].header.frame_id == places[at].header.frame_id == "sensor"
    assert (places[at].point.x, places[at].point.y) == pytest.approx((3e-3, -2e-3), abs=3e-4)
    variances = np.diag(np.reshape(covariances[at].data, (3, 3)))
    assert (0.0 < variances[0] < 1e-6, variances[2]) == (True, 0.0)

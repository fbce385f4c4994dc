"""The guide's scripts for loggers: with the real pylsl, and a few lines in place of the others."""

import importlib
import io
import re
import sys
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest

from pvdf_fem import Response
from tests.helpers.streams import Tap, make_sensor, make_stream

MODEL = make_sensor()
TAP = Tap(1.0, 0.1, (3.0, -2.0), 0.8)
STREAM = make_stream(MODEL, [TAP], 1.5, noise_V=2e-4)
SAMPLES = list(zip(*map(np.ndarray.tolist, STREAM), strict=True))


@pytest.fixture
def load_script(monkeypatch):
    """Imports a script for the made-up response, with packages that are made up, too."""

    def load(name, **packages):
        for package, members in packages.items():
            module = SimpleNamespace(**members)
            monkeypatch.setitem(sys.modules, package.replace("__", "."), module)
        monkeypatch.setattr(Response, "load", lambda path: MODEL)
        sys.modules.pop(f"reports.guide.loggers.{name}", None)
        return importlib.import_module(f"reports.guide.loggers.{name}")

    return load


# ------------------------------------------------------------------------------------ serial port


def track_lines(load_script, capsys, lines):
    """Return the lines that the script for serial ports prints about a port with some lines."""
    port = io.BytesIO(b"".join(lines))
    module = load_script("serial_port", serial={"Serial": lambda device, baud, timeout: port})
    module.main("sensor.response", "/dev/ttyACM0")
    return capsys.readouterr().out.splitlines()


def find_numbers(text):
    return [float(number) for number in re.findall(r"-?\d+\.?\d*", text)]


def make_lines(unit_s):
    for t, row in SAMPLES:
        yield f"{t / unit_s:.0f},{','.join(map(str, row))}\r\n".encode()


def test_a_serial_port_with_cut_lines_and_missing_readings(load_script, capsys):
    lines = [b".3,0.4\r\n", *make_lines(1e-6)]
    lines[400] = b"39\xff999,0.1,\r\n"
    lines[500] = lines[500].replace(b",", b",?", 1)
    lines[-1] = lines[-1][:-9]
    (touch,) = track_lines(load_script, capsys, lines)
    assert "touch" in touch


def test_a_serial_port_with_a_header_in_another_unit_and_order(load_script, capsys):
    lines = [b"boot\r\n", b"t_ms, D, C, B, A\r\n"]
    for t, row in SAMPLES:
        lines.append(f"{1e3 * t:.3f},{','.join(map(str, row[::-1]))}\r\n".encode())
    (touch,) = track_lines(load_script, capsys, lines)
    (expected,) = track_lines(load_script, capsys, [b"\r\n", *make_lines(1e-6)])
    assert find_numbers(touch) == pytest.approx(find_numbers(expected), abs=2e-3)


# --------------------------------------------------------------------------------------- pylsl


@pytest.fixture(scope="module")
def pylsl(tmp_path_factory):
    """The real package, for streams on this machine."""
    settings = tmp_path_factory.mktemp("lsl") / "lsl_api.cfg"
    settings.write_text("[multicast]\nResolveScope = machine\n[log]\nlevel = -3\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("LSLAPICFG", str(settings))
        try:
            import pylsl
        except (ImportError, RuntimeError) as error:
            pytest.skip(f"liblsl cannot be loaded: {error}")
        pylsl.local_clock()  # liblsl reads the settings at its first call
        yield pylsl


def start_source(pylsl, name, labels, rate_Hz=1000.0):
    """Start a stream with a channel for each label."""
    info = pylsl.StreamInfo(name, "Film", len(labels), rate_Hz, "double64", name)
    if any(labels):
        info.set_channel_labels(list(labels))
    return pylsl.StreamOutlet(info)


def run_script(pylsl, module, monkeypatch, name, outlet, stamps, samples):
    """Return the samples that the script sends for a stream, with their stamps."""
    monkeypatch.setattr(module, "END_S", 1.0)
    thread = threading.Thread(target=module.main, args=("sensor.response", name), daemon=True)
    thread.start()
    sent = pylsl.StreamInlet(pylsl.resolve_byprop("name", f"{name}-touches", timeout=10.0)[0])
    sent.open_stream(timeout=10.0)
    assert outlet.wait_for_consumers(10.0)
    start_s = pylsl.local_clock()
    for i in range(0, len(stamps), 20):  # chunks with the stamp of their last sample
        chunk = samples[i : i + 20]
        stamp = start_s + stamps[min(i + 20, len(stamps)) - 1]
        outlet.push_chunk(chunk, stamp)
        time.sleep(0.002)
    pulled = [sent.pull_sample(timeout=2.0) for _ in stamps]
    thread.join(timeout=20.0)
    assert not thread.is_alive()
    rows, times_s = zip(*pulled, strict=True)
    return np.array(rows), np.array(times_s) - start_s


def test_a_lab_streaming_layer_stream(pylsl, load_script, monkeypatch, capsys):
    module = load_script("lab_streaming_layer")
    outlet = start_source(pylsl, "film", ["light", *reversed(MODEL.names)])
    samples = [[0.0, *row[::-1]] for _, row in SAMPLES]
    stamps = [t for t, _ in SAMPLES]
    rows, times_s = run_script(pylsl, module, monkeypatch, "film", outlet, stamps, samples)
    assert len(rows) == len(SAMPLES)
    assert times_s == pytest.approx(stamps, abs=2e-3)
    force = rows[:, module.COLUMNS.index("force_N")]
    assert rows[np.nanargmax(force), :4] == pytest.approx([1.0, 3.0, -2.0, 0.8], abs=0.3)
    assert len(capsys.readouterr().out.splitlines()) == 1


def test_a_pause_of_a_stream_is_kept(pylsl, load_script, monkeypatch):
    """`proc_ALL` joins the parts before and after it, so that later samples come too early."""
    module = load_script("lab_streaming_layer")
    outlet = start_source(pylsl, "pausing", MODEL.names)
    stamps = np.array([t for t, _ in SAMPLES])
    stamps[800:] += 0.7
    samples = [row for _, row in SAMPLES]
    _, times_s = run_script(pylsl, module, monkeypatch, "pausing", outlet, stamps, samples)
    assert times_s == pytest.approx(stamps, abs=2e-3)


def test_other_labels_are_refused(pylsl, load_script):
    module = load_script("lab_streaming_layer")
    outlet = start_source(pylsl, "other", ["ai0", "ai1", "ai2", "ai3"])
    with pytest.raises(SystemExit, match=r"other: has the channels \['ai0'"):
        module.main("sensor.response", "other")
    del outlet


# --------------------------------------------------------------------------------------- ROS 2


def make_message(**values):
    """Make a message of ROS 2 with fields that can be set."""
    point = SimpleNamespace(x=0.0, y=0.0, z=0.0)
    header = SimpleNamespace(stamp=None, frame_id="")
    wrench = SimpleNamespace(force=SimpleNamespace(x=0.0, y=0.0, z=0.0))
    return SimpleNamespace(header=header, wrench=wrench, point=point, data=[], **values)


def test_a_ros_2_node(load_script):
    published = {}
    subscriptions = []
    node = SimpleNamespace(
        create_publisher=lambda kind, topic, depth: SimpleNamespace(
            publish=published.setdefault(topic, []).append
        ),
        create_subscription=lambda kind, topic, call, quality: subscriptions.append(call),
    )

    def spin(node):
        for t, row in SAMPLES:
            nanoseconds = round(1e9 * t)
            stamp = SimpleNamespace(sec=1_777_000_000, nanosec=nanoseconds)
            message = SimpleNamespace(
                header=SimpleNamespace(stamp=stamp), name=MODEL.names[::-1], effort=row[::-1]
            )
            if nanoseconds >= 10**9:
                stamp.sec += 1
                stamp.nanosec -= 10**9
            subscriptions[0](message)

    module = load_script(
        "ros2_node",
        rclpy={
            "init": lambda: None,
            "create_node": lambda name: node,
            "spin": spin,
            "shutdown": lambda: None,
        },
        rclpy__qos={
            "QoSProfile": lambda **values: values,
            "ReliabilityPolicy": SimpleNamespace(BEST_EFFORT=2),
        },
        builtin_interfaces__msg={"Time": lambda sec, nanosec: (sec, nanosec)},
        geometry_msgs__msg={"PointStamped": make_message, "WrenchStamped": make_message},
        sensor_msgs__msg={"JointState": make_message},
        std_msgs__msg={"Float64MultiArray": make_message},
    )
    module.main("sensor.response")
    forces = [message.wrench.force.z for message in published["force"]]
    strongest = int(np.argmax(forces))
    place = published["place"][strongest]
    assert forces[strongest] == pytest.approx(0.8, abs=0.1)
    assert [place.point.x, place.point.y] == pytest.approx([3e-3, -2e-3], abs=3e-4)
    sec, nanosec = place.header.stamp
    assert sec + 1e-9 * nanosec == pytest.approx(1_777_000_001.05, abs=0.03)
    assert len(published["place_covariance"][strongest].data) == 9

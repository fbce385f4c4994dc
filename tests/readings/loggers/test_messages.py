"""MCAP files and ROS 2 bags that mcap and rosbags write."""

import json
import shutil
import sqlite3

import numpy as np
import pytest

from pvdf_fem.files import FileError
from tests.helpers.recordings import NAMES, make_samples, read_recording

mcap_writer = pytest.importorskip("mcap.writer")
ros2_writer = pytest.importorskip("mcap_ros2.writer")
rosbag2 = pytest.importorskip("rosbags.rosbag2")
typesys = pytest.importorskip("rosbags.typesys")

SAMPLES = make_samples()
START_NS = 1_777_000_000_123_456_789
STEP_NS = 2_000_000
STAMPS_NS = [START_NS + i * STEP_NS for i in range(50)]
TIMES_S = 2e-3 * np.arange(50)

ARRAY = """std_msgs/MultiArrayLayout layout
float64[] data
===
MSG: std_msgs/MultiArrayLayout
std_msgs/MultiArrayDimension[] dim
uint32 data_offset
===
MSG: std_msgs/MultiArrayDimension
string label
uint32 size
uint32 stride
"""
HEADER = """===
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
===
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
JOINTS = "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] effort\n" + HEADER
SCALAR = "float64 data\n"


def make_header(stamp_ns):
    sec, nanosec = divmod(stamp_ns, 10**9)
    return {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": "film"}


def write_ros(path, messages, **options):
    """Write (topic, type, definition, log time, message) to an MCAP file."""
    with path.open("wb") as file:
        writer = ros2_writer.Writer(file, **options)
        schemas = {}
        for topic, kind, definition, log_ns, message in messages:
            if kind not in schemas:
                schemas[kind] = writer.register_msgdef(kind, definition)
            writer.write_message(topic, schemas[kind], message, log_ns, log_ns + 5_000_000)
        writer.finish()
    return path


def list_arrays():
    for stamp_ns, row in zip(STAMPS_NS, SAMPLES.tolist(), strict=True):
        layout = {"dim": [], "data_offset": 0}
        message = {"layout": layout, "data": row}
        yield "/readings", "std_msgs/msg/Float64MultiArray", ARRAY, stamp_ns, message


def list_joints(delay_ns=(0,)):
    for i, (stamp_ns, row) in enumerate(zip(STAMPS_NS, SAMPLES.tolist(), strict=True)):
        message = {
            "header": make_header(stamp_ns),
            "name": ["D", "C", "B", "A"],
            "position": [],
            "effort": row[::-1],
        }
        log_ns = stamp_ns + delay_ns[i % len(delay_ns)]
        yield "/film", "sensor_msgs/msg/JointState", JOINTS, log_ns, message


def test_an_array_has_the_times_of_logging(tmp_path):
    read = read_recording(write_ros(tmp_path / "r.mcap", list_arrays()))
    assert read.values == pytest.approx(SAMPLES)
    assert read.times_s == pytest.approx(TIMES_S, abs=1e-12)
    assert "A=/readings/data/0" in read.notes
    assert "no stamps" in read.notes


def test_named_elements_have_the_stamps_of_their_headers(tmp_path):
    path = write_ros(tmp_path / "r.mcap", list_joints(delay_ns=(0, 900_000, 300_000)))
    read = read_recording(path)
    assert read.values == pytest.approx(SAMPLES)
    assert read.times_s == pytest.approx(TIMES_S, abs=1e-12)
    assert read.recording.columns[0].heading == "/film/effort/A"


def test_a_topic_for_each_electrode_is_joined_by_stamps(tmp_path):
    kind = "pvdf/msg/Reading"
    definition = "std_msgs/Header header\nfloat64 volts\n" + HEADER
    messages = []
    for column, name in enumerate(NAMES):
        for i, stamp_ns in enumerate(STAMPS_NS):
            if (name, i) == ("C", 7):  # lost
                continue
            message = {"header": make_header(stamp_ns), "volts": SAMPLES[i, column]}
            messages.append((f"/film/{name}", kind, definition, stamp_ns + 1000 * column, message))
    messages.sort(key=lambda message: message[3])
    channels = {name: f"/film/{name}/volts" for name in NAMES}
    read = read_recording(write_ros(tmp_path / "r.mcap", messages), channels=channels)
    expected = SAMPLES.copy()
    expected[7, 2] = np.nan
    order = np.argsort(read.times_s)
    assert read.times_s[order] == pytest.approx(TIMES_S, abs=1e-12)
    assert read.values[order] == pytest.approx(expected, nan_ok=True)


def test_json_with_a_stamp(tmp_path):
    path = tmp_path / "r.mcap"
    with path.open("wb") as file:
        writer = mcap_writer.Writer(file)
        writer.start()
        schema = writer.register_schema("film", "jsonschema", b"{}")
        channel = writer.register_channel("/film", "json", schema)
        for stamp_ns, row in zip(STAMPS_NS, SAMPLES.tolist(), strict=True):
            content = {"timestamp": {"sec": stamp_ns // 10**9, "nsec": stamp_ns % 10**9}}
            content |= dict(zip(NAMES, row, strict=True))
            data = json.dumps(content).encode()
            writer.add_message(channel, stamp_ns + 777, data, stamp_ns)
        writer.finish()
    read = read_recording(path)
    assert read.values == pytest.approx(SAMPLES)
    assert read.times_s == pytest.approx(TIMES_S, abs=1e-12)


def test_a_file_without_its_end_is_read_up_to_the_cut(tmp_path):
    """mcap's reader finds no message in it, wherever the cut is."""
    content = write_ros(tmp_path / "r.mcap", list_joints(), chunk_size=300).read_bytes()
    path = tmp_path / "cut.mcap"
    counts = []
    for size in np.linspace(2000, len(content) - 1, 40, dtype=int):
        path.write_bytes(content[:size])
        read = read_recording(path)
        counts.append(len(read.values))
        assert read.values == pytest.approx(SAMPLES[: len(read.values)])
        assert "no end" in read.notes
    assert counts == sorted(counts)
    assert counts[0] < 20
    assert counts[-1] == 50


def test_other_encodings_are_named(tmp_path):
    path = tmp_path / "r.mcap"
    with path.open("wb") as file:
        writer = mcap_writer.Writer(file)
        writer.start()
        schema = writer.register_schema("Film", "protobuf", b"")
        channel = writer.register_channel("/film", "protobuf", schema)
        writer.add_message(channel, START_NS, b"\x08\x01", START_NS)
        writer.finish()
    with pytest.raises(FileError, match="/film: protobuf"):
        read_recording(path)


# ------------------------------------------------------------------------------------------ bags


def write_bag(path, version=9):
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    types = store.types
    joints = types["sensor_msgs/msg/JointState"]
    header = types["std_msgs/msg/Header"]
    time = types["builtin_interfaces/msg/Time"]
    with rosbag2.Writer(path, version=version) as writer:
        connection = writer.add_connection("/film", joints.__msgtype__, typestore=store)
        for stamp_ns, row in zip(STAMPS_NS, SAMPLES, strict=True):
            stamp = time(stamp_ns // 10**9, stamp_ns % 10**9)
            empty = np.array([])
            message = joints(header(stamp, "film"), list(NAMES), empty, empty, row)
            data = store.serialize_cdr(message, joints.__msgtype__)
            writer.write(connection, stamp_ns + 123, data)
    return path


@pytest.mark.parametrize("version", [8, 9])
def test_a_bag_by_its_folder_or_file(tmp_path, version):
    folder = write_bag(tmp_path / "bag", version)
    for path in (folder, folder / "bag.db3"):
        read = read_recording(path)
        assert read.values == pytest.approx(SAMPLES)
        assert read.times_s == pytest.approx(TIMES_S, abs=1e-12)


def test_messages_in_the_write_ahead_log_are_read(tmp_path):
    """A recorder that was stopped hard leaves them there; rosbags' reader misses them."""
    database = write_bag(tmp_path / "bag") / "bag.db3"
    connection = sqlite3.connect(database)
    rows = connection.execute("SELECT * FROM messages WHERE id > 20").fetchall()
    connection.execute("DELETE FROM messages WHERE id > 20")
    connection.commit()
    connection.execute("PRAGMA journal_mode=WAL")
    connection.executemany("INSERT INTO messages VALUES (?, ?, ?, ?)", rows)
    connection.commit()
    copy = tmp_path / "copy"
    copy.mkdir()
    for path in database.parent.iterdir():
        shutil.copy(path, copy)
    connection.close()
    assert (copy / "bag.db3-wal").exists()
    assert read_recording(copy / "bag.db3").values == pytest.approx(SAMPLES)


def test_another_database_is_refused(tmp_path):
    connection = sqlite3.connect(tmp_path / "r.db3")
    connection.execute("CREATE TABLE readings (a)")
    connection.commit()
    connection.close()
    with pytest.raises(FileError, match="not a bag"):
        read_recording(tmp_path / "r.db3")

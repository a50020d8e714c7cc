"""ROS bags: topics on their own clocks, our definitions where the bag has none, the bag's own where it has."""

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from greybox_id.base.errors import BadInput
from greybox_id.datasets.column_map import parse_column_map
from greybox_id.datasets.formats.ros import shipped_types
from greybox_id.datasets.read import read

START = 1_731_000_000 * 10**9
ODOM, DRIVE, CORE = np.arange(400) * 0.02, 0.5 + np.arange(60) * 0.1, 0.003 + np.arange(800) * 0.01
MAP = """
[time]
unit = "s"
[signals]
v_x = { column = "/odom.twist.twist.linear.x", unit = "m/s" }
yaw = { column = "/odom.pose.pose.orientation.yaw", unit = "rad" }
steer = { column = "/drive.drive.steering_angle", unit = "rad" }
motor_current = { column = "/sensors/core.state.current_motor", unit = "A" }
"""


def store_with_ours():
    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(shipped_types(get_types_from_msg))
    return store


def heading(t):
    return np.angle(np.exp(1j * t))  # turns by 1 rad/s and begins anew at half a turn


@pytest.fixture
def bag(tmp_path):
    def bag(plugin=StoragePlugin.MCAP, embedded=True, late=0.0):
        store = store_with_ours()
        t = store.types

        def header(when):
            ns = START + round(when * 1e9)
            return t["std_msgs/msg/Header"](t["builtin_interfaces/msg/Time"](ns // 10**9, ns % 10**9), "base")

        def vector(x, y, z):
            return t["geometry_msgs/msg/Vector3"](x, y, z)

        def odometry(when):
            turn = t["geometry_msgs/msg/Quaternion"](0.0, 0.0, np.sin(when / 2), np.cos(when / 2))
            pose = t["geometry_msgs/msg/Pose"](t["geometry_msgs/msg/Point"](0.0, 0.0, 0.0), turn)
            twist = t["geometry_msgs/msg/Twist"](vector(2 + np.sin(when), 0.0, 0.0), vector(0.0, 0.0, 1.0))
            none = np.zeros(36)
            return t["nav_msgs/msg/Odometry"](
                header(when), "car", t["geometry_msgs/msg/PoseWithCovariance"](pose, none),
                t["geometry_msgs/msg/TwistWithCovariance"](twist, none),
            )  # fmt: skip

        def drive(when):
            command = t["ackermann_msgs/msg/AckermannDrive"](round(when, 1) / 10, 0.0, 2.0, 0.0, 0.0)
            return t["ackermann_msgs/msg/AckermannDriveStamped"](header(when), command)

        def core(when):
            names = t["vesc_msgs/msg/VescState"].__dataclass_fields__
            ints = ("displacement", "distance_traveled", "fault_code", "controller_id")
            values = {n: 0 if n in ints else 0.0 for n in names if not n.startswith("__")}
            state = t["vesc_msgs/msg/VescState"](**{**values, "current_motor": 3 * when})
            return t["vesc_msgs/msg/VescStateStamped"](header(when), state)

        path = tmp_path / "bag"
        with Writer(path, version=9, storage_plugin=plugin) as writer:
            for topic, kind, times, make in (
                ("/odom", "nav_msgs/msg/Odometry", ODOM, odometry),
                ("/drive", "ackermann_msgs/msg/AckermannDriveStamped", DRIVE, drive),
                ("/sensors/core", "vesc_msgs/msg/VescStateStamped", CORE, core),
            ):
                known = {"typestore": store} if embedded else {"msgdef": "", "rihs01": "RIHS01_0"}
                connection = writer.add_connection(topic, kind, **known)
                for when in times:
                    arrived = START + round((when + late) * 1e9)
                    writer.write(connection, arrived, store.serialize_cdr(make(when), kind))
        return path

    return bag


@pytest.mark.parametrize("plugin", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
@pytest.mark.parametrize("folder", [True, False])
def test_topics_meet_on_the_fastest_clock(bag, plugin, folder):
    path = bag(plugin, late=0.013)
    file = path if folder else next(p for p in path.iterdir() if p.suffix in (".mcap", ".db3"))
    recording = read(file, parse_column_map(MAP, "car.toml"))
    begins = START * 1e-9 + recording.time - START * 1e-9
    np.testing.assert_allclose(np.diff(begins), 0.01, atol=1e-6)
    when = recording.time  # counted from the first odometry, at 0
    np.testing.assert_allclose(recording["motor_current"], 3 * when, atol=1e-6)  # own clock: stamps, not arrivals
    assert np.max(np.abs(recording["v_x"] - (2 + np.sin(when)))) <= 1.05 * recording.resampled["v_x"].largest
    turned = np.angle(np.exp(1j * (recording["yaw"] - heading(when))))
    assert np.max(np.abs(turned)) < 1e-6  # also where yaw begins anew
    assert set(recording.resampled) == {"v_x", "yaw", "steer"}
    assert (recording.resampled["steer"].method, recording.resampled["v_x"].method) == ("held", "linear")
    np.testing.assert_allclose(recording["steer"], np.minimum(np.floor((when + 1e-9) * 10), 64) / 100, atol=1e-6)
    assert len(recording.source.sha256) == 64


def test_without_definitions_in_the_bag_ours_are_used(bag):
    path = next(bag(StoragePlugin.MCAP, embedded=False).glob("*.mcap"))
    recording = read(path, parse_column_map(MAP, "car.toml"))
    assert np.isfinite(recording["motor_current"]).all()


def test_the_bags_own_definition_goes_before_ours(tmp_path):
    store = get_typestore(Stores.ROS2_HUMBLE)
    kind = "vesc_msgs/msg/VescState"
    store.register(get_types_from_msg("float64 speed\nfloat64[2] phases\nbool armed\n", kind))
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/core", kind, typestore=store)
        for k in range(20):
            message = store.types[kind](speed=0.5 * k, phases=np.array([1.0, k]), armed=True)
            writer.write(connection, START + k * 10**7, store.serialize_cdr(message, kind))
    mapping = parse_column_map(
        '[time]\nunit="s"\n[signals.v_x]\ncolumn="speed"\nunit="m/s"\n'
        '[extra.phase]\ncolumn="/core.phases.1"\nunit="A"\n[extra.armed]\ncolumn="/core.armed"\nunit="1"',
        "own.toml",
    )
    recording = read(tmp_path / "bag", mapping)
    np.testing.assert_allclose(recording["v_x"], 0.5 * np.arange(20))
    np.testing.assert_allclose(recording["phase"], np.arange(20))
    np.testing.assert_allclose(recording["armed"], 1)
    np.testing.assert_allclose(recording.time, 0.01 * np.arange(20), atol=1e-9)


def test_a_missing_topic_is_named_with_what_there_is(bag):
    with pytest.raises(BadInput, match=r'no column "/imu.x".*The file has /odom.pose.pose.position.x'):
        read(bag(), parse_column_map('[time]\nunit="s"\n[signals.v_x]\ncolumn="/imu.x"\nunit="m/s"', "own.toml"))


def test_a_missing_extra_is_one_sentence_that_names_it(bag, monkeypatch):
    import sys

    path = bag()
    monkeypatch.setitem(sys.modules, "rosbags", None)
    with pytest.raises(BadInput, match=r"pip install 'greybox-id\[ros\]'"):
        read(path)

"""MCAP by the mcap packages, rosbag2 by rosbags."""

from __future__ import annotations

import json
import shutil
import tempfile
from pathlib import Path

from google.protobuf import descriptor_pb2, descriptor_pool, message, message_factory, timestamp_pb2
from mcap.reader import make_reader
from mcap.writer import CompressionType
from mcap.writer import Writer as JsonWriter
from mcap_protobuf.decoder import DecoderFactory as ProtobufFactory
from mcap_protobuf.writer import Writer as ProtobufWriter
from mcap_ros2.decoder import DecoderFactory
from mcap_ros2.writer import Writer as RosWriter
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as BagWriter
from rosbags.typesys import Stores, get_typestore

START = 1_700_000_000_123_456_789
RULE = "=" * 80
TWIST = f"Vector3 linear\nVector3 angular\n{RULE}\nMSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n"
STATE = f"""# A state
uint8 OK=1
std_msgs/Header header
string[] name
float64[] position
float32[3] covariance
bool ready
uint8 mode 7
int16[<=4] counts
{RULE}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{RULE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
COMPRESSIONS = {"ros2_zstd.mcap": CompressionType.ZSTD, "ros2_lz4.mcap": CompressionType.LZ4, "ros2_plain.mcap": CompressionType.NONE}


def twist(k: int) -> dict[str, object]:
    return {"linear": {"x": 0.1 * k, "y": -0.5, "z": 0.0}, "angular": {"x": 0.0, "y": 0.0, "z": 1.0 / (k + 1)}}


def state(k: int) -> dict[str, object]:
    sent = START + 20_000_000 * k - 3_000_000
    return {
        "header": {"stamp": {"sec": sent // 10**9, "nanosec": sent % 10**9}, "frame_id": "odd" if k % 2 else "base_link"},
        "name": ["a", "shoulder"],
        "position": [0.25 * k, -1.0] + ([3.0] if k > 4 else []),
        "covariance": [1.5, 2.5 * k, -3.5],
        "ready": k % 3 == 0,
        "mode": k,
        "counts": [k, -k],
    }


def definitions() -> type:
    """A message with everything that protobuf has for numbers; without protoc, its descriptors are put together here."""
    f = descriptor_pb2.FieldDescriptorProto
    many, one = f.LABEL_REPEATED, f.LABEL_OPTIONAL
    file = descriptor_pb2.FileDescriptorProto(name="test/motor.proto", package="test", syntax="proto3")
    file.dependency.append("google/protobuf/timestamp.proto")
    mode = file.enum_type.add(name="Mode")
    for number, name in enumerate(["OFF", "ON", "FAULT"]):
        mode.value.add(name=name, number=number * number)
    vector = file.message_type.add(name="Vector")
    for number, name in enumerate("xyz", 1):
        vector.field.add(name=name, number=number, type=f.TYPE_DOUBLE, label=one)
    motor = file.message_type.add(name="Motor")
    entry = motor.nested_type.add(name="GainsEntry")
    entry.options.map_entry = True
    entry.field.add(name="key", number=1, type=f.TYPE_STRING, label=one)
    entry.field.add(name="value", number=2, type=f.TYPE_FLOAT, label=one)
    plain = [
        ("timestamp", f.TYPE_MESSAGE, one, ".google.protobuf.Timestamp"),
        ("force", f.TYPE_MESSAGE, one, ".test.Vector"),
        ("points", f.TYPE_MESSAGE, many, ".test.Vector"),
        ("currents", f.TYPE_FLOAT, many, None),
        ("counts", f.TYPE_SINT64, many, None),
        ("mode", f.TYPE_ENUM, one, ".test.Mode"),
        ("ready", f.TYPE_BOOL, one, None),
        ("ticks", f.TYPE_UINT64, one, None),
        ("step", f.TYPE_SFIXED32, one, None),
        ("small", f.TYPE_INT32, one, None),
        ("label", f.TYPE_STRING, one, None),
        ("raw", f.TYPE_BYTES, one, None),
        ("gains", f.TYPE_MESSAGE, many, ".test.Motor.GainsEntry"),
        ("picture", f.TYPE_UINT32, many, None),
        ("speed", f.TYPE_DOUBLE, one, None),
        ("angle", f.TYPE_DOUBLE, one, None),
        ("late", f.TYPE_DOUBLE, one, None),
    ]
    motor.oneof_decl.add(name="motion")
    for number, (name, kind, label, of) in enumerate(plain, 1):
        field = motor.field.add(name=name, number=number, type=kind, label=label, type_name=of)
        if name in ("speed", "angle"):
            field.oneof_index = 0
        if name == "late":
            motor.oneof_decl.add(name="_late")
            field.oneof_index, field.proto3_optional = 1, True
    pool = descriptor_pool.DescriptorPool()
    pool.AddSerializedFile(timestamp_pb2.DESCRIPTOR.serialized_pb)
    pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName("test.Motor"))


def motor(kind: type, k: int) -> message.Message:
    sent = START + 5_000_000 * k - 2_000_000
    made = kind(
        force={"x": 0.1 * k, "z": -2.0},
        points=[{"x": k + i, "y": 0.5} for i in range(2 + k % 2)],
        currents=[0.1 * k, -0.2],
        counts=[-k, 2**40 + k],
        mode=[0, 1, 4][k % 3],
        ready=k % 2 == 0,
        ticks=2**53 - 1 - k,
        step=-7 * k,
        small=-k,
        label="text",
        raw=b"\x00\x01",
        gains={"kp": 1.5 * k, "kd": 0.25},
        picture=range(100),
    )
    made.timestamp.seconds, made.timestamp.nanos = sent // 10**9, sent % 10**9
    if k % 2:
        made.speed = 3.0 * k
    else:
        made.angle = 0.5 * k
    if k > 3:
        made.late = 0.0
    return made


def write(folder: Path) -> None:
    with (folder / "protobuf.mcap").open("wb") as file:
        with ProtobufWriter(file, chunk_size=900, compression=CompressionType.ZSTD) as writer:
            kind = definitions()
            for k in range(10):
                writer.write_message("/motor", motor(kind, k), log_time=START + 5_000_000 * k)
    for name, compression in COMPRESSIONS.items():
        with (folder / name).open("wb") as file:
            writer = RosWriter(file, chunk_size=600, compression=compression)
            commands = writer.register_msgdef("geometry_msgs/msg/Twist", TWIST)
            states = writer.register_msgdef("test_msgs/msg/State", STATE)
            for k in range(12):
                writer.write_message("/cmd_vel", commands, twist(k), log_time=START + 20_000_000 * k)
                writer.write_message("/state", states, state(k), log_time=START + 20_000_000 * k + 1_000_000)
            writer.finish()
    with (folder / "json.mcap").open("wb") as file:
        writer = JsonWriter(file, compression=CompressionType.NONE, use_chunking=False)
        writer.start()
        schema = writer.register_schema("sample", "jsonschema", json.dumps({"type": "object"}).encode())
        channel = writer.register_channel("sample", "json", schema)
        for k in range(8):
            data = {"u": k / 7, "pose": {"xy": [k, -k]}, "on": k > 3, "label": "text", "late": None if k < 2 else k * 0.1}
            writer.add_message(channel, START + 10_000_000 * k, json.dumps(data).encode(), START + 10_000_000 * k)
        writer.finish()
    # rosbags makes a folder; its database is the log.
    store = get_typestore(Stores.ROS2_HUMBLE)
    vector, message = store.types["geometry_msgs/msg/Vector3"], store.types["geometry_msgs/msg/Twist"]
    imu = store.types["sensor_msgs/msg/Imu"]
    quaternion = store.types["geometry_msgs/msg/Quaternion"]
    header, time = store.types["std_msgs/msg/Header"], store.types["builtin_interfaces/msg/Time"]
    import numpy as np

    with tempfile.TemporaryDirectory() as made:
        with BagWriter(Path(made) / "bag", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
            commands = writer.add_connection("/cmd_vel", "geometry_msgs/msg/Twist", typestore=store)
            sensors = writer.add_connection("/imu", "sensor_msgs/msg/Imu", typestore=store)
            for k in range(30):
                t = START + 20_000_000 * k
                value = message(linear=vector(x=0.1 * k, y=0.0, z=1.0), angular=vector(x=0.0, y=0.0, z=-0.1 * k))
                writer.write(commands, t, store.serialize_cdr(value, "geometry_msgs/msg/Twist"))
                sent = t - 2_000_000
                reading = imu(
                    header=header(stamp=time(sec=sent // 10**9, nanosec=sent % 10**9), frame_id="imu"),
                    orientation=quaternion(x=0.0, y=0.0, z=0.0, w=1.0),
                    orientation_covariance=np.arange(9.0),
                    angular_velocity=vector(x=0.01 * k, y=0.0, z=0.0),
                    angular_velocity_covariance=np.zeros(9),
                    linear_acceleration=vector(x=0.0, y=0.0, z=9.81),
                    linear_acceleration_covariance=np.zeros(9),
                )
                writer.write(sensors, t + 500_000, store.serialize_cdr(reading, "sensor_msgs/msg/Imu"))
        shutil.copy(next((Path(made) / "bag").glob("*.db3")), folder / "bag.db3")


def flat(value: object, path: str, into: dict[str, float]) -> None:
    """Numbers of a message by their paths."""
    if isinstance(value, bool | int | float):
        into[path or "value"] = float(value)
    elif hasattr(value, "DESCRIPTOR"):
        for field in value.DESCRIPTOR.fields:
            # What a sender left out is missing where that can be told from 0.
            if not field.has_presence or value.HasField(field.name):
                flat(getattr(value, field.name), f"{path}.{field.name}" if path else field.name, into)
    elif hasattr(value, "items") and not isinstance(value, dict):
        for name, part in value.items():
            flat(part, f"{path}[{name}]", into)
    elif isinstance(value, dict):
        for name, part in value.items():
            flat(part, f"{path}.{name}" if path else name, into)
    elif isinstance(value, str | bytes) or value is None:
        pass
    elif hasattr(value, "__len__"):
        if len(value) <= 64:
            for i, part in enumerate(value):
                flat(part.item() if hasattr(part, "item") else part, f"{path}[{i}]", into)
    else:
        names = getattr(value, "__slots__", None) or getattr(value, "__dataclass_fields__", {})
        for name in names:
            if not name.startswith("_"):
                flat(getattr(value, name), f"{path}.{name}" if path else name, into)


def topics(rows: list[tuple[str, int, object]]) -> dict[str, object]:
    start = rows[0][1]
    found: dict[str, dict] = {}
    for topic, stamp, value in rows:
        numbers: dict[str, float] = {}
        flat(value, "", numbers)
        held = found.setdefault(topic, {"time": [], "channels": {}})
        for channel, x in numbers.items():
            held["channels"].setdefault(channel, [None] * len(held["time"])).append(x)
        held["time"].append((stamp - start) / 1e9)
        for values in held["channels"].values():
            values.extend([None] * (len(held["time"]) - len(values)))
    return found


def read(folder: Path) -> dict[str, object]:
    found: dict[str, object] = {}
    for name in COMPRESSIONS:
        with (folder / name).open("rb") as file:
            reader = make_reader(file, decoder_factories=[DecoderFactory()])
            rows = [(c.topic, m.log_time, d) for _, c, m, d in reader.iter_decoded_messages()]
        found[name] = topics(rows)
    with (folder / "protobuf.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[ProtobufFactory()])
        found["protobuf.mcap"] = topics([(c.topic, m.log_time, d) for _, c, m, d in reader.iter_decoded_messages()])
    with (folder / "json.mcap").open("rb") as file:
        rows = [(c.topic, m.log_time, json.loads(m.data)) for _, c, m in make_reader(file).iter_messages()]
    found["json.mcap"] = topics(rows)
    with tempfile.TemporaryDirectory() as made:
        # rosbags wants the folder's metadata; the database alone is what people hand over.
        import sqlite3

        store = get_typestore(Stores.ROS2_HUMBLE)
        base = sqlite3.connect(folder / "bag.db3")
        query = "SELECT t.name, m.timestamp, m.data, t.type FROM messages m JOIN topics t ON m.topic_id = t.id ORDER BY m.timestamp"
        rows = [(name, stamp, store.deserialize_cdr(data, kind)) for name, stamp, data, kind in base.execute(query)]
        base.close()
    found["bag.db3"] = topics(rows)
    return found

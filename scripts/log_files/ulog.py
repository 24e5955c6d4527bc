"""ULog by the specification; pyulog reads it."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
from pyulog import ULog

NAMES = ["flight.ulg", "flight_appended.ulg"]
SYNC = bytes([0x2F, 0x73, 0x13, 0x20, 0x25, 0x0C, 0xBB, 0x12])


def message(kind: str, payload: bytes) -> bytes:
    return struct.pack("<HB", len(payload), ord(kind)) + payload


def add(instance: int, number: int, name: str) -> bytes:
    return message("A", struct.pack("<BH", instance, number) + name.encode())


def data(number: int, payload: bytes) -> bytes:
    return message("D", struct.pack("<H", number) + payload)


def head(appended: int) -> bytes:
    flags = bytes(8) + bytes([1 if appended else 0]) + bytes(7) + struct.pack("<QQQ", appended, 0, 0)
    formats = [
        "vehicle_rates:uint64_t timestamp;float[3] xyz;uint8_t[4] _padding0;",
        "point:float x;float y;int8_t quality;uint8_t[3] _padding0;",
        "track:uint64_t timestamp;point[2] points;bool valid;char[4] label;uint8_t[3] _padding0;",
        "actuator:uint64_t timestamp;float thrust;uint16_t[2] pwm;int32_t count;uint8_t[4] _padding0;",
    ]
    text = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1_000_000) + message("B", flags)
    text += b"".join(message("F", f.encode()) for f in formats)
    key = b"char[4] sys_name"
    return text + message("I", bytes([len(key)]) + key + b"test")


def body(first: int, last: int) -> bytes:
    out = b""
    for k in range(first, last):
        t = 1_000_000 + 4000 * k
        # Padding at the end is not logged.
        out += data(1, struct.pack("<Qfff", t, 0.1 * k, -0.2 * k, float("nan") if k == 5 else 0.5))
        out += data(2, struct.pack("<Qfff", t + 700, 1.0 + k, 2.0, 3.0))
        if k % 2 == 0:
            points = struct.pack("<ffb3x", 1.5 * k, 2.5, -k) + struct.pack("<ffb3x", -1.5 * k, 3.5, k)
            out += data(3, struct.pack("<Q", t + 100) + points + struct.pack("<?4s", k % 4 == 0, b"abcd"))
        if k % 3 == 0:
            out += data(4, struct.pack("<QfHHi", t + 50, 0.3 + 0.01 * k, 1000 + k, 2000 - k, -k * 100_000))
        if k == 8:
            out += message("O", struct.pack("<H", 120))
        if k == 11:
            out += message("S", SYNC)
    return out


def write(folder: Path) -> None:
    subscribe = add(0, 1, "vehicle_rates") + add(1, 2, "vehicle_rates") + add(0, 3, "track") + add(0, 4, "actuator")
    whole = head(0) + subscribe + body(0, 20)
    (folder / NAMES[0]).write_bytes(whole)
    # The recorder died in the middle of a message; after the restart it appended data.
    torn = body(0, 10)
    torn = torn[: len(torn) - 9]
    start = len(head(1)) + len(subscribe) + len(torn)
    (folder / NAMES[1]).write_bytes(head(start) + subscribe + torn + subscribe + body(10, 16))


def read(folder: Path) -> dict[str, object]:
    found: dict[str, object] = {}
    for name in NAMES:
        log = ULog(str(folder / name))
        several = {d.name for d in log.data_list if d.multi_id > 0}
        topics: dict[str, dict] = {}
        for d in log.data_list:
            topic = f"{d.name}[{d.multi_id}]" if d.name in several else d.name
            fields = {f.field_name: f.type_str for f in d.field_data}
            channels = {f: np.asarray(v, dtype=float).tolist() for f, v in d.data.items() if f != "timestamp" and fields[f] != "char" and "_padding" not in f}
            # pyulog keeps what was appended apart.
            held = topics.setdefault(topic, {"time": [], "channels": {c: [] for c in channels}})
            held["time"] += (d.data["timestamp"] / 1e6).tolist()
            for channel, values in channels.items():
                held["channels"][channel] += values
        found[name] = topics
    return found

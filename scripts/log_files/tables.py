"""Parquet and Arrow IPC by pyarrow."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pyarrow.feather as feather
import pyarrow.parquet as pq

N = 40


def table() -> pa.Table:
    stamps = [1_700_000_000_000_000_000 + 10_000_000 * k for k in range(N)]
    return pa.table(
        {
            "timestamp": pa.array(stamps, pa.timestamp("ns", tz="UTC")),
            "u": pa.array([(k // 5) % 2 for k in range(N)], pa.int32()),
            "y": pa.array([None if k == 7 else 0.1 * k for k in range(N)], pa.float64()),
            "f": pa.array([0.1 * k for k in range(N)], pa.float32()),
            "on": pa.array([k % 3 == 0 for k in range(N)], pa.bool_()),
            "note": pa.array([f"row {k}" for k in range(N)], pa.string()),
        }
    )


def write(folder: Path) -> None:
    data = table()
    pq.write_table(data, folder / "snappy.parquet", compression="snappy", row_group_size=16)
    pq.write_table(data, folder / "zstd.parquet", compression="zstd", use_dictionary=False)
    feather.write_feather(data, folder / "data.arrow", compression="uncompressed")
    feather.write_feather(data, folder / "lz4.feather", compression="lz4")


def read(folder: Path) -> dict[str, object]:
    found: dict[str, object] = {}
    for name in ["snappy.parquet", "zstd.parquet", "data.arrow", "lz4.feather"]:
        data = pq.read_table(folder / name) if name.endswith("parquet") else feather.read_table(folder / name)
        stamps = data["timestamp"].cast(pa.int64()).to_pylist()
        channels = {c: [None if v is None else float(v) for v in data[c].to_pylist()] for c in ["u", "y", "f", "on"]}
        found[name] = {"": {"time": [(s - stamps[0]) / 1e9 for s in stamps], "channels": channels}}
    return found

"""Logs read by deadtime and by each format's own Python reader: time and peak memory, each run in a process of its own, in turns; prints Markdown tables.

Called by lab/peers with the path of our timing program. Memory is the peak of the process less what it held before the file was read. The sums of all channels agree.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

CHANNELS = 6
#: One run of a reader.
RUN = """
import json, sys, time
import numpy as np
{imports}
def held(key):
    with open("/proc/self/status") as status:
        return next(int(line.split()[1]) for line in status if line.startswith(key)) * 1024
open("/proc/self/clear_refs", "w").write("5")
before, start, cpu = held("VmRSS"), time.perf_counter(), time.process_time()
{read}
seconds, cpu, peak = time.perf_counter() - start, time.process_time() - cpu, held("VmHWM") - before
{sums}
print(json.dumps({{"seconds": seconds, "cpu": cpu, "bytes": peak, "sums": sums}}))
"""
CSV = {"read": "frame = reader.read_csv(sys.argv[1])", "sums": "sums = [float(frame[name].sum()) for name in frame.columns[1:]]"}
#: Of each reader: what is imported, the reading, and the sums of each channel or topic, which are not timed.
READERS = {
    "pandas": {"imports": "import pandas as reader", **CSV},
    "polars": {"imports": "import polars as reader", **CSV},
    "pyulog": {
        "imports": "from pyulog import ULog",
        "read": "log = ULog(sys.argv[1])",
        "sums": """
topics = sorted(log.data_list, key=lambda d: (d.name, d.multi_id))
sums = [float(sum(np.sum(v, dtype=float) for k, v in d.data.items() if k != "timestamp")) for d in topics]""",
    },
    # As its pages show it; the numbers are kept as columns, as the other readers give them.
    "mcap": {
        "imports": "from mcap.reader import make_reader\nfrom mcap_ros2.decoder import DecoderFactory",
        "read": """
times, columns = [], [[] for _ in range(8)]
with open(sys.argv[1], "rb") as file:
    for _, _, message, decoded in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
        times.append(message.log_time)
        for column, value in zip(columns, (*decoded.acceleration, *decoded.rate, decoded.temperature, decoded.count)):
            column.append(value)
columns = [np.array(column) for column in columns]""",
        "sums": "sums = [float(sum(np.sum(column, dtype=float) for column in columns))]",
    },
    "scipy": {
        "imports": "from scipy.io import loadmat",
        "read": "log = loadmat(sys.argv[1])",
        "sums": "sums = [float(sum(np.sum(v) for k, v in log.items() if k not in ('t', '__header__', '__version__', '__globals__')))]",
    },
}
#: Topics as an autopilot logs them: name, numbers of four bytes beside the stamp, messages in each round.
TOPICS = [("sensor_combined", 9, 4), ("vehicle_attitude", 8, 2), ("actuator_outputs", 17, 2), ("vehicle_local_position", 30, 1)]


def write(path: Path, megabytes: float) -> tuple[int, list[float]]:
    """A log as a recorder writes it, of six digits: its numbers (time among them), and the sum of each channel."""
    rows = round(megabytes * 1e6 / (9.0 * (CHANNELS + 1)))
    values = np.random.default_rng(1).normal(size=(rows, CHANNELS)).round(5)
    time = (0.001 * np.arange(rows)).round(3)
    header = ",".join(["time", *(f"c{k}" for k in range(CHANNELS))])
    np.savetxt(path, np.column_stack([time, values]), fmt=["%.3f"] + ["%.5f"] * CHANNELS, delimiter=",", header=header, comments="")
    return values.size + rows, values.sum(axis=0).tolist()


def write_ulog(path: Path, megabytes: float) -> int:
    """A log of ULog, by the specification; how many numbers it holds, stamps among them."""

    def message(kind: str, payload: bytes) -> bytes:
        return len(payload).to_bytes(2, "little") + kind.encode() + payload

    text, subscriptions = b"ULog\x01\x12\x35\x01" + bytes(8) + message("B", bytes(40)), b""
    parts: list[tuple[str, object]] = []
    places: list[tuple[int, int, int]] = []
    for at, (name, fields, often) in enumerate(TOPICS):
        text += message("F", f"{name}:uint64_t timestamp;{''.join(f'float f{k};' for k in range(fields))}".encode())
        # All formats stand before the first subscription: there the definitions end.
        subscriptions += message("A", bytes([0]) + at.to_bytes(2, "little") + name.encode())
        for k in range(often):
            one = [("size", "<u2"), ("kind", "u1"), ("id", "<u2"), ("t", "<u8"), ("x", "<f4", (fields,))]
            parts.append((f"m{at}_{k}", np.dtype(one)))
            places.append((at, k, fields))
    kind = np.dtype(parts)
    rounds = round(megabytes * 1e6 / kind.itemsize)
    table = np.zeros(rounds, dtype=kind)
    rng = np.random.default_rng(1)
    for at, k, fields in places:
        part = table[f"m{at}_{k}"]
        part["size"], part["kind"], part["id"] = 10 + 4 * fields, ord("D"), at
        part["t"] = 1_000_000 + 4000 * np.arange(rounds) + 4000 * k // TOPICS[at][2]
        part["x"] = rng.normal(size=(rounds, fields))
    path.write_bytes(text + subscriptions + table.tobytes())
    return rounds * sum((1 + fields) * often for _, fields, often in TOPICS)


def write_mcap(path: Path, megabytes: float) -> int:
    """A bag of one inertial sensor in chunks packed by zstd, by the format's own writer; how many numbers it holds, stamps among them."""
    from mcap_ros2.writer import Writer

    rng = np.random.default_rng(1)
    rounds = round(megabytes * 1e6 / 88)
    with path.open("wb") as file:
        writer = Writer(file)
        kind = writer.register_msgdef("lab_msgs/msg/Inertial", "float64[3] acceleration\nfloat64[3] rate\nfloat32 temperature\nuint32 count\n")
        values = rng.normal(size=(rounds, 6)).tolist()
        for k, row in enumerate(values):
            message = {"acceleration": row[:3], "rate": row[3:], "temperature": 20.5, "count": k}
            writer.write_message("/inertial", kind, message, log_time=1_000_000_000 + 4_000_000 * k, publish_time=1_000_000_000 + 4_000_000 * k)
        writer.finish()
    return 9 * rounds


def write_mat(path: Path, megabytes: float) -> int:
    """A MAT file of version 7, packed as MATLAB does: time and six channels; how many numbers it holds."""
    from scipy.io import savemat

    rows = round(megabytes * 1e6 / 8 / (CHANNELS + 1))
    values = np.random.default_rng(1).normal(size=(rows, CHANNELS))
    savemat(path, {"t": 0.001 * np.arange(rows), **{f"c{k}": values[:, k] for k in range(CHANNELS)}}, do_compression=True)
    return rows * (CHANNELS + 1)


def ours(program: str, path: Path, task: str = "csv") -> dict[str, object]:
    """One run of our timing program; its peak, all of it."""
    with tempfile.NamedTemporaryFile() as out:
        request = json.dumps({"task": task, "u": str(path), "loops": 1, "out": out.name})
        process = subprocess.Popen([program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert process.stdin is not None and process.stdout is not None
        process.stdin.write(request + "\n")
        process.stdin.flush()
        seconds = json.loads(process.stdout.readline())["seconds"]
        # Of the program's own memory: what the kernel reports at the end of a child includes the parent's from before it became another program.
        peak = int(re.search(r"VmHWM:\s+(\d+)", Path(f"/proc/{process.pid}/status").read_text()).group(1)) * 1024
        process.stdin.close()
        _, code, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(code)
        return {"seconds": seconds, "cpu": usage.ru_utime + usage.ru_stime, "bytes": peak, "sums": np.fromfile(out.name, dtype="<f8").tolist()}


def peer(module: str, path: Path, threads: str | None) -> dict[str, object]:
    """One run of a peer."""
    environment = dict(os.environ) if threads is None else {**os.environ, "POLARS_MAX_THREADS": threads}
    script = RUN.format(**READERS[module])
    done = subprocess.run([sys.executable, "-c", script, str(path)], env=environment, capture_output=True, text=True, check=True)
    return json.loads(done.stdout)  # type: ignore[no-any-return]


def main() -> int:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("program")
    arguments.add_argument("--pairs", type=int, default=5)
    arguments.add_argument("--only", choices=["csv", "ulog", "mcap", "mat"], default="")
    arguments.add_argument("--megabytes", type=float, default=100.0)
    options = arguments.parse_args()
    frames = {"pandas `read_csv`": ("pandas", None), "polars `read_csv`, one thread": ("polars", "1"), "polars `read_csv`, all threads": ("polars", None)}
    print("# Reading logs beside other tools\n")
    print("`lab/peers --logs` prints this page: files of one kind each, read whole by `deadtime` and by the reader that their users have in Python.")
    print("The sums of what they read agree. Memory is the peak of the process less what it held before the file was read.")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.csv"
        if options.only in ("", "csv"):
            numbers, sums = write(path, options.megabytes)
            compare("A log of CSV", "csv", "deadtime `log::read`", frames, (path, numbers, sums), options)
            path.unlink()
        for task, title, ending, writer, reader, module in (
            ("ulog", "A log of ULog", "ulg", write_ulog, "pyulog `ULog`", "pyulog"),
            ("mcap", "A bag of MCAP, ROS 2 messages", "mcap", write_mcap, "mcap `iter_decoded_messages`", "mcap"),
            ("mat", "A MAT file of version 7", "mat", write_mat, "scipy `loadmat`", "scipy"),
        ):
            if options.only in ("", task):
                path = Path(folder) / f"log.{ending}"
                numbers = writer(path, options.megabytes)
                compare(title, "recording", "deadtime `log::open`", {reader: (module, None)}, (path, numbers, None), options)
                path.unlink()
    return 0


def compare(
    title: str,
    task: str,
    name: str,
    peers: dict[str, tuple[str, str | None]],
    log: tuple[Path, int, list[float] | None],
    options: argparse.Namespace,
) -> None:
    """Runs all readers in turns and prints their table; without sums to hold against, all must agree with the first."""
    path, numbers, sums = log
    size = path.stat().st_size
    runs: dict[str, list[dict[str, object]]] = {reader: [] for reader in (name, *peers)}
    for _ in range(options.pairs):
        runs[name].append(ours(options.program, path, task))
        for reader, (module, threads) in peers.items():
            runs[reader].append(peer(module, path, threads))
    meant = np.array(runs[name][0]["sums"] if sums is None else sums, dtype=float)
    for reader, done in runs.items():
        if not all(np.allclose(np.array(run["sums"], dtype=float), meant, rtol=1e-9, atol=1e-6) for run in done):
            raise SystemExit(f"{reader} read other numbers")
    mine = runs[name]
    print(f"\n## {title}, {size / 1e6:.0f} MB\n")
    print(f"{numbers} numbers, which take {8 * numbers / 1e6:.0f} MB; {options.pairs} runs of each in turns, a process each; {os.cpu_count()} processors. Ours uses one thread; its processor time and memory are those of the whole process.\n")
    print("| reader | s by the clock, min (median) | s of processor time, min (median) | MB/s of processor time | processor time over ours | peak memory over the numbers | over ours |")
    print("| --- | --- | --- | --- | --- | --- | --- |")

    def of(done: list[dict[str, object]], key: str) -> np.ndarray:
        return np.array([run[key] for run in done], dtype=float)

    def both(values: np.ndarray) -> str:
        return f"{values.min():.3g} ({np.median(values):.3g})"

    for reader, done in runs.items():
        cpu, held = of(done, "cpu"), np.median(of(done, "bytes"))
        ratio, more = cpu.min() / of(mine, "cpu").min(), held / np.median(of(mine, "bytes"))
        print(
            f"| {reader} | {both(of(done, 'seconds'))} | {both(cpu)} | {size / 1e6 / cpu.min():.0f} | {ratio:.2f}× | {held / (8 * numbers):.1f}× | {more:.2f}× |"
        )


if __name__ == "__main__":
    raise SystemExit(main())

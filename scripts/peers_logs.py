"""A log of CSV read by deadtime, pandas and polars, and one of ULog by deadtime and pyulog: time and peak memory, each run in a process of its own, in turns; prints Markdown tables.

Called by scripts/peers with the path of our timing program. Memory is the peak of the process less what it held before the file was read. The sums of all channels agree.
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
PEER = """
import json, sys, time
import {module} as reader
def held(key):
    with open("/proc/self/status") as status:
        return next(int(line.split()[1]) for line in status if line.startswith(key)) * 1024
open("/proc/self/clear_refs", "w").write("5")
before, start, cpu = held("VmRSS"), time.perf_counter(), time.process_time()
frame = reader.read_csv(sys.argv[1])
seconds, cpu = time.perf_counter() - start, time.process_time() - cpu
print(json.dumps({{"seconds": seconds, "cpu": cpu, "bytes": held("VmHWM") - before, "sums": [float(frame[name].sum()) for name in frame.columns[1:]]}}))
"""

PYULOG = """
import json, sys, time
import numpy as np
from pyulog import ULog
def held(key):
    with open("/proc/self/status") as status:
        return next(int(line.split()[1]) for line in status if line.startswith(key)) * 1024
open("/proc/self/clear_refs", "w").write("5")
before, start, cpu = held("VmRSS"), time.perf_counter(), time.process_time()
log = ULog(sys.argv[1])
seconds, cpu, peak = time.perf_counter() - start, time.process_time() - cpu, held("VmHWM") - before
topics = sorted(log.data_list, key=lambda d: (d.name, d.multi_id))
sums = [float(sum(np.sum(v, dtype=float) for k, v in d.data.items() if k != "timestamp")) for d in topics]
print(json.dumps({{"seconds": seconds, "cpu": cpu, "bytes": peak, "sums": sums}}))
"""
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
    script = (PYULOG if module == "pyulog" else PEER).format(module=module)
    done = subprocess.run([sys.executable, "-c", script, str(path)], env=environment, capture_output=True, text=True, check=True)
    return json.loads(done.stdout)  # type: ignore[no-any-return]


def main() -> int:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("program")
    arguments.add_argument("--pairs", type=int, default=5)
    arguments.add_argument("--only", choices=["csv", "ulog"], default="")
    arguments.add_argument("--megabytes", type=float, default=100.0)
    options = arguments.parse_args()
    frames = {"pandas `read_csv`": ("pandas", None), "polars `read_csv`, one thread": ("polars", "1"), "polars `read_csv`, all threads": ("polars", None)}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.csv"
        if options.only in ("", "csv"):
            numbers, sums = write(path, options.megabytes)
            compare("A log of CSV", "csv", "deadtime `log::read`", frames, (path, numbers, sums), options)
            path.unlink()
        path = Path(folder) / "log.ulg"
        if options.only in ("", "ulog"):
            numbers = write_ulog(path, options.megabytes)
            compare("A log of ULog", "ulog", "deadtime `log::open`", {"pyulog `ULog`": ("pyulog", None)}, (path, numbers, None), options)
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

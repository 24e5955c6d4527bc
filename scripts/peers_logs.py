"""A log of CSV read by deadtime, pandas and polars: time and peak memory, each run in a process of its own, in turns; prints a Markdown table.

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


def write(path: Path, megabytes: float) -> tuple[int, list[float]]:
    """A log as a recorder writes it, of six digits: its numbers (time among them), and the sum of each channel."""
    rows = round(megabytes * 1e6 / (9.0 * (CHANNELS + 1)))
    values = np.random.default_rng(1).normal(size=(rows, CHANNELS)).round(5)
    time = (0.001 * np.arange(rows)).round(3)
    header = ",".join(["time", *(f"c{k}" for k in range(CHANNELS))])
    np.savetxt(path, np.column_stack([time, values]), fmt=["%.3f"] + ["%.5f"] * CHANNELS, delimiter=",", header=header, comments="")
    return values.size + rows, values.sum(axis=0).tolist()


def ours(program: str, path: Path) -> dict[str, object]:
    """One run of our timing program; its peak, all of it."""
    with tempfile.NamedTemporaryFile() as out:
        request = json.dumps({"task": "csv", "u": str(path), "loops": 1, "out": out.name})
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
    done = subprocess.run([sys.executable, "-c", PEER.format(module=module), str(path)], env=environment, capture_output=True, text=True, check=True)
    return json.loads(done.stdout)  # type: ignore[no-any-return]


def main() -> int:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("program")
    arguments.add_argument("--pairs", type=int, default=5)
    arguments.add_argument("--megabytes", type=float, default=100.0)
    options = arguments.parse_args()
    peers = {"pandas `read_csv`": ("pandas", None), "polars `read_csv`, one thread": ("polars", "1"), "polars `read_csv`, all threads": ("polars", None)}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.csv"
        numbers, sums = write(path, options.megabytes)
        size = path.stat().st_size
        runs: dict[str, list[dict[str, object]]] = {name: [] for name in ("deadtime `log::read`", *peers)}
        for _ in range(options.pairs):
            runs["deadtime `log::read`"].append(ours(options.program, path))
            for name, (module, threads) in peers.items():
                runs[name].append(peer(module, path, threads))
    for name, done in runs.items():
        if not all(np.allclose(np.array(run["sums"], dtype=float), sums, rtol=1e-9, atol=1e-6) for run in done):
            raise SystemExit(f"{name} read other numbers")
    mine = runs["deadtime `log::read`"]
    print(f"\n## A log of CSV, {size / 1e6:.0f} MB\n")
    print(f"{numbers} numbers, which take {8 * numbers / 1e6:.0f} MB; {options.pairs} runs of each in turns, a process each; {os.cpu_count()} processors. Ours uses one thread; its processor time and memory are those of the whole process.\n")
    print("| reader | s by the clock, min (median) | s of processor time, min (median) | MB/s of processor time | processor time over ours | peak memory over the numbers | over ours |")
    print("| --- | --- | --- | --- | --- | --- | --- |")

    def of(done: list[dict[str, object]], key: str) -> np.ndarray:
        return np.array([run[key] for run in done], dtype=float)

    def both(values: np.ndarray) -> str:
        return f"{values.min():.3g} ({np.median(values):.3g})"

    for name, done in runs.items():
        cpu, held = of(done, "cpu"), np.median(of(done, "bytes"))
        ratio, more = cpu.min() / of(mine, "cpu").min(), held / np.median(of(mine, "bytes"))
        print(
            f"| {name} | {both(of(done, 'seconds'))} | {both(cpu)} | {size / 1e6 / cpu.min():.0f} | {ratio:.2f}× | {held / (8 * numbers):.1f}× | {more:.2f}× |"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())

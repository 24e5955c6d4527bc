"""The pictures of the first pages: a log, a simulator that misses it, the same simulator repaired, and the methods over kinds of records."""

from __future__ import annotations

import csv
import subprocess
import tempfile
from pathlib import Path

from . import svg, tables

FLIGHT, MODEL, DELAYED = "examples/uav_flight.csv", "examples/uav_lateral_stabilised.toml", "examples/uav_lateral_delayed.toml"
# A second and a half in which the command changes now and then.
SECONDS = (3.0, 4.5)
BENCHMARK = Path("docs/results/studies/bjorklund.md")
METHODS = "oe_posterior oestruc met1struc arxstruc arxdap p2d delayest impulseest cusum_step lagudap fischer gcc_hannan_thomson crosscorr area2".split()
KINDS = (("open", "open loop"), ("one lag or none", "one lag or none"), ("closed", "in a loop"))


def pages(root: Path, program: str) -> dict[str, str]:
    """Path below docs/ to text."""
    measured = columns(root / FLIGHT)
    plain, late = (simulated(root, program, model) for model in (MODEL, DELAYED))
    time = [t for t in measured["time"] if SECONDS[0] <= t <= SECONDS[1]]
    first = measured["time"].index(time[0])
    part = slice(first, first + len(time))
    command, output = measured["r"], measured["ay"]
    largest = max(abs(v) for v in output[part])
    scaled = [largest * v / max(abs(u) for u in command[part]) for v in command[part]]
    machine = ("measured", output[part], svg.GREY, "")
    return {
        "images/five-minutes/log.svg": svg.curves(
            "a command and what the machine did", time, [("command r (scaled)", scaled, svg.BLUE, "6 4"), ("measured sideways acceleration", output[part], svg.GREY, "")], "m/s²"
        ),
        "images/five-minutes/simulated.svg": svg.curves(
            "measured and simulated", time, [machine, ("simulated", plain[part], svg.RED, "")], "m/s²"
        ),
        "images/five-minutes/repaired.svg": svg.curves(
            "measured, and simulated with a dead time of 0.13 s", time, [machine, ("simulated, with 0.13 s of dead time", late[part], svg.BLUE, "6 4")], "m/s²"
        ),
        "images/five-minutes/gap.svg": svg.curves(
            "measured, simulated, and simulated with a dead time of 0.13 s",
            time,
            [machine, ("simulated", plain[part], svg.RED, ""), ("simulated with the cause that was found", late[part], svg.BLUE, "6 4")],
            "m/s²",
        ),
        "images/which-method.svg": methods(root),
        **drive(root, program),
    }


def drive(root: Path, program: str) -> dict[str, str]:
    """The tutorial's second run, converted as it says, beside its simulator without and with the dead time."""
    run, model = columns(root / "examples/drive_run_2.csv"), (root / "examples/drive.toml").read_text(encoding="utf-8")
    speed = [v * 3.14159265 / 30 for v in run["speed"]]
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "run.csv"
        rows = (f"{t:.2f},{u!r},{y:.4f}\n" for t, u, y in zip(run["time"], run["voltage"], speed, strict=True))
        log.write_text("time,voltage [V],speed [rad/s]\n" + "".join(rows), encoding="utf-8")
        entry = '\n[[effects]]\neffect = "input_delay"\nchannel = "voltage"\nparameters = { delay = 0.012 }\n'
        drawn = []
        for text in (model, model + entry):
            (Path(folder) / "model.toml").write_text(text, encoding="utf-8")
            subprocess.run([program, "simulate", "model.toml", "run.csv", "--out", "out.csv", "-q"], cwd=folder, check=True)
            drawn.append(columns(Path(folder) / "out.csv")["speed"])
    part = slice(300, 361)
    time, machine = run["time"][part], ("measured", speed[part], svg.GREY, "")
    before, after = drawn
    return {
        "images/tutorial/before.svg": svg.curves("measured and simulated speed", time, [machine, ("simulated", before[part], svg.RED, "")], "rad/s"),
        "images/tutorial/after.svg": svg.curves(
            "measured speed, and simulated with the dead time", time, [machine, ("simulated with 12 ms of dead time", after[part], svg.BLUE, "6 4")], "rad/s"
        ),
    }


def columns(path: Path) -> dict[str, list[float]]:
    """The columns of a log by their names without units."""
    with path.open(encoding="utf-8") as opened:
        head, *rows = list(csv.reader(opened))
    return {name.split(" ")[0]: [float(row[k] or "nan") for row in rows] for k, name in enumerate(head)}


def simulated(root: Path, program: str, model: str) -> list[float]:
    """The sideways acceleration of a model on the flight's commands."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out.csv"
        subprocess.run([program, "simulate", model, FLIGHT, "--out", str(out), "-q"], cwd=root, check=True)
        return columns(out)["ay"]


def methods(root: Path) -> str:
    """RMS errors of the standard benchmark: a bar for each method and kind of record."""
    rows = [row for row in tables.rows(root / BENCHMARK, "grid", "from", "method") if row["from"] == "u" and row["RMS error (samples)"] != "–"]
    score = {(row["grid"], row["method"]): float(row["RMS error (samples)"]) for row in rows}
    left, top, row_height, column = 168, 44, 24, 190
    height = top + row_height * len(METHODS) + 34
    parts = []
    for place, (_, words) in enumerate(KINDS):
        parts.append(svg.text(left + column * place, 26, words))
    for row, method in enumerate(METHODS):
        y = top + row_height * row
        parts.append(svg.text(left - 12, y + 13, method, "end"))
        for place, (grid, _) in enumerate(KINDS):
            x, value = left + column * place, score.get((grid, method))
            if value is None:
                parts.append(svg.text(x, y + 13, "not run", colour=svg.GREY))
                continue
            best = value <= 1.5 * min(v for (g, m), v in score.items() if g == grid and m in METHODS)
            width = 130 * min(value, 10.0) / 10.0
            parts.append(f"<rect x='{x}' y='{y}' width='{width:.1f}' height='17' fill='{svg.BLUE if best else svg.LINE}'/>")
            parts.append(svg.text(x + width + 6, y + 13, f"{value:.2f}", colour=svg.INK))
    parts.append(svg.text(left, height - 10, "root mean square error, samples; blue: within 1.5 times the best of its column", colour=svg.GREY))
    return svg.picture(760, height, "errors of methods on three kinds of records of the standard benchmark", parts)

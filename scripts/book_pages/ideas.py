"""What the methods of a class look at, as a picture: made by the program from the example flight and from signals of its own."""

from __future__ import annotations

import subprocess
import tempfile
from pathlib import Path

from . import svg
from .pictures import FLIGHT, MODEL, columns

#: Class to picture and the sentence beneath it.
SEEN = {
    "sampled models": ("loss", "A model is fitted for each candidate delay. The delay whose model leaves the least error wins. Here the model is given, so the error alone is shown."),
    "continuous process models": ("loss", "The delay is a parameter of a model, and need not be whole samples. Where the error is least, it stands. Here the model is given, so the error alone is shown."),
    "measured states": ("loss", "With the model known, the delay that explains the states best stands where the error is least."),
    "thresholds on a response": ("response", "The response to an impulse is estimated. The dead time ends where it first stands out. Here it is without noise."),
    "Laguerre series": ("response", "The response to an impulse is described by a series of smooth functions, and its delay is read off. Here it is without noise."),
    "areas and moments": ("response", "Areas under the response, or its moments, give the lag and the delay together. Here it is without noise."),
    "correlation": ("correlation", "The output is moved against the input. Where they are most alike, the delay stands."),
    "phase": ("correlation", "A delay turns the phase by more, the higher the frequency. In time it is the shift at which both are most alike."),
    "higher-order statistics": ("correlation", "As a correlation, but of three values at a time, to which symmetric noise adds nothing."),
}


def section(kind: str) -> list[str]:
    """The lines of a page that show what its class looks at; none where there is no picture."""
    if kind not in SEEN:
        return []
    name, words = SEEN[kind]
    return ["## What it looks at", "", f"![what methods of the class {kind} look at](../images/ideas/{name}.svg)", "", words, ""]


def pages(root: Path, program: str) -> dict[str, str]:
    """Path below docs/ to text."""
    return {"images/ideas/loss.svg": loss(root, program), "images/ideas/response.svg": response(root, program), "images/ideas/correlation.svg": correlation(program)}


def ran(program: str, folder: str, *words: str) -> None:
    """Runs the program."""
    subprocess.run([program, *words, "-q"], cwd=folder, check=True)


def loss(root: Path, program: str) -> str:
    """Error of the example's simulator over the delay of its command."""
    measured = columns(root / FLIGHT)["ay"]
    delays, errors = [0.01 * k for k in range(31)], []
    mean = sum(measured) / len(measured)
    size = sum((y - mean) ** 2 for y in measured)
    with tempfile.TemporaryDirectory() as folder:
        for delay in delays:
            ran(program, folder, "simulate", str(root / MODEL), str(root / FLIGHT), "--delay", f"r={delay:.2f}", "--out", "out.csv")
            simulated = columns(Path(folder) / "out.csv")["ay"]
            errors.append((sum((y - s) ** 2 for y, s in zip(measured, simulated, strict=True)) / size) ** 0.5)
    return svg.curves("error of the simulator over its delay", delays, [("error over the delay; the log was made with 0.13 s", errors, svg.BLUE, "")], "error over motion")


def response(root: Path, program: str) -> str:
    """Response of the example's simulator to a pulse of one sample, behind 0.13 s."""
    with tempfile.TemporaryDirectory() as folder:
        rows = "".join(f"{0.02 * k:.2f},{1 if k == 0 else 0}\n" for k in range(41))
        (Path(folder) / "pulse.csv").write_text(f"time,r\n-0.02,0\n{rows}", encoding="utf-8")
        ran(program, folder, "simulate", str(root / MODEL), "pulse.csv", "--delay", "r=0.13", "--out", "out.csv")
        table = columns(Path(folder) / "out.csv")
    return svg.curves("response to a pulse behind a dead time of 0.13 s", table["time"], [("response to a pulse; the dead time is 0.13 s", table["ay"], svg.RED, "")], "m/s²")


def correlation(program: str) -> str:
    """Cross-correlation of a band-limited random signal with a copy of it, 0.25 s later."""
    late = 5
    with tempfile.TemporaryDirectory() as folder:
        ran(program, folder, "excite", "rbs", "--samples", "600", "--sample-time", "0.05", "--set", "band=[0,0.2]", "--channel", "u", "--out", "u.csv")
        u = columns(Path(folder) / "u.csv")["u"]
    lags = range(31)
    alike = [sum(u[k - late] * u[k - lag] for k in range(40, len(u))) / (len(u) - 40) for lag in lags]
    return svg.curves("likeness of two signals over their shift", [0.05 * lag for lag in lags], [("correlation over the shift; the delay is 0.25 s", alike, svg.BLUE, "")], "correlation")

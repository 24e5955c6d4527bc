"""A page and a picture of every effect."""

from __future__ import annotations

import csv
import json
import math
import subprocess
import tempfile
from pathlib import Path
from typing import Any

from . import sources, svg

# Where an effect is shown: a model, its channel there, and sizes that can be seen.
WIRE = """format = "deadtime/model@1"
name = "wire"
kind = "lti"
inputs = [{ name = "u" }]
states = [{ name = "s" }]
outputs = [{ name = "y" }]
A = [[-1.0]]
B = [[0.0]]
C = [[0.0]]
D = [[1.0]]
"""
SPRING = """format = "deadtime/model@1"
name = "mass on a spring"
kind = "lti"
inputs = [{ name = "u" }]
states = [{ name = "x" }, { name = "v" }]
outputs = [{ name = "x" }]
A = [[0.0, 1.0], [-4.0, -0.8]]
B = [[0.0], [4.0]]
C = [[1.0, 0.0]]
D = [[0.0]]
"""
SUSPECT = SPRING + """[[candidates]]
state = "v"
adds = "k*x*abs(x)"
"""
TANKS = """format = "deadtime/model@1"
name = "two tanks"
kind = "lti"
inputs = [{ name = "u" }]
states = [{ name = "a" }, { name = "b" }]
outputs = [{ name = "b" }]
initial = [0.0, 0.0]
A = [[-0.6, 0.0], [0.0, -0.9]]
B = [[1.0], [0.3]]
C = [[0.0, 1.0]]
D = [[0.0]]
"""
TWO = """format = "deadtime/model@1"
name = "two outputs"
kind = "lti"
inputs = [{ name = "u" }]
states = [{ name = "p" }, { name = "q" }]
outputs = [{ name = "y" }, { name = "from" }]
A = [[-3.0, 0.0], [0.0, -0.7]]
B = [[3.0], [0.7]]
C = [[1.0, 0.0], [0.0, 1.0]]
D = [[0.0], [0.0]]
"""
WIRES = """format = "deadtime/model@1"
name = "two wires"
kind = "lti"
inputs = [{ name = "u" }, { name = "v" }]
states = [{ name = "s" }]
outputs = [{ name = "y" }]
A = [[-1.0]]
B = [[0.0, 0.0]]
C = [[0.0]]
D = [[1.0, 0.0]]
"""
LOOP = """format = "deadtime/model@1"
name = "position servo"
kind = "equations"
inputs = [{ name = "u", unit = "rad" }]
outputs = [{ name = "q", unit = "rad" }]
[states]
q = { unit = "rad", initial = 0.0 }
w = { unit = "rad/s", initial = 0.0 }
[derivatives]
q = "w"
w = "25*(u - q) - 6*w"
[output_equations]
q = "q"
"""
TRAIN = """format = "deadtime/model@1"
name = "motor and load"
kind = "equations"
inputs = [{ name = "u" }]
outputs = [{ name = "load", unit = "rad" }]
[states]
motor = { unit = "rad", initial = 0.0 }
load = { unit = "rad", initial = 0.0 }
wm = { initial = 0.0 }
wl = { initial = 0.0 }
[derivatives]
motor = "wm"
load = "wl"
wm = "u - 40*(motor - load) - wm"
wl = "40*(motor - load) - 2*load - wl"
[output_equations]
load = "load"
"""
SHOWN: dict[str, tuple[str, str, dict[str, float]]] = {
    "input_delay": (WIRE, "u", {"delay": 0.4}),
    "delay_jump": (WIRE, "u", {"delay": 0.15, "time": 5.0, "later": 0.6}),
    "delay_drift": (WIRE, "u", {"delay": 0.05, "rate": 0.08}),
    "multi_rate": (WIRE, "u", {"period": 0.5, "phase": 0.0}),
    "input_gain": (WIRE, "u", {"gain": 0.7}),
    "input_curve": (WIRE, "u", {"quadratic": 0.4}),
    "gain_fade": (WIRE, "u", {"rate": 0.05}),
    "gain_jump": (WIRE, "u", {"gain": 1.0, "time": 5.0, "later": 0.5}),
    "input_offset": (WIRE, "u", {"offset": 0.25}),
    "deadband": (WIRE, "u", {"width": 0.3}),
    "backlash": (WIRE, "u", {"width": 0.3}),
    "saturation": (WIRE, "u", {"lower": -0.5, "upper": 0.6}),
    "rate_limit": (WIRE, "u", {"rate": 1.0}),
    "actuator_lag": (WIRE, "u", {"time_constant": 0.4}),
    "swapped_inputs": (WIRES, "u<->v", {"share": 1.0}),
    "dropped_commands": (WIRE, "u", {"probability": 0.9}),
    "delay_jitter": (WIRE, "u", {"delay": 0.3, "spread": 0.2, "ordered": 1.0}),
    "candidate": (SUSPECT, "v += k*x*abs(x)", {"k": -6.0}),
    "parameter_error": (SPRING, "A[v,x]", {"value": -8.0}),
    "parameter_jump": (SPRING, "A[v,x]", {"value": -20.0, "time": 5.0, "later": -8.0}),
    "cross_coupling": (TANKS, "a->b", {"gain": 0.3}),
    "exchange": (TANKS, "a<->b", {"gain": 0.5}),
    "internal_saturation": (LOOP, "25*(u - q)", {"lower": -6.0, "upper": 8.0}),
    "internal_deadband": (LOOP, "25*(u - q)", {"width": 4.0}),
    "internal_delay": (LOOP, "25*(u - q)", {"delay": 0.1}),
    "internal_lag": (LOOP, "25*(u - q)", {"time_constant": 0.15}),
    "driveline_backlash": (TRAIN, "motor - load", {"width": 0.15}),
    "driveline_friction": (TRAIN, "motor - load", {"level": 0.2, "speed": 0.1}),
    "coulomb_friction": (SPRING, "v", {"level": 1.0}),
    "stribeck_friction": (SPRING, "v", {"level": 0.5, "extra": 1.0, "velocity": 0.2}),
    "hysteresis": (SPRING, "v", {"level": 2.0, "displacement": 0.2, "sharpness": 1.5}),
    "quadratic_drag": (SPRING, "v", {"coefficient": 1.5}),
    "cubic_stiffness": (SPRING, "x->v", {"coefficient": 4.0}),
    "unmodelled_mode": (SPRING, "u->output:x", {"frequency": 1.5, "damping": 0.05, "gain": 0.3}),
    "constant_disturbance": (SPRING, "v", {"level": 1.0}),
    "periodic_disturbance": (SPRING, "v", {"frequency": 1.0, "amplitude": 12.0, "phase": 0.0}),
    "output_delay": (TWO, "y", {"delay": 0.4}),
    "sensor_lag": (TWO, "y", {"time_constant": 0.5}),
    "output_backlash": (TWO, "y", {"width": 0.2}),
    "static_nonlinearity": (TWO, "y", {"quadratic": 0.15, "cubic": -0.3}),
    "sensor_gain": (TWO, "y", {"gain": 1.3}),
    "sensor_bias": (TWO, "y", {"offset": 0.25}),
    "sensor_drift": (TWO, "y", {"rate": 0.05}),
    "sensor_saturation": (TWO, "y", {"lower": -0.4, "upper": 0.6}),
    "sensor_quantisation": (TWO, "y", {"step": 0.25}),
    "misalignment": (TWO, "from->y", {"gain": 0.5}),
    "swapped_outputs": (TWO, "y<->from", {"share": 1.0}),
    "clock_skew": (TWO, "*", {"ratio": 1.06}),
    "clock_offset": (TWO, "*", {"offset": 0.4}),
}
STEP = 0.02


def command(t: float) -> float:
    """Small and large, slow and sudden: a sine, then steps of three heights."""
    if t < 0.5:
        return 0.0
    if t < 5.5:
        return math.sin(2.0 * math.pi * (t - 0.5) / 2.5)
    return 0.0 if t < 6.0 else 1.0 if t < 7.5 else -0.6 if t < 9.0 else 0.2


def pages(root: Path, program: str, listed: list[dict[str, Any]]) -> dict[str, str]:
    """Path below docs/ to text."""
    about = sources.effects(root)
    written: dict[str, str] = {}
    for effect in listed:
        name = effect["effect"]
        text = about.get(name)
        lacking = [s for s in ("Assumes", "Fails when", "Source") if text is None or s not in text.sections]
        if text is None or lacking:
            raise SystemExit(f"{name}: its doc comment lacks {', '.join(lacking)}; docs/adding.md shows how they are written")
        if name not in SHOWN:
            raise SystemExit(f"{name}: scripts/book_pages/effects.py does not say on which model, and how large, it is shown")
        written[f"effects/{name}.md"] = page(effect, text)
        written[f"images/effects/{name}.svg"] = picture(program, name)
    written["effects/index.md"] = index(listed)
    return written


def index(listed: list[dict[str, Any]]) -> str:
    """All effects with their pictures, by where they act."""
    lines = ["# The effects", "", "What a simulator may lack, one page each: equation, picture, assumptions, what it is taken for, source."]
    lines += ["[Conventions](../effects.md) tells the order in which they act. Grey and dashed is the command or the model as it is, red what the effect makes of it.", ""]
    titles = {"input": "On the way of the commands", "dynamics": "In the equations of motion", "output": "On the way of the measurements", "clock": "Between the clocks"}
    for site in dict.fromkeys(effect["site"] for effect in listed):
        lines += [f"## {titles[site]}", "", "| effect | what it is | |", "| --- | --- | --- |"]
        for effect in listed:
            name = effect["effect"]
            if effect["site"] == site:
                lines.append(f"| [{name}]({name}.md) | {effect['summary']} | ![{name}](../images/effects/{name}.svg) |")
        lines.append("")
    return "\n".join(lines)


def page(effect: dict[str, Any], text: sources.About) -> str:
    """The page of one effect."""
    name = effect["effect"]
    _, channel, values = SHOWN[name]
    formula = text.equation or text.what.rstrip(".")
    lines = [f"# {name}", "", f"{effect['summary'][0].upper()}{effect['summary'][1:]}. It acts on the {effect['site']} side, on {effect['channels']}.", ""]
    if effect["site"] == "dynamics":
        lines[2] = f"{effect['summary'][0].upper()}{effect['summary'][1:]}. It acts in the equations of motion, on {effect['channels']}."
    lines += ["## Equation", "", sources.equation(formula), ""]
    parameters = [f"| {p['name']} | {sources.words(p['unit'])} |" for p in effect["parameters"]]
    lines += ["| parameter | unit |", "| --- | --- |", *parameters, ""] if parameters else ["Its parameters are those of the expression, each with the unit that the model file gives.", ""]
    lines += ["u is the command, x a state, y an output, t the time since the log's first sample. [All effects](../effects.md) says in which order they act.", ""]
    lines += ["## Picture", "", f"![what {name} does](../images/effects/{name}.svg)", "", "Made by `deadtime simulate` with this entry at the end of the model file:", ""]
    lines += ["```toml", "[[effects]]", f'effect = "{name}"', f'channel = "{channel}"', f"parameters = {{ {', '.join(f'{k} = {v}' for k, v in values.items())} }}", "```", ""]
    lines += ["## What it assumes", "", capital(sources.words(text.sections["Assumes"])), ""]
    lines += ["## When it is missed or taken for another", "", f"It fails when {sources.words(text.sections['Fails when'])}", ""]
    lines += ["## Source", "", sources.words(text.sections["Source"]), "", f"The code stands in `{text.file}`.", ""]
    return "\n".join(lines)


def capital(text: str) -> str:
    """With a capital at the start."""
    return text[0].upper() + text[1:]


def picture(program: str, name: str) -> str:
    """The model's first output as it is, and with the effect."""
    model, channel, values = SHOWN[name]
    entry = f'\n[[effects]]\neffect = "{name}"\nchannel = "{channel}"\nparameters = {json.dumps(values).replace(": ", " = ").replace(chr(34), "")}\n'
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "command.csv"
        rows = (f"{k * STEP:.2f},{command(k * STEP):.6f},{-0.5 * command(k * STEP - 1.0):.6f}\n" for k in range(501))
        log.write_text("time,u,v\n" + "".join(rows), encoding="utf-8")
        time, plain = simulated(program, Path(folder), log, model)
        _, bent = simulated(program, Path(folder), log, model + entry)
    held = model is WIRE
    before, after = ("command", "what reaches the plant") if held else ("the model as it is", f"with {name}")
    dashes = "6 4"
    return svg.curves(f"{before}, and {after}", time, [(before, plain, svg.GREY, dashes), (after, bent, svg.RED, "")], "u" if held else "output")


def simulated(program: str, folder: Path, log: Path, model: str) -> tuple[list[float], list[float]]:
    """Times and the first output."""
    (folder / "model.toml").write_text(model, encoding="utf-8")
    words = [program, "simulate", str(folder / "model.toml"), str(log), "--out", str(folder / "out.csv"), "--seed", "1", "-q"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise SystemExit(f"deadtime simulate: {done.stderr}")
    with (folder / "out.csv").open(encoding="utf-8") as opened:
        table = list(csv.reader(opened))
    first = next(k for k, head in enumerate(table[0]) if head.split(" ")[0] not in ("time", "u", "v"))
    return [float(row[0]) for row in table[1:]], [float(row[first]) for row in table[1:]]

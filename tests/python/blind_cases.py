"""Two small cases of the check on withheld effects, made by hand: a plant of one lag whose command arrives late, and one that its simulator describes."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np

MODEL = """\
format = "deadtime/model@1"
name = "lag"
kind = "lti"
inputs = [{ name = "u" }]
outputs = [{ name = "y" }]
states = [{ name = "x" }]
A = [[-2.0]]
B = [[2.0]]
C = [[1.0]]
D = [[0.0]]
"""
SAMPLE_TIME = 0.05


def record(samples: int, delay: int, seed: int) -> np.ndarray:
    """Time, a random binary command that holds for 8 samples, and the lag's answer to it `delay` samples later, with noise: columns of a log."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.choice([-1.0, 1.0], samples // 8 + 1), 8)[:samples]
    pole = np.exp(-2.0 * SAMPLE_TIME)
    y = np.zeros(samples)
    for k in range(1, samples):
        late = u[k - 1 - delay] if k - 1 - delay >= 0 else 0.0
        y[k] = pole * y[k - 1] + (1 - pole) * late
    return np.column_stack([SAMPLE_TIME * np.arange(samples), u, y + 0.01 * rng.standard_normal(samples)])


def write_log(path: Path, columns: np.ndarray) -> None:
    np.savetxt(path, columns, delimiter=",", header="time,u,y", comments="", fmt="%.9g")


def make(folder: Path, delays: dict[str, int], samples: int = 400) -> tuple[Path, Path]:
    """Cases and labels; a case is called by its name in `delays`, and its command arrives so many samples late."""
    cases, labels = folder / "cases", folder / "labels"
    labels.mkdir(parents=True)
    for number, (name, delay) in enumerate(delays.items()):
        case = cases / name
        case.mkdir(parents=True)
        (case / "model.toml").write_text(MODEL)
        write_log(case / "train_1.csv", record(samples, delay, 10 * number + 1))
        write_log(case / "holdout_1.csv", record(samples, delay, 10 * number + 2))
        effect = {"effect": "input_delay", "channel": "u", "parameters": {"delay": delay * SAMPLE_TIME}}
        label = {
            "id": name,
            "salt": f"salt of {name}",
            "group": "single" if delay else "none",
            "verdict": "input_delay" if delay else "none",
            "effects": [effect] if delay else [],
            "alias_class": ["input_delay:u", "output_delay:y", "output_delay:*", "clock_offset:*"] if delay else [],
            "outputs": ["y"] if delay else [],
        }
        text = json.dumps(label, indent=1)
        bare = text.replace(json.dumps(label["salt"]), '""', 1)
        (labels / f"{name}.json").write_text(text)
        (case / "commitment.txt").write_text(hashlib.sha256((str(label["salt"]) + bare).encode()).hexdigest() + "\n")
    return cases, labels

"""What a case looks like on disk: model.toml, CSV logs, label and commitment (`deadtime/blind@1`)."""

import hashlib
import json
from pathlib import Path

import numpy as np

from .cases import Case
from .experiment import Experiment
from .system import Names


def _toml(value) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return repr(float(value))
    if isinstance(value, str):
        return json.dumps(value)
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{k} = {_toml(v)}" for k, v in value.items()) + " }"
    return "[" + ", ".join(_toml(v) for v in value) + "]"


def model_toml(experiment: Experiment, mean_outputs: list[bool]) -> str:
    """The nominal model, with `initial_std` if the experimenter knows the start; its operating points perhaps "mean"."""
    model, names = dict(experiment.nominal), Names(experiment.nominal)
    means = {"inputs": [experiment.mean_inputs] * len(names.inputs), "outputs": mean_outputs}
    for kind, flags in means.items():
        model[kind] = [{**c, "operating": "mean"} if mean else c for c, mean in zip(model[kind], flags)]
    spread = [float(f"{v:.2g}") for v in experiment.start_std] if experiment.gives_std else None
    if spread and names.lti:
        model["initial_std"] = spread
    lines = [f"{key} = {_toml(value)}" for key, value in model.items() if not isinstance(value, dict)]
    if not names.lti:
        states = {n: dict(entry) for n, entry in model["states"].items()}
        for name, value in zip(states, spread or []):
            states[name]["initial_std"] = value
        for table in ("states", "parameters", "derivatives", "output_equations"):
            entries = states if table == "states" else model[table]
            lines += [f"\n[{table}]", *(f"{n} = {_toml(entry)}" for n, entry in entries.items())]
    return "\n".join(lines) + "\n"


def log_csv(model: dict, time, u, y, missing, with_units: bool) -> str:
    def title(channel):
        return f"{channel['name']} [{channel['unit']}]" if with_units else channel["name"]

    rows = [",".join(["time", *(title(c) for c in [*model["inputs"], *model["outputs"]])])]
    for t, commands, values, lost in zip(time.tolist(), u.tolist(), y.tolist(), missing.tolist()):
        cells = [f"{t:.12g}", *(f"{v:.10g}" for v in commands), *("" if gone else f"{v:.10g}" for v, gone in zip(values, lost))]
        rows.append(",".join(cells))
    return "\n".join(rows) + "\n"


def commitment(label_bytes: bytes, salt: str) -> str:
    """Hex SHA-256 of the salt's bytes followed by the label file's bytes with the salt's text cut out (`"salt": ""`)."""
    held = f'"salt": "{salt}"'.encode()
    assert label_bytes.count(held) == 1
    return hashlib.sha256(salt.encode() + label_bytes.replace(held, b'"salt": ""')).hexdigest()


def write(case: Case, label: dict, folder: Path, identity: str, salt: str) -> None:
    """`folder`/cases/ID and `folder`/labels/ID.json."""
    experiment, place = case.experiment, folder / "cases" / identity
    place.mkdir(parents=True)
    (folder / "labels").mkdir(exist_ok=True)
    (place / "model.toml").write_text(model_toml(experiment, case.mean_outputs()))
    with_units = int(identity[0], 16) % 2 == 0
    for name, run, (u, y, _) in zip(("train_1", "train_2", "holdout_1"), experiment.runs, case.logs):
        (place / f"{name}.csv").write_text(log_csv(experiment.nominal, run.time + run.begins, u, y, run.missing, with_units))
    document = {"format": "deadtime/blind@1", "id": identity, "salt": salt, **label}
    content = (json.dumps(_plain(document), indent=1, allow_nan=False) + "\n").encode()
    (folder / "labels" / f"{identity}.json").write_bytes(content)
    (place / "commitment.txt").write_text(commitment(content, salt) + "\n")


def _plain(value):
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    return value.item() if isinstance(value, np.generic) else value

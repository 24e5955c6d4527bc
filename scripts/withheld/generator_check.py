"""A few cases drawn with a fixed seed must be whole and consistent; run by `python -m withheld.selfcheck`."""

import csv
import json
import tempfile
import tomllib
from pathlib import Path

import numpy as np

from .cases import GUSTS
from .catalogue import nominal_value
from .files import commitment
from .generate import BESIDE, generate
from .plants import PLANTS
from .simulate import simulate
from .structure import same_by_construction
from .system import Names

SEED = 8
PLANTS_BY_NAME = {plant.model["name"]: plant for plant in PLANTS.values()}
KEYS = [
    "format", "id", "salt", "group", "verdict", "effects", "alias_class", "outputs", "from_s", "to_s", "from_hz", "to_hz", "strength_db", "before", "oracle_after",
]


def _check_case(folder: Path, result: dict) -> None:
    place, identity = folder / "cases" / result["id"], result["id"]
    assert sorted(p.name for p in place.iterdir()) == ["commitment.txt", "holdout_1.csv", "model.toml", "train_1.csv", "train_2.csv"], identity
    content = (folder / "labels" / f"{identity}.json").read_bytes()
    label = json.loads(content)
    assert list(label) == KEYS, f"{identity}: keys of the label"
    assert (place / "commitment.txt").read_text().strip() == commitment(content, label["salt"]), f"{identity}: commitment"
    assert label["group"] == result["wanted"].group, f"{identity}: group"
    named = [f"{e['effect']}:{e['channel']}" for e in label["effects"]]
    classes = label["alias_class"] if label["group"] == "pair" else [label["alias_class"]] * len(named)
    assert len(classes) == len(named) and all(n in c for n, c in zip(named, classes)), f"{identity}: the truth is in its own class"
    model = tomllib.loads((place / "model.toml").read_text())
    channels = [c["name"] for c in model["inputs"] + model["outputs"]]
    for name in ("train_1", "train_2", "holdout_1"):
        rows = list(csv.reader((place / f"{name}.csv").read_text().splitlines()))
        assert [title.split(" [")[0] for title in rows[0]] == ["time", *channels], f"{identity}: header of {name}"
        times = [float(row[0]) for row in rows[1:]]
        assert len(times) > 200 and all(a < b for a, b in zip(times, times[1:])), f"{identity}: times of {name}"
        assert all(cell for row in rows[1:] for cell in row[: 1 + len(model["inputs"])]), f"{identity}: a missing command"
    if label["effects"]:
        assert label["strength_db"] >= 10.0 and label["oracle_after"] < label["before"], f"{identity}: strength"
    if label["group"] == "none":
        assert label["verdict"] == "none" and not label["alias_class"], identity
    if label["group"] == "unknown":
        assert label["verdict"] == "unknown" and not label["effects"] and label["before"] > label["oracle_after"], identity


def _read_log(path: Path, model: dict) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rows = list(csv.reader(path.read_text().splitlines()))
    values = np.array([[float(cell) if cell else np.nan for cell in row] for row in rows[1:]])
    nu = len(model["inputs"])
    return values[:, 0], values[:, 1:1 + nu], values[:, 1 + nu:]


def _files_and_label_tell_the_same(folder: Path, identity: str) -> set[str]:
    """scipy's integrator, given nothing but the files and the label's effects, leaves what the label says; which kinds of files these are."""
    place = folder / "cases" / identity
    model, label = tomllib.loads((place / "model.toml").read_text()), json.loads((folder / "labels" / f"{identity}.json").read_text())
    logs = [_read_log(place / f"{name}.csv", model) for name in ("train_1", "train_2", "holdout_1")]
    kinds = {"sampled"} if model.get("sample_time_s") else set()
    for kind, part in (("inputs", 1), ("outputs", 2)):
        mean = np.nanmean(np.concatenate([log[part] for log in logs[:2]]), axis=0)
        for channel, value in zip(model[kind], mean):
            if channel.get("operating") == "mean":
                channel["operating"] = float(value)
                kinds.add("mean")
    time, u, y = logs[2]
    if np.ptp(np.diff(time)) > 0.1 * np.median(np.diff(time)):
        kinds.add("uneven")
    drifts = model["kind"] == "lti" and not kinds & {"sampled"} and np.linalg.eigvals(np.array(model["A"])).real.max() > -1e-6
    if drifts or label["group"] == "unknown" or any(e["effect"] == "dropped_commands" for e in label["effects"]):
        return kinds
    residual = (y - simulate(model, time, u, label["effects"], integrator="reference"))[len(time) // 5:]
    left = float(np.sqrt(np.mean(np.nanmean(residual**2, axis=0) / np.nanvar(y, axis=0))))
    assert 0.8 < left / label["oracle_after"] < 1.25, f"{identity}: {left:.4g} is left, by the label {label['oracle_after']:.4g}"
    return kinds


def drawn_cases_are_whole():
    counts, kinds = {"single": 3, "none": 1, "unknown": 1, "pair": 1}, set()
    with tempfile.TemporaryDirectory() as first, tempfile.TemporaryDirectory() as second:
        results = generate(Path(first), counts, seed=SEED, jobs=1)
        for result in results:
            assert result["id"], f"nothing adequate: {result['discarded']}"
            _check_case(Path(first), result)
            kinds |= _files_and_label_tell_the_same(Path(first), result["id"])
        assert kinds >= {"sampled", "mean", "uneven"}, f"the seed must draw every kind of file, not only {kinds}"
        one = {"single": 0, "none": 1, "unknown": 0, "pair": 0}
        again, twice = (generate(Path(second) / name, one, SEED, 1)[0] for name in ("again", "twice"))
        assert again["label"] == twice["label"] and again["id"] == twice["id"], "same seed, same case"
        (again, twice) = ([path.read_bytes() for path in sorted((Path(second) / name).rglob("*.*"))] for name in ("again", "twice"))
        assert again == twice and len(again) == 6, "same seed, same files"


def machines_without_effects_differ_as_asked():
    """All parameters off by some per cent, or gusts: the label says so, names no effect, and the parameters explain what the files hold."""
    with tempfile.TemporaryDirectory() as place:
        for beside in BESIDE["none"]:
            folder = Path(place) / beside
            (result,) = generate(folder, {"single": 0, "none": 1, "unknown": 0, "pair": 0}, SEED, 1, beside=beside)
            label = json.loads((folder / "labels" / f"{result['id']}.json").read_text())
            errors = label.pop("parameter_errors")
            assert label.pop("outside") == (None if beside == "parameters" else "gusts")
            assert list(label) == KEYS and label["group"] == label["verdict"] == "none" and not label["effects"]
            if beside == "gusts":
                assert not errors and GUSTS[0] - 6 < label["strength_db"] < GUSTS[1] + 6, f"gusts of {label['strength_db']} dB"
                continue
            model = tomllib.loads((folder / "cases" / result["id"] / "model.toml").read_text())
            share = [e["parameters"]["value"] / nominal_value(PLANTS_BY_NAME[model["name"]].model, e["channel"]) - 1 for e in errors]
            assert len(share) > 1 and all(0 < abs(s) <= 0.031 for s in share), f"parameters off by {share}"
            assert label["oracle_after"] < 0.95 * label["before"], "with the true parameters less is left"


def what_is_the_same_by_construction_is():
    """Two effects that are called the same leave the same simulated outputs, at another number; a gain of the whole command is not the same about a working point."""
    rng, found = np.random.default_rng(SEED), 0
    for name, plant in PLANTS.items():
        model, names = plant.model, Names(plant.model)
        time = np.arange(120) * plant.sample_time
        u = np.array(plant.trim or [0.0] * len(names.inputs)) + np.repeat(rng.normal(size=(12, len(names.inputs))), 10, axis=0) * np.array(plant.levels)
        for one, others in same_by_construction(model).items():
            for other in others:
                found += 1
                outputs = []
                for text in (one, other):
                    effect, channel = text.split(":")
                    outputs.append(lambda value, e=effect, c=channel: simulate(model, time, u, [{"effect": e, "channel": c, "parameters": _numbers(model, e, c, value)}]))
                plain, target = simulate(model, time, u, []), outputs[0](0.02)
                tried = outputs[1](0.01) - plain  # scaled to the target: both act in proportion when small, whatever is the same meets it exactly
                scale = float(np.vdot(tried, target - plain) / np.vdot(tried, tried))
                for _ in range(20):
                    moved = outputs[1](0.01 * scale) - plain
                    scale *= float(np.vdot(moved, target - plain) / np.vdot(moved, moved))
                left = np.abs(outputs[1](0.01 * scale) - target).max() / np.abs(target - plain).max()
                assert left < 1e-5, f"{name}: {one} and {other} differ by {left:.2g}"
    assert found >= 20, f"{found} pairs"
    assert "input_gain:heater" not in same_by_construction(PLANTS["thermal"].model), "a gain moves the working point, an entry of B does not"


def _numbers(model: dict, effect: str, channel: str, size: float) -> dict[str, float]:
    if effect == "parameter_error":
        return {"value": nominal_value(model, channel) * (1 + size)}
    name = {"input_gain": "gain", "input_offset": "offset", "constant_disturbance": "level", "quadratic_drag": "coefficient"}[effect]
    return {name: 1 + size if name == "gain" else size}


CHECKS = [drawn_cases_are_whole, machines_without_effects_differ_as_asked, what_is_the_same_by_construction_is]

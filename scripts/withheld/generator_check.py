"""A few cases drawn with a fixed seed must be whole and consistent; run by `python -m withheld.selfcheck`."""

import csv
import json
import tempfile
import tomllib
from pathlib import Path

from .files import commitment
from .generate import generate

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


def drawn_cases_are_whole():
    counts = {"single": 1, "none": 1, "unknown": 1, "pair": 0}
    with tempfile.TemporaryDirectory() as first, tempfile.TemporaryDirectory() as second:
        results = generate(Path(first), counts, seed=11, jobs=1)
        for result in results:
            assert result["id"], f"nothing adequate: {result['discarded']}"
            _check_case(Path(first), result)
        again = generate(Path(second), {"single": 0, "none": 1, "unknown": 0, "pair": 0}, seed=11, jobs=1)
        twice = generate(Path(second) / "twice", {"single": 0, "none": 1, "unknown": 0, "pair": 0}, seed=11, jobs=1)
        assert again[0]["label"] == twice[0]["label"] and again[0]["id"] == twice[0]["id"], "same seed, same case"


CHECKS = [drawn_cases_are_whole]

"""Small genuine log files, made by the formats' own writers, and what the formats' own Python readers say is in them.

(in scripts/, with the python that `scripts/venv logs` prints)

    python -m log_files          writes golden/log_files
    python -m log_files --check  reads the committed files again and compares with the committed expected.json
    python -m log_files --stamp  the same, and renews its part of golden/HASHES, as writing does

ULog has no writer in Python: its file is put together by the specification, and pyulog is the witness.
"""

from __future__ import annotations

import json
import math
import sys
from importlib.metadata import version
from pathlib import Path

from golden import hashes

from . import bags, matlab, tables, ulog

FOLDER = Path(__file__).resolve().parents[2] / "golden" / "log_files"
TOOLS = ["numpy", "pyulog", "mcap", "mcap-ros2-support", "mcap-protobuf-support", "protobuf", "rosbags", "scipy", "h5py", "mat-io", "pyarrow"]


def clean(value: object) -> object:
    """JSON has no NaN: a value that is missing is null."""
    if isinstance(value, dict):
        return {key: clean(v) for key, v in value.items()}
    if isinstance(value, list):
        return [clean(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def expected() -> dict[str, object]:
    found: dict[str, object] = {}
    for part in (ulog, bags, matlab, tables):
        found.update(part.read(FOLDER))
    return json.loads(json.dumps(clean(found)))


def main() -> None:
    path = FOLDER / "expected.json"
    if {"--check", "--stamp"} & set(sys.argv):
        if json.loads(path.read_text()) != expected():
            raise SystemExit("golden/log_files/expected.json is not what the readers say")
        print(f"log_files: {len(expected())} files agree")
        if "--stamp" in sys.argv:
            hashes.stamp("log_files")
        return
    FOLDER.mkdir(parents=True, exist_ok=True)
    for part in (ulog, bags, matlab, tables):
        part.write(FOLDER)
    path.write_text(json.dumps(expected(), indent=None, separators=(",", ":")) + "\n")
    tools = "\n".join(f"- {tool} {version(tool)}" for tool in TOOLS)
    (FOLDER / "SOURCE.md").write_text(
        "# Log files of other programs\n\n"
        "Made by `python -m log_files` in scripts/ (with the python of `scripts/venv logs`): each file by its format's own writer, `expected.json` by its format's own Python reader.\n"
        "The ULog file is put together by the specification (there is no writer in Python); pyulog is the witness.\n"
        "mat-io has no timeseries, outputs and Datasets of Simulink of its own: their properties are called as in MATLAB's files.\n\n"
        f"Tools:\n{tools}\n\nTolerance: none, the values must be equal to the bit; time stamps to 1e-9 s (nanoseconds as f64 seconds).\n"
    )
    hashes.stamp("log_files")


main()

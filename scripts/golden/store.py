"""Reading, writing and comparing the JSON files."""

import json
import math
import os
import tempfile
from pathlib import Path

import numpy as np

FOLDER = Path(__file__).resolve().parents[2] / "golden"
NOT_COMPARED = {"tool", "tolerance"}


def plain(value):
    """Numpy values as nested lists of Python numbers; complex numbers as [re, im]."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, (complex, np.complexfloating)):
        return [float(value.real), float(value.imag)]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float):
        if not math.isfinite(value):
            raise ValueError("a golden number is not finite")
        return value + 0.0  # turns -0.0 into 0.0
    return value


def dumps(document: dict) -> str:
    """One line per top-level key, and one line per item of a list of objects."""
    lines = []
    for key, value in document.items():
        if isinstance(value, list) and value and isinstance(value[0], dict):
            items = ",\n".join(json.dumps(item, allow_nan=False, separators=(",", ":")) for item in value)
            lines.append(f"{json.dumps(key)}: [\n{items}\n]")
        else:
            lines.append(f"{json.dumps(key)}: {json.dumps(value, allow_nan=False, separators=(',', ':'))}")
    return "{\n" + ",\n".join(lines) + "\n}\n"


def write(path: Path, document: dict) -> None:
    """Writes to a temporary name beside `path`, then renames."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    with os.fdopen(handle, "w", encoding="utf-8") as file:
        file.write(dumps(plain(document)))
    os.chmod(name, 0o644)
    os.replace(name, path)


def read(path: Path) -> dict | None:
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else None


def _is_number(value) -> bool:
    return isinstance(value, float) or (isinstance(value, int) and not isinstance(value, bool))


def _largest(value) -> float:
    if isinstance(value, list):
        return max((_largest(item) for item in value), default=0.0)
    return abs(value) if _is_number(value) else 0.0


def _difference(new, old) -> float:
    """Largest absolute difference of two nested lists of numbers; infinite when anything else differs."""
    if isinstance(old, list):
        if not isinstance(new, list) or len(new) != len(old):
            return math.inf
        return max((_difference(n, o) for n, o in zip(new, old)), default=0.0)
    if _is_number(old) and _is_number(new):
        return abs(new - old)
    return 0.0 if new == old else math.inf


def compare(new: dict, old: dict, tolerance: dict, where: str = "") -> list[tuple[float, str]]:
    """(excess, place) for every field, excess = difference / (tolerance x largest magnitude of the stored field).

    A field whose tolerance is null is informative and not compared; a field without one uses "default".
    """
    if new.keys() != old.keys():
        return [(math.inf, f"{where}: keys {sorted(new.keys() ^ old.keys())}")]
    found = []
    for key, value in old.items():
        limit = tolerance.get(key, tolerance["default"])
        if key in NOT_COMPARED or limit is None:
            continue
        place = f"{where}{key}"
        if isinstance(value, dict):
            found += compare(new[key], value, tolerance, f"{place}.")
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            if len(new[key]) != len(value):
                found.append((math.inf, f"{place}: {len(new[key])} items instead of {len(value)}"))
                continue
            for index, (n, o) in enumerate(zip(new[key], value)):
                found += compare(n, o, tolerance, f"{place}[{o.get('id', index)}].")
        else:
            scale = _largest(value) or 1.0
            found.append((_difference(new[key], value) / (limit * scale), place))
    return found

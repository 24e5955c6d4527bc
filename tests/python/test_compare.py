"""Results side by side, from Python as on the command line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import deadtime

FILE = "examples/diagnosis.json"


def changed(tmp_path: Path) -> Path:
    """The same diagnosis of a machine whose dead time is longer."""
    data = json.loads(Path(FILE).read_text())
    for effect in data["cause"]["effects"] + data["cause"].get("contributions", []):
        for parameter in effect["parameters"]:
            if parameter["value"] is not None and parameter["ci95"] is not None:
                width = parameter["ci95"][1] - parameter["ci95"][0]
                parameter["value"] += 20 * width
                parameter["ci95"] = [end + 20 * width for end in parameter["ci95"]]
    folder = tmp_path / "after"
    folder.mkdir()
    (folder / "diagnosis.json").write_text(json.dumps(data))
    return folder


def test_a_number_that_moved_is_said_to_differ(tmp_path: Path) -> None:
    found = deadtime.compare({"before": FILE, "after": changed(tmp_path)})
    data = found.to_dict()
    assert data["format"] == "deadtime/compare@1"
    assert data["names"] == ["before", "after"]
    assert any(row["agree"] is False for row in data["parameters"]), data["parameters"]
    same = deadtime.compare({"before": FILE, "again": FILE}).to_dict()
    assert all(row["agree"] for row in same["parameters"] if row["agree"] is not None)
    assert "before" in str(found) and "<pre>" in found._repr_html_()
    assert found.page().startswith("<!")
    found.save(tmp_path / "compare.json")
    assert json.loads((tmp_path / "compare.json").read_text()) == data


def test_what_cannot_be_compared_is_said(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="give two or more"):
        deadtime.compare({"only": FILE})
    other = tmp_path / "other.json"
    other.write_text('{"format": "deadtime/gate@1"}')
    with pytest.raises(ValueError, match="other: neither a diagnosis nor a study"):
        deadtime.compare({"one": FILE, "other": other})
    with pytest.raises(ValueError, match="neither diagnosis.json nor study.json"):
        deadtime.compare({"one": FILE, "folder": tmp_path})
    study = tmp_path / "study.json"
    study.write_text('{"format": "deadtime/study@1"}')
    with pytest.raises(ValueError, match="a study and a diagnosis"):
        deadtime.compare({"one": FILE, "two": study})
    with pytest.raises(deadtime.errors.FileError):
        deadtime.compare({"one": FILE, "gone": tmp_path / "gone.json"})
    broken = tmp_path / "broken.json"
    broken.write_text('{"format": "deadtime/diagnosis@2"}')
    with pytest.raises(ValueError, match="broken: missing field"):
        deadtime.compare({"one": FILE, "broken": broken})

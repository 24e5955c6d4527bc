"""The notebooks in examples/ run from top to bottom, are stored with their outputs, and show pictures that need no script."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))

from notebooks import run  # noqa: E402

NOTEBOOKS = ("estimate_a_dead_time", "repair_a_simulator", "which_method_to_trust")


def cells(examples: Path, name: str) -> list[dict[str, Any]]:
    """The cells of a notebook of format 4.5."""
    notebook = json.loads((examples / f"{name}.ipynb").read_text(encoding="utf-8"))
    assert (notebook["nbformat"], notebook["nbformat_minor"]) == (4, 5)
    found: list[dict[str, Any]] = notebook["cells"]
    assert len({cell["id"] for cell in found}) == len(found)
    return found


def stored(cell: dict[str, Any]) -> str:
    """The text of a cell's stored result."""
    results = [output["data"] for output in cell["outputs"] if output["output_type"] == "execute_result"]
    assert len(results) <= 1 and cell["execution_count"] is not None
    return "".join(results[0]["text/plain"]) if results else ""


def words(text: str) -> list[str]:
    """Words of three letters and more: numbers, bars and units of time differ between processors."""
    return re.findall(r"[A-Za-z_]{3,}", text)


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_a_notebook_runs_from_top_to_bottom(name: str, examples: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(examples)
    names: dict[str, Any] = {"__name__": "__main__"}
    pictures = 0
    for cell in cells(examples, name):
        if cell["cell_type"] == "code":
            shown, _ = run("".join(cell["source"]), names, f"{name}.ipynb, {cell['id']}")
            page = shown._repr_html_() if hasattr(shown, "_repr_html_") else ""
            pictures += page.count('src="data:image/png;base64,')
            assert not re.search(r"<script|https?://", page)
            assert words(stored(cell)) == words(repr(shown) if shown is not None else ""), "scripts/notebooks.py stores what is shown"
    assert pictures > 0, "a notebook shows a picture"


def test_every_notebook_is_run(examples: Path) -> None:
    assert sorted(path.stem for path in examples.glob("*.ipynb")) == sorted(NOTEBOOKS)


def test_logs_and_isolability_show_pictures_whatever_channels_are_called(examples: Path) -> None:
    import deadtime

    log = deadtime.Log([0.0, 1.0, 2.0], {"$\\frac{$": [1.0, 2.0, 3.0], "<b>": [0.0, float("nan"), 1.0]})
    page = log._repr_html_()
    assert "<img" in page and "<details>" in page and "<b>" not in page and "&lt;b&gt;" in page
    flight = deadtime.read(examples / "uav_flight.csv")
    apart = deadtime.isolability(examples / "uav_lateral_stabilised.toml", flight)
    assert "<img" in apart._repr_html_() and len(apart.plot().axes) == 2


def test_without_matplotlib_a_result_shows_its_numbers(examples: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import deadtime
    from deadtime import plotting

    answers = deadtime.estimate(examples / "uav_flight.csv", "r", "ay", method="arxstruc")
    assert "<img" in answers._repr_html_() and "<details>" in answers._repr_html_()

    def missing(width: float, height: float) -> None:
        raise ImportError("no matplotlib")

    monkeypatch.setattr(plotting, "figure", missing)
    page = answers._repr_html_()
    assert "<img" not in page and "<details>" not in page and "<td>arxstruc</td>" in page and "dead time" in page

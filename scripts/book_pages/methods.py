"""A page and a picture of every method, and their index."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from . import ideas, sources, svg, tables

RESULTS = Path("docs/results/methods.md")
BENCHMARK = Path("docs/results/studies/bjorklund.md")
#: What the contract tests ask of every method that does not say otherwise.
LAWS = {
    "shift": "to move with the output (an output that is later by some samples gives an answer that is later by as many)",
    "gain": "to ignore gains of input and output",
    "sign": "to ignore signs of input and output",
    "exact": "whole samples exactly where there is no noise",
    "silence": "silence where there is noise alone",
    "window": "to know its window (a delay beyond it is not found elsewhere)",
}
KINDS = (("made for", "error", "held", "none"), ("lag", "lag: error", "held 6", "none 7"), ("loop", "loop: error", "held 9", "none 10"))


def number(cell: str | None) -> float | None:
    """A cell of a table as a number, where it is one."""
    try:
        return float(cell or "")
    except ValueError:
        return None


def pages(root: Path, listed: list[dict[str, Any]]) -> dict[str, str]:
    """Path below docs/ to text."""
    about = sources.methods(root)
    scores = {row["method"]: row for row in tables.rows(root / RESULTS, "method", "made for", "error")}
    benchmark = tables.rows(root / BENCHMARK, "grid", "from", "method")
    written: dict[str, str] = {}
    for method in listed:
        name = method["name"]
        text = about.get(name)
        lacking = [s for s in ("Assumes", "Fails when", "Source") if text is None or s not in text.sections] + ([] if text and text.equation else ["Equation"])
        if text is None or lacking:
            raise SystemExit(f"{name}: its doc comment lacks {', '.join(lacking)}; docs/adding.md shows how they are written")
        written[f"methods/{name}.md"] = page(method, text, scores.get(name), [row for row in benchmark if row["method"] == name])
        if name in scores:
            written[f"images/methods/{name}.svg"] = picture(name, scores)
    written["methods/index.md"] = index(listed)
    return written


def page(method: dict[str, Any], text: sources.About, score: dict[str, str] | None, benchmark: list[dict[str, str]]) -> str:
    """The page of one method."""
    name = method["name"]
    options = ", ".join(f"`{key}` = `{json.dumps(value)}`" for key, value in method["options"].items())
    lines = [f"# {name}", "", f"{method['summary'][0].upper()}{method['summary'][1:]}.", "", f"Class: {method['class']}. {sources.words(text.what)}", ""]
    channels = {"event times": "--events FIRST,SECOND", "measured states": "--input U --output Y --model MODEL"}.get(method["class"], "--input U --output Y")
    lines += [f"    deadtime estimate LOG {channels} --method {name}", ""]
    lines += ideas.section(method["class"])
    lines += ["## Equation", "", sources.equation(text.equation), ""]
    lines += ["## When it may be used", "", f"- It needs: {sources.words(method['needs'])}.", f"- It assumes: {sources.words(text.sections['Assumes'])}"]
    lines += [f"- Its 95 % interval still holds under: {', '.join(method['withstands']) or 'none of the listed complications'}."]
    lines += [f"- {name}: {sources.words(text.sections[name])}" for name in ("Inputs", "Resolution and cost", "Interval") if name in text.sections]
    lines += ["", "## How it fails", "", f"- It cannot see: {sources.words(method['cannot_see'])}.", f"- It fails when {sources.words(text.sections['Fails when'])}"]
    lines += [f"- It does not promise {LAWS[broken['law']]}: {sources.words(broken['why'])}." for broken in method["does_not_promise"]]
    lines += ["", "## How accurate it is", ""]
    if score:
        lines += [f"![{name} among all methods on three kinds of records](../images/methods/{name}.svg)", ""]
        lines += ["| records | RMS error (samples) | interval holds the truth | without answer, of 100 |", "| --- | ---: | ---: | ---: |"]
        for kind, error, held, none in KINDS:
            title = {"made for": f"what it is made for: {score['made for']}", "lag": "a plant with a lag", "loop": "the same in a loop"}[kind]
            if score.get(none):
                lines.append(f"| {title} | {score[error]} | {score[held]} | {score[none]} |")
        lines += ["", "From the [common study](../results/methods.md#errors-and-times), which tells how the records are drawn."]
    if benchmark:
        lines += ["", "On the [standard benchmark](../bjorklund.md), beside the error that a perfect method could reach (the Cramér-Rao bound):", ""]
        lines += ["| records | estimates | RMS error (samples) | bound (samples) | interval holds the truth |", "| --- | ---: | ---: | ---: | ---: |"]
        lines += [
            f"| {row['grid']}, from {row['from']} | {row['estimates']} | {row['RMS error (samples)']} | {row['bound (samples)']} | {row['truth in 95 % interval']} |"
            for row in benchmark
        ]
    lines += ["", "## Options", "", options or "None."]
    lines += ["", "## Source", "", sources.words(text.sections["Source"]), "", f"The code stands in `{text.file}`.", ""]
    return "\n".join(lines)


def picture(name: str, scores: dict[str, dict[str, str]]) -> str:
    """Its errors among those of all others."""
    groups = []
    for kind, error, _, _ in KINDS:
        others = [v for other, row in scores.items() if other != name and (v := number(row.get(error))) is not None]
        groups.append(({"made for": "made for", "lag": "plant with a lag", "loop": "plant in a loop"}[kind], number(scores[name].get(error)), others))
    return svg.standing(f"errors of {name} beside those of the other methods", groups)


def index(listed: list[dict[str, Any]]) -> str:
    """All methods, class by class."""
    lines = ["# The methods", "", "One page each: what it computes, when it may be used, how it fails, how accurate it was, where it comes from."]
    lines += ["[Which method when](../which-method.md) tells where to begin, [the common study](../results/methods.md) compares them all.", ""]
    for kind in dict.fromkeys(m["class"] for m in listed):
        lines += [f"## {kind[0].upper()}{kind[1:]}", "", "| method | what it does |", "| --- | --- |"]
        lines += [f"| [{m['name']}]({m['name']}.md) | {sources.words(m['summary'])} |" for m in listed if m["class"] == kind]
        lines.append("")
    return "\n".join(lines)

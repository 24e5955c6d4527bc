"""The table of contents, docs/SUMMARY.md: the pages in reading order, with those of every method and effect."""

from __future__ import annotations

from pathlib import Path
from typing import Any

BEFORE = """# Summary

[The problem in five minutes](five-minutes.md)

# Begin

- [Install](install.md)
- [Which method when](which-method.md)
- [Tutorial: from a log to a repaired simulator](tutorial.md)

# Dead time

- [Estimating a dead time](estimating.md)
- [Making an experiment](experiments.md)
- [Delays that change](tracking.md)
- [Machines in a loop](loops.md)
- [Studies](studies.md)
    - [The thesis' studies](thesis.md)
    - [The standard benchmark](bjorklund.md)
- [A gate for CI](gate.md)
"""
GAP = """
# The gap

- [Checks before a diagnosis](checks.md)
- [How a diagnosis is made](gap.md)
    - [The stages of a diagnosis](gap-stages.md)
- [Any function as a simulator](black-box.md)
- [Results side by side](comparing.md)
- [Blind cases](blind.md)
"""
AFTER = """
# Models and files

- [Model files](models.md)
- [From a log to a model](identifying.md)
    - [Many parameters at once](structured.md)
    - [A real quadrotor](nanodrone.md)
- [Logs](logs.md)
- [File formats](formats.md)

# Python

- [In Python](python.md)
- [Notebooks and scripts](examples.md)
- [Studies on many machines](dask.md)

# Reference

- [The command line](reference/cli.md)
- [The Python package](reference/python.md)
- [The Rust library](library.md)
- [Reliability and limits](reliability.md)
- [How to add a method or an effect](adding.md)
- [Release checklist](releasing.md)
- [Changes](changes.md)

# Measured results

- [The most important numbers](results/index.md)
    - [What was checked with what](results/validation.md)
    - [Withheld effects](results/withheld.md)
    - [Diagnoses of the bank](results/bank.md)
    - [Several causes at once](results/mixtures.md)
    - [Delays that move](results/moving.md)
    - [Weak effects](results/weak.md)
    - [Real machines](results/machines.md)
    - [Real logs](results/real-logs.md)
    - [All methods compared](results/methods.md)
    - [Thresholds of a diagnosis](results/criteria.md)
    - [How far from the Cramér-Rao bound](results/bounds.md)
    - [Speed: aims, and what was tried](speed.md)
    - [Speed beside other tools](results/peers.md)
    - [What a user waits for](results/waiting.md)
    - [Reading logs beside other tools](results/readers.md)
"""


def page(docs: Path, methods: list[dict[str, Any]], effects: list[dict[str, Any]], studies: list[str]) -> str:
    """The whole table of contents; a page in docs/ that has no place in it stands at its end."""
    lines = [BEFORE.rstrip("\n"), "- [The methods](methods/index.md)"]
    lines += [f"    - [{m['name']}](methods/{m['name']}.md)" for m in methods]
    lines += [GAP.rstrip("\n"), "- [The effects](effects/index.md)", "    - [Conventions and order](effects.md)"]
    lines += [f"    - [{e['effect']}](effects/{e['effect']}.md)" for e in effects]
    lines += [AFTER.rstrip("\n"), "    - [Tables of the studies](results/studies/index.md)"]
    lines += [f"        - [{name}](results/studies/{name}.md)" for name in studies]
    there = "\n".join(lines)
    more = [path for path in sorted(docs.glob("*.md")) if f"({path.name})" not in there and path.name != "SUMMARY.md"]
    if more:
        lines += ["", "# More", "", *(f"- [{path.read_text(encoding='utf-8').splitlines()[0].removeprefix('# ')}]({path.name})" for path in more)]
    return "\n".join(lines) + "\n"


def studies_index(studies: list[str]) -> str:
    """The list of the studies' tables."""
    lines = ["# Tables of the studies", "", "As the program printed them: [Studies](../../studies.md) tells how they are run and read.", ""]
    return "\n".join([*lines, *(f"- [{name}]({name}.md)" for name in studies), ""])

"""The table of contents, docs/SUMMARY.md: the pages in reading order, with those of every method and effect."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

BEFORE = """# Summary

[The problem in five minutes](five-minutes.md)

# Using

- [Install](install.md)
- [Tutorial: from a log to a repaired simulator](tutorial.md)
- [Reading a diagnosis](reading-a-diagnosis.md)
- [Estimating a dead time](estimating.md)
    - [Which method when](which-method.md)
    - [Making an experiment](experiments.md)
- [From a log to a model](identifying.md)
    - [Many parameters at once](structured.md)
- [Model files](models.md)
- [Logs](logs.md)
- [Checks before a diagnosis](checks.md)
- [Any function as a simulator](black-box.md)
- [Results side by side](comparing.md)
- [Exporting a diagnosis](exporting.md)
- [A gate for CI](gate.md)
- [In Python](python.md)
- [For MATLAB users](for-matlab-users.md)
- [For PX4 and ROS users](for-px4-ros-users.md)
- [For MuJoCo and Isaac users](for-mujoco-isaac-users.md)
- [What it is not for](what-it-is-not-for.md)

# How it works

- [The diagnosis](gap.md)
    - [Its stages](gap-stages.md)
    - [Conventions of effects, and their order](effects.md)
    - [Blind cases](blind.md)
    - [A real quadrotor](nanodrone.md)
- [Dead times: awkward records](awkward-records.md)
    - [Delays that change](tracking.md)
    - [Machines in a loop](loops.md)
    - [Without a log: frequency responses and step tables](responses.md)
- [Studies](studies.md)
    - [The thesis' studies](thesis.md)
    - [The standard benchmark](bjorklund.md)
    - [Studies on many machines](dask.md)
- [Reliability and limits](reliability.md)
- [File formats](formats.md)
- [Notebooks and scripts](examples.md)
- [The Rust library](library.md)
- [How to add a method or an effect](adding.md)
- [Release checklist](releasing.md)
- [Changes](changes.md)

# Reference

- [The command line](reference/cli.md)
- [The Python package](reference/python.md)
"""
AFTER = """
# Measured results

- [The most important numbers](results/index.md)
    - [What was checked with what](results/validation.md)
    - [Diagnoses of the bank](results/bank.md)
    - [Ablation of the constants](results/ablation.md)
    - [Machines with friction, limits and loops](results/machine-kinds.md)
    - [Real machines](results/machines.md)
    - [Effects injected into logs of real machines](results/injections.md)
    - [Real logs](results/real-logs.md)
    - [All methods compared](results/methods.md)
    - [How far from the Cramér-Rao bound](results/bounds.md)
    - [Speed: aims, and what was tried](speed.md)
    - [Speed and other tools](results/peers.md)
    - [What a user waits for](results/waiting.md)
    - [Reading logs, and other tools](results/readers.md)
"""

#: The most words of the shelf "Using".
WORDS = 25_000


def page(docs: Path, methods: list[dict[str, Any]], effects: list[dict[str, Any]], studies: list[str]) -> str:
    """The whole table of contents; a page in docs/ that has no place in it stands at its end."""
    lines = [BEFORE.rstrip("\n"), "- [The methods](methods/index.md)"]
    lines += [f"    - [{m['name']}](methods/{m['name']}.md)" for m in methods]
    lines += ["- [The effects](effects/index.md)"]
    lines += [f"    - [{e['effect']}](effects/{e['effect']}.md)" for e in effects]
    lines += [AFTER.rstrip("\n"), "    - [Tables of the studies](results/studies/index.md)"]
    lines += [f"        - [{name}](results/studies/{name}.md)" for name in studies]
    there = "\n".join(lines)
    more = [path for path in sorted(docs.glob("*.md")) if f"({path.name})" not in there and path.name != "SUMMARY.md"]
    if more:
        lines += ["", "# More", "", *(f"- [{path.read_text(encoding='utf-8').splitlines()[0].removeprefix('# ')}]({path.name})" for path in more)]
    return "\n".join(lines) + "\n"


def words_of_using(docs: Path) -> int:
    """The words of the pages on the shelf "Using"."""
    shelf = BEFORE[BEFORE.index("# Using") : BEFORE.index("# How it works")]
    return sum(len((docs / name).read_text(encoding="utf-8").split()) for name in re.findall(r"\((\S+\.md)\)", shelf))


def studies_index(studies: list[str]) -> str:
    """The list of the studies' tables."""
    lines = ["# Tables of the studies", "", "As the program printed them: [Studies](../../studies.md) tells how they are run and read.", ""]
    return "\n".join([*lines, *(f"- [{name}]({name}.md)" for name in studies), ""])

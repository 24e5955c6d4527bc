"""Numbers of the README, read from the generated tables, so that they cannot drift from them."""

from __future__ import annotations

import re
from pathlib import Path

from . import tables
from .results import bank, percent

BEGIN, END = "<!-- Five numbers, written by scripts/book. -->\n", "<!-- End of the five numbers. -->\n"


def lines(root: Path) -> str:
    """A list of sentences."""
    results = root / "docs" / "results"
    benchmark = {(r["grid"], r["from"], r["method"]): r for r in tables.rows(results / "studies" / "bjorklund.md", "grid", "from", "method")}
    best = benchmark["open", "u", "oestruc"]
    locked, development = bank(results)
    golden = tables.rows(results / "validation.md", "data", "quantity", "compared")
    machines = tables.rows(results / "machines.md", "machine", "missing", "known value")
    named = sum(r["agreement"].startswith("yes") for r in machines)
    compared = sum(int(r["compared"]) for r in golden)
    with_rest = sum(r["agreement"].startswith("yes, with a rest") for r in machines)
    unknown = sum(r["agreement"] == "no: unknown" for r in machines)
    partly = sum(r["agreement"].startswith("partly") for r in machines)
    return "\n".join(
        [
            f"- **{best['RMS error (samples)']} samples**: error of `oestruc` over {best['estimates']} records of the field's standard benchmark; the least that an unbiased method "
            f"can reach is {best['bound (samples)']}. Its interval holds the truth in {best['truth in 95 % interval']} of them ([table](docs/results/studies/bjorklund.md)).",
            f"- **{percent(locked['named']['all'])}** of the diagnoses of {locked['cases']['all']} locked cases name the strongest cause, up to aliases in the logs; "
            f"{percent(locked['precision']['all'])} of what is named acts. Nothing was chosen by these cases. Of the {development['cases']['all']} development cases it is "
            f"{percent(development['named']['all'])} and {percent(development['precision']['all'])} ([table](docs/results/bank.md)).",
            f"- **{percent(locked['false_alarm']['all'])}** of the simulators that lack nothing are accused of something; {percent(locked['false_complete']['all'])} of the answers "
            f"that are called complete name a false cause, too ([table](docs/results/bank.md)).",
            f"- **{named} of {len(machines)}** logs of real machines give the cause that physics names, {with_rest} of them with an unexplained part that is `unknown`; "
            f"{partly} has it among others, {unknown} without any cause, {len(machines) - named - unknown - partly} with another ([table](docs/results/machines.md)).",
            f"- **{compared}** comparisons with other programs, or with slow calculations that share no line with this one, agree within their tolerances "
            f"([table](docs/results/validation.md)).",
            "",
        ]
    )


def readme(root: Path) -> str:
    """The README with its numbers as they are now."""
    text = (root / "README.md").read_text(encoding="utf-8")
    found = re.search(re.escape(BEGIN) + ".*?" + re.escape(END), text, re.DOTALL)
    if not found:
        raise SystemExit(f"README.md has no lines between {BEGIN.strip()} and {END.strip()}")
    return text[: found.start()] + BEGIN + lines(root) + END + text[found.end() :]

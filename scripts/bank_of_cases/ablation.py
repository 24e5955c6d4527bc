"""What each chosen constant of the diagnosis changes on development cases: the program is built again with another value, in a copy of the repository.

The table goes to docs/results/ablation.md. A variant is answered once; an interrupted run goes on where it was.
"""

import json
import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from . import answers, sets, tables
from .judge import SCORES

SEARCH, FOUND, CRITERIA = (f"crates/gap/src/{name}.rs" for name in ("causes/search", "causes/found", "input/criteria"))
SHOWN = ("named", "precision", "false_complete", "false_alarm", "coverage", "time_median")
HEAD = """# Ablation of the constants

`scripts/bank ablate OUT --cases N` writes this page. It builds the program with another value of one constant and answers the first N development cases of each group
([the bank](bank.md) defines groups and scores). *changed* counts the answers with another verdict or other causes. All other columns are scores with this value. Of few cases, no change
is no proof that a constant never matters.

"""


@dataclass(frozen=True)
class Constant:
    """A constant in a source file, and the values that are tried in its place."""

    name: str
    file: str
    line: str  # with {} for the value
    value: str
    tried: tuple[str, ...]


def criterion(name: str, field: str, value: str, *tried: str) -> Constant:
    return Constant(name, CRITERIA, f"            {field}: {{}},", value, tried)


CONSTANTS = (
    Constant("fits of an expansion", SEARCH, "const FITTED: usize = {};", "6", ("3", "12")),
    Constant("expansions without a new best set", SEARCH, "const PATIENCE: usize = {};", "3", ("1", "6")),
    Constant("different sets of each size", SEARCH, "const DIFFERENT: usize = {};", "3", ("1",)),
    Constant("sets are one within", SEARCH, "const SAME: f64 = {};", "0.02", ("0.08",)),
    Constant("first size of the recalibration", SEARCH, "const SIZE: f64 = {};", "0.05", ("0.2",)),
    Constant("named share", FOUND, "pub(crate) const NAMED: f64 = {};", "0.01", ("0.03",)),
    Constant("as good as the best", FOUND, "const AS_GOOD: f64 = {};", "6.0", ("2.0",)),
    Constant("steps of a fit", "crates/gap/src/causes/fit.rs", "const STEPS: usize = {};", "6", ("3",)),
    Constant("window of the correlation, samples", "crates/gap/src/causes/score.rs", "const WINDOW: usize = {};", "60", ("20",)),
    Constant("refit under coloured noise", "crates/gap/src/causes/conclusion.rs", "const SETTLED: f64 = {};", "1.2", ("2.0",)),
    criterion("inexactness", "inexact_gap", "0.05", "0.02"),
    criterion("class by energy", "inexact", "2e-4", "1e-3"),
    criterion("verdict: residual over the floor", "above_floor", "1.5", "2.0"),
    criterion("complete: residual over the floor", "complete", "1.25", "1.5"),
    criterion("verdict: explained share, one effect", "one_explains", "0.93", "0.86"),
    criterion("verdict: explained share, several", "two_explain", "0.97", "0.93"),
    criterion("further cause, floors", "further", "5.0", "3.0"),
    criterion("clear reduction", "clear", "2.0", "1.4"),
    criterion("usual error of parameters", "usual_error", "0.03", "0.01"),
    criterion("effect matters", "first_matters", "1.3", "1.1"),
    criterion("longest autoregression", "longest_autoregression", "16", "4"),
)


def missing() -> list[str]:
    """Constants whose line is not in the source as it is."""
    return [c.name for c in CONSTANTS if (sets.ROOT / c.file).read_text().count(c.line.format(c.value)) != 1]


def _copy(folder: Path) -> Path:
    """The repository's committed files in a folder of their own."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    archive = subprocess.run(["git", "archive", "HEAD"], cwd=sets.ROOT, capture_output=True, check=True).stdout
    subprocess.run(["tar", "-x", "-C", folder], input=archive, check=True)
    return folder


def _built(copy: Path, place: Path) -> Path:
    """The program of the copy as it is now."""
    target = copy.parent / "target"
    subprocess.run(["cargo", "build", "--locked", "--quiet", "-p", "deadtime", "--bin", "deadtime"], cwd=copy, env=os.environ | {"CARGO_TARGET_DIR": str(target)}, check=True)
    place.mkdir(parents=True, exist_ok=True)
    return Path(shutil.copy2(target / "debug" / "deadtime", place / "deadtime"))


def _answered(place: Path, drawn: Path, cases: int, build) -> dict[str, dict]:
    """A variant's answers; its program is built where some are missing."""
    wanted = [n for n in sets.names(None, cases) if (drawn / n).is_dir()]
    known = answers.read(place) if (place / "answers.jsonl").exists() else {}
    if any(n not in known for n in wanted):
        program = place / "deadtime" if known else build()
        answers.run("development", drawn, program, place, None, cases, answers.LIMIT_S, place.name)
        known = answers.read(place)
    return {n: known[n] for n in wanted}


def _causes(answer: dict) -> str:
    names = sorted(f"{c['effect']}:{c['channel']}" for c in answer.get("contributions", ()))
    return json.dumps([answer.get("verdict"), answer.get("explained"), names, bool(answer.get("recalibration"))])


def ablate(out: Path, drawn: Path, cases: int, only: list[str]) -> int:
    """Answers of every variant, and the page."""
    if absent := missing():
        sys.exit(f"not in the source with the value that scripts/bank_of_cases/ablation.py knows: {', '.join(absent)}")
    copy = _copy(out / "source")
    base = _answered(out / "base", drawn, cases, lambda: _built(copy, out / "base"))
    rows = [["as it is", "", "", *tables.values(base, drawn, SHOWN)]]
    for constant in CONSTANTS:
        if only and constant.name not in only:
            continue
        for value in constant.tried:
            place, file = out / f"{re.sub('[^a-z]+', '_', constant.name.lower())}-{value}", copy / constant.file

            def build(file=file, place=place, constant=constant, value=value) -> Path:
                before = file.read_text()
                file.write_text(before.replace(constant.line.format(constant.value), constant.line.format(value)))
                try:
                    return _built(copy, place)
                finally:
                    file.write_text(before)

            found = _answered(place, drawn, cases, build)
            changed = sum(_causes(found[n]) != _causes(base[n]) for n in found)
            rows.append([constant.name, f"{constant.value} → {value}", f"{changed} of {len(found)}", *tables.values(found, drawn, SHOWN)])
            print(" | ".join(rows[-1]), file=sys.stderr, flush=True)
    table = tables.markdown(["constant", "value", "changed", *SHOWN], rows)
    print(table)
    if not only:
        page = sets.ROOT / "docs" / "results" / "ablation.md"
        temporary = page.with_suffix(".tmp")
        temporary.write_text(f"{HEAD}N = {cases}.\n\n{table}\n")
        temporary.replace(page)
    return 0


assert set(SHOWN) <= set(SCORES)

"""docs/results/bank.md from the stored answers of both sets."""

import sys
from pathlib import Path

from . import answers, law, sets, tables

STORED, PAGE = sets.ROOT / "golden" / "bank", sets.ROOT / "docs" / "results" / "bank.md"


def _stored(name: str) -> Path:
    """The answers of a set that golden/bank/SOURCE.md calls the newest: the file that comes first there."""
    text = (STORED / "SOURCE.md").read_text()
    found = sorted((text.index(path.name), path) for path in STORED.glob(f"{name}-*.jsonl.gz") if path.name in text)
    return found[0][1] if found else sys.exit(f"golden/bank/SOURCE.md names no answers of the set {name}")


def write(folder: Path) -> None:
    locked, development = _stored("locked"), _stored("development")

    def part(place: Path, name: str) -> tuple[int, str, str]:
        found = answers.read(place)
        return len(found), place.name.split("-")[1].split(".")[0], tables.scores(found, folder / name)

    (shut, commit, last), (free, own, first) = part(locked, "locked"), part(development, "development")
    PAGE.write_text(f"""# Diagnoses of the bank

`scripts/bank page` writes this page from the answers in `golden/bank`; the cases must be drawn (`scripts/bank draw SET`). `scripts/bank --help` defines groups and scores.
The cases come from a generator that shares no code with the program (`scripts/withheld`), with fixed seeds. Times are processor seconds of one core.

Which data were used for what: score and search of the diagnosis have no number that was fitted to these cases. The law of class probabilities is fitted to the development
cases. The locked cases chose nothing; `scripts/bank_log.md` lists their runs.

## Locked cases

{shut} of the 200 locked cases, answered by commit {commit}.

{last}

## Development cases

{free} of the 200 development cases, answered by commit {own}.

{first}

## Probabilities of classes

On the development cases, the law of each case fitted without it:

{law.report(development, folder / "development")}
""")
    print(f"wrote {PAGE.relative_to(sets.ROOT)}")

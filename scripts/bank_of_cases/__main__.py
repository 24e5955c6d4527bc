"""Decides on fixed drawn cases whether a change of the diagnosis is better.

  scripts/bank draw SET      draws the cases that are not there yet (SET: development, locked) and checks all by golden/bank/SET.sha256
  scripts/bank run SET --program P --out FOLDER     answers of a program; what it has answered is kept
  scripts/bank score FOLDER  the scores by group
  scripts/bank law FOLDER    the law of class probabilities, fitted to answers of the development set, and its reliability
  scripts/bank page          docs/results/bank.md from the newest stored answers of both sets
  scripts/bank ablate OUT --cases N     docs/results/ablation.md: what each chosen constant changes on the development set
  scripts/bank compare OLD NEW   paired differences; FOLDER or a file of answers, such as golden/bank/development-75a22eac.jsonl.gz

Changes are tried on the development set. The locked set is for the last word on a change: `run locked` demands --final COMMIT, appends to scripts/bank_log.md,
and is refused after three commits.
"""

import argparse
import datetime
import os
import sys
from pathlib import Path

from . import ablation, answers, check, law, page, sets, tables
from .judge import SCORES

LOG = sets.ROOT / "scripts" / "bank_log.md"
MOST_LOCKED = 3
HEAD = "# Runs of the locked set\n\n`scripts/bank run locked` writes this file.\n\n| commit | date | scores of all cases |\n| --- | --- | --- |\n"


def _entries() -> dict[str, str]:
    """The log's lines by commit."""
    rows = [line for line in LOG.read_text().splitlines() if line.startswith("| ")][2:] if LOG.exists() else []
    return {row.split("|")[1].strip(): row for row in rows}


def _log(commit: str, text: str) -> None:
    date = datetime.datetime.now(tz=datetime.UTC).date().isoformat()
    LOG.write_text(HEAD + "\n".join((_entries() | {commit: f"| {commit} | {date} | {text} |"}).values()) + "\n")


def _arguments() -> argparse.Namespace:
    definitions = "scores, each by group and of all cases:\n" + "\n".join(f"  {name:17}{text}" for name, (_, _, text) in SCORES.items())
    groups = "groups:\n" + "\n".join(f"  {name:19}{g.count:3} cases" for name, g in sets.GROUPS.items())
    parser = argparse.ArgumentParser(prog="scripts/bank", description=__doc__, epilog=f"{groups}\n\n{definitions}", formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)

    def command(name: str, text: str) -> argparse.ArgumentParser:
        made = commands.add_parser(name, help=text, description=text)
        made.add_argument("--folder", type=Path, default=sets.CACHE, help=f"where sets are drawn, default {sets.CACHE.relative_to(sets.ROOT)}")
        return made

    def which(made: argparse.ArgumentParser) -> None:
        made.add_argument("set", choices=sets.SEEDS)
        made.add_argument("--group", action="append", choices=sets.GROUPS, help="this group only; may be repeated")
        made.add_argument("--cases", type=int, help="so many of each group at most, the first ones")

    draw = command("draw", "draws and checks cases")
    which(draw)
    draw.add_argument("--jobs", type=int, default=1)
    draw.add_argument("--stamp", action="store_true", help="stores the hashes of cases that have none")
    run = command("run", "asks a program")
    which(run)
    run.add_argument("--program", type=Path, required=True)
    run.add_argument("--out", type=Path, required=True)
    run.add_argument("--name", default="", help="what to call the program in its answers, such as its commit")
    run.add_argument("--limit", type=float, default=answers.LIMIT_S, help="processor seconds of one case, default 600")
    run.add_argument("--final", metavar="COMMIT", help="of the locked set: the commit of the program")
    run.add_argument("--force", action="store_true", help=f"of the locked set: even after {MOST_LOCKED} commits")
    score = command("score", "scores of a program's answers")
    score.add_argument("answers", type=Path)
    fitted = command("law", "the law of class probabilities")
    fitted.add_argument("answers", type=Path)
    command("page", "writes docs/results/bank.md from golden/bank")
    compare = command("compare", "paired differences of two programs' answers")
    compare.add_argument("old", type=Path)
    compare.add_argument("new", type=Path)
    ablated = command("ablate", "what each chosen constant changes")
    ablated.add_argument("out", type=Path)
    ablated.add_argument("--cases", type=int, default=4, help="so many of each group, default 4")
    ablated.add_argument("--only", action="append", default=[], metavar="NAME", help="this constant only, and no page; may be repeated")
    commands.add_parser("check", help="checks of the scores themselves, and of the constants' lines")
    for made in (score, compare):
        made.add_argument("--by", choices=("group", "trait"), default="group", help="trait: linear, equations, sampled, predictor, closed loop")
        made.add_argument("--cases", type=int, help="so many of each group at most, the first ones")
    return parser.parse_args()


def _read(place: Path, cases: int | None) -> dict[str, dict]:
    found, wanted = answers.read(place), set(sets.names(None, cases))
    return {name: answer for name, answer in found.items() if name in wanted}


def _drawn(folder: Path, found: dict[str, dict]) -> Path:
    """Where the cases of these answers are drawn."""
    names = {answer["set"] for answer in found.values()}
    if len(names) != 1:
        sys.exit("no answers" if not names else "answers of different sets")
    return folder / names.pop()


def _locked(options: argparse.Namespace) -> int:
    """A run of the locked set, written down before it begins and again with its scores."""
    if not options.final:
        sys.exit("the locked set is for the last word on a change: --final COMMIT")
    if options.final not in (known := _entries()) and len(known) >= MOST_LOCKED and not options.force:
        sys.exit(f"the locked set was run {len(known)} times ({', '.join(known)}): what is chosen by it is no longer tested by it (--force)")
    _log(options.final, "begun")
    code = answers.run("locked", options.folder / "locked", options.program.resolve(), options.out, options.group, options.cases, options.limit, options.final)
    found = answers.read(options.out)
    _log(options.final, f"{len(found)} cases: {tables.summary(found, options.folder / 'locked')}")
    return code


def main() -> int:
    options = _arguments()
    if options.command == "check":
        return check.main()
    if options.command == "draw":
        return sets.draw(options.set, options.folder / options.set, options.group, options.cases, options.jobs, options.stamp)
    if options.command == "run":
        if not os.access(options.program, os.X_OK):
            sys.exit(f"{options.program} is no program")
        if options.set == "locked":
            return _locked(options)
        return answers.run(options.set, options.folder / options.set, options.program.resolve(), options.out, options.group, options.cases, options.limit, options.name)
    if options.command == "ablate":
        return ablation.ablate(options.out.resolve(), options.folder / "development", options.cases, options.only)
    if options.command == "law":
        print(law.report(options.answers, options.folder / "development"))
    elif options.command == "page":
        page.write(options.folder)
    elif options.command == "score":
        found = _read(options.answers, options.cases)
        print(tables.scores(found, _drawn(options.folder, found), options.by))
    else:
        old, new = (_read(place, options.cases) for place in (options.old, options.new))
        print(tables.compare(old, new, _drawn(options.folder, old | new), options.by))
    return 0


if __name__ == "__main__":
    sys.exit(main())

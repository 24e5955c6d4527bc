"""docs/results/index.md: the most important numbers, read from the committed tables, so that they cannot drift from them."""

from __future__ import annotations

from pathlib import Path

from . import tables

HEAD = """# Measured results

`scripts/book` writes this page. Each number stands in the table behind its link; the command in the last column prints that table anew.
Intervals are 95 % intervals. [Reliability and limits](../reliability.md) holds what was tested for faults, memory and damaged files.
"""
TITLES = ("| question | measured | table | command |", "| --- | --- | --- | --- |")


def page(root: Path) -> str:
    """The summary."""
    results = root / "docs" / "results"
    sections = {"Dead time": dead_time(results), "The gap": gap(results), "Arithmetic and speed": speed(results)}
    lines = [HEAD]
    for title, rows in sections.items():
        lines += [f"## {title}", "", *TITLES, *rows, ""]
    return "\n".join(lines)


def row(question: str, measured: str, table: str, command: str) -> str:
    """A line of a section; the table by its path below docs/results."""
    return f"| {question} | {measured} | [{Path(table).stem}]({table}) | `{command}` |"


def dead_time(results: Path) -> list[str]:
    """Errors, intervals and refusals of estimators."""
    studies = results / "studies"
    methods = {name: {(r["grid"], r["from"], r["method"]): r for r in tables.rows(studies / f"{name}.md", "grid", "from", "method")} for name in ("bjorklund", "twin", "unrelated")}
    standard, anywhere, nothing = methods["bjorklund"]["open", "u", "oestruc"], methods["twin"]["twin", "u", "oe_posterior"], methods["unrelated"]["unrelated", "u", "oestruc"]
    bound = {r["method"]: r for r in tables.rows(results / "bounds.md", "method", "least RMS/bound")}["`p2d`"]
    responses = {r["plant"]: r for r in tables.rows(studies / "responses.md", "plant", "errors")}["all"]
    opened = {r["excitation"]: r for r in tables.rows(studies / "loop.md", "excitation", "linear: a loop")}["all"]
    closed = {r["reference"]: r for r in tables.rows(studies / "loop.md", "reference", "less than 1 %")}["all"]
    still = {r["excitation"]: r for r in tables.rows(studies / "track.md", "excitation", "record", "run")}["all"]
    return [
        row("error of `oestruc` on the field's standard benchmark, open loop", f"{standard['RMS error (samples)']} samples RMS over {standard['estimates']} records; bound "
            f"{standard['bound (samples)']}; interval holds the truth in {standard['truth in 95 % interval']}", "studies/bjorklund.md", "lab/plans bjorklund"),
        row("error of `oe_posterior`, delay anywhere in the window", f"{anywhere['RMS error (samples)']} samples RMS over {anywhere['estimates']} records; wrong without a flag in "
            f"{anywhere['wrong unflagged']}", "studies/twin.md", "lab/plans twin"),
        row("least error of `p2d` over the Cramér-Rao bound", f"{bound['least RMS/bound']} at a signal-to-noise ratio of {bound['at SNR']}", "bounds.md", "lab/bounds"),
        row("`oestruc` on an output that does not follow its input", f"no answer in {nothing['no answer']} of {nothing['estimates']} records", "studies/unrelated.md", "lab/plans unrelated"),
        row("intervals from frequency responses", f"hold the dead time in {responses['holds']}", "studies/responses.md", "lab/study responses 40 5"),
        row("feedback that does not exist, linear plants", f"reported in {opened['linear: a loop']} records", "studies/loop.md", "lab/study loop 100 6000000"),
        row("feedback that makes more than half of the input's variance", f"reported in {closed['more than 50 %']} records", "studies/loop.md", "lab/study loop 100 6000000"),
        row("alarms of the tracker while the delay is constant", f"in {still['run']} runs", "studies/track.md", "lab/study track 3 3000000"),
    ]


def gap(results: Path) -> list[str]:
    """How often a diagnosis is right."""
    locked, development = bank(results)
    kinds = {r["kind"]: r for r in tables.rows(results / "machine-kinds.md", "kind", "cases")}["all kinds"]
    machines = tables.rows(results / "machines.md", "machine", "missing", "known value")
    named = sum(r["agreement"].startswith("yes") for r in machines)
    print_all = "scripts/bank page"

    def share(score: str, group: str = "all") -> str:
        return f"{percent(locked[score][group])} of the locked cases, {percent(development[score][group])} of the development cases"

    return [
        row("the strongest cause is named, up to aliases", share("named"), "bank.md", print_all),
        row("causes that are named, by their share of the gap", share("recall"), "bank.md", print_all),
        row("named causes that act, by their share of the gap", share("precision"), "bank.md", print_all),
        row("complete answers that name something false, too", share("false_complete"), "bank.md", print_all),
        row("machines without a cause that are accused, also with parameters 1 % off and under gusts", share("false_alarm"), "bank.md", print_all),
        row("written models that are worse than the nominal one on held-out data", share("worse"), "bank.md", print_all),
        row("intervals of parameters that hold the truth", share("coverage"), "bank.md", print_all),
        row("machines with friction, play, limits, loops and events: the leading cause acts", kinds["named"], "machine-kinds.md", "python -m withheld.machine_rates FOLDER"),
        row("the same: a cause that does not act is more than 80 % sure", kinds["wrong"], "machine-kinds.md", "python -m withheld.machine_rates FOLDER"),
        row("logs of real machines that give the cause that physics names", f"{named} of {len(machines)}", "machines.md", "lab/machines/run FOLDER"),
    ]


def bank(results: Path) -> list[dict[str, dict[str, str]]]:
    """The scores of the locked and of the development cases."""
    text = (results / "bank.md").read_text(encoding="utf-8").splitlines()
    tables_of = [[tables.cells(line) for line in lines] for begins, lines in sections(text) if begins == "score"]
    return [{row[0]: dict(zip(table[0], row, strict=True)) for row in table[2:]} for table in tables_of]


def sections(text: list[str]) -> list[tuple[str, list[str]]]:
    """Tables with the first cell of their heads."""
    found: list[tuple[str, list[str]]] = []
    for before, line in zip(["", *text], text, strict=False):
        if line.startswith("|"):
            if not before.startswith("|"):
                found.append((tables.cells(line)[0], []))
            found[-1][1].append(line)
    return found


def percent(cell: str) -> str:
    """A share in percent."""
    return cell if cell == "–" else f"{100 * float(cell):.0f} %"


def speed(results: Path) -> list[str]:
    """Agreement with other programs, and times."""
    compared = sum(int(r["compared"]) for r in tables.rows(results / "validation.md", "data", "quantity", "compared"))
    peers = {r["computation"]: r for r in tables.rows(results / "peers.md", "computation", "ours, min (median)") if r["computation"]}
    waits = {r["what is asked"]: r for r in tables.rows(results / "waiting.md", "what is asked", "ours, min (median)") if r["what is asked"]}
    waits |= {r["what is asked"]: r for r in diagnoses(results) if r["what is asked"]}
    reading = tables.rows(results / "readers.md", "reader", "s by the clock, min (median)")[0]

    def wait(question: str) -> str:
        found = waits[question]
        return f"least (median) {found['ours, min (median)']}; aim {found['aim']}, {found[''].strip('*')}"

    def ratio(computation: str) -> str:
        found = peers[computation]
        return f"{found['ratio of minima (medians)'].split()[0]} the speed of {found['peer']}"

    return [
        row("comparisons with other programs or slow independent calculations", f"{compared} agree within their tolerances", "validation.md", "scripts/validation"),
        row("zero-order hold of 3 states, one thread", ratio("c2d zoh, 3 states (lateral)"), "peers.md", "lab/peers"),
        row("regulator of 9 states, one thread", ratio("dlqr, 9 states (UAV)"), "peers.md", "lab/peers"),
        row("`estimate`, all methods, 1500 samples", wait("`estimate`, all methods, 1500 samples"), "waiting.md", "lab/peers --users"),
        row("`gap`, linear model of 3 states, three logs of 6000 samples", wait("`gap`, linear, 3 states"), "waiting.md", "lab/peers --users"),
        row("`gap`, equations of 4 states, the same logs", wait("`gap`, equations, 4 states"), "waiting.md", "lab/peers --users"),
        row("reading CSV", f"{reading['MB/s of processor time']} MB/s of processor time", "readers.md", "lab/peers --logs"),
    ]


def diagnoses(results: Path) -> list[dict[str, str]]:
    """The table of diagnoses in waiting.md, which is its second."""
    text = (results / "waiting.md").read_text(encoding="utf-8").split("## A diagnosis")[1].splitlines()
    lines = [tables.cells(line) for line in text if line.startswith("|")]
    end = next(at for at, line in enumerate(lines[2:], 2) if line == lines[0])
    return [dict(zip(lines[0], line, strict=False)) for line in lines[2:end]]

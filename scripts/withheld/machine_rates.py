"""``python -m withheld.machine_rates FOLDER [--program PROGRAM] [--table FILE]``: what the program says of machines that ``withheld.machines`` drew, a row a kind.

Every case is diagnosed from run_1 and run_2, fresh.csv held out; answers are kept in the folder as answer.json and reused.

named      the first class that is more than numbers standing off holds an effect that acts (of a payload: a change of parameters); of nothing: the verdict is `none` or
           names numbers that stand off; of gusts: also `unknown`
all named  every effect that acts is in a class that is named
wrong      a class with a probability above 0.8 that holds no effect that acts
complete   the program says that the causes explain the gap down to the noise
worse      the error of the written model in free run on the fresh log is above the nominal one's
value      the interval of the first parameter holds the truth, where the effect itself is named
"""

import argparse
import json
import os
import resource
import subprocess
import tempfile
from pathlib import Path

SURE = 0.8
CHANGES = ("parameter_jump", "parameter_error", "parameter_drift")


def diagnose(program: str, case: Path) -> dict:
    """The stored answer, or a new one."""
    stored = case / "answer.json"
    if stored.exists():
        return json.loads(stored.read_text())
    logs = [argument for name in ("run_1", "run_2") for argument in ("--log", str(case / f"{name}.csv"))]
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        command = [program, "gap", "--model", str(case / "model.toml"), *logs, "--holdout", str(case / "fresh.csv"), "--out", str(out), "--quiet"]
        before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
        run = subprocess.run(command, capture_output=True, text=True, env={**os.environ, "RAYON_NUM_THREADS": "1"})
        answer = {"seconds": resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before}
        if run.returncode:
            answer["failure"] = run.stderr
        else:
            answer["diagnosis"] = json.loads((out / "diagnosis.json").read_text())
    stored.write_text(json.dumps(answer))
    return answer


def keys(member) -> list[str]:
    """The effects of a member of a class."""
    return [member] if isinstance(member, str) else list(member)


def score(case: Path, answer: dict) -> dict:
    truth = json.loads((case / "truth.json").read_text())
    if "failure" in answer:
        return {"kind": truth["kind"], "failed": True, "named": False, "all": False, "wrong": False, "seconds": answer["seconds"]}
    diagnosis = answer["diagnosis"]
    cause = diagnosis["cause"]
    acts = {f"{e['effect']}:{e['channel']}": e for e in truth["effects"]}
    # A gain of the only input of a servo is one of its stiffness, too.
    same = {"input_gain:target": {"sensor_gain:q", "sensor_gain:*", "parameter_error:kp"}}

    def holds(one: dict) -> set[str]:
        members = {key for member in one["members"] for key in keys(member)} | {one["representative"]}
        found = {key for key in acts if key in members or same.get(key, set()) & members}
        if "event" in truth and any(key.split(":")[0] in CHANGES for key in members):
            found.add("event")
        if truth.get("off") and any(key.split(":")[0] in ("parameter_error", "recalibration") for key in members):
            found.add("numbers")
        return found

    found = [(one, holds(one)) for one in cause["classes"]]
    everything = set(acts) | ({"event"} if "event" in truth else set())
    named = {key for _, held in found for key in held}
    # Where the machine's numbers stand off, a recalibration may explain most.
    first = next((held for _, held in found if held != {"numbers"}), set())
    silent = ("none", "unknown") if truth["kind"] == "gusts" else ("none",)
    quiet = cause["verdict"] in silent or bool(found) and all("numbers" in held for _, held in found)
    result = {
        "kind": truth["kind"],
        "failed": False,
        "named": bool(first & everything) if everything else quiet,
        "all": everything <= named if everything else quiet,
        "wrong": any(one["probability"] > SURE and not held for one, held in found),
        "complete": cause["explained"] == "all",
        "seconds": answer["seconds"],
    }
    free = diagnosis.get("errors") or {}
    free = free.get("free_run") or {}
    if free.get("before") is not None and free.get("after") is not None:
        result["worse"] = free["after"] > 1.02 * free["before"]
    for effect in cause["effects"]:
        if true := acts.get(f"{effect['effect']}:{effect['channel']}"):
            for parameter in effect["parameters"]:
                value = true["parameters"].get(parameter["name"])
                if value is not None and parameter.get("ci95"):
                    result["value"] = parameter["ci95"][0] <= value <= parameter["ci95"][1]
                    break
    return result


def table(scores: list[dict]) -> str:
    columns = ("named", "all", "wrong", "complete", "worse", "value")
    lines = ["| kind | cases | failed | " + " | ".join("all named" if c == "all" else c for c in columns) + " | median s | longest s |", "| --- |" + " ---: |" * (len(columns) + 4)]
    kinds = list(dict.fromkeys(s["kind"] for s in scores))
    for kind in (*kinds, "all kinds"):
        own = [s for s in scores if kind in (s["kind"], "all kinds")]
        seconds = sorted(s["seconds"] for s in own)
        cells = [kind.replace("_", " "), str(len(own)), str(sum(s["failed"] for s in own))]
        for column in columns:
            values = [s[column] for s in own if s.get(column) is not None]
            cells.append(f"{sum(values)} of {len(values)}" if values else "–")
        cells += [f"{seconds[len(seconds) // 2]:.1f}", f"{seconds[-1]:.1f}"]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(prog="withheld.machine_rates", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--program", default=os.environ.get("DEADTIME_PROGRAM", "deadtime"))
    options = parser.parse_args()
    cases = sorted(path.parent for path in options.folder.glob("*/truth.json"))
    scores = [score(case, diagnose(options.program, case)) for case in cases]
    for case, one in zip(cases, scores):
        print(case.name, {k: v for k, v in one.items() if k != "kind"})
    print()
    print(table(scores))


if __name__ == "__main__":
    main()

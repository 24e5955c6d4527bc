"""Answers of a program to the cases of a set: one JSON line per case in FOLDER/answers.jsonl, appended as cases are answered."""

import gzip
import hashlib
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

from . import sets

LIMIT_S = 600.0
WALL, LEAST_WALL_S = 20, 3600.0  # a diagnosis that waits this many times its limit, and an hour, is ended, too


def identity(program: Path) -> str:
    """The first 16 digits of the program's SHA-256."""
    return hashlib.sha256(program.read_bytes()).hexdigest()[:16]


def read(place: Path) -> dict[str, dict]:
    """Answers by case: of a folder, or of a file that may be compressed."""
    path = place / "answers.jsonl" if place.is_dir() else place
    text = gzip.decompress(path.read_bytes()).decode() if path.suffix == ".gz" else path.read_text()
    return {answer["case"]: answer for answer in map(json.loads, text.splitlines())}


def _short(value):
    """The value with seven digits of every number."""
    if isinstance(value, float):
        return float(f"{value:.7g}")
    if isinstance(value, dict):
        return {k: _short(v) for k, v in value.items()}
    return [_short(v) for v in value] if isinstance(value, list) else value


def _parameters(found: list[dict]) -> dict[str, list]:
    """Estimate and 95 % interval of each parameter."""
    return {p["name"]: [p["value"], *(p["ci95"] or [None, None])] for p in found}


def distilled(diagnosis: dict) -> dict:
    """What scores and readers need of a diagnosis."""
    cause, shrink = diagnosis["cause"], diagnosis["shrink"]
    block, left = cause["recalibration"], cause["remainder"]
    rows = sorted(cause["ranking"], key=lambda row: -row["probability"])[:6]
    return _short({
        "mode": diagnosis["prediction"]["mode"], "verdict": cause["verdict"], "channel": cause["channel"], "explained": cause["explained"],
        "contributions": [
            {"effect": c["effect"], "channel": c["channel"], "share": c["share"]["learnt"], "held_out": c["share"]["held_out"],
             "probability": c.get("probability"), "class": c["class"], "surrogate": c["surrogate"], "parameters": _parameters(c["parameters"])}
            for c in cause["contributions"]
        ],
        "recalibration": {"share": block["share"]["learnt"], "size": block["size"], "parameters": _parameters(block["parameters"])} if block["accepted"] else None,
        "classes": [{"representative": c["representative"], "probability": c["probability"], "members": c["members"], **c["grounds"]} for c in cause.get("classes", ())],
        "indistinguishable": cause["indistinguishable"],
        "ranking": [[["".join([e, ":", c]) for e, c in row["effects"]] if "effects" in row else [f"{row['effect']}:{row['channel'] or ''}"], row["probability"]] for row in rows],
        "remainder": {"share": left["share"]["learnt"], "above_floor": left["above_floor"]},
        "gap": {name: diagnosis["gap"][name] for name in ("before", "floor")},
        "before": shrink["before"], "after": shrink["after"], "decoded": shrink.get("decoded"),
    })


def ask(program: Path, case: Path, limit: float) -> dict:
    """The program's answer to one case with its processor seconds; or why there is none."""
    logs = [word for name in ("train_1", "train_2") for word in ("--log", case / f"{name}.csv")]
    longest = max(WALL * limit, LEAST_WALL_S)
    with tempfile.TemporaryDirectory() as out:
        command = [program, "gap", "--model", case / "model.toml", *logs, "--holdout", case / "holdout_1.csv", "--out", out, "--quiet"]
        began = time.perf_counter()
        with tempfile.TemporaryFile() as said:
            process = subprocess.Popen([str(word) for word in command], stdin=subprocess.DEVNULL, stdout=said, stderr=said)
            resource.prlimit(process.pid, resource.RLIMIT_CPU, (int(limit), int(limit) + 5))
            guard = threading.Timer(longest, process.kill)
            guard.start()
            _, status, usage = os.wait4(process.pid, 0)
            guard.cancel()
            process.returncode = os.waitstatus_to_exitcode(status)
            said.seek(0)
            words = said.read().decode(errors="replace").strip().splitlines()
        seconds = usage.ru_utime + usage.ru_stime
        answer = {"seconds": round(seconds, 2), "wall_s": round(time.perf_counter() - began, 2), "failure": None}
        file = Path(out) / "diagnosis.json"
        if process.returncode == 0 and file.exists():
            return answer | distilled(json.loads(file.read_text()))
        late = process.returncode == -signal.SIGXCPU or answer["wall_s"] >= longest
        return answer | {"failure": "time" if late else f"exit {process.returncode}: {words[-1][:200] if words else ''}"}


def run(set_name: str, drawn: Path, program: Path, out: Path, groups: list[str] | None, cases: int | None, limit: float, name: str) -> int:
    """Answers what this program has not answered yet; exit code 1 where cases are not drawn."""
    out.mkdir(parents=True, exist_ok=True)
    file, own = out / "answers.jsonl", identity(program)
    done = read(out) if file.exists() else {}
    others = {a["program"] for a in done.values()} - {own}
    if others:
        sys.exit(f"{out} holds answers of another program ({', '.join(sorted(others))}); this one is {own}")
    work = [n for n in sets.names(groups, cases) if n not in done]
    missing = [n for n in work if not (drawn / n).is_dir()]
    stored = sets.sums(set_name)
    for number, case in enumerate((n for n in work if n not in missing), start=1):
        if stored.get(case, digest := sets.digest(drawn / case)) != digest:
            text = f"{drawn / case} is not the case that golden/bank stands for"
            if set_name == "locked":
                sys.exit(f"{text}; draw it again")
            if number == 1:
                print(f"{text}: another processor rounds otherwise; answers to this draw can be compared with each other only", file=sys.stderr)
        answer = {"case": case, "set": set_name, "program": own, "name": name, "drawn": digest} | ask(program, drawn / case, limit)
        with file.open("a") as lines:
            lines.write(json.dumps(answer) + "\n")
        print(f"{number}/{len(work) - len(missing)} {case} {answer['seconds']:.1f} s {answer['failure'] or answer['verdict']}", file=sys.stderr, flush=True)
    if missing:
        print(f"not drawn: {len(missing)} cases, first {missing[0]}; scripts/bank draw {set_name}", file=sys.stderr)
    return 1 if missing else 0

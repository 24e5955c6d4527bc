"""``scripts/bank check``: scores of answers whose values follow by hand, and programs that answer, crash and never end; exit 1 on a failure."""

import argparse
import contextlib
import io
import json
import math
import tempfile
import time
from pathlib import Path

from . import ablation, answers, sets, tables
from .judge import Truth, judge

DIAGNOSIS = sets.ROOT / "examples" / "diagnosis.json"
MODEL = {
    "format": "deadtime/model@1", "name": "m", "kind": "lti", "inputs": [{"name": "u", "unit": "1"}], "outputs": [{"name": "y", "unit": "1"}, {"name": "z", "unit": "1"}],
    "states": [{"name": "x", "unit": "1"}], "A": [[-1.0]], "B": [[2.0]], "C": [[1.0], [1.0]], "D": [[0.0], [0.0]],
}


def _claim(text: str, share: float, probability: float = 0.9, **parameters) -> dict:
    effect, channel = text.split(":")
    return {"effect": effect, "channel": channel, "share": share, "probability": probability, "class": [], "parameters": parameters}


def _answer(verdict: str, *claims: dict, explained: str = "all", block: dict | None = None, before: float = 1.0, after: float = 0.5) -> dict:
    effect, _, channel = verdict.partition(":")
    return {"failure": None, "seconds": 2.0, "verdict": effect, "channel": channel or None, "explained": explained, "contributions": list(claims), "recalibration": block,
            "indistinguishable": [], "before": before, "after": after}


def _effect(text: str, **parameters) -> dict:
    effect, channel = text.split(":")
    return {"effect": effect, "channel": channel, "parameters": parameters}


def _truth(kind: str, *effects: dict, shares=(), classes=(), outside=False, off=None) -> Truth:
    named = [f"{e['effect']}:{e['channel']}" for e in effects]
    more = [{f"parameter_error:{name}"} for name in off or {}]
    return Truth("mixture", kind, ["linear"], list(effects), [{n, *others} for n, others in zip(named, classes or [()] * len(named))], list(shares) or [1.0] * len(named),
                 more, outside, 1.0, 0.5, None, off or {}, MODEL)


def _rate(judged: dict, score: str) -> float:
    return judged[score][0] / judged[score][1]


def mixtures_are_scored_by_share():
    truth = _truth("mixture", _effect("input_delay:u", delay=0.1), _effect("sensor_bias:y", offset=1.0), _effect("deadband:u", width=0.2),
                   shares=(0.5, 0.3, 0.1), classes=(("clock_offset:*",), (), ()))
    right = judge(_answer("input_delay:u", _claim("input_delay:u", 0.6, delay=[0.11, 0.09, 0.13]), _claim("sensor_bias:y", 0.3, offset=[2.0, 1.5, 2.5])), truth)
    assert [_rate(right, s) for s in ("verdict", "named", "first", "precision", "false_complete")] == [1, 1, 1, 1, 0]
    assert math.isclose(_rate(right, "recall"), 0.8 / 0.9) and right["coverage"] == [1, 2] and _rate(right, "of_oracle") == 1.0
    other = judge(_answer("deadband:u", _claim("deadband:u", 0.6), _claim("clock_offset:*", 0.2), _claim("sensor_drift:z", 0.2)), truth)
    assert [_rate(other, s) for s in ("verdict", "named", "first", "precision", "false_complete")] == [1, 1, 0, 0.8, 1], other
    assert math.isclose(_rate(other, "recall"), 0.6 / 0.9)
    nothing = judge(_answer("unknown", explained="nothing", after=1.1), truth)
    assert [_rate(nothing, s) for s in ("verdict", "named", "recall", "f1", "worse")] == [0, 0, 0, 0, 1] and "precision" not in nothing and "false_complete" not in nothing
    failed = judge({"failure": "time", "seconds": 600.0}, truth)
    assert [_rate(failed, s) for s in ("failed", "verdict", "named", "recall", "f1")] == [1, 0, 0, 0, 0]
    near = _truth("mixture", _effect("input_delay:u"), _effect("sensor_bias:y"), shares=(0.5, 0.4))
    assert "first" not in judge(_answer("sensor_bias:y", _claim("sensor_bias:y", 1.0)), near), "a near tie has no first"


def recalibrations_are_claims():
    block = {"share": 0.4, "parameters": {"A[x,x]": [-1.1, -1.2, -1.05], "B[x,u]": [2.0, 1.9, 2.1]}}
    answer = _answer("input_delay:u", _claim("input_delay:u", 0.3), block=block)
    hidden = judge(answer, _truth("single", _effect("input_delay:u"), off={"A[x,x]": -1.1}))
    assert math.isclose(_rate(hidden, "precision"), 0.5 / 0.7) and _rate(hidden, "recall") == 1 and _rate(hidden, "first") == 0 and hidden["coverage_block"] == [2, 2]
    assert judge(answer, _truth("single", _effect("input_delay:u")))["coverage_block"] == [1, 2], "a parameter that is right has its nominal value"
    gain = judge(answer, _truth("single", _effect("input_gain:u"), classes=(("parameter_error:B[x,u]",),)))
    assert _rate(gain, "named") == 1 and gain["coverage_block"] == [0, 1], "what an effect does in a parameter's place leaves the parameter without a true value"


def false_alarms_are_what_is_not_there():
    delay, outside, off = _claim("input_delay:u", 0.5), {"outside": True}, {"off": {"A[x,x]": -1.01}}
    block = {"share": 0.4, "parameters": {"A[x,x]": [-1.1, -1.2, -1.05], "B[x,u]": [2.1, 2.0, 2.2]}}
    for answer, truth, verdict, alarm in (
        (_answer("none"), {}, 1, 0), (_answer("unknown"), {}, 0, 1), (_answer("input_delay:u", delay), {}, 0, 1), (_answer("unknown", delay), {}, 0, 1),
        (_answer("unknown"), outside, 1, 0), (_answer("unknown", delay), outside, 1, 1), (_answer("none"), outside, 1, 0),
        (_answer("none", block=block), off, 1, 0), (_answer("none", block=block), {}, 1, 1), (_answer("parameter_error:A[x,x]", _claim("parameter_error:A[x,x]", 1.0)), off, 1, 0),
        (_answer("unknown"), off, 0, 1),
    ):
        found = judge(answer, _truth("none", **truth))
        assert (_rate(found, "verdict"), _rate(found, "false_alarm")) == (verdict, alarm), (answer["verdict"], truth)
    assert _rate(judge(_answer("unknown", explained="part"), _truth("none", outside=True)), "complete_outside") == 0


def sets_are_fixed_and_begin_with_every_group():
    every = sets.names()
    assert len(every) == len(set(every)) == 200 and {sets.group_of(n) for n in every[:10]} == set(sets.GROUPS)
    assert sorted(sets.names(["single"], 3)) == ["single-00", "single-01", "single-02"]
    turns = [sets.wanted(1, f"single-{n:02}")[0].effect for n in range(40)]
    assert set(turns[: len(sets.GROUPS["single"].effects)]) == set(sets.GROUPS["single"].effects), "every effect has its turn"
    assert all(sets.wanted(1, n)[1].generate_state(2).tolist() != sets.wanted(2, n)[1].generate_state(2).tolist() for n in every)


def programs_answer_crash_and_run_too_long():
    with tempfile.TemporaryDirectory() as place:
        drawn, out = Path(place) / "development", Path(place) / "out"
        for name in sets.names(["none"], 2):
            (drawn / name).mkdir(parents=True)
            for file in sets.FILES:
                (drawn / name / file).write_text("{}")
        stored, sets.sums = sets.sums, lambda _: {}
        try:
            for number, (words, failure) in enumerate(((f'cp {DIAGNOSIS} "$out/diagnosis.json"', None), ("echo broken; exit 3", "exit 3: broken"), ("while :; do :; done", "time"))):
                program = Path(place) / f"program{number}"
                program.write_text('#!/bin/sh\nwhile [ "$1" != --out ]; do shift; done; out=$2; echo >> "$0.calls"\n' + words + "\n")
                program.chmod(0o755)
                for _ in range(2):
                    with contextlib.redirect_stderr(io.StringIO()):
                        code = answers.run("development", drawn, program, out / str(number), ["none"], 2, 1.0, "")
                found = answers.read(out / str(number))
                assert code == 0 and [a["failure"] for a in found.values()] == [failure] * 2, found
                assert Path(f"{program}.calls").read_text() == "\n\n", "what is answered is not asked again"
            assert answers.read(out / "0")["none-00"]["verdict"] == json.loads(DIAGNOSIS.read_text())["cause"]["verdict"]
        finally:
            sets.sums = stored


def the_locked_set_is_refused_after_three_commits():
    from . import __main__ as program

    with tempfile.TemporaryDirectory() as place:
        kept = program.LOG, answers.run, answers.read, tables.summary
        program.LOG, answers.run, answers.read, tables.summary = Path(place) / "log.md", lambda *_: 0, lambda _: {}, lambda *_: "scores"
        try:
            for commit, force, passes in ((None, False, False), ("a", False, True), ("b", False, True), ("a", False, True), ("c", False, True), ("d", False, False), ("d", True, True)):
                options = argparse.Namespace(final=commit, force=force, folder=Path(), program=Path(), out=Path(), group=None, cases=None, limit=1.0)
                try:
                    passed = program._locked(options) == 0
                except SystemExit:
                    passed = False
                assert passed == passes, f"commit {commit}, force {force}"
            assert list(program._entries()) == ["a", "b", "c", "d"] and "scores" in program.LOG.read_text()
        finally:
            program.LOG, answers.run, answers.read, tables.summary = kept


def differences_are_paired():
    judged, names = tables.judged, [f"none-{n:02}" for n in range(20)]
    tables.judged = lambda found, _: {n: (_truth("none"), judge(a, _truth("none"))) for n, a in found.items()}
    try:
        old = {n: _answer("none") for n in names}
        new = old | {n: _answer("unknown") for n in names[:8]}
        rows = {tuple(c.strip() for c in line.split("|")[1:3]): [c.strip() for c in line.split("|")[3:-1]] for line in tables.compare(old, new, Path()).splitlines() if "|" in line}
        assert rows["all", "verdict"][:5] == ["20", "8", "1.000", "0.600", "-0.400"] and rows["all", "verdict"][6] == "WORSE", rows["all", "verdict"]
        assert rows["all", "worse"][1:6] == ["0", "0.000", "0.000", "0.000", "0.000 … 0.000"] and rows["all", "worse"][6] == ""
    finally:
        tables.judged = judged


def every_constant_of_the_ablation_stands_in_the_source():
    assert not ablation.missing(), ablation.missing()


CHECKS = [
    mixtures_are_scored_by_share, recalibrations_are_claims, false_alarms_are_what_is_not_there, sets_are_fixed_and_begin_with_every_group,
    programs_answer_crash_and_run_too_long, the_locked_set_is_refused_after_three_commits, differences_are_paired, every_constant_of_the_ablation_stands_in_the_source,
]


def main() -> int:
    failed = False
    for check in CHECKS:
        began = time.perf_counter()
        try:
            check()
            print(f"ok      {check.__name__} ({time.perf_counter() - began:.2f} s)", flush=True)
        except AssertionError as problem:
            failed = True
            print(f"FAILED  {check.__name__}: {problem}", flush=True)
    return 1 if failed else 0

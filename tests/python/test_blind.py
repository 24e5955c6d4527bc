"""The check on withheld effects, from Python."""

from __future__ import annotations

import json
from pathlib import Path

import blind_cases
import pytest
from interrupts import interrupted

import deadtime
from deadtime import blind
from deadtime.errors import BlindError, FileError


@pytest.fixture(scope="module")
def checked(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Path, blind.BlindRun, list[blind.CaseOutcome]]:
    folder = tmp_path_factory.mktemp("blind")
    cases, labels = blind_cases.make(folder, {"late": 4, "true": 0})
    told: list[blind.CaseOutcome] = []
    run = blind.run(cases, folder / "verdicts", progress=told.append)
    return cases, labels, folder / "verdicts", run, told


def test_every_case_gets_a_verdict_and_is_told(checked):
    cases, _, verdicts, run, told = checked
    assert run.passed and [case.id for case in run] == ["late", "true"] and len(run) == 2
    assert sorted(told, key=lambda c: c.id) == list(run.cases)
    assert all(case.outcome == "done" and case.time_s > 0 for case in run)
    assert json.loads((verdicts / "late" / "diagnosis.json").read_text())["cause"]["verdict"] == "input_delay"
    assert (verdicts / "late" / "commitment.txt").read_bytes() == (cases / "late" / "commitment.txt").read_bytes()
    assert "2 cases diagnosed" in repr(run) and run.to_dict() == {"cases": 2, "done": 2, "failed": []}


def test_what_was_done_is_kept_and_a_case_that_fails_stops_no_other(checked, tmp_path):
    cases, _, verdicts, _, _ = checked
    again = blind.run(cases, verdicts)
    assert [case.outcome for case in again] == ["kept", "kept"] and again.cases[0].time_s is None
    broken, _ = blind_cases.make(tmp_path, {"late": 4, "bad": 0}, samples=200)
    (broken / "bad" / "train_1.csv").write_text("time,u,y\n0,0,x\n")
    run = blind.run(broken, tmp_path / "verdicts")
    assert not run.passed and list(run.failed) == ["bad"] and "train_1.csv" in run.failed["bad"]
    assert "1 of 2 cases" in repr(run) and not (tmp_path / "verdicts" / "bad" / "run.json").exists()


def test_scores_are_what_the_labels_say(checked, tmp_path):
    _, labels, verdicts, _, _ = checked
    score = blind.score(verdicts, labels)
    assert score.cases == 2 and score.groups == {"mixture": 0, "moving": 0, "none": 1, "pair": 0, "single": 1, "unknown": 0}
    assert score["top1_class"] == 1.0 and score["false_alarm"] == 0.0 and score["pair_any"] is None
    assert score.scores["top1_class"]["count"] == 1 and {b["key"] for b in score.by} == {"effect", "plant"}
    assert score.to_dict()["format"] == "deadtime/blind-score@1" and "top1_class" in repr(score)
    score.save(tmp_path / "score.json")
    assert json.loads((tmp_path / "score.json").read_text()) == score.to_dict()
    assert score.markdown().startswith("# Withheld effects")


def test_limits_are_kept_or_named(checked):
    _, labels, verdicts, _, _ = checked
    assert blind.score(verdicts, labels, require=["top1_class>=0.9", "false_alarm<=0.1"]).passed
    missed = blind.score(verdicts, labels, require=["top1_class<=0.1", "pair_any>=0.5"])
    assert not missed.passed and missed.unmet[0].startswith("top1_class<=0.1 was not met: it is 1")
    assert "no case has this score" in missed.unmet[1]
    with pytest.raises(BlindError, match="there is no score"):
        blind.score(verdicts, labels, require=["nonsense>=1"])
    with pytest.raises(BlindError, match="NAME>=VALUE"):
        blind.score(verdicts, labels, require=["top1_class"])


def test_a_label_that_was_changed_is_refused(checked, tmp_path):
    _, labels, verdicts, _, _ = checked
    for file in labels.iterdir():
        (tmp_path / file.name).write_text(file.read_text().replace("input_delay", "sensor_bias"))
    with pytest.raises(BlindError, match="late.*does not match its commitment"):
        blind.score(verdicts, tmp_path)


def test_no_cases_and_no_jobs_are_errors(tmp_path):
    with pytest.raises(FileError) as caught:
        blind.run(tmp_path / "nowhere", tmp_path)
    assert isinstance(caught.value, OSError) and isinstance(caught.value, deadtime.DeadtimeError)
    (tmp_path / "empty").mkdir()
    with pytest.raises(BlindError):
        blind.run(tmp_path / "empty", tmp_path / "verdicts")
    with pytest.raises(ValueError, match="jobs"):
        blind.run(tmp_path, tmp_path, jobs=0)


def test_ctrl_c_is_heard_within_a_fifth_of_a_second(tmp_path):
    cases, _ = blind_cases.make(tmp_path, {f"case{n}": 4 for n in range(12)}, samples=800)
    # The machine may be busy: one of three tries has to.
    assert any(interrupted(lambda to=f"verdicts{n}": blind.run(cases, tmp_path / to)) < 0.2 for n in range(3))

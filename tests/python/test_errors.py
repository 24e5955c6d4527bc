"""Every kind of error reaches Python as its own class, and says what is wrong and where."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import blind_cases
import numpy
import pytest

import deadtime
from deadtime import _native, errors

_TIME = numpy.arange(200) * 0.1
_WAVE = numpy.sign(numpy.sin(_TIME * 2.0))


def _log(**channels: object) -> deadtime.Log:
    return deadtime.Log(_TIME, {"u": _WAVE, "y": numpy.roll(_WAVE, 3), **channels})


def _model() -> deadtime.Model:
    lag = deadtime.StateSpace([[-2.0]], [[2.0]], [[1.0]], [[0.0]])
    return deadtime.Model.from_system(lag, ["u"], ["y"])


def _torn(folder: Path) -> object:
    """Scores a verdict that was cut off."""
    cases, labels = blind_cases.make(folder, {"late": 4}, samples=60)
    verdict = folder / "verdicts" / "late"
    verdict.mkdir(parents=True)
    (verdict / "diagnosis.json").write_text('{"format": "deadtime/diag', encoding="utf-8")
    return deadtime.blind.score(folder / "verdicts", labels, cases)


#: One way into each class, and a word that its message must have.
WAYS: dict[str, tuple[Callable[[Path], object], str]] = {
    "TimeError": (lambda _: deadtime.c2d(_model().system(), -0.1), "-0.1"),
    "LogError": (lambda _: deadtime.Log([0.0, 0.0], {"u": [1.0, 2.0]}), "stands still"),
    "ModelError": (lambda _: deadtime.StateSpace([[1.0, 2.0]], [[1.0]], [[1.0]]), "matrix A"),
    "SignalError": (lambda _: deadtime.excite("prbs", 0), "0"),
    "SimulateError": (lambda _: deadtime.lsim(_model().system(), [numpy.inf, 1.0], sample_time=0.1), "inf"),
    "GapError": (lambda _: deadtime.gap(_model(), _log().window(0.0, 1.0)), "samples"),
    "EffectError": (lambda _: _model().with_effects([{"effect": "friction", "channel": "u"}]), "friction"),
    "DelayError": (lambda _: deadtime.estimate(_log(still=numpy.ones(200)), "u", "still"), "still"),
    "DiagnosisError": (_torn, "diagnosis.json"),
    "BlindError": (lambda folder: deadtime.blind.score(folder, folder), "no label"),
    "StudyError": (lambda _: deadtime.study("no_such_plan"), "no_such_plan"),
    "RegistryError": (lambda _: deadtime.estimate(_log(), "u", "y", method="arx_struc"), "arx_struc"),
    "FileError": (lambda folder: deadtime.read(folder / "none.csv"), "none.csv"),
}


@pytest.mark.parametrize("name", WAYS)
def test_every_kind_of_error_has_a_class_and_a_message(name: str, tmp_path: Path) -> None:
    way, word = WAYS[name]
    with pytest.raises(getattr(errors, name)) as raised:
        way(tmp_path)
    assert type(raised.value) is getattr(errors, name)
    assert isinstance(raised.value, deadtime.DeadtimeError)
    assert word in str(raised.value)
    assert "--" not in str(raised.value), "a remedy of the command line"


def test_there_is_a_way_into_every_class() -> None:
    assert sorted(WAYS) == sorted(_native.ERROR_CLASSES)


def test_remedies_are_those_of_python(tmp_path: Path) -> None:
    with pytest.raises(errors.DeadtimeError, match=r'log\.rename\(\{"u": column\}\)'):
        deadtime.gap(_model(), deadtime.Log(_TIME, {"command": _WAVE, "y": _WAVE}))
    with pytest.raises(errors.DelayError, match="max_delay= "):
        deadtime.estimate(_log(), "u", "y", method="arxstruc", max_delay=100.0)
    folded = tmp_path / "folded--twice.csv"
    folded.write_text("time,u\n0,1\n1,2\n0,3\n", encoding="utf-8")
    with pytest.raises(errors.LogError, match=r"folded--twice\.csv.*deadtime\.read_records\(path, column\)"):
        deadtime.read(folded)


#: A call that is refused, and the arguments or calls that its message names.
REMEDIES: list[tuple[Callable[[], object], str]] = [
    (lambda: _log().rename({"a": "u", "b": "u"}), "`log.rename({name: column})`"),
    (lambda: _log().window(100.0, 200.0), "choose `log.window(start, stop)` within 0 s"),
    (lambda: _log().resample(1e-12), "give `log.resample(sample_time)` a larger"),
    (lambda: deadtime.estimate_events(_TIME, _TIME + 0.05, method="oestruc"), "give input= and output="),
    (lambda: deadtime.step_log({"time": _TIME, "level": _TIME}, time=0.05), "the time of a row as time="),
]


@pytest.mark.parametrize(("call", "remedy"), REMEDIES)
def test_a_message_names_what_python_has(call: Callable[[], object], remedy: str) -> None:
    with pytest.raises(errors.DeadtimeError) as raised:
        call()
    assert remedy in str(raised.value)
    assert "--" not in str(raised.value)


def test_a_guessed_unit_of_time_is_a_warning_that_names_the_arguments(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("stamp_ms,u\n0,1\n100,2\n200,3\n", encoding="utf-8")
    with pytest.warns(UserWarning, match="time= and time_unit= say it otherwise") as warned:
        deadtime.read(path)
    assert not [w for w in warned if "--" in str(w.message)]


def test_notes_of_answers_name_arguments_too() -> None:
    short = deadtime.Log(_TIME[:60], {"u": _WAVE[:60], "y": numpy.roll(_WAVE, 3)[:60]})
    notes = [answer.note for answer in deadtime.estimate(short, "u", "y").pair.estimates if answer.note]
    assert any("max_delay=" in note for note in notes)
    assert not [note for note in notes if "--" in note]


COUNTS: list[tuple[str, Callable[[], object]]] = [
    ("threads is 0", lambda: deadtime.estimate(_log(), "u", "y", threads=0)),
    ("threads is -1", lambda: deadtime.predict_precision(_log(), "u", "y", threads=-1)),
    ("threads is 0", lambda: deadtime.gap(_model(), _log(), threads=0)),
    ("threads is -2", lambda: deadtime.study("thesis", threads=-2)),
    ("trials is -1", lambda: deadtime.study("thesis", trials=-1)),
    ("degree_bias is -1", lambda: deadtime.estimate(_log(), "u", "y", degree_bias=-1)),
    ("samples is -1", lambda: deadtime.excite("rbs", -1)),
    ("seed is -1", lambda: deadtime.add_noise(_WAVE, 10.0, seed=-1)),
    ("jobs is 0", lambda: deadtime.blind.run("cases", "verdicts", jobs=0)),
]


@pytest.mark.parametrize(("said", "call"), COUNTS)
def test_counts_that_cannot_be_are_refused_by_their_name(said: str, call: Callable[[], object]) -> None:
    with pytest.raises(ValueError, match=said):
        call()

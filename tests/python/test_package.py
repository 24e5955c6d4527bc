"""The package as a whole: its stubs, its documentation, its errors, its command line, its interrupts."""

from __future__ import annotations

import inspect
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

import deadtime
from deadtime import _native, errors


def run(*words: str, **options: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, *words], capture_output=True, text=True, check=False, **options)  # type: ignore[call-overload]


def test_stubs_are_what_the_native_module_holds(root: Path, tmp_path: Path) -> None:
    found = run("-m", "mypy.stubtest", "--mypy-config-file", str(root / "pyproject.toml"), "deadtime._native", cwd=tmp_path)
    assert found.returncode == 0, found.stdout + found.stderr


def test_the_package_passes_a_strict_type_check(root: Path, tmp_path: Path) -> None:
    sources = root / "python" / "deadtime"
    found = run("-m", "mypy", "--config-file", str(root / "pyproject.toml"), "--cache-dir", str(tmp_path), str(sources), cwd=tmp_path)
    assert found.returncode == 0, found.stdout + found.stderr


def public() -> list[tuple[str, object]]:
    """Every public name, and the public methods of every public class, as users reach them."""
    found: list[tuple[str, object]] = []
    for name in deadtime.__all__:
        value = getattr(deadtime, name)
        if inspect.ismodule(value) or not callable(value):
            continue
        found.append((name, value))
        if inspect.isclass(value) and not issubclass(value, Exception):
            found += [(f"{name}.{key}", member) for key, member in vars(value).items() if not key.startswith("_")]
    return found


def test_every_public_name_is_there_once() -> None:
    assert sorted(set(deadtime.__all__)) == sorted(deadtime.__all__)
    for name in deadtime.__all__:
        assert hasattr(deadtime, name), name


def test_every_public_name_is_documented() -> None:
    bare = [name for name, value in public() if not (inspect.getdoc(value) or "").strip()]
    assert not bare


def test_every_argument_is_named_in_its_documentation() -> None:
    silent = []
    for name, value in public():
        function = value.__func__ if isinstance(value, (classmethod, staticmethod)) else value
        # Nobody makes a result by hand.
        if not callable(function) or (inspect.isclass(value) and "Parameters" not in (value.__doc__ or "")):
            continue
        try:
            arguments = inspect.signature(function).parameters
        except (TypeError, ValueError):
            continue
        text = inspect.getdoc(function) or ""
        silent += [f"{name}({argument})" for argument in arguments if argument not in ("self", "cls", "args", "kwargs") and argument not in text]
    assert not silent


def test_there_is_one_exception_class_for_each_kind_of_error() -> None:
    classes = {name for name, value in vars(errors).items() if inspect.isclass(value) and issubclass(value, errors.DeadtimeError)}
    assert classes == {*_native.ERROR_CLASSES, "DeadtimeError"}
    assert all(getattr(errors, name).__doc__ for name in classes)


def test_a_missing_file_is_named_with_the_system_s_reason(tmp_path: Path) -> None:
    with pytest.raises(errors.FileError, match="No such file") as raised:
        deadtime.read(tmp_path / "none.csv")
    assert raised.value.filename is not None and Path(raised.value.filename).name == "none.csv"
    assert raised.value.errno == 2
    assert isinstance(raised.value, OSError)


def test_the_version_is_the_crate_s(root: Path) -> None:
    assert f'version = "{deadtime.__version__}"' in (root / "Cargo.toml").read_text(encoding="utf-8")


def test_the_command_line_comes_with_the_package(examples: Path) -> None:
    asked = run("-m", "deadtime", "estimate", str(examples / "uav_flight.csv"), "--input", "r", "--output", "ay", "--method", "arxstruc")
    assert asked.returncode == 0, asked.stderr
    assert "Dead time " in asked.stdout
    refused = run("-m", "deadtime", "estimate", "nowhere.csv", "--input", "r", "--output", "ay")
    assert refused.returncode == 2
    assert "nowhere.csv" in refused.stderr


@pytest.mark.skipif(os.name == "nt", reason="a console's Ctrl-C goes to every process of it")
def test_an_interrupted_command_leaves_no_half_written_file(tmp_path: Path) -> None:
    # As a shell starts it: children inherit that signals are ignored.
    words = [sys.executable, "-m", "deadtime", "excite", "prbs", "--samples", "50000000", "--sample-time", "0.01", "--out", str(tmp_path / "a.csv")]
    running = subprocess.Popen(words, stderr=subprocess.PIPE)
    until = time.monotonic() + 60.0
    while not list(tmp_path.iterdir()) and time.monotonic() < until:
        time.sleep(0.01)
    assert list(tmp_path.iterdir()), "the command writes nothing"
    running.send_signal(signal.SIGINT)
    running.communicate(timeout=60.0)
    assert running.returncode == 130
    assert not list(tmp_path.iterdir())


def test_interrupts_are_honoured_within_a_fifth_of_a_second() -> None:
    waits = []
    for _ in range(5):
        sent = []

        def interrupt(sent: list[float] = sent) -> None:
            time.sleep(0.2)
            sent.append(time.monotonic())
            os.kill(os.getpid(), signal.SIGINT)

        timer = threading.Thread(target=interrupt)
        timer.start()
        with pytest.raises(KeyboardInterrupt):
            _native._busy(20.0)
        waits.append(time.monotonic() - sent[0])
        timer.join()
    # A busy machine may be late once.
    assert sorted(waits)[1] < 0.2


def test_other_threads_go_on_while_the_package_works() -> None:
    counted = [0]
    done = threading.Event()

    def count() -> None:
        while not done.is_set():
            counted[0] += 1
            time.sleep(0.001)

    counter = threading.Thread(target=count)
    counter.start()
    _native._busy(0.5)
    done.set()
    counter.join()
    assert counted[0] > 50

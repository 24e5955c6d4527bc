"""Excitation and noise."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy
import pytest

import deadtime
from deadtime import errors


@pytest.mark.parametrize("kind", list(deadtime.excitations()))
def test_an_excitation_is_the_command_line_s_to_the_bit(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "u.csv"
    words = ["excite", kind, "--samples", "300", "--sample-time", "0.05", "--seed", "7", "--channel", "delta", "--out", str(path)]
    ran = subprocess.run([sys.executable, "-m", "deadtime", *words], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    written = deadtime.read(path)
    u = deadtime.excite(kind, 300, seed=7)
    assert u.shape == (300,) and u.dtype == float
    assert numpy.array_equal(written["delta"], u)
    log = deadtime.excite(kind, 300, 0.05, seed=7, channel="delta")
    assert log.channels == ["delta"] and numpy.array_equal(log.time, written.time) and log.sample_time == 0.05
    assert numpy.array_equal(deadtime.excitations()[kind](300, seed=7), u)


def test_options_change_the_signal_and_wrong_ones_are_told() -> None:
    assert deadtime.excite("doublet", 6, at=1, width=2, amplitude=3.0).tolist() == [0, 3, 3, -3, -3, 0]
    assert set(deadtime.excite("rbs", 400, levels=numpy.array([-2.0, 5.0]))) == {-2.0, 5.0}
    assert deadtime.excite("staircase", 5, pieces=[(1.0, 2), (4.0, 2)]).tolist()[:4] == [1, 1, 4, 4]
    with pytest.raises(errors.RegistryError, match="there is no excitation `prsb`.*there are: .*prbs"):
        deadtime.excite("prsb", 10)
    with pytest.raises(errors.RegistryError, match="bnd"):
        deadtime.excite("rbs", 10, bnd=[0, 0.5])
    with pytest.raises(errors.SignalError, match="band"):
        deadtime.excite("rbs", 10, band=[0.5, 0.1])
    with pytest.raises(errors.SignalError, match="at least 1"):
        deadtime.excite("rbs", 0)
    with pytest.raises(ValueError, match="sample_time"):
        deadtime.excite("rbs", 10, channel="u")  # type: ignore[call-overload]
    with pytest.raises(errors.TimeError, match="sample time 0"):
        deadtime.excite("rbs", 10, 0.0, channel="u")


def test_seeds_decide_random_signals() -> None:
    assert numpy.array_equal(deadtime.excite("rbs", 100, seed=3), deadtime.excite("rbs", 100, seed=3))
    assert not numpy.array_equal(deadtime.excite("rbs", 100, seed=3), deadtime.excite("rbs", 100, seed=4))


def test_noise_has_the_variance_that_the_ratio_asks_for() -> None:
    signal = numpy.sin(numpy.arange(20_000) * 0.1)
    for colour in ("white", {"ar": [-0.7]}, {"ar": [-0.7], "ma": [0.5]}):
        v = deadtime.add_noise(signal, 4.0, colour, seed=2, scaling="realised") - signal
        assert numpy.var(signal) / numpy.var(v) == pytest.approx(4.0, rel=1e-9)
        expected = deadtime.add_noise(signal, 4.0, colour, seed=2) - signal
        assert numpy.var(signal) / numpy.var(expected) == pytest.approx(4.0, rel=0.15)
    ar = deadtime.add_noise(signal, 4.0, {"ar": [-0.7]}) - signal
    # Of v(t) = 0.7·v(t − 1) + e the correlation of neighbours is 0.7.
    assert numpy.corrcoef(ar[1:], ar[:-1])[0, 1] == pytest.approx(0.7, abs=0.03)
    white = deadtime.add_noise(signal, 4.0) - signal
    assert abs(numpy.corrcoef(white[1:], white[:-1])[0, 1]) < 0.03


def test_noise_without_end_or_sense_is_refused() -> None:
    signal = numpy.sin(numpy.arange(100) * 0.1)
    assert numpy.array_equal(deadtime.add_noise(signal, numpy.inf), signal)
    for wrong in (0.0, -1.0, numpy.nan):
        with pytest.raises(errors.SignalError, match="snr"):
            deadtime.add_noise(signal, wrong)
    with pytest.raises(errors.SignalError, match="pole"):
        deadtime.add_noise(signal, 4.0, {"ar": [-1.1]})
    with pytest.raises(errors.SignalError, match="constant"):
        deadtime.add_noise(numpy.ones(10), 4.0)
    with pytest.raises(errors.SignalError, match="sample 1"):
        deadtime.add_noise([0.0, numpy.nan], 4.0)
    for colour in ("pink", {}, {"poles": [1.0]}):
        with pytest.raises(ValueError, match="colour"):
            deadtime.add_noise(signal, 4.0, colour)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="shape"):
        deadtime.add_noise(numpy.zeros((3, 3)), 4.0)


def test_lists_are_readable() -> None:
    listed = deadtime.excitations()
    assert "rbs" in repr(listed) and "<td>rbs</td>" in listed._repr_html_()
    assert listed["step"].options == {"amplitude": 1.0, "at": 10}

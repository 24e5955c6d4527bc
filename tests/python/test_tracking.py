"""`deadtime.Tracker`: the delay of a machine that runs. The machine is stepped here."""

from __future__ import annotations

import math
import random

import pytest

import deadtime
from deadtime.errors import DelayError, TimeError


def watched(samples: int, delay, tracker: deadtime.Tracker, *, measured=lambda k: True) -> list[deadtime.Tracking]:
    """y(t) = 0.9 y(t-1) + 0.1 u(t - delay(t)) with noise, pushed sample by sample."""
    rng = random.Random(4)
    u, y, told = [0.0] * 40, 0.0, []
    for k in range(samples):
        u.append(rng.choice([-1.0, 1.0]) if rng.random() < 0.15 else u[-1])
        y = 0.9 * y + 0.1 * u[-1 - delay(k)]
        told.append(tracker.push(u[-1], y + rng.gauss(0.0, 0.01) if measured(k) else math.nan))
    return told


def test_a_delay_that_changes_raises_one_alarm_with_both_values() -> None:
    told = watched(4000, lambda k: 5 if k < 2500 else 12, deadtime.Tracker(0.01))
    assert told[100].delay_s is None and told[100].band_s is None
    alarms = [t for t in told if t.alarm is not None]
    assert len(alarms) == 1 and alarms[0].alarm is not None
    alarm = alarms[0].alarm
    # The hold's own sample is taken off: 5 samples behind the command of the same row are 0.04 s.
    assert alarm.cause == "delay_changed" and alarm.from_s == pytest.approx(0.04, abs=1e-9) and alarm.to_s == pytest.approx(0.11, abs=1e-9)
    assert abs(alarm.since_s - 25.0) < 0.2 and alarms[0].time_s < 26.0
    low, high = told[-1].band_s or (math.nan, math.nan)
    assert low <= 0.11 <= high and high - low < 0.03


def test_samples_that_were_not_measured_are_passed_over() -> None:
    told = watched(3000, lambda k: 5, deadtime.Tracker(0.01), measured=lambda k: k % 50 > 4)
    assert all(t.alarm is None for t in told)
    assert told[-1].delay_s == pytest.approx(0.04, abs=0.005)


def test_what_is_no_number_and_options_out_of_range_are_refused() -> None:
    tracker = deadtime.Tracker(0.01)
    with pytest.raises(DelayError):
        tracker.push(math.nan, 0.0)
    with pytest.raises(DelayError):
        tracker.push(0.0, math.inf)
    with pytest.raises(DelayError, match="learn"):
        deadtime.Tracker(0.01, learn=3)
    with pytest.raises(TimeError):
        deadtime.Tracker(0.0)

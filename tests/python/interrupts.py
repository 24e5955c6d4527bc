"""Ctrl-C in the middle of work."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable

import pytest


def interrupted(work: Callable[[], object], after: float = 0.3) -> float:
    """Sends this process SIGINT so many seconds after the work began; returns the seconds until it was heard."""
    sent: list[float] = []

    def interrupt() -> None:
        sent.append(time.monotonic())
        os.kill(os.getpid(), signal.SIGINT)

    timer = threading.Timer(after, interrupt)
    timer.start()
    try:
        work()
    except KeyboardInterrupt:
        return time.monotonic() - sent[0]
    finally:
        timer.cancel()
    pytest.fail("the work was done before it was interrupted")

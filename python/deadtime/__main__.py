"""The command line: `deadtime`, or `python -m deadtime`."""

from __future__ import annotations

import signal
import sys
from typing import NoReturn

from ._native import _command


def main() -> NoReturn:
    """Runs the program with the words that were typed, and ends with its exit code."""
    # Nothing of Python's runs until it is done: Ctrl-C is the operating system's business.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    sys.stdout.flush()
    sys.exit(_command(["deadtime", *sys.argv[1:]]))


if __name__ == "__main__":
    main()

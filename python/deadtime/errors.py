"""What stops the program from answering: one class per kind of error.

"No delay visible", "none" and "unknown" are results, not errors.
"""

from __future__ import annotations


class DeadtimeError(Exception):
    """The base of all of them."""


class TimeError(DeadtimeError):
    """A sample time or delay that cannot be."""


class LogError(DeadtimeError):
    """A log that cannot be read or used."""


class ModelError(DeadtimeError):
    """A model that cannot be built, read or converted."""


class SignalError(DeadtimeError):
    """A signal that cannot be made."""


class SimulateError(DeadtimeError):
    """A simulation that cannot be run."""


class GapError(DeadtimeError):
    """A gap that cannot be diagnosed."""


class EffectError(DeadtimeError):
    """An effect that cannot be applied."""


class DelayError(DeadtimeError):
    """An estimation that cannot be set up."""


class DiagnosisError(DeadtimeError):
    """A diagnosis that cannot be read or written."""


class BlindError(DeadtimeError):
    """Blind cases, verdicts or labels that cannot be used."""


class StudyError(DeadtimeError):
    """A study that cannot be planned, run or read."""


class RegistryError(DeadtimeError):
    """A name or option that no list knows."""


class FileError(DeadtimeError, OSError):
    """The operating system refused a file: `filename` and `errno` say which and why."""

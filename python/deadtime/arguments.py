"""Numbers that a person passes, refused with a remedy before anything is begun."""

from __future__ import annotations

from typing import overload


def whole(what: str, value: int, least: int) -> int:
    """The value of the argument `what`, a whole number from `least` on."""
    if isinstance(value, bool) or not hasattr(value, "__index__"):
        raise TypeError(f"{what} is {value!r}, not a whole number")
    if not least <= int(value) < 2**63:
        raise ValueError(f"{what} is {value}; it must be at least {least}")
    return int(value)


@overload
def perhaps(what: str, value: None, least: int) -> None: ...
@overload
def perhaps(what: str, value: int | None, least: int) -> int | None: ...
def perhaps(what: str, value: int | None, least: int) -> int | None:
    """The same of one that may be left out."""
    return None if value is None else whole(what, value, least)

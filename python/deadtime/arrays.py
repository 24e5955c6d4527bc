"""Arrays of numbers, and the responses that are made of them."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy
from numpy.typing import NDArray

Array: TypeAlias = "NDArray[numpy.float64]"
ComplexArray: TypeAlias = "NDArray[numpy.complex128]"


class TimeResponse(NamedTuple):
    """A response from rest, one for every pair of output and input."""

    #: s, shape (N,).
    time: Array
    #: Shape (N, p, m): output i under input j alone; (N,) where there is one of each.
    y: Array

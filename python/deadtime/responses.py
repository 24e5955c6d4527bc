"""Frequency responses from logs, without a model."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy
from numpy.typing import NDArray

from . import _native
from .logs import LogLike, as_logs
from .results import PrintedResult

if TYPE_CHECKING:
    import control

#: How a frequency response is estimated.
ResponseMethod: TypeAlias = Literal["lpm", "welch"]


class FrequencyResponse(PrintedResult):
    """Responses of p outputs to m inputs at N frequencies; printed, it is what `deadtime response` prints.

    Made by `frequency_response`. The response is that of samples: a zero-order hold at the input adds half a sample of delay.

    Parameters
    ----------
    file : str
        The text of `deadtime/response@1`.
    text : str
        What the command line prints.

    Attributes
    ----------
    frequency_hz : array, shape (N,)
        Frequencies, Hz, increasing; what the inputs do not excite is absent.
    response : complex array, shape (p, m, N)
        The response, in each output's unit per the input's.
    std : array, shape (p, m, N)
        Standard deviation of the real part, and of the imaginary part.
    coherence : array, shape (p, m, N)
        Squared coherence of each input and output, the other inputs' parts removed.
    gain_ci95, phase_ci95_rad : arrays, shape (p, m, N, 2)
        95 % intervals; of a phase NaN where the interval of the gain holds 0.
    inputs, outputs, references : list of str
        Their names.
    sample_time_s : float
        Sample time, s.
    method : str
        The method.
    notes : list of str
        What a reader must know.
    """

    def __init__(self, file: str, text: str) -> None:
        self._file, self._text = file, text
        data = self._data
        self.inputs: list[str] = [channel["name"] for channel in data["inputs"]]
        self.outputs: list[str] = [channel["name"] for channel in data["outputs"]]
        self.references: list[str] = [channel["name"] for channel in data["references"]]
        self.sample_time_s: float = data["sample_time_s"]
        self.method: str = data["method"]
        self.notes: list[str] = data["notes"]
        pairs = {(pair["output"], pair["input"]): pair for pair in data["responses"]}

        def every(key: str) -> NDArray[numpy.float64]:
            return numpy.array([[pairs[y, u][key] for u in self.inputs] for y in self.outputs], dtype=float)

        self.frequency_hz: NDArray[numpy.float64] = numpy.array(data["responses"][0]["frequency_hz"], dtype=float)
        self.response: NDArray[numpy.complex128] = every("real") + 1j * every("imag")
        self.std: NDArray[numpy.float64] = every("std")
        self.coherence: NDArray[numpy.float64] = every("coherence")
        self.gain_ci95: NDArray[numpy.float64] = every("gain_ci95")
        unknown = [numpy.nan, numpy.nan]
        phases = [[[ends or unknown for ends in pairs[y, u]["phase_ci95_rad"]] for u in self.inputs] for y in self.outputs]
        self.phase_ci95_rad: NDArray[numpy.float64] = numpy.array(phases, dtype=float)

    @property
    def omega_rad_s(self) -> NDArray[numpy.float64]:
        """The frequencies, rad/s."""
        return 2 * numpy.pi * self.frequency_hz

    def to_control(self) -> control.FrequencyResponseData:
        """The response as a `control.FrequencyResponseData`, which `deadtime.estimate_frf` takes too.

        Raises
        ------
        ImportError
            python-control is not installed.

        Examples
        --------
        >>> import deadtime
        >>> found = deadtime.frequency_response("examples/two_inputs.csv", ["heater", "fan"], "temperature")
        >>> found.to_control().ninputs
        2
        """
        import control

        return control.FrequencyResponseData(self.response, self.omega_rad_s)


def frequency_response(
    log: LogLike | Iterable[LogLike],
    inputs: str | Sequence[str],
    outputs: str | Sequence[str],
    *,
    method: ResponseMethod = "lpm",
    references: str | Sequence[str] = (),
    options: Mapping[str, Any] | None = None,
    threads: int | None = None,
) -> FrequencyResponse:
    """Frequency responses of logs without a model, as `deadtime response` makes them.

    Parameters
    ----------
    log : log-like, or several
        A `Log`, the path of a CSV file, a frame, a dict of arrays with a key `time`; several are records of one machine on one even grid.
    inputs, outputs : str or sequence of str
        Channels: commands and responses.
    method : {"lpm", "welch"}
        `lpm` takes leakage and transients out; `welch` averages spectra of segments.
    references : str or sequence of str
        Of a closed loop what is fed into it from outside, one channel for each input.
    options : dict, optional
        Options of the method: `{"segment": 512}`.
    threads : int, optional
        Threads to use; default one for each core.

    Returns
    -------
    FrequencyResponse
        The responses with standard deviations and coherence.

    Raises
    ------
    ModelError
        Too few samples, inputs that excite nothing or are combinations of each other.
    LogError, RegistryError
        Unknown channels, methods or options.

    Examples
    --------
    >>> import deadtime
    >>> found = deadtime.frequency_response("examples/two_inputs.csv", ["heater", "fan"], "temperature")
    >>> found.response.shape == found.std.shape == (1, 2, len(found.frequency_hz))
    True
    """

    def listed(names: str | Sequence[str]) -> list[str]:
        return [names] if isinstance(names, str) else list(names)

    channels = (listed(inputs), listed(outputs), listed(references))
    return FrequencyResponse(*_native._frequency_response(as_logs(log), channels, method, dict(options or {}), threads))

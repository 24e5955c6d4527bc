"""Dead times: estimated in logs, arrays and event times, and predicted before anything is estimated."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypedDict

import numpy
from numpy.typing import ArrayLike, NDArray

from . import _native, plotting
from ._native import Log
from .arguments import perhaps
from .errors import RegistryError
from .logs import LogLike, as_logs
from .models import ModelLike, as_model
from .results import FileResult

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

#: What is taken off each channel first.
Detrend: TypeAlias = Literal["none", "mean", "line"]
#: What is known of feedback in a log.
Loop: TypeAlias = Literal["auto", "open", "closed"]
#: Options by method: `{"oestruc": {"nf": 3}}`.
Options: TypeAlias = Mapping[str, Mapping[str, Any]]

_Array: TypeAlias = "NDArray[numpy.float64]"
#: Lags, s; coefficients; their standard deviations.
_Response: TypeAlias = "tuple[_Array, _Array, _Array]"


class Finding(TypedDict):
    """What a record shows that not every method withstands."""

    #: `feedback`, `unstable_plant`, `coloured_noise`, `dynamics`, `missing_outputs` or `other_inputs`.
    condition: str
    #: The same in a few words.
    words: str
    #: What shows it.
    evidence: str


class Precision(TypedDict):
    """What is to be expected of a method on some data."""

    #: Standard deviation of its answer, s, with the resolution of methods that count samples.
    std_s: float
    #: The share of the data alone in that, s.
    data_std_s: float
    #: Half the distance between the responses at neighbouring whole delays, over the noise; below 3 they are barely distinguishable.
    separation: float


@dataclass(frozen=True)
class Estimate:
    """One method's answer for one input and one output; fields are called as in `deadtime/estimate@1`.

    Attributes
    ----------
    method : str
        The method.
    outcome : str
        `found` or `at_edge` (these have a `delay_s`), `not_visible`, `not_rich_enough`, `singular`, `not_converged`, `flat`, `not_applicable`.
    delay_s : float or None
        The dead time, s: what the method found less the degree bias.
    std_s : float or None
        Its standard deviation, s.
    ci95_s : tuple[float, float] or None
        Its 95 % interval, s.
    raw_delay_s : float or None
        What the method's original definition returns, s.
    degree_bias_samples : float
        Samples taken off the raw value: the relative degree of the sampled plant.
    note : str or None
        What a reader must know besides.
    predicted_std_s : float or None
        The standard deviation that was to be expected before the method ran, s.
    time_s : float
        Run time, s.
    class_ : str
        The class of methods that it belongs to.
    counts : bool
        The verdict may use it: a delay was found, and neither the record nor the residuals of the method contradict its assumptions.
    distrust : tuple[str, ...]
        What the record shows that the method does not withstand.
    contradicted : bool
        What the method leaves over contradicts its own model.
    """

    method: str
    outcome: str
    delay_s: float | None
    std_s: float | None
    ci95_s: tuple[float, float] | None
    raw_delay_s: float | None
    degree_bias_samples: float
    note: str | None
    predicted_std_s: float | None
    time_s: float
    class_: str
    counts: bool
    distrust: tuple[str, ...]
    contradicted: bool

    def __repr__(self) -> str:
        if self.delay_s is None:
            return f"<Estimate {self.method}: {self.outcome.replace('_', ' ')}>"
        interval = "" if self.ci95_s is None else f" (95 %: {self.ci95_s[0]:.6g} to {self.ci95_s[1]:.6g})"
        return f"<Estimate {self.method}: {self.outcome.replace('_', ' ')}, {self.delay_s:.6g} s{interval}>"


@dataclass(frozen=True)
class Verdict:
    """The verdict on the answers of many methods.

    Attributes
    ----------
    delay_s : float or None
        The dead time, s; None where none is trusted.
    ci95_s : tuple[float, float] or None
        Its 95 % interval, s.
    why : str
        The reason, a sentence.
    method : str or None
        The method whose answer it is.
    """

    delay_s: float | None
    ci95_s: tuple[float, float] | None
    why: str
    method: str | None


@dataclass(frozen=True)
class Pair:
    """All answers for one input and one output.

    Attributes
    ----------
    input : str
        The input.
    output : str
        The output; `*` where an answer holds whatever the output.
    estimates : tuple[Estimate, ...]
        One answer per method; `pair["oestruc"]` is that method's.
    verdict : Verdict
        The verdict.
    findings : tuple[Finding, ...]
        What the record shows: feedback, coloured noise, …
    warning : str or None
        Poor excitation and outliers, if any.
    moving : dict or None
        A delay that changes, as `deadtime/estimate@1` has it: its `kind`, `stretches`, `rate`, `quantiles_s`, `gain`; None where one delay describes the records.
    track : dict or None
        The dead time against time with its 95 % band, where it was asked for: lists `record`, `time_s`, `delay_s`, `low_s`, `high_s`.
    jitter : dict or None
        How long single events take: `events`, `std_s`, `quantiles` (`share`, `delay_s`, `ci95_s`), `longest_s`; None where there are no events.
    """

    input: str
    output: str
    estimates: tuple[Estimate, ...]
    verdict: Verdict
    findings: tuple[Finding, ...]
    warning: str | None
    moving: dict[str, Any] | None
    track: dict[str, list[float]] | None
    jitter: dict[str, Any] | None

    def __getitem__(self, method: str) -> Estimate:
        """The answer of one method."""
        for estimate in self.estimates:
            if estimate.method == method:
                return estimate
        raise KeyError(f"{method} did not run; there are: {', '.join(e.method for e in self.estimates)}")


class Estimates(FileResult):
    """What the methods say of every pair of inputs and outputs; printed, it is what `deadtime estimate` prints.

    Made by `estimate` and `estimate_events`.

    Parameters
    ----------
    file : str
        The text of `deadtime/estimate@1`.
    beside : dict
        What a reader should know with it.
    logs : sequence of Log
        What was estimated in, for the impulse responses of a figure.
    detrend : {"mean", "none", "line"}
        What was taken off each channel first.

    Attributes
    ----------
    log : str
        What the log is called.
    sample_time_s : float
        Sample time, s.
    max_delay_s : float
        The longest delay that was searched, s.
    pairs : tuple of Pair
        One entry per input and output; `estimates[input, output]` finds one.
    """

    log: str
    sample_time_s: float
    max_delay_s: float
    pairs: tuple[Pair, ...]

    def __init__(self, file: str, beside: dict[str, Any], logs: Sequence[Log] = (), detrend: Detrend = "mean") -> None:
        data = json.loads(file)
        self.log, self.sample_time_s, self.max_delay_s = data["log"], data["sample_time_s"], data["max_delay_s"]
        self.pairs = tuple(_pair(pair, more) for pair, more in zip(data["pairs"], beside["pairs"], strict=True))
        self._file = file
        self._texts: tuple[str, str, str] = (beside["preamble"], beside["text"], beside["full"])
        self._logs, self._detrend = tuple(logs), detrend
        self._responses: dict[tuple[str, str], _Response | None] = {}

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Estimates) and self._file == other._file

    def __hash__(self) -> int:
        return hash(self._file)

    def __getstate__(self) -> dict[str, Any]:
        """Without the logs, with what a figure needs of them."""
        for pair in self.pairs:
            self._response(pair)
        return self.__dict__ | {"_logs": ()}

    @property
    def pair(self) -> Pair:
        """The only pair.

        Raises
        ------
        ValueError
            There are several.
        """
        if len(self.pairs) == 1:
            return self.pairs[0]
        there = ", ".join(f"{p.input} → {p.output}" for p in self.pairs) or "none"
        raise ValueError(f"this asks for a result of one pair; take one of estimates.pairs or estimates[input, output]: {there}")

    @property
    def verdict(self) -> Verdict:
        """The verdict on the only pair."""
        return self.pair.verdict

    @property
    def best(self) -> Estimate | None:
        """The answer that the verdict on the only pair took; None where no dead time is trusted."""
        pair = self.pair
        return None if pair.verdict.method is None else pair[pair.verdict.method]

    @property
    def delay_s(self) -> float | None:
        """The dead time of the only pair, s; None where none is trusted."""
        return self.verdict.delay_s

    def __getitem__(self, channels: tuple[str, str]) -> Pair:
        """The pair of an input and an output."""
        for pair in self.pairs:
            if (pair.input, pair.output) == tuple(channels):
                return pair
        raise KeyError(f"{channels}: there are {', '.join(f'{p.input} → {p.output}' for p in self.pairs)}")

    def to_json(self) -> str:
        """The text of the file format `deadtime/estimate@1`."""
        return self._file

    def to_text(self, full: bool = False) -> str:
        """What the command line prints.

        Parameters
        ----------
        full : bool
            Every method with every number, in wide tables, also those that the verdict leaves out.
        """
        _, short, whole = self._texts
        return whole if full else short

    def __repr__(self) -> str:
        return self.to_text()

    def to_pandas(self) -> pandas.DataFrame:
        """One row per pair and method, with the columns of `Estimate`; the interval is `ci95_low_s`, `ci95_high_s`."""
        import pandas

        rows = []
        for pair in self.pairs:
            for e in pair.estimates:
                low, high = e.ci95_s if e.ci95_s is not None else (None, None)
                row = {"input": pair.input, "output": pair.output, "method": e.method, "class": e.class_, "outcome": e.outcome, "delay_s": e.delay_s}
                row |= {"std_s": e.std_s, "ci95_low_s": low, "ci95_high_s": high, "raw_delay_s": e.raw_delay_s}
                row |= {"degree_bias_samples": e.degree_bias_samples, "predicted_std_s": e.predicted_std_s, "counts": e.counts}
                rows.append(row | {"note": e.note, "time_s": e.time_s})
        frame = pandas.DataFrame(rows)
        numbers = ["delay_s", "std_s", "ci95_low_s", "ci95_high_s", "raw_delay_s", "predicted_std_s"]
        return frame.astype(dict.fromkeys([n for n in numbers if n in frame.columns], "float64"))

    def _repr_html_(self) -> str:
        answers = [f"{p.input} → {'the states' if p.output == '*' else p.output}: {_believed(p)}" for p in self.pairs]
        # A figure for each of many pairs would be a page of its own.
        picture = plotting.image(self.plot, "; ".join(answers)) if len(self.pairs) <= _PICTURES else ""
        said = "".join(f"<p><b>{escape(answer)}</b></p>" for answer in answers)
        return said + plotting.folded(picture, self._tables())

    def _tables(self) -> str:
        parts = [f"<p>{escape(self._texts[0])}</p>"]
        for pair in self.pairs:
            target = "the states" if pair.output == "*" else pair.output
            parts.append(f"<h4>{escape(pair.input)} → {escape(target)}</h4>")
            if pair.findings:
                shown = "; ".join(f"{f['words']} ({f['evidence']})" for f in pair.findings)
                parts.append(f"<p>The record shows {escape(shown)}.</p>")
            headings = ["method", "outcome", "dead time (s)", "std (s)", "predicted (s)", "95 % interval (s)", "counts"]
            parts.append("<table><thead><tr>" + "".join(f"<th>{h}</th>" for h in headings) + "</tr></thead><tbody>")
            for e in pair.estimates:
                interval = "–" if e.ci95_s is None else f"{e.ci95_s[0]:.6g} … {e.ci95_s[1]:.6g}"
                style = "" if e.counts else ' style="color: grey"'
                cells = [e.method, e.outcome.replace("_", " "), _number(e.delay_s), _number(e.std_s), _number(e.predicted_std_s), interval]
                cells.append("yes" if e.counts else "–" if e.outcome != "found" else "no")
                hint = "" if e.note is None else f' title="{escape(e.note)}"'
                parts.append(f"<tr{style}{hint}>" + "".join(f"<td>{escape(c)}</td>" for c in cells) + "</tr>")
            parts.append("</tbody></table>")
            if pair.warning is not None:
                parts.append(f"<p>{escape(pair.warning)}</p>")
            v = pair.verdict
            if pair.moving is not None:
                parts.append(f"<p><b>{escape(v.why)}</b>.</p>")
            elif v.delay_s is None or v.ci95_s is None:
                parts.append(f"<p><b>No trusted dead time</b>: {escape(v.why)}.</p>")
            else:
                parts.append(f"<p><b>Dead time {v.delay_s:.6g} s</b> ({v.ci95_s[0]:.6g} to {v.ci95_s[1]:.6g} s): {escape(v.why)}.</p>")
        return "".join(parts)

    def _response(self, pair: Pair) -> _Response | None:
        """The impulse response of a pair of channels, made once."""
        key = (pair.input, pair.output)
        if key not in self._responses:
            between = pair.output != "*" and bool(self._logs)
            self._responses[key] = estimate_impulse_response(self._logs, *key, detrend=self._detrend) if between else None
        return self._responses[key]

    def plot(self) -> Figure:
        """A figure: every method's dead time with its 95 % interval, above the estimated impulse response, pair by pair.

        Grey answers are not counted; the band is the verdict.

        Raises
        ------
        ImportError
            matplotlib is not there: `pip install deadtime[plot]`.
        """
        return plotting.estimates([_drawn(pair, self._response(pair)) for pair in self.pairs], self.sample_time_s)



def _drawn(pair: Pair, response: _Response | None) -> plotting.PairAnswers:
    """What a figure shows of a pair."""
    answers = [plotting.Answer(e.method, e.outcome, e.delay_s, e.ci95_s, e.raw_delay_s, e.counts) for e in pair.estimates]
    return plotting.PairAnswers(pair.input, pair.output, answers, pair.verdict.delay_s, pair.verdict.ci95_s, response)


#: As many pairs as one picture holds.
_PICTURES = 6


def _believed(pair: Pair) -> str:
    """The verdict in one line."""
    v = pair.verdict
    if v.delay_s is None or v.ci95_s is None:
        return "no trusted dead time"
    return f"dead time {v.delay_s:.4g} s ({v.ci95_s[0]:.4g} to {v.ci95_s[1]:.4g} s)"


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.6g}"


def estimate(
    log: LogLike | Iterable[LogLike],
    inputs: str | Sequence[str],
    outputs: str | Sequence[str],
    *,
    method: str | Sequence[str] = "all",
    max_delay: float | None = None,
    model: ModelLike | None = None,
    detrend: Detrend = "mean",
    degree_bias: int | None = None,
    loop: Loop = "auto",
    options: Options | None = None,
    resample: float | None = None,
    window: tuple[float | None, float | None] | None = None,
    track: bool = False,
    threads: int | None = None,
) -> Estimates:
    """The dead time between inputs and outputs of a log, by one method or by all, with a verdict.

    Parameters
    ----------
    log : log-like, or several
        A `Log`, the path of a CSV file, a frame, a dict of arrays with a key `time`; several are records of one experiment on one even grid.
    inputs, outputs : str or sequence of str
        Channels: commands and responses. Every pair of an input and an output is estimated.
    method : str or sequence of str
        Names of methods, or `all`; `deadtime.methods()` lists them.
    max_delay : float, optional
        Longest delay to search, s; default 35 samples (at most 25 % of the longest record), doubled up to 33 % of it while the response begins later.
    model : model-like, optional
        Linear model of the plant: adds `state_least_squares` (its pairs have the output `*`) and the model's own degree bias.
    detrend : {"mean", "none", "line"}
        What to take off each channel first.
    degree_bias : int, optional
        Samples that the plant needs to respond without any dead time (its relative degree when sampled); default the model's, or 1.
    loop : {"auto", "open", "closed"}
        What is known of feedback; `auto` looks for it.
    options : dict of dict, optional
        Options by method, such as `{"oestruc": {"nf": 3}}`.
    resample : float, optional
        Put logs onto an even grid of this sample time first, s: inputs are held, outputs interpolated.
    window : (float or None, float or None), optional
        The part to use, s from each log's first sample.
    track : bool
        The dead time against time too: `pair.track`.
    threads : int, optional
        Threads to use; default all.

    Returns
    -------
    Estimates
        Pairs with their answers and verdicts.

    Raises
    ------
    LogError
        A channel that is not there, uneven time stamps, missing input samples, with the place and the remedy.
    DelayError
        A channel that never moves, a window longer than the log, a model that does not fit.
    RegistryError
        A method or option that there is not.
    ModelError
        A model that cannot be read or used.

    Examples
    --------
    >>> import deadtime
    >>> u = deadtime.excite("rbs", 400)
    >>> y = numpy.convolve(u, [0, 0, 0, 0, 1, 0.5])[:400]
    >>> log = {"time": 0.1 * numpy.arange(400), "u": u, "y": y}
    >>> round(deadtime.estimate(log, "u", "y", method="arxstruc").delay_s, 6)
    0.3
    """
    logs, asked = _asked(log, inputs, outputs, method, max_delay, detrend, degree_bias, loop, options, resample, window)
    plant = None if model is None else as_model(model)
    asked["track"] = track
    file, beside = _native._estimate(logs, plant, _plain(options), asked, perhaps("threads", threads, 1))
    return Estimates(file, beside, logs, detrend)


def estimate_delay(
    u: ArrayLike,
    y: ArrayLike,
    sample_time: float,
    *,
    method: str = "oestruc",
    max_delay: float | None = None,
    detrend: Detrend = "mean",
    degree_bias: int | None = None,
    **options: Any,
) -> Estimate:
    """The dead time from one array to another by one method: the short way.

    Parameters
    ----------
    u : array, shape (N,)
        The input (command).
    y : array, shape (N,)
        The output (response); NaN marks a missing sample.
    sample_time : float
        Sample time, s.
    method : str
        The method; `deadtime.methods()` lists them. For all methods and a verdict give the arrays to `estimate`.
    max_delay : float, optional
        Longest delay to search, s; default 35 samples, at most 25 % of the record.
    detrend : {"mean", "none", "line"}
        What to take off each channel first.
    degree_bias : int, optional
        Samples that the plant needs to respond without any dead time; default 1, a strictly proper plant behind a zero-order hold.
    **options
        Options of the method, such as `nf=3`.

    Returns
    -------
    Estimate
        Delay, standard deviation and 95 % interval, s; `outcome` says so where there is none.

    Raises
    ------
    LogError, DelayError, RegistryError, TimeError
        As `estimate`; a sample time that cannot be.

    Examples
    --------
    >>> import deadtime
    >>> u = deadtime.excite("rbs", 400)
    >>> y = numpy.convolve(u, [0, 0, 0, 0, 1, 0.5])[:400]
    >>> deadtime.estimate_delay(u, y, 0.1).outcome
    'found'
    """
    if method == "all" or not isinstance(method, str):
        raise ValueError('estimate_delay runs one method; for several give the arrays to `estimate({"time": t, "u": u, "y": y}, "u", "y")`')
    given = _known(method)
    if given.scope != "pair":
        raise ValueError(f"{method} looks at {given.scope}, not at one input and one output; use {'estimate_events' if given.scope == 'events' else 'estimate'}")
    log = _native._of_arrays(_flat(u, "u"), _flat(y, "y"), sample_time)
    return estimate(
        log, "u", "y", method=method, max_delay=max_delay, detrend=detrend, degree_bias=degree_bias, options={method: options}
    ).pair.estimates[0]


def estimate_events(
    first: ArrayLike,
    second: ArrayLike,
    *,
    method: str | Sequence[str] = "all",
    max_delay: float | None = None,
    paired: bool = False,
    options: Options | None = None,
    names: tuple[str, str] = ("first", "second"),
    units: tuple[str | None, str | None] = (None, None),
) -> Estimates:
    """The delay between two sequences of event times: when the same events were seen at two places.

    Parameters
    ----------
    first, second : array, shapes (N,) and (M,)
        Times of the events at the two places, s, increasing; either place may have missed some.
    method : str or sequence of str
        Names of methods whose scope is `events`, or `all`.
    max_delay : float, optional
        Longest delay to search, s; default 35 typical intervals of the first sequence.
    paired : bool
        `first[i]` and `second[i]` are one event, as sent and received times of one packet: equal lengths, and `second` need not increase.
    options : dict of dict, optional
        Options by method.
    names : (str, str)
        What the two sequences are called.
    units : (str or None, str or None)
        Their units, where they are not seconds.

    Returns
    -------
    Estimates
        One pair.

    Raises
    ------
    DelayError
        Times that do not increase or are no numbers, fewer than two events.
    ValueError
        `paired` with sequences of different lengths.

    Examples
    --------
    >>> import deadtime, numpy
    >>> first = numpy.cumsum(numpy.random.default_rng(1).exponential(1.0, 40))
    >>> round(deadtime.estimate_events(first, first + 0.4).verdict.delay_s, 6)
    0.4
    """
    chosen = _names(method)
    _check_options(chosen, options, ("events",))
    sequences = [(name, unit, _flat(times, name)) for name, unit, times in zip(names, units, (first, second), strict=True)]
    lengths = [len(times) for _, _, times in sequences]
    if paired and lengths[0] != lengths[1]:
        raise ValueError(f"paired events: {names[0]} has {lengths[0]} times and {names[1]} has {lengths[1]}; leave paired out if either place missed some")
    file, beside = _native._estimate_events(sequences[0], sequences[1], chosen, _plain(options), "events", max_delay, paired)
    return Estimates(file, beside, [], "none")


def estimate_frf(
    frequency: ArrayLike | str | os.PathLike[str] | Any,
    response: ArrayLike | None = None,
    *,
    unit: Literal["rad/s", "Hz"] = "rad/s",
    coherence: ArrayLike | None = None,
    std: ArrayLike | None = None,
    method: str | Sequence[str] = "all",
    max_delay: float | None = None,
    options: Options | None = None,
    threads: int | None = None,
) -> Estimates:
    """The dead time in a measured frequency response, given poles and zeros of the plant.

    Parameters
    ----------
    frequency : array, shape (N,), path, or frequency response data of python-control
        Frequencies, increasing; or a text file as `deadtime estimate --frf` reads it; or an object with `omega` and `frdata` (`control.frd`) of one input and one output.
    response : array of complex, shape (N,), optional
        The response at each frequency; left out where `frequency` holds it.
    unit : {"rad/s", "Hz"}
        Unit of an array of frequencies.
    coherence : array, shape (N,), optional
        Squared coherence, between 0 and 1.
    std : array, shape (N,), optional
        Standard deviation of the real part, and of the imaginary part. Without it and coherence, errors of one size and errors in proportion to the response are both tried.
    method : str or sequence of str
        `rational` (poles, zeros and delay fitted together), `bode_phase` (the phase that the magnitude does not explain), or `all`.
    max_delay : float, optional
        Longest delay to search, s; default forty periods of the highest frequency, at most half of what the distance of the frequencies resolves.
    options : dict of dict, optional
        Options by method: `{"rational": {"max_poles": 8}}`.
    threads : int, optional
        Threads to use; default one for each core.

    Returns
    -------
    Estimates
        One pair, `input` to `output`.

    Raises
    ------
    LogError
        Frequencies that do not increase, values that are no numbers, too few of them.
    DelayError
        A search beyond what the frequencies resolve.

    Examples
    --------
    >>> import deadtime, numpy
    >>> omega = numpy.geomspace(0.1, 30, 60)
    >>> response = numpy.exp(-0.43j * omega) * 2 / (1 + 0.8j * omega)
    >>> round(deadtime.estimate_frf(omega, response).delay_s, 6)
    0.43
    """
    chosen = _names(method)
    nothing = numpy.zeros(0)
    if isinstance(frequency, (str, os.PathLike)):
        if response is not None or coherence is not None or std is not None:
            raise ValueError("a file holds frequencies, response and quality: leave out response, coherence and std")
        file, beside = _native._estimate_response(
            os.fspath(frequency), nothing, nothing, nothing, ("", nothing), chosen, _plain(options), max_delay, threads
        )
        return Estimates(file, beside, [], "none")
    if hasattr(frequency, "omega"):
        # frequency response data of python-control: `fresp` of older versions, `frdata` of newer ones
        data = getattr(frequency, "frdata", None)
        data = getattr(frequency, "fresp", None) if data is None else data
        if data is None or response is not None:
            raise ValueError("an object with `omega` must hold the response too, as `frdata`, and response is then left out")
        values = numpy.asarray(data)
        if values.ndim == 3 and values.shape[:2] != (1, 1):
            raise ValueError(f"{values.shape[0]} outputs and {values.shape[1]} inputs: take one response out of the system, such as system[0, 0]")
        response, frequency, unit = values.reshape(-1), numpy.asarray(frequency.omega), "rad/s"
    if response is None:
        raise ValueError("response is missing: the complex value at each frequency")
    if coherence is not None and std is not None:
        raise ValueError("give coherence or std, not both")
    if unit not in ("rad/s", "Hz"):
        raise ValueError(f"unit is {unit!r}; it must be 'rad/s' or 'Hz'")
    values = numpy.asarray(response, dtype=complex).reshape(-1)
    omega = _flat(frequency, "frequency") * (2 * numpy.pi if unit == "Hz" else 1.0)
    known = ("coherence", _flat(coherence, "coherence")) if coherence is not None else ("std", _flat(std, "std")) if std is not None else ("", nothing)
    real, imag = numpy.ascontiguousarray(values.real), numpy.ascontiguousarray(values.imag)
    file, beside = _native._estimate_response(None, omega, real, imag, known, chosen, _plain(options), max_delay, threads)
    return Estimates(file, beside, [], "none")


def step_log(table: LogLike, response: str | None = None, *, size: float = 1.0, time: float | None = None) -> Log:
    """A table of a step response as a log with its step, which `estimate` takes as any other.

    Parameters
    ----------
    table : log-like
        Time and the response.
    response : str, optional
        The channel of the response; default the only one.
    size : float
        Height of the step.
    time : float, optional
        Time of the step, s; default 0, where the table holds it, or else its first row.

    Returns
    -------
    Log
        Channels `step` and the response, on an even grid; 20 samples of rest are put before a table that begins with the step.

    Raises
    ------
    LogError
        A step outside the table or between two rows, several channels of which none is named.

    Examples
    --------
    >>> import deadtime, numpy
    >>> time = numpy.arange(160.0)
    >>> level = 3 * (1 - numpy.exp(-numpy.maximum(time - 4.37, 0) / 12))
    >>> log = deadtime.step_log({"time": time, "level": level}, size=2.0)
    >>> round(deadtime.estimate(log, "step", "level", method="p1d").delay_s, 3)
    4.37
    """
    return _native._of_step(as_logs(table)[0], response, size, time)


def predict_precision(
    log: LogLike | Iterable[LogLike],
    input: str,
    output: str,
    *,
    method: str | Sequence[str] = "all",
    max_delay: float | None = None,
    model: ModelLike | None = None,
    detrend: Detrend = "mean",
    degree_bias: int | None = None,
    threads: int | None = None,
) -> dict[str, Precision | None]:
    """How precise each method can be expected to be on a log, before any estimates: the Cramér-Rao bound of what it looks at, at a rough model of the pair.

    Parameters
    ----------
    log : log-like, or several
        As in `estimate`.
    input, output : str
        The pair.
    method : str or sequence of str
        Names of methods, or `all`.
    max_delay : float, optional
        Longest delay to be searched, s; default 35 samples, at most 25 % of the longest record. No prediction is worse than this window's width over √12.
    model : model-like, optional
        As in `estimate`.
    detrend : {"mean", "none", "line"}
        What to take off each channel first.
    degree_bias : int, optional
        As in `estimate`.
    threads : int, optional
        Threads to use; default all.

    Returns
    -------
    dict of str to Precision
        By method; None where there is no prediction. A large number means that the excitation is too poor for any method.

    Raises
    ------
    LogError, DelayError, RegistryError, ModelError
        As `estimate`.

    Examples
    --------
    A delay cannot be known to less than this, whatever the method: a tenth of a sample of 0.02 s or more.

    >>> import deadtime
    >>> expected = deadtime.predict_precision("examples/uav_flight.csv", "r", "ay", method="oestruc")
    >>> 0.002 < expected["oestruc"]["std_s"] < 0.02
    True
    """
    logs, asked = _asked(log, input, output, method, max_delay, detrend, degree_bias, "auto", None, None, None)
    plant = None if model is None else as_model(model)
    (pair,) = _native._expected(logs, plant, {}, asked, perhaps("threads", threads, 1))
    return dict(pair["methods"])


def estimate_impulse_response(
    log: LogLike | Iterable[LogLike], input: str, output: str, *, detrend: Detrend = "mean"
) -> _Response | None:
    """The impulse response from one channel to another by least squares, as the method `threshold` estimates it.

    Parameters
    ----------
    log : log-like, or several
        As in `estimate`.
    input, output : str
        The channels.
    detrend : {"mean", "none", "line"}
        What to take off each channel first.

    Returns
    -------
    lag, response, std : array, shape (71,) each
        Lags, s, from 0; coefficients, output's unit per input's; their standard deviations. None where the input does not excite all of them.

    Raises
    ------
    LogError
        As `estimate`.

    Examples
    --------
    >>> import deadtime, numpy
    >>> u = deadtime.excite("rbs", 400, seed=1)
    >>> y = numpy.concatenate([numpy.zeros(3), 2.0 * u[:-3]])
    >>> lag, response, std = deadtime.estimate_impulse_response({"time": numpy.arange(400) * 0.1, "u": u, "y": y}, "u", "y")
    >>> round(float(lag[response.argmax()]), 6), round(float(response.max()), 2)
    (0.3, 2.0)
    """
    logs = as_logs(log)
    found = _native._impulse_response(logs, input, output, detrend)
    if found is None:
        return None
    response, std = found
    # A log that is not on an even grid was refused above.
    lag: _Array = numpy.arange(len(response), dtype=float) * float(logs[0].sample_time or 0.0)
    return lag, response, std


@dataclass(frozen=True)
class Method:
    """One method of the list: what it is for, its options, and where it still holds. Called with two arrays it estimates.

    Attributes
    ----------
    name : str
        Its name.
    class_ : str
        What it sees a record by: `parametric`, `process`, `threshold`, `correlation`, `frequency`, `laguerre`, `area`, `higher_order`, `states`, `events`.
    scope : str
        What it looks at: a `pair` of channels, the `states` of a model, or `events`.
    summary : str
        What it is, in one line.
    options : dict[str, Any]
        Its options with their defaults.
    withstands : tuple[str, ...]
        Complications that it withstands: `feedback`, `unstable_plant`, `coloured_noise`, `dynamics`, `missing_outputs`, `other_inputs`.
    needs : str
        What it needs.
    blind_to : str
        What it cannot see.
    exempt : dict[str, str]
        Laws that it does not promise (`shift`, `gain`, `sign`, `exact`, `silence`, `window`), and why.
    title : str
        The heading of its class.
    """

    name: str
    class_: str
    scope: str
    summary: str
    options: dict[str, Any]
    withstands: tuple[str, ...]
    needs: str
    blind_to: str
    exempt: dict[str, str]
    title: str

    def __post_init__(self) -> None:
        lines = [f"{self.name}: {self.summary}.", "", f"Class: {self.title}. Needs {self.needs}. Cannot see {self.blind_to}."]
        if self.withstands:
            lines.append(f"Withstands {', '.join(self.withstands)}.")
        lines += ["", "Options", "-------"] + [f"{key} : default {value!r}" for key, value in self.options.items()]
        object.__setattr__(self, "__doc__", "\n".join(lines))

    def __call__(self, u: ArrayLike, y: ArrayLike, sample_time: float = 1.0, **options: Any) -> Estimate:
        """The method's answer for two arrays (for event times: two sequences of them).

        Parameters
        ----------
        u, y : array, shape (N,)
            Input and output, NaN in `y` for a missing sample; or two sequences of event times, s, which may differ in length.
        sample_time : float
            Sample time, s; event times have none.
        **options
            Options of the method, and `max_delay`, `detrend`, `degree_bias` as in `estimate_delay`.
        """
        if self.scope == "events":
            common = {key: options.pop(key) for key in ("max_delay",) if key in options}
            return estimate_events(u, y, method=self.name, options={self.name: options}, **common).pair.estimates[0]
        return estimate_delay(u, y, sample_time, method=self.name, **options)

    def __repr__(self) -> str:
        options = ", ".join(f"{key}={value!r}" for key, value in self.options.items())
        return f"<Method {self.name}({options}): {self.summary}>"


class Methods(dict[str, Method]):
    """The methods by name, within a class the most trusted first."""

    def __repr__(self) -> str:
        width = max((len(name) for name in self), default=0)
        return "\n".join(f"{name:<{width}}  {method.summary}" for name, method in self.items())

    def _repr_html_(self) -> str:
        def cells(m: Method) -> str:
            options = ", ".join(f"{key}={value!r}" for key, value in m.options.items())
            return "".join(f"<td>{escape(text)}</td>" for text in (m.name, m.title, m.summary, m.needs, m.blind_to, options))

        head = "".join(f"<th>{text}</th>" for text in ("method", "class", "what it is", "needs", "cannot see", "options"))
        return f"<table><thead><tr>{head}</tr></thead><tbody>" + "".join(f"<tr>{cells(m)}</tr>" for m in self.values()) + "</tbody></table>"


def methods() -> Methods:
    """Every method there is, by name: a dict whose values describe it and can be called.

    Examples
    --------
    >>> import deadtime
    >>> deadtime.methods()["oestruc"].options["nf"]
    2
    """
    return Methods(
        (
            m["name"],
            Method(
                name=m["name"],
                class_=m["class"],
                scope=m["scope"],
                summary=m["summary"],
                options=m["options"],
                withstands=tuple(m["withstands"]),
                needs=m["needs"],
                blind_to=m["blind_to"],
                exempt={e["law"]: e["why"] for e in m["exempt"]},
                title=m["title"],
            ),
        )
        for m in _native._methods()
    )


def _known(name: str) -> Method:
    there = methods()
    if name not in there:
        raise RegistryError(f"there is no method `{name}`; there are: {', '.join(there)}")
    return there[name]


def _names(names: str | Sequence[str]) -> list[str]:
    return [names] if isinstance(names, str) else list(names)


def _check_options(chosen: list[str], options: Options | None, scopes: tuple[str, ...]) -> None:
    """Options of a method that does not run would be lost in silence."""
    there = methods()
    for name in options or {}:
        runs = name in chosen or ("all" in chosen and name in there and there[name].scope in scopes)
        if name in there and not runs:
            raise ValueError(f"options are given for {name}, which is not among the methods that run")


def _plain(options: Options | None) -> dict[str, Any]:
    """Options as JSON takes them: NumPy's numbers and arrays as plain ones."""

    def plain(value: Any) -> Any:
        if isinstance(value, numpy.ndarray | numpy.generic):
            return value.tolist()
        if isinstance(value, Mapping):
            return {str(key): plain(item) for key, item in value.items()}
        if isinstance(value, list | tuple):
            return [plain(item) for item in value]
        return value

    return {name: plain(given) for name, given in (options or {}).items()}


def _flat(values: ArrayLike, what: str) -> _Array:
    array = numpy.asarray(values, dtype=float)
    if array.ndim != 1:
        raise ValueError(f"{what} has the shape {array.shape}; give one number after the other, shape (N,)")
    return array


def _asked(
    log: LogLike | Iterable[LogLike],
    inputs: str | Sequence[str],
    outputs: str | Sequence[str],
    method: str | Sequence[str],
    max_delay: float | None,
    detrend: str,
    degree_bias: int | None,
    loop: str,
    options: Options | None,
    resample: float | None,
    window: tuple[float | None, float | None] | None,
) -> tuple[list[Log], dict[str, Any]]:
    """The logs as they are to be used, and the rest of what was asked for."""
    logs, held, chosen = as_logs(log), _names(inputs), _names(method)
    if not held or not _names(outputs):
        raise ValueError("name at least one input and one output")
    _check_options(chosen, options, ("pair", "states"))
    name = _name(logs)
    if window is not None:
        logs = [one.window(*window) for one in logs]
    if resample is not None:
        logs = [one.resample(resample, held) for one in logs]
    asked = {"name": name, "inputs": held, "outputs": _names(outputs), "methods": chosen, "max_delay": max_delay}
    asked |= {"degree_bias": perhaps("degree_bias", degree_bias, 0), "detrend": detrend, "loop": loop, "track": False}
    return logs, asked


def _name(logs: list[Log]) -> str:
    """What several records are called together: the file that they are of, else all their names."""
    names = list(dict.fromkeys(log.source.split("#", 1)[0] if len(logs) > 1 else log.source for log in logs))
    return ", ".join(names)


def _pair(pair: dict[str, Any], more: dict[str, Any]) -> Pair:
    """A pair of the file, with its notes."""
    rows = [
        Estimate(**(row | aside | {"ci95_s": _interval(row["ci95_s"]), "distrust": tuple(aside["distrust"])}))
        for row, aside in zip(pair["estimates"], more["estimates"], strict=True)
    ]
    v = pair["verdict"]
    verdict = Verdict(v["delay_s"], _interval(v["ci95_s"]), v["why"], more["method"])
    told = (pair.get("moving"), pair.get("track"), pair.get("jitter"))
    return Pair(pair["input"], pair["output"], tuple(rows), verdict, tuple(more["findings"]), more["warning"], *told)


def _interval(ends: list[float] | None) -> tuple[float, float] | None:
    return None if ends is None else (ends[0], ends[1])

"""The dead time of a machine that runs, sample by sample."""

from __future__ import annotations

from dataclasses import dataclass

from . import _native


@dataclass(frozen=True)
class Alarm:
    """Why a tracker raises its voice.

    Attributes
    ----------
    cause : str
        `delay_changed`: the dead time is another one. `response_changed`: no delay explains what the output does any more; the response is fitted anew.
    from_s, to_s : float or None
        The dead time before and now, s; None for a response that changed.
    since_s : float
        Since when, s from the first sample.
    """

    cause: str
    from_s: float | None
    to_s: float | None
    since_s: float


@dataclass(frozen=True)
class Tracking:
    """What is known after a sample.

    Attributes
    ----------
    time_s : float
        The sample's time, s from the first.
    delay_s : float or None
        The dead time, s; None while the response is fitted.
    band_s : tuple[float, float] or None
        Its 95 % band, s: wide where the input does not move.
    alarm : Alarm or None
        What happened at this sample.
    """

    time_s: float
    delay_s: float | None
    band_s: tuple[float, float] | None
    alarm: Alarm | None


class Tracker:
    """Follows the dead time between a command and a response of a machine that runs: bounded memory, some microseconds a sample.

    Parameters
    ----------
    sample_time : float
        Seconds from one sample to the next.
    max_delay : int
        Longest delay, samples, the hold's own included.
    bias : int
        Samples that the plant needs to respond without any dead time.
    na, nb : int
        Past outputs and input coefficients of the model of the response.
    learn : int
        Samples that the first response is fitted to, before anything is reported; longer where the input does not move.
    forget : int
        Samples after which an observation has 1/3 of its weight.
    alarm : float
        Log-likelihood that a change must gain before it is reported: a lower one reports sooner, with more false alarms.

    Raises
    ------
    TimeError
        A sample time that is not finite and above zero.
    DelayError
        An option out of its range.

    Examples
    --------
    >>> import deadtime
    >>> u = deadtime.excite("rbs", 1500, seed=1)
    >>> tracker, y, alarms = deadtime.Tracker(0.01), 0.0, []
    >>> for k in range(1500):
    ...     late = 5 if k < 1000 else 10
    ...     y = 0.8 * y + (u[k - late] if k >= late else 0.0) + 0.1 * (-1) ** (k // 3)
    ...     alarms += [told.alarm] if (told := tracker.push(u[k], y)).alarm else []
    >>> alarms[0].cause, round(alarms[0].to_s - alarms[0].from_s, 6)
    ('delay_changed', 0.05)
    """

    def __init__(
        self,
        sample_time: float,
        *,
        max_delay: int = 35,
        bias: int = 1,
        na: int = 6,
        nb: int = 4,
        learn: int = 600,
        forget: int = 4000,
        alarm: float = 20.0,
    ) -> None:
        self._running = _native._Tracker(sample_time, max_delay, bias, na, nb, learn, forget, alarm)

    def push(self, u: float, y: float) -> Tracking:
        """What is known once this sample has come.

        Parameters
        ----------
        u : float
            The command given at it.
        y : float
            The response measured at it; NaN where it was not measured.

        Raises
        ------
        DelayError
            A command that is not finite, or an infinite response; the sample is left out.
        """
        time_s, delay_s, band_s, alarm = self._running.push(u, y)
        band = None if band_s is None else (band_s[0], band_s[1])
        return Tracking(time_s, delay_s, band, None if alarm is None else Alarm(*alarm))

"""How well a delay can be known at all: lower bounds on the standard deviation of any unbiased estimate, and what happens where they fail.

Standard deviations are in the unit of time that goes in: samples where signals go in, seconds where frequencies or time constants do.
A ratio `snr` is that of the power of the signal to that of the noise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from numpy.typing import ArrayLike

from . import _native
from .delays import _flat


def two_sensors_white(samples: int, snr: float) -> float:
    """Two sensors that see one white signal in white noise of the same ratio: √(3(1 + 2ρ)/(π²Nρ²)) samples.

    Parameters
    ----------
    samples : int
        Samples N.
    snr : float
        Ratio ρ of powers at each sensor.

    References
    ----------
    Knapp and Carter (1976), IEEE Trans. ASSP 24(4), 320-327, doi:10.1109/TASSP.1976.1162830, for a flat spectrum up to half the sampling rate.

    Examples
    --------
    √9/(π·√1000):

    >>> import deadtime
    >>> round(deadtime.bounds.two_sensors_white(1000, 1.0), 4)
    0.0302
    """
    return _native._two_sensors_white(samples, snr)


def two_sensors(duration_s: float, band_hz: tuple[float, float], coherence: Callable[[float], float]) -> float:
    """Two sensors with magnitude-squared coherence γ²(f): (2T∫(2πf)²·γ²/(1 − γ²)·df)^(−½) seconds.

    Parameters
    ----------
    duration_s : float
        T, s.
    band_hz : (float, float)
        The band, Hz.
    coherence : callable
        γ² at a frequency in Hz, 0 to 1.

    References
    ----------
    As `two_sensors_white`.

    Examples
    --------
    Equal parts of signal and noise up to 5 Hz, over 10 s:

    >>> import deadtime
    >>> round(deadtime.bounds.two_sensors(10.0, (0.0, 5.0), lambda f: 0.5), 4)
    0.0055
    """
    return _native._two_sensors(duration_s, band_hz, coherence)


def reference_white(samples: int, snr: float) -> float:
    """A white signal known without noise, its delayed copy in white noise: √(3/(π²Nρ)) samples.

    Parameters
    ----------
    samples : int
        Samples N.
    snr : float
        Ratio ρ of powers at the copy.

    References
    ----------
    Kay (1993), Fundamentals of Statistical Signal Processing: Estimation Theory, example 3.13.

    Examples
    --------
    >>> import deadtime
    >>> round(deadtime.bounds.reference_white(1000, 10.0), 4)
    0.0055
    """
    return _native._reference_white(samples, snr)


def reference(signal: ArrayLike, noise_std: float) -> float:
    """Any band-limited signal known without noise: σ/‖dy/dt‖ samples, the derivative by its spectrum.

    Parameters
    ----------
    signal : array, shape (N,)
        The signal.
    noise_std : float
        Standard deviation σ of the noise of a sample, in the signal's unit.

    References
    ----------
    As `reference_white`.

    Examples
    --------
    A sine of 10 periods in 100 samples; its slope has the norm 0.2·π·√50:

    >>> import deadtime, numpy
    >>> sine = numpy.sin(0.2 * numpy.pi * numpy.arange(100))
    >>> round(deadtime.bounds.reference(sine, 0.1), 4)
    0.0225
    """
    return _native._reference(_flat(signal, "signal"), noise_std)


def known_model(slope: ArrayLike, noise_std: float) -> float:
    """A response known but for its delay: σ/‖ψ‖.

    Parameters
    ----------
    slope : array, shape (N,)
        ψ = ∂ŷ/∂L at each sample, per unit of the delay; for coloured noise filtered by the inverse of what colours it.
    noise_std : float
        σ, in the output's unit.

    References
    ----------
    Kay (1993), section 3.5.

    Examples
    --------
    >>> import deadtime
    >>> deadtime.bounds.known_model([3.0, 4.0], 1.0)
    0.2
    """
    return _native._known_model(_flat(slope, "slope"), noise_std)


def joint(slope: ArrayLike, others: Sequence[ArrayLike], noise_std: float) -> float | None:
    """The same where other parameters are unknown too: σ/‖P⊥ψ‖, P⊥ψ what of ψ is no combination of their derivatives.

    Parameters
    ----------
    slope : array, shape (N,)
        ψ, as in `known_model`.
    others : sequence of array, shape (N,) each
        The derivatives by the other parameters: gain, poles, start, …
    noise_std : float
        σ, in the output's unit.

    Returns
    -------
    float or None
        None where nothing remains: the delay is indistinguishable from them.

    References
    ----------
    Kay (1993), section 3.7; the Schur complement of the information matrix.

    Examples
    --------
    What of (3, 4) is no multiple of (0, 1) has the norm 3:

    >>> import deadtime
    >>> round(deadtime.bounds.joint([3.0, 4.0], [[0.0, 1.0]], 1.0), 6)
    0.333333
    """
    psi, rest = _flat(slope, "slope"), [_flat(other, "others") for other in others]
    if any(len(other) != len(psi) for other in rest):
        raise ValueError(f"every derivative has as many samples as slope, {len(psi)}")
    return _native._joint(psi, rest, noise_std)


class StepBound(NamedTuple):
    """Bounds of a step response, s."""

    #: Gain and lag known: √(2TΔσ²/(KA)²).
    known: float
    #: The lag unknown too: √(4TΔσ²/(KA)²).
    joint: float


def first_order_step(height: float, lag_s: float, sample_time_s: float, noise_std: float) -> StepBound:
    """K·e^(−Ls)/(Ts + 1) after a step of its input, over a record long against T.

    Parameters
    ----------
    height : float
        K times the step.
    lag_s : float
        T, s.
    sample_time_s : float
        Sample time Δ, s, short against T.
    noise_std : float
        Standard deviation σ of the noise of a sample.

    Examples
    --------
    With the lag unknown, too, the bound rises from √2·σ√(T·Δ) to 2·σ√(T·Δ):

    >>> import deadtime
    >>> bound = deadtime.bounds.first_order_step(1.0, 1.0, 0.01, 0.1)
    >>> round(bound.known, 4), round(bound.joint, 4)
    (0.0141, 0.02)
    """
    return StepBound(*_native._first_order_step(height, lag_s, sample_time_s, noise_std))


def ziv_zakai(window: float, distance: Callable[[float], float]) -> float:
    """The least root mean square error of a delay drawn from 0 to `window` with equal chances, also below the threshold.

    Parameters
    ----------
    window : float
        The window D.
    distance : callable
        d(h): the norm of the response delayed by h more minus itself, over the noise's standard deviation of a sample.

    References
    ----------
    Bell, Steinberg, Ephraim and Van Trees (1997), IEEE Trans. Inf. Theory 43(2), 624-637, doi:10.1109/18.556118.

    Examples
    --------
    Without any information the error is that of a draw from the window, its width over √12:

    >>> import deadtime
    >>> round(deadtime.bounds.ziv_zakai(12.0**0.5, lambda h: 0.0), 4)
    1.0
    """
    return _native._ziv_zakai(window, distance)


def anomaly_probability(peak: float, cells: float) -> float:
    """The chance that noise makes a higher peak of a correlation elsewhere.

    Parameters
    ----------
    peak : float
        The true peak's height over the standard deviation of the correlation around it.
    cells : float
        Independent lags searched, about 2·D·B for a window D and a bandwidth B.

    References
    ----------
    Ianniello (1982), IEEE Trans. ASSP 30(6), 998-1003, doi:10.1109/TASSP.1982.1163992.

    Examples
    --------
    A peak of twenty standard deviations is never missed among fifty:

    >>> import deadtime
    >>> deadtime.bounds.anomaly_probability(20.0, 50.0) < 1e-9
    True
    """
    return _native._anomaly_probability(peak, cells)


def with_anomalies(std: float, window: float, probability: float) -> float:
    """The root mean square error of a correlator that errs uniformly over the window with a probability, and by `std` else.

    Parameters
    ----------
    std : float
        Standard deviation without anomalies.
    window : float
        The window.
    probability : float
        That of an anomaly, as `anomaly_probability` says.

    Examples
    --------
    Never, and always:

    >>> import deadtime
    >>> deadtime.bounds.with_anomalies(0.1, 12.0**0.5, 0.0), round(deadtime.bounds.with_anomalies(0.1, 12.0**0.5, 1.0), 6)
    (0.1, 1.0)
    """
    return _native._with_anomalies(std, window, probability)

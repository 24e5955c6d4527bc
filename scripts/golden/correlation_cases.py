"""Case delays_correlation: averaged spectra, generalised cross-correlation with every weight, the phase's slope, the cross-bispectrum."""

import numpy as np
from scipy import optimize, signal

from .discretise import assert_close
from .witness import TOOL, answer, as_records, kept

SAMPLES, DELAY, WINDOW, SEGMENT = 700, 7.3, 30, 64
THIRD_SEGMENT = 32
LINES = 35 / 18  # variance of a line of an average with Hann's window: M sum(w^4) / (sum w^2)^2


def fractional(series: np.ndarray, delay: float) -> np.ndarray:
    """A periodic signal later by `delay` samples, by the phase of its transform."""
    spectrum = np.fft.rfft(series)
    return np.fft.irfft(spectrum * np.exp(-2j * np.pi * np.arange(len(spectrum)) * delay / len(series)), len(series))


def copy(skewed: bool):
    """A coloured signal and its delayed copy, noise on both."""
    generator = np.random.default_rng(71 if skewed else 70)
    source = generator.standard_normal(1024)
    source = source**2 - 1 if skewed else signal.lfilter([1.0, 0.5], [1.0, -0.4], source)
    u, y = source[200 : 200 + SAMPLES], -0.8 * fractional(source, DELAY)[200 : 200 + SAMPLES]
    noise = lambda share: share * np.std(u) * generator.standard_normal(SAMPLES)
    return u + noise(0.2), y + noise(0.3)


def window(length: int) -> np.ndarray:
    """Hann's, its first and last sample half a step inside."""
    return np.sin(np.pi * (np.arange(length) + 0.5) / length) ** 2


class Spectra:
    """Averages over segments a quarter apart; sum over the circle / segment = mean square."""

    def __init__(self, u, y, segment):
        taper = window(segment)
        welch = lambda a, b: signal.csd(
            a, b, window=taper, nperseg=segment, noverlap=segment - segment // 4, detrend=False, return_onesided=False, scaling="density"
        )[1][: segment // 2 + 1]
        self.segment = segment
        self.omega = 2 * np.pi * np.arange(segment // 2 + 1) / segment
        self.uu, self.yy, self.uy = welch(u, u).real, welch(y, y).real, welch(u, y)
        # csd conjugates its first argument; the line at the Nyquist frequency has the sign of either half.
        weight = np.zeros(len(u))
        for start in range(0, len(u) - segment + 1, segment // 4):
            weight[start : start + segment] += taper**2
        self.looks = np.sum(weight) ** 2 / np.sum(weight**2) / segment
        self.coherence = np.abs(self.uy) ** 2 / (self.uu * self.yy)


class Lines:
    """The weights' arguments of Knapp and Carter (1976), table I, the coherence freed of what chance adds."""

    def __init__(self, s: Spectra):
        looks = s.looks * LINES
        self.uu, self.yy, self.cross = s.uu, s.yy, np.abs(s.uy)
        self.coherence = np.clip(s.coherence - (1 - s.coherence) / (looks - 1), 0, 1 - 1e-6)
        self.chance = np.sqrt(s.uu * s.yy / looks)
        k = np.arange(len(s.uu))
        self.times = np.where(2 * (k + 1) >= s.segment, 0.0, np.where(k == 0, 1.0, 2.0))


def eckart(line):
    gamma = np.sqrt(line.coherence)
    return gamma / (np.sqrt(line.uu * line.yy) * (1 - gamma) ** 2)


WEIGHTS = {
    "crosscorr": lambda line: np.ones_like(line.uu),
    "gcc_roth": lambda line: 1 / line.uu,
    "gcc_scot": lambda line: 1 / np.sqrt(line.uu * line.yy),
    "gcc_phat": lambda line: 1 / np.maximum(line.cross, line.chance),
    "gcc_eckart": eckart,
    "gcc_hannan_thomson": lambda line: line.coherence / (line.cross * (1 - line.coherence)),
}


def centred(u, y):
    u, y = u / np.max(np.abs(u)), y / np.max(np.abs(y))
    return u - u.mean(), y - y.mean()


def aligned(u, y, lag):
    return Spectra(u[: len(u) - lag], y[lag:], SEGMENT)


def peak(u, y, weight) -> tuple[int, float, Spectra, Lines]:
    """Whole lag and fraction of the largest |R|, R = sum over omega of psi G e^(i omega tau), y moved back by the lag."""
    found = signal.correlate(y, u)[len(u) - 1 : len(u) + WINDOW]
    lag = int(np.argmax(np.abs(found)))
    for _ in range(5):
        spectra = aligned(u, y, lag)
        line = Lines(spectra)
        amplitude = spectra.uy * line.times * weight(line)
        r = lambda tau: float(np.sum((amplitude * np.exp(1j * spectra.omega * tau)).real))
        grid = np.arange(-lag, WINDOW - lag + 1)
        step = int(grid[np.argmax([abs(r(tau)) for tau in grid])])
        if step == 0:
            break
        lag += step
    sign = np.sign(r(0.0))
    slope = lambda tau: float(np.sum((1j * spectra.omega * amplitude * np.exp(1j * spectra.omega * tau)).real))
    dense = np.linspace(-1, 1, 2001)
    near = dense[np.argmax([sign * r(tau) for tau in dense])]
    return lag, optimize.brentq(slope, near - 2e-3, near + 2e-3, xtol=1e-14), spectra, line


def phase_slope(u, y) -> float:
    """Least squares on the unwrapped phase, weights gamma^2/(1 - gamma^2)."""
    lag, fraction, s, line = peak(u, y, WEIGHTS["gcc_hannan_thomson"])
    r = np.sum((s.uy * line.times * WEIGHTS["gcc_hannan_thomson"](line)).real)
    use = (line.times > 1) & (line.coherence > 0)
    omega, weight = s.omega[use], (line.coherence / (1 - line.coherence))[use]
    left = np.angle(s.uy[use] * np.sign(r) * np.exp(1j * omega * fraction))
    root = np.sqrt(weight)
    more = np.linalg.lstsq((root * omega)[:, None], -root * left, rcond=None)[0][0]
    assert np.max(np.abs(left + omega * more)) < np.pi
    return lag + fraction + float(more)


def bispectrum(u, y) -> float:
    """The lag of the largest |t|, t(tau) = sum of Buyu conj(Buuu) over the powers: direct sums over both frequencies, segment by segment."""
    beside = THIRD_SEGMENT // 2
    reach = THIRD_SEGMENT + 2 * beside + WINDOW
    length = min(odd * 2 ** int(np.ceil(np.log2(np.ceil(reach / odd)))) for odd in (1, 3, 9))
    taper = window(THIRD_SEGMENT)
    seen = []
    for start in range(0, len(u) + 1 - THIRD_SEGMENT - WINDOW, beside):
        around = lambda x: np.fft.fft([x[t] if 0 <= t < len(x) else 0.0 for t in range(start - beside, start - beside + reach)], length)
        windowed = np.zeros(length)
        windowed[beside : beside + THIRD_SEGMENT] = taper * u[start : start + THIRD_SEGMENT]
        seen.append((np.fft.fft(windowed), around(u), around(y)))
    k = np.arange(length)
    both = (k[:, None] + k[None, :]) % length  # [k, l]
    pairs = lambda w: w[:, None] * np.conj(w[both])
    own, other = (sum(pairs(w) * each[None, :] for w, each in ((s[0], s[i]) for s in seen)) for i in (1, 2))
    power_u, power_y = sum(np.abs(s[0]) ** 2 for s in seen), sum(np.abs(s[2]) ** 2 for s in seen)
    cross = np.sum(other * np.conj(own) / (power_u[:, None] * power_u[both] * power_y[None, :]), axis=0)
    half = length // 2
    omega = 2 * np.pi * np.arange(half) / length
    t = lambda tau: float(np.sum((cross[:half] * np.exp(1j * omega * tau)).real))
    whole = np.fft.ifft(cross).real[: WINDOW + 1]
    lag = int(np.argmax(np.abs(whole)))
    sign = np.sign(whole[lag])
    dense = lag + np.linspace(-1, 1, 2001)
    near = dense[np.argmax([sign * t(tau) for tau in dense])]
    slope = lambda tau: float(np.sum((1j * omega * cross[:half] * np.exp(1j * omega * tau)).real))
    return optimize.brentq(slope, near - 2e-3, near + 2e-3, xtol=1e-14)


def correlation(stored: dict | None) -> dict:
    u, y = kept(stored, "copy", lambda: copy(False))
    v, z = kept(stored, "skewed", lambda: copy(True))
    spectra = Spectra(u, y, SEGMENT)
    answers = []
    for name, weight in WEIGHTS.items():
        lag, fraction, _, _ = peak(*centred(u, y), weight)
        assert_close(lag + fraction, DELAY, 0.2 / DELAY, name)
        answers.append(answer(name, "copy", WINDOW, 0, {"segment": SEGMENT}, raw=lag + fraction, delay=lag + fraction))
    slope, third = phase_slope(*centred(u, y)), bispectrum(*centred(v, z))
    assert_close(slope, DELAY, 0.2 / DELAY, "phase slope")
    assert_close(third, DELAY, 0.2 / DELAY, "bispectrum")
    answers.append(answer("phase_slope", "copy", WINDOW, 0, {"segment": SEGMENT}, raw=slope, delay=slope))
    answers.append(answer("bispectrum", "skewed", WINDOW, 0, {"segment": THIRD_SEGMENT}, raw=third, delay=third))
    lags = np.arange(-40, 41)
    return {
        "tool": TOOL,
        "tolerance": {"default": 1e-8},
        "records": as_records(copy=(u, y), skewed=(v, z)),
        "spectra": {"segment": SEGMENT, "looks": spectra.looks, "uu": spectra.uu, "yy": spectra.yy, "uy": spectra.uy, "coherence": spectra.coherence},
        "correlation": {"first": int(lags[0]), "last": int(lags[-1]), "sums": signal.correlate(y, u)[len(u) - 1 + lags]},
        "within": 1e-6,
        "answers": answers,
    }

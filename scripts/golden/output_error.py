"""Output-error models by projection: for fixed poles the numerator is linear, and a general optimiser moves the poles from several starts."""

import numpy as np
from scipy import optimize, signal

from .witness import shifted

STARTS = ((0.3, 0.0), (0.8, 0.3), (0.95, 0.6), (0.6 + 0.4j, 0.6 - 0.4j), (0.3 + 0.8j, 0.3 - 0.8j), (-0.5, 0.2))


def project(sources, y, f):
    """Linear coefficients of `sources` / F, and y_hat - y."""
    basis = np.column_stack([signal.lfilter([1.0], [1.0, *f], s) for s in sources])
    linear = np.linalg.lstsq(basis, y, rcond=None)[0]
    return linear, basis @ linear - y


def stable(f) -> bool:
    return len(f) == 0 or bool(np.all(np.abs(np.roots([1.0, *f])) < 1))


def fit_sources(sources, y, nf, starts=STARTS):
    """(loss, b, f) with the smallest loss of all starts; the poles stay inside the unit circle."""

    def rest(f):
        return project(sources, y, f)[1] if stable(f) else np.full(len(y), 10 * np.max(np.abs(y)))

    best = None
    for start in starts:
        f0 = np.real(np.poly(start[:nf]))[1:]
        if nf == 1 and np.iscomplexobj(start):
            continue
        found = optimize.least_squares(rest, f0, xtol=1e-15, ftol=1e-15, gtol=1e-15, max_nfev=400, diff_step=1e-7)
        loss = float(np.mean(rest(found.x) ** 2))
        if best is None or loss < best[0]:
            best = (loss, project(sources, y, found.x)[0], found.x)
    return best


def fit(u, y, nk, nb, nf, starts=STARTS):
    return fit_sources([shifted(u, nk + j) for j in range(nb)], y, nf, starts)

"""Times deadtime against python-control, scipy, numpy and SIPPY on the same data, alternating, in one run.

Called by lab/peers with the path of our timing program; prints a Markdown table.
"""

import argparse
import contextlib
import io
import json
import os
import subprocess
import tempfile
import time
import warnings

import control
import numpy as np
import scipy.linalg
import scipy.optimize
import scipy.signal

warnings.filterwarnings("ignore")

SEED = 1
LONG = 1_000_000
DELAYS = 36
TAPS = 71
NA, NB = 10, 5


class Ours:
    """The Rust program: one JSON request a line, one JSON answer a line."""

    def __init__(self, program, folder):
        self.process = subprocess.Popen([program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.folder = folder

    def file(self, name, values):
        path = os.path.join(self.folder, name)
        np.ascontiguousarray(values, dtype="<f8").tofile(path)
        return path

    def run(self, request, loops, out=None):
        message = {**request, "loops": loops}
        if out:
            message["out"] = out
        self.process.stdin.write(json.dumps(message) + "\n")
        self.process.stdin.flush()
        answer = self.process.stdout.readline()
        if not answer:
            raise SystemExit("our timing program ended; see its message above")
        return json.loads(answer)["seconds"]

    def values(self, request):
        out = os.path.join(self.folder, "out")
        self.run(request, 1, out)
        return np.fromfile(out, dtype="<f8")


def timed(function, loops):
    start = time.perf_counter()
    for _ in range(loops):
        function()
    return (time.perf_counter() - start) / loops


def loops_for(seconds, at_least=0.02):
    """Repetitions that fill `at_least` seconds, so that the clock's grain and the pipe do not count."""
    return int(np.clip(np.ceil(at_least / max(seconds, 1e-9)), 1, 20_000))


class Table:
    def __init__(self, ours, pairs):
        self.ours, self.pairs, self.rows, self.missed = ours, pairs, [], []
        print("| computation | ours, min (median) | peer | peer, min (median) | ratio of minima (medians) | aim | | worst disagreement |")
        print("| --- | --- | --- | --- | --- | --- | --- | --- |", flush=True)

    def compare(self, name, request, peers, expected=None, within=None):
        """peers: {name: (function, aim or None, scale)}; scale: what its time is multiplied by to be the whole computation; within: seconds that ours may take."""
        ours = self.ours
        ours.run(request, 1)
        our_loops = loops_for(ours.run(request, 3))
        peer_loops = {}
        for peer, (function, _, _) in peers.items():
            # A long one has warmed up in the call for its result.
            first = timed(function, 1)
            peer_loops[peer] = loops_for(first if first > 0.5 else timed(function, 3))
        mine, theirs = [], {peer: [] for peer in peers}
        for _ in range(self.pairs):
            for peer, (function, _, scale) in peers.items():
                mine.append(ours.run(request, our_loops))
                theirs[peer].append(timed(function, peer_loops[peer]) * scale)
        for peer, (_, aim, _) in peers.items():
            ratio = min(theirs[peer]) / min(mine)
            medians = np.median(theirs[peer]) / np.median(mine)
            verdict = "" if aim is None else "met" if ratio >= aim else "**missed**"
            aim_text = "" if aim is None else f"≥ {aim}×"
            if within is not None:
                verdict = "met" if min(mine) <= within else "**missed**"
                aim_text = f"ours ≤ {within * 1e6:.0f} µs"
            if verdict == "**missed**":
                self.missed.append(name)
            gap = expected.get(peer, "") if expected else ""
            print(
                f"| {name} | {human(mine)} | {peer} | {human(theirs[peer])} | {ratio:.1f}× ({medians:.1f}×) | {aim_text} | {verdict} | {gap} |",
                flush=True,
            )
            name = "" if len(peers) > 1 else name


def human(seconds):
    def one(value):
        for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
            if value >= size:
                return f"{value / size:.3g} {unit}"
        return f"{value * 1e9:.3g} ns"

    return f"{one(min(seconds))} ({one(float(np.median(seconds)))})"


def gap(ours, theirs):
    ours, theirs = np.ravel(ours), np.ravel(theirs)
    return f"{np.max(np.abs(ours - theirs)) / max(np.max(np.abs(theirs)), 1e-300):.0e}"


def uav():
    """The quadrotor of the thesis: the matrices that the crate has built in."""
    g = 9.81
    lateral = ([[-0.211, 0, g], [-3.613, 0, 0], [0, 1, 0]], [[9.379], [851.287], [0]], [[0, 1, 0], [-0.211, 0, 0]], [[0], [9.379]])
    longitudinal = ([[-0.282, 0, -g], [6.297, 0, 0], [0, 1, 0]], [[-8.758], [473.061], [0]], [[0, 1, 0], [-0.282, 0, 0]], [[0], [-8.758]])
    directional = ([[-8.178, 0], [1, 0]], [[255.59], [0]], [[1, 0]], [[0]])
    vertical = ([[-0.731]], [[-34.35]], [[-0.731]], [[-34.35]])
    parts = [lateral, longitudinal, directional, vertical]
    return parts, [scipy.linalg.block_diag(*(np.array(p[i], float) for p in parts)) for i in range(4)]


def listed(m):
    return np.asarray(m, float).tolist()


def conversions(table, ours):
    parts, whole = uav()
    ts = 0.01
    for name, (a, b, c, d), aims in (
        ("c2d zoh, 3 states (lateral)", [np.array(m, float) for m in parts[0]], (10, 3)),
        ("c2d zoh, 9 states (UAV)", whole, (None, None)),
    ):
        request = dict(task="c2d", a=listed(a), b=listed(b), c=listed(c), d=listed(d), ts=ts)
        sys = control.ss(a, b, c, d)
        result = ours.values(request)
        n = a.shape[0]

        def reference(sampled_a, sampled_b):
            return gap(result, np.concatenate([np.ravel(sampled_a), np.ravel(sampled_b)])) if result.size == n * (n + b.shape[1]) else "shape"

        by_control = control.c2d(sys, ts, "zoh")
        by_scipy = scipy.signal.cont2discrete((a, b, c, d), ts, "zoh")
        table.compare(
            name,
            request,
            {
                "python-control `c2d`": (lambda: control.c2d(sys, ts, "zoh"), aims[0], 1),
                "scipy `cont2discrete`": (lambda: scipy.signal.cont2discrete((a, b, c, d), ts, "zoh"), aims[1], 1),
            },
            {"python-control `c2d`": reference(by_control.A, by_control.B), "scipy `cont2discrete`": reference(by_scipy[0], by_scipy[1])},
        )


def regulators(table, ours):
    parts, whole = uav()
    # The UAV is four plants that do not touch, which ours solves one by one; turned, no entry is 0.
    turn = np.linalg.qr(np.random.default_rng(SEED).standard_normal((9, 9)))[0]
    for name, model, turned, aim in (
        ("dlqr, 3 states (lateral)", parts[0], False, 10),
        ("dlqr, 9 states (UAV)", whole, False, 10),
        ("dlqr, 9 states (UAV, state turned: one dense matrix)", whole, True, None),
    ):
        a, b, c, d, _ = scipy.signal.cont2discrete([np.array(m, float) for m in model], 0.01, "zoh")
        if turned:
            a, b = turn @ a @ turn.T, turn @ b
        q, r = np.eye(a.shape[0]), np.eye(b.shape[1])
        request = dict(task="dlqr", a=listed(a), b=listed(b), q=listed(q), r=listed(r))
        result = ours.values(request)

        def by_scipy():
            x = scipy.linalg.solve_discrete_are(a, b, q, r)
            return np.linalg.solve(r + b.T @ x @ b, b.T @ x @ a)

        peers = {
            "python-control `dlqr` (slycot)": (lambda: control.dlqr(a, b, q, r, method="slycot"), aim, 1),
            "scipy `solve_discrete_are`, gain": (by_scipy, None, 1),
        }
        by_control = control.dlqr(a, b, q, r, method="slycot")[0]
        table.compare(name, request, peers, dict(zip(peers, (gap(result, by_control), gap(result, by_scipy())))))


def simulations(table, ours, rng):
    _, (a, b, c, d) = uav()
    # The UAV is unstable: a short step keeps the numbers of the long record finite.
    for samples, ts in ((150, 0.01), (LONG, 1e-4)):
        sys = control.ss(a, b, c, d)
        sampled = scipy.signal.cont2discrete((a, b, c, d), ts, "zoh")
        discrete = control.ss(*sampled[:4], ts)
        u = rng.standard_normal((samples, b.shape[1]))
        t = np.arange(samples) * ts
        transposed = np.ascontiguousarray(u.T)
        file = ours.file(f"lsim{samples}", transposed)
        for hold, peers in (
            (
                "zero",
                {
                    "python-control `forced_response`, sampled model": (lambda: control.forced_response(discrete, t, transposed), 40, 1),
                    "scipy `lsim`": (lambda: scipy.signal.lsim((a, b, c, d), u, t, interp=False), None, 1),
                    "scipy `dlsim`": (lambda: scipy.signal.dlsim((*sampled[:4], ts), u), None, 1),
                },
            ),
            (
                "linear",
                {
                    "python-control `forced_response`, continuous model": (lambda: control.forced_response(sys, t, transposed), 40, 1),
                    "scipy `lsim`": (lambda: scipy.signal.lsim((a, b, c, d), u, t, interp=True), None, 1),
                },
            ),
        ):
            request = dict(task="lsim", u=file, ts=ts, hold=hold)
            result = ours.values(request).reshape(-1, samples)
            gaps = {}
            for peer, (function, _, _) in peers.items():
                answer = function()
                gaps[peer] = gap(result, answer.outputs if "control" in peer else answer[1].T)
            table.compare(f"lsim, 9-state UAV, {samples} samples, {hold} hold", request, peers, gaps)


def record(rng, samples, noise=0.05):
    """A second-order plant with 8 samples of delay, under a random binary input."""
    u = np.sign(rng.standard_normal(samples))
    y = scipy.signal.lfilter([0] * 8 + [0.1], [1, -1.5, 0.6], u)
    return u, y + noise * np.std(y) * rng.standard_normal(samples)


def tall(u, y, na, lags):
    """Columns y(t−1) … y(t−na), u(t) … u(t−lags+1), y(t), as numpy builds them fastest."""
    first = max(na, lags - 1)
    windows = np.lib.stride_tricks.sliding_window_view
    parts = []
    if na:
        parts.append(windows(y, na)[first - na : len(y) - na, ::-1])
    parts.append(windows(u, lags)[first - lags + 1 :, ::-1])
    parts.append(y[first:, None])
    return np.hstack(parts)


def scan_losses(gram, rows, na, nb, delays):
    """The ARX losses of all delays out of one Gram matrix."""
    losses = []
    last = gram.shape[0] - 1
    for nk in range(delays):
        index = list(range(na)) + list(range(na + nk, na + nk + nb))
        right = gram[index, last]
        theta = np.linalg.solve(gram[np.ix_(index, index)], right)
        losses.append((gram[last, last] - right @ theta) / rows)
    return np.array(losses)


def regressions(table, ours, rng):
    u, y = record(rng, 500)
    request = dict(task="arx", max_delay=19, u=ours.file("u500", u), y=ours.file("y500", y))
    few = tall(u, y, NA, 19 + NB)
    theirs = scan_losses(few.T @ few, few.shape[0], NA, NB, 20)
    peers = {"numpy, Gram and the 20 losses, matrix given": (lambda: scan_losses(few.T @ few, few.shape[0], NA, NB, 20), None, 1)}
    table.compare("arxstruc scan, 20 delays, 500 samples", request, peers, dict.fromkeys(peers, gap(ours.values(request), theirs)), 50e-6)

    u, y = record(rng, LONG)
    files = dict(u=ours.file("u", u), y=ours.file("y", y))
    lags = DELAYS - 1 + NB
    request = dict(task="arx", max_delay=DELAYS - 1, **files)
    x = tall(u, y, NA, lags)
    rows = x.shape[0]
    result = ours.values(request)
    expected = gap(result, scan_losses(x.T @ x, rows, NA, NB, DELAYS))

    def built():
        m = tall(u, y, NA, lags)
        return m.T @ m

    peers = {
        "numpy, Gram of the tall matrix, matrix given": (lambda: x.T @ x, 10, 1),
        "numpy, Gram of the tall matrix, building it": (built, None, 1),
        "numpy, Gram and the 36 losses, matrix given": (lambda: scan_losses(x.T @ x, rows, NA, NB, DELAYS), None, 1),
    }
    table.compare(f"arxstruc scan, {DELAYS} delays, {LONG} samples", request, peers, dict.fromkeys(peers, expected))
    del x

    request = dict(task="fir", taps=TAPS, **files)
    x = tall(u, y, 0, TAPS)[:, :TAPS].copy()
    target = y[TAPS - 1 :]

    def normal_equations(x):
        gram, right = x.T @ x, x.T @ target
        h = np.linalg.solve(gram, right)
        variance = (target @ target - right @ h) / (len(target) - TAPS)
        return np.concatenate([h, np.diag(np.linalg.inv(gram) * variance)])

    peers = {
        "numpy, normal equations, matrix given": (lambda: normal_equations(x), 10, 1),
        "numpy, normal equations, building the matrix": (lambda: normal_equations(tall(u, y, 0, TAPS)[:, :TAPS]), None, 1),
    }
    expected = gap(ours.values(request), normal_equations(x))
    table.compare(f"FIR, {TAPS} taps with covariance, {LONG} samples", request, peers, dict.fromkeys(peers, expected))


def output_errors(table, ours, rng, sippy):
    u, y = record(rng, 150)
    request = dict(task="oe", max_delay=DELAYS - 1, u=ours.file("u150", u), y=ours.file("y150", y))
    result = ours.values(request)

    def model(p, nk):
        return scipy.signal.lfilter(np.concatenate([np.zeros(nk), p[:1]]), [1, p[1], p[2]], u)

    def residual(p, nk):
        return model(p, nk) - y

    def jacobian(p, nk):
        f = [1, p[1], p[2]]
        per_b = scipy.signal.lfilter([1], f, np.concatenate([np.zeros(nk), u[: len(u) - nk]]))
        per_f = scipy.signal.lfilter([1], f, -p[0] * per_b)
        return np.column_stack([per_b, np.concatenate([[0], per_f[:-1]]), np.concatenate([[0, 0], per_f[:-2]])])

    def scan(**options):
        fits = [scipy.optimize.least_squares(residual, [0.1, -0.5, 0.1], args=(nk,), method="lm", **options) for nk in range(DELAYS)]
        return np.array([2 * fit.cost / len(y) for fit in fits])

    def worst(theirs):
        """Positive where our minimum is above theirs."""
        return f"our losses − theirs, relative: {np.max((result - theirs) / theirs):+.0e} at most, {np.min((result - theirs) / theirs):+.0e} at least"

    few = [0, 8, 20]
    peers = {
        "scipy `least_squares`, analytic Jacobian": (lambda: scan(jac=jacobian), 20, 1),
        "scipy `least_squares`, 2-point Jacobian": (lambda: scan(), 20, 1),
    }
    gaps = {
        "scipy `least_squares`, analytic Jacobian": worst(scan(jac=jacobian)),
        "scipy `least_squares`, 2-point Jacobian": worst(scan()),
    }
    table.compare(f"oestruc scan, {DELAYS} delays, 150 samples", request, peers, gaps)

    def by_sippy():
        losses = []
        with contextlib.redirect_stdout(io.StringIO()):
            for nk in few:
                # theta 0 is a delay of one sample in SIPPY, whose models have no direct path; the cost does not depend on it.
                losses.append(2 * sippy("OE", y, u, 0, 1, 0, 0, 2, max(nk - 1, 0), 200, 1.0, False)[4])
        return losses

    losses = by_sippy()
    name = f"SIPPY `GEN_id(\"OE\")`, {len(few)} delays, time scaled to {DELAYS}"
    table.compare("", request, {name: (by_sippy, 500, DELAYS / len(few))}, {name: f"loss at 8 samples: ours {result[8]:.6g}, SIPPY {losses[1]:.6g}"})


def main():
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("program")
    arguments.add_argument("--pairs", type=int, default=7)
    arguments.add_argument("--only", default="", help="c2d, dlqr, lsim, regressions or oe")
    options = arguments.parse_args()
    from sippy_unipi.io_opt import GEN_id

    threads = os.environ.get("OPENBLAS_NUM_THREADS", "default")
    print(f"\nThreads: {threads} for BLAS, {os.environ.get('RAYON_NUM_THREADS', 'default')} for ours; {os.cpu_count()} processors. Seed {SEED}.\n")
    rng = np.random.default_rng(SEED)
    with tempfile.TemporaryDirectory() as folder:
        ours = Ours(options.program, folder)
        table = Table(ours, options.pairs)
        cases = {
            "c2d": lambda: conversions(table, ours),
            "dlqr": lambda: regulators(table, ours),
            "lsim": lambda: simulations(table, ours, rng),
            "regressions": lambda: regressions(table, ours, rng),
            "oe": lambda: output_errors(table, ours, rng, GEN_id),
        }
        for name, case in cases.items():
            if options.only in ("", name):
                case()
        ours.process.stdin.close()
        ours.process.wait()
    print("\nAll aims met." if not table.missed else "\nMissed: " + ", ".join(table.missed) + ".")


if __name__ == "__main__":
    main()

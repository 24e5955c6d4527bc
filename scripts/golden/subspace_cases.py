"""Case subspace: PBSIDopt, N4SID and MOESP on a stored record, from explicit data matrices, `lstsq` and `svd`."""

import numpy as np
import scipy.linalg

from . import octave

TOOL = "numpy 2.3.5, scipy 1.17.1"
SAMPLES, PAST, ORDER = 500, 8, 3
# One unstable pole; inputs in other units than outputs.
A = np.array([[1.05, 0.2, 0.0], [0.0, 0.7, 0.3], [0.0, -0.3, 0.6]])
B = np.array([[0.02, 0.0], [0.1, -0.05], [0.0, 0.08]])
C = np.array([[30.0, 0.0, 5.0], [0.0, 0.2, 0.1]])
K = np.array([[0.02, 0.3], [0.001, 0.5], [0.0, 0.2]])
NOISE = np.diag([0.5, 0.01])
FEEDBACK = np.array([[0.25, 0.0], [0.0, -2.0]])


def closed_loop() -> tuple[np.ndarray, np.ndarray]:
    """x+ = A x + B u + K e, y = C x + e, u = r - F y with random r of +-1 and +-2; rows are samples."""
    generator = np.random.default_rng(20260211)
    x, u, y = np.zeros(3), np.zeros((SAMPLES, 2)), np.zeros((SAMPLES, 2))
    for t in range(SAMPLES):
        e = NOISE @ generator.standard_normal(2)
        y[t] = C @ x + e
        u[t] = generator.choice([-1.0, 1.0], 2) * [1.0, 2.0] - FEEDBACK @ y[t] + [3.0, 0.0]
        x = A @ x + B @ u[t] + K @ e
    return np.round(u, 9), np.round(y, 9)


def data(stored: dict | None) -> tuple[np.ndarray, np.ndarray]:
    if stored is not None:
        return np.array(stored["u"]), np.array(stored["y"])
    return closed_loop()


# Stable, and no feedback: what SLICOT's methods are made for.
OPEN_A = np.array([[0.8, 0.3, 0.0], [-0.3, 0.8, 0.1], [0.0, 0.0, 0.6]])
OPEN_SAMPLES, OPEN_NOISE, BLOCKS = 400, 1e-3, 8
# Ten times what a mean of so many samples is uncertain by.
TEN_STD = 10 * OPEN_NOISE / OPEN_SAMPLES**0.5


def open_loop() -> tuple[np.ndarray, np.ndarray]:
    """Random binary inputs, outputs with white noise of a thousandth of their spread; rows are samples."""
    generator = np.random.default_rng(20261126)
    u = generator.choice([-1.0, 1.0], (OPEN_SAMPLES, 2)) * [1.0, 2.0]
    x, y = np.zeros(3), np.zeros((OPEN_SAMPLES, 2))
    for t in range(OPEN_SAMPLES):
        y[t] = C @ x
        x = OPEN_A @ x + B @ u[t]
    return u, np.round(y + OPEN_NOISE * y.std(axis=0) * generator.standard_normal(y.shape), 9)


def by_octave(stored: dict | None) -> dict:
    """N4SID, and MOESP for A and C with N4SID for B and D, of Octave's control package: SLICOT's IB01AD and IB01BD. Its plain MOESP stops there with an error."""
    tool = octave.versions()
    u, y = (np.array(stored["u"]), np.array(stored["y"])) if stored is not None else open_loop()
    names = ["n4sid", "moen4"]
    script = [f"d = iddata({octave.literal(y)}, {octave.literal(u)}, 1);"]
    for name in names:
        script.append(f"s = {name}(d, {ORDER}, 's', {BLOCKS}); [a, b, c, dd] = ssdata(s);")
        script += [f"put('{name}.{matrix}', {matrix if matrix != 'd' else 'dd'});" for matrix in "abcd"]
    found = octave.run("\n".join(script))
    cases = []
    for name in names:
        a, b, c, d = (found[f"{name}.{matrix}"].real for matrix in "abcd")
        powers = [np.linalg.matrix_power(a, j) for j in range(6)]
        markov = np.hstack([d, *(c @ p @ b for p in powers)])
        cases.append({"id": name, "poles": np.sort_complex(np.linalg.eigvals(a)), "markov": markov})
    return {
        "tool": tool,
        "tolerance": {"default": TEN_STD},
        "past": BLOCKS,
        "order": ORDER,
        "true_poles": np.sort_complex(np.linalg.eigvals(OPEN_A)),
        "u": u,
        "y": y,
        "cases": cases,
    }


def past_of(z: np.ndarray, rows: np.ndarray, past: int) -> np.ndarray:
    """[z(t-1) ... z(t-past)] of every row."""
    return np.hstack([z[rows - lag] for lag in range(1, past + 1)])


def with_constant(regressors: np.ndarray, targets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients of the regressors given a constant, and the constant."""
    solved = np.linalg.lstsq(np.hstack([regressors, np.ones((len(regressors), 1))]), targets, rcond=None)[0]
    return solved[:-1], solved[-1]


def realise(u, y, z, states_map) -> dict:
    """A, B, C, K from the states x(t) = map [z(t-1); ...; z(t-PAST)], by two regressions, each with a constant; D = 0."""
    rows = np.arange(PAST, len(y))
    x, x_next = past_of(z, rows, PAST) @ states_map.T, past_of(z, rows + 1, PAST) @ states_map.T
    c, constant = with_constant(x, y[rows])
    c, e = c.T, y[rows] - x @ c - constant
    abk = with_constant(np.hstack([x, u[rows], e]), x_next)[0].T
    n, m = len(states_map), u.shape[1]
    return {"A": abk[:, :n], "B": abk[:, n : n + m], "C": c, "K": abk[:, n + m :]}


def by_shift(u, y, z, states_map, gamma, w) -> dict:
    """A and C by the shift of the observability matrix, K of Kalman's filter, B by the run of the observer A - K C, for A is unstable here; D = 0."""
    rows, (n, m, l) = np.arange(PAST, len(y)), (len(states_map), u.shape[1], y.shape[1])
    white, c = w @ gamma, gamma[:l]
    a = np.linalg.lstsq(white[:-l], white[l:], rcond=None)[0]
    x, x_next = past_of(z, rows, PAST) @ states_map.T, past_of(z, rows + 1, PAST) @ states_map.T
    moved, seen = x_next - x @ a.T, y[rows] - x @ c.T
    slopes, constant = with_constant(u[rows], moved)
    left, v = moved - u[rows] @ slopes - constant, seen - seen.mean(axis=0)
    p = scipy.linalg.solve_discrete_are(a.T, c.T, left.T @ left, v.T @ v, s=left.T @ v)
    k = (a @ p @ c.T + left.T @ v) @ np.linalg.inv(c @ p @ c.T + v.T @ v)
    assert np.max(np.abs(np.linalg.eigvals(a))) > 1

    def run(start, forcing):
        """Outputs of x+ = (A - K C) x + forcing."""
        x, seen = start, []
        for f in forcing:
            seen.append(c @ x)
            x = (a - k @ c) @ x + f
        return np.concatenate(seen)

    none, unit = np.zeros((len(y), n)), np.eye(n)
    columns = [np.outer(u[:, j], unit[i]) for j in range(m) for i in range(n)]
    columns = [run(np.zeros(n), f) for f in columns] + [run(unit[i], none) for i in range(n)] + [run(np.zeros(n), none + unit[i]) for i in range(n)]
    columns += [np.tile(np.eye(l)[i], len(y)) for i in range(l)]
    # Outputs weighted as in the decomposition.
    whitened = lambda column: (column.reshape(len(y), l) @ w[:l, :l].T).ravel()
    rest = whitened(y.ravel() - run(np.zeros(n), y @ k.T))
    b = np.linalg.lstsq(np.column_stack([whitened(column) for column in columns]), rest, rcond=None)[0][: n * m].reshape(m, n).T
    return {"A": a, "B": b, "C": c, "K": k}


def invariants(model: dict, singular: np.ndarray) -> dict:
    """What does not depend on the choice of states: eigenvalues, C A^j B and C A^j K, j = 0 .. 5."""
    powers = [np.linalg.matrix_power(model["A"], j) for j in range(6)]
    return {
        "singular": singular[:6],
        "poles": np.sort_complex(np.linalg.eigvals(model["A"])),
        "markov": np.hstack([model["C"] @ p @ model["B"] for p in powers]),
        "noise_markov": np.hstack([model["C"] @ p @ model["K"] for p in powers]),
    }


def long_predictor(z, y):
    """Coefficients on the past given a constant, channels by rows of past, and the innovations' covariance."""
    rows = np.arange(PAST, len(y))
    regressors = past_of(z, rows, PAST)
    theta, constant = with_constant(regressors, y[rows])
    rest = y[rows] - regressors @ theta - constant
    return theta, rest.T @ rest / (len(rows) - regressors.shape[1] - 1)


def weight(covariance: np.ndarray) -> np.ndarray:
    """The symmetric inverse square root for every block row."""
    values, vectors = np.linalg.eigh(covariance)
    return np.kron(np.eye(PAST), vectors @ np.diag(values**-0.5) @ vectors.T)


def states(w, predictions, right):
    """S^(-1/2) U' W P, and the singular values of W P right."""
    u, s, _ = np.linalg.svd(w @ predictions @ right, full_matrices=False)
    return np.diag(s[:ORDER] ** -0.5) @ u[:, :ORDER].T @ w @ predictions, s


def pbsidopt(u, y, z) -> dict:
    theta, covariance = long_predictor(z, y)
    width, l = z.shape[1], y.shape[1]
    predictions = np.zeros((PAST * l, PAST * width))
    for ahead in range(PAST):
        predictions[ahead * l : (ahead + 1) * l, : (PAST - ahead) * width] = theta[ahead * width :].T
    rows = np.arange(PAST, len(y))
    right = past_of(z, rows, PAST)
    mapping, singular = states(weight(covariance), predictions, (right - right.mean(axis=0)).T / np.sqrt(len(rows)))
    return invariants(realise(u, y, z, mapping), singular)


def projection(u, y, z, beside_inputs: bool) -> dict:
    """Oblique projection of future outputs along future inputs on the past; MOESP takes the past without what future inputs explain, and its own realisation."""
    _, covariance = long_predictor(z, y)
    instants = np.arange(PAST, len(y) - PAST + 1)
    instants = instants[instants + PAST < len(y)]  # rows that the triangular factor of twice the past has
    before = past_of(z, instants, PAST)
    future = lambda series: np.hstack([series[instants + i] for i in range(PAST)])
    uf, yf = future(u), future(y)
    along, _ = with_constant(np.hstack([before, uf]), yf)
    predictions = along[: before.shape[1]].T
    seen = before - before.mean(axis=0)
    if beside_inputs:
        slopes, constant = with_constant(uf, before)
        seen = before - uf @ slopes - constant
    rows = len(y) - PAST
    mapping, singular = states(weight(covariance), predictions, seen.T / np.sqrt(rows))
    if not beside_inputs:
        return invariants(realise(u, y, z, mapping), singular)
    gamma = np.linalg.lstsq(seen @ mapping.T, seen @ predictions.T, rcond=None)[0].T
    return invariants(by_shift(u, y, z, mapping, gamma, weight(covariance)), singular)


def subspace(stored: dict | None) -> dict:
    u, y = data(stored)
    centred = (u - u.mean(axis=0), y - y.mean(axis=0))
    z = np.hstack(centred)
    cases = {
        "pbsidopt": pbsidopt(*centred, z),
        "n4sid": projection(*centred, z, beside_inputs=False),
        "moesp": projection(*centred, z, beside_inputs=True),
    }
    truth = np.sort_complex(np.linalg.eigvals(A))
    assert np.max(np.abs(cases["pbsidopt"]["poles"] - truth)) < 0.2, cases["pbsidopt"]["poles"]
    return {
        "tool": TOOL,
        "tolerance": {"default": 1e-8},
        "past": PAST,
        "order": ORDER,
        "true_poles": truth,
        "u": u,
        "y": y,
        "cases": [{"id": name, **case} for name, case in cases.items()],
    }

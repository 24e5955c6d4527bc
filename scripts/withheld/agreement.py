"""Independent ways to the same response must agree; run by `python -m withheld.selfcheck`."""

import copy

import numpy as np
from scipy import linalg

from .laws import NOMINAL, TIME, TS, TWO, close, commands, effect
from .pieces import InputChain
from .plants import PLANTS
from .signals import stamps
from .simulate import simulate
from .variants import can_sample, can_shift, in_other_unit, sampled, shifted, whole_delays

PENDULUM = {
    "kind": "equations", "inputs": [{"name": "torque"}, {"name": "wind"}], "outputs": [{"name": "angle"}, {"name": "rate"}],
    "states": {"angle": {"initial": 0.4}, "rate": {"initial": 0.0}},
    "parameters": {"inertia": {"value": 0.5}, "viscous": {"value": 0.2}, "weight": {"value": 4.0}},
    "derivatives": {"angle": "rate", "rate": "(torque - viscous*rate - weight*sin(angle))/inertia + wind^2*0.1*cos(2*time)"},
    "output_equations": {"angle": "angle", "rate": "rate + 0.05*wind"},
}
ACTING = [
    effect("input_delay", "u", delay=0.0313), effect("gain_fade", "u", rate=0.05), effect("gain_jump", "v", gain=1.1, time=0.8137, later=0.7),
    effect("deadband", "u", width=0.15), effect("backlash", "v", width=0.2),
    effect("saturation", "u", lower=-0.9, upper=1.0), effect("rate_limit", "u", rate=8.0), effect("actuator_lag", "u", time_constant=0.04),
    effect("unmodelled_mode", "u->input:u", frequency=5.0, damping=0.1, gain=0.4), effect("unmodelled_mode", "v->output:w", frequency=7.0, damping=0.2, gain=0.3),
    effect("periodic_disturbance", "z", frequency=1.7, amplitude=1.0, phase=0.4), effect("misalignment", "y->w", gain=0.3), effect("sensor_lag", "w", time_constant=0.03),
    effect("output_delay", "y", delay=0.041), effect("clock_skew", "*", ratio=0.99), effect("cross_coupling", "u->x", gain=0.5),
]


def exponentials_and_solve_ivp():
    u = commands(2)
    one = simulate(TWO, TIME, u, ACTING, x0=[0.2, 0.1])
    for integrator, limit in (("fast", 1e-8), ("reference", 1e-9)):
        close(simulate(TWO, TIME, u, ACTING, x0=[0.2, 0.1], integrator=integrator), one, limit, integrator)


def nonlinear_integrators():
    u = commands(2)
    items = [effect("coulomb_friction", "rate", level=0.8), effect("quadratic_drag", "rate", coefficient=0.3), effect("input_delay", "torque", delay=0.013),
             effect("cubic_stiffness", "angle->rate", coefficient=2.0), effect("parameter_error", "weight", value=4.4), effect("parameter_jump", "inertia", value=0.5, time=0.9171, later=0.3), effect("actuator_lag", "wind", time_constant=0.02)]
    fast = simulate(PENDULUM, TIME, u, items)
    reference = simulate(PENDULUM, TIME, u, items, integrator="reference")
    tight = simulate(PENDULUM, TIME, u, items, integrator="reference", tolerance=1e-12, method="Radau")
    close(fast, reference, 1e-7, "Dormand-Prince and DOP853")
    close(tight, reference, 1e-8, "Radau and DOP853")


def sampled_equals_continuous():
    """The zero-order-hold model of a continuous one gives the same samples while inputs are held over whole samples."""
    ts = 0.02
    block = linalg.expm(ts * np.block([[np.array(TWO["A"]), np.array(TWO["B"])], [np.zeros((2, 4))]]))
    sampled = {**TWO, "sample_time_s": ts, "A": block[:2, :2].tolist(), "B": block[:2, 2:].tolist()}
    u = commands(2)
    items = [effect("input_delay", "u", delay=0.06), effect("deadband", "u", width=0.2), effect("backlash", "v", width=0.1), effect("output_delay", "w", delay=0.04),
             effect("misalignment", "w->y", gain=0.1), effect("sensor_bias", "y", offset=0.2), effect("saturation", "v", lower=-0.3, upper=None)]
    close(simulate(sampled, TIME, u, items), simulate(TWO, TIME, u, items), 1e-12, "sampled")
    held = [effect("input_delay", "u", delay=0.013)]
    shifted = np.vstack([u[:1], 0.35 * u[1:] + 0.65 * u[:-1]])
    only_u = u.copy()
    only_u[:, 0] = shifted[:, 0]
    no_direct = {**sampled, "D": [[0.0, 0.0], [0.0, 0.0]]}
    close(simulate(no_direct, TIME, u, held), simulate(no_direct, TIME, only_u), 1e-12, "mean of a delayed edge")
    slow = [effect("sensor_lag", "*", time_constant=0.05), effect("actuator_lag", "u", time_constant=0.06), effect("clock_offset", "*", offset=-0.007)]
    close(simulate(no_direct, TIME, u, slow), simulate({**TWO, "D": no_direct["D"]}, TIME, u, slow), 0.01, "lags, to the sampled model's own error")
    for item in NOMINAL:
        if item["effect"] in ("parameter_error", "cross_coupling", "coulomb_friction", "unmodelled_mode"):
            try:
                simulate(sampled, TIME, u, [item])
            except ValueError:
                continue
            raise AssertionError(f"{item['effect']} on a sampled model must be refused")


def uneven_stamps():
    """Jittered and missed samples: matrix exponentials, Dormand-Prince and solve_ivp agree, effects with edges between the samples acting."""
    for timing in ("jitter", "missed"):
        time = stamps(np.random.default_rng(1), TS, 2.4, timing)
        assert np.ptp(np.diff(time)) > 0.4 * TS, f"{timing} must be uneven"
        u = commands(2)[: len(time)]
        reference = simulate(TWO, time, u, ACTING, x0=[0.2, 0.1], integrator="reference")
        close(simulate(TWO, time, u, ACTING, x0=[0.2, 0.1]), reference, 1e-8, timing)
        nonlinear = [effect("input_delay", "torque", delay=0.013), effect("coulomb_friction", "rate", level=0.4), effect("output_delay", "*", delay=0.007)]
        close(simulate(PENDULUM, time, u, nonlinear), simulate(PENDULUM, time, u, nonlinear, integrator="reference"), 1e-7, f"{timing}, nonlinear")


def whole_signals_equal_pieces():
    """A command worked out as a whole has the same pieces as one worked out edge by edge."""
    rng = np.random.default_rng(9)
    for _ in range(60):
        chosen = {"input_delay": {"delay": 0.0}, "input_gain": {"gain": 1.2}, "input_curve": {"quadratic": 0.1}, "input_offset": {"offset": 0.2}, "gain_fade": {"rate": 0.04}, "gain_jump": {"gain": 0.8, "time": 1.1113, "later": 1.3},
                  "deadband": {"width": 0.2}, "backlash": {"width": 0.15}, "saturation": {"lower": -0.9}, "rate_limit": {"rate": 20.0}}
        own = {name: p for name, p in chosen.items() if rng.random() < 0.5}
        values, delay = commands(1, int(rng.integers(99)))[:, 0], float(rng.choice([0.0, 0.013, 0.04]))
        whole, single = InputChain(own, delay), InputChain(own, delay)
        whole.push_all(TIME, values)
        for time, value in zip(TIME, values):
            single.push(time, value)
        pieces = np.array(single.pieces(0.0, 2.5, 1e-9))
        begins, heights, slopes = whole.at_once(0.0, 2.5, 1e-9)
        for at in rng.uniform(0.0, 2.49, 200):
            i, j = np.searchsorted(begins, at, side="right") - 1, np.searchsorted(pieces[:, 0], at, side="right") - 1
            close(heights[i] + slopes[i] * (at - begins[i]), pieces[j, 2] + pieces[j, 3] * (at - pieces[j, 0]), 1e-12, f"{sorted(own)} at once")


def other_ways_to_write_a_machine():
    """Another unit, another working point and a sample time change nothing but what they should; the oracle is solve_ivp on the plain model."""
    rng, steps = np.random.default_rng(10), 60
    for name, plant in PLANTS.items():
        time = np.arange(steps) * plant.sample_time
        u = np.array(plant.trim or [0.0] * len(plant.levels)) + np.array(plant.levels) * commands(len(plant.levels))[:steps]
        plain = simulate(plant.model, time, u, integrator="reference")
        size = np.maximum(np.abs(plain).max(axis=0), 1e-9)
        scaled = copy.deepcopy(plant.model)
        in_other_unit(rng, scaled)
        factors = [{"deg": 57.29577951308232, "deg/s": 57.29577951308232, "rpm": 9.549296585513721, "mm": 1000.0, "km/h": 3.6, "g": 1 / 9.80665, "mA": 1000.0}.get(c["unit"], 1.0)
                   if c["unit"] != d["unit"] else 1.0 for c, d in zip(scaled["outputs"], plant.model["outputs"])]
        close(simulate(scaled, time, u) / factors / size, plain / size, 1e-7, f"{name} in another unit")
        if can_shift(plant):
            model = copy.deepcopy(plant.model)
            moved = shifted(rng, plant, model)
            points = [c["operating"] for c in model["outputs"]]
            close((simulate(model, time, u + moved.trim) - points) / size, plain / size, 1e-7, f"{name} about another point")
        if can_sample(plant):
            model = copy.deepcopy(plant.model)
            whole_delays(model, plant.sample_time)
            plain = simulate(model, time, u, integrator="reference")
            close(simulate(sampled(model, plant.sample_time), time, u) / size, plain / size, 1e-7, f"{name}, sampled")


def couplings_are_entries():
    """About a working point too, a cross coupling from an input is an entry of B."""
    plant = PLANTS["thermal"]
    time, u = np.arange(60) * plant.sample_time, np.array(plant.trim) + np.array(plant.levels) * commands(2)[:60]
    entered = copy.deepcopy(plant.model)
    entered["B"][0][1] = 0.05
    close(simulate(plant.model, time, u, [effect("cross_coupling", "fan->core", gain=0.05)]), simulate(entered, time, u, integrator="reference"), 1e-6, "coupling")


CHECKS = [exponentials_and_solve_ivp, nonlinear_integrators, sampled_equals_continuous, uneven_stamps, whole_signals_equal_pieces, other_ways_to_write_a_machine, couplings_are_entries]

"""Independent ways to the same response must agree; run by `python -m withheld.selfcheck`."""

import numpy as np
from scipy import linalg

from .laws import NOMINAL, TIME, TWO, close, commands, effect
from .simulate import simulate

PENDULUM = {
    "kind": "equations", "inputs": [{"name": "torque"}, {"name": "wind"}], "outputs": [{"name": "angle"}, {"name": "rate"}],
    "states": {"angle": {"initial": 0.4}, "rate": {"initial": 0.0}},
    "parameters": {"inertia": {"value": 0.5}, "viscous": {"value": 0.2}, "weight": {"value": 4.0}},
    "derivatives": {"angle": "rate", "rate": "(torque - viscous*rate - weight*sin(angle))/inertia + wind^2*0.1*cos(2*time)"},
    "output_equations": {"angle": "angle", "rate": "rate + 0.05*wind"},
}
ACTING = [
    effect("input_delay", "u", delay=0.0313), effect("gain_fade", "u", rate=0.05), effect("deadband", "u", width=0.15), effect("backlash", "v", width=0.2),
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
             effect("cubic_stiffness", "angle->rate", coefficient=2.0), effect("parameter_error", "weight", value=4.4), effect("actuator_lag", "wind", time_constant=0.02)]
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


CHECKS = [exponentials_and_solve_ivp, nonlinear_integrators, sampled_equals_continuous]

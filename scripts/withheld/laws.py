"""Analytic laws that the simulator must obey; run by `python -m withheld.selfcheck`."""

import math

import numpy as np

from .simulate import Simulator, losses, simulate

TS = 0.02
TIME = np.arange(120) * TS

TWO = {
    "kind": "lti", "inputs": [{"name": "u"}, {"name": "v"}], "states": [{"name": "x"}, {"name": "z"}],
    "outputs": [{"name": "y"}, {"name": "w"}],
    "A": [[0.0, 1.0], [-9.0, -1.2]], "B": [[0.0, 0.3], [4.0, 0.0]], "C": [[1.0, 0.0], [0.0, 1.0]], "D": [[0.0, 0.0], [0.0, 0.2]],
}
MASS = {
    "kind": "equations", "inputs": [{"name": "u"}], "outputs": [{"name": "position"}, {"name": "speed"}],
    "states": {"position": {"initial": 0.0}, "speed": {"initial": 0.0}}, "parameters": {"mass": {"value": 2.0}},
    "derivatives": {"position": "speed", "speed": "u/mass"}, "output_equations": {"position": "position", "speed": "speed"},
}
FIRST = {
    "kind": "lti", "inputs": [{"name": "u"}], "states": [{"name": "x"}], "outputs": [{"name": "y"}],
    "A": [[-2.0]], "B": [[2.0]], "C": [[1.0]], "D": [[0.0]],
}
PASS = {**FIRST, "C": [[0.0]], "D": [[1.0]]}


def effect(name: str, channel: str, **parameters) -> dict:
    return {"effect": name, "channel": channel, "parameters": parameters}


def commands(channels: int, seed: int = 1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.repeat(rng.uniform(-1.5, 1.5, (len(TIME) // 6, channels)), 6, axis=0)


def close(left, right, limit, what):
    error = float(np.max(np.abs(np.asarray(left) - np.asarray(right))))
    assert error <= limit, f"{what}: {error:.3g} > {limit:.3g}"


NOMINAL = [
    effect("input_delay", "u", delay=0.0), effect("input_gain", "u", gain=1.0), effect("input_curve", "u", quadratic=0.0),
    effect("gain_fade", "u", rate=0.0), effect("input_offset", "u", offset=0.0), effect("deadband", "u", width=0.0),
    effect("backlash", "u", width=0.0), effect("saturation", "u", lower=None, upper=None), effect("rate_limit", "u", rate=1e9),
    effect("actuator_lag", "u", time_constant=1e-7), effect("unmodelled_mode", "u->input:u", frequency=2.0, damping=0.1, gain=0.0),
    effect("output_delay", "*", delay=0.0), effect("sensor_lag", "y", time_constant=1e-7), effect("sensor_gain", "y", gain=1.0),
    effect("sensor_bias", "y", offset=0.0), effect("sensor_drift", "y", rate=0.0), effect("misalignment", "w->y", gain=0.0),
    effect("static_nonlinearity", "y", quadratic=0.0, cubic=0.0),
    effect("clock_skew", "*", ratio=1.0), effect("clock_offset", "*", offset=0.0), effect("cross_coupling", "u->x", gain=0.0), effect("exchange", "x<->z", gain=0.0),
    effect("coulomb_friction", "z", level=0.0), effect("stribeck_friction", "z", level=0.0, extra=0.0, velocity=0.4), effect("hysteresis", "z", level=0.0, displacement=0.1, sharpness=1.5), effect("quadratic_drag", "z", coefficient=0.0),
    effect("cubic_stiffness", "x->z", coefficient=0.0), effect("unmodelled_mode", "u->state:z", frequency=2.0, damping=0.1, gain=0.0),
    effect("unmodelled_mode", "u->output:y", frequency=2.0, damping=0.1, gain=0.0), effect("constant_disturbance", "z", level=0.0),
    effect("periodic_disturbance", "z", frequency=1.0, amplitude=0.0, phase=0.3), effect("parameter_error", "A[z,x]", value=-9.0),
    effect("gain_jump", "u", gain=1.0, time=0.7, later=1.0), effect("parameter_jump", "A[z,x]", value=-9.0, time=0.7, later=-9.0),
]


def nominal_is_identity():
    u = commands(2)
    plain = simulate(TWO, TIME, u, x0=[0.3, -0.2])
    for item in NOMINAL:
        limit = 2e-5 if "time_constant" in item["parameters"] else 1e-7
        close(simulate(TWO, TIME, u, [item], x0=[0.3, -0.2]), plain, limit, f"nominal {item['effect']}")
    drops = np.zeros((len(TIME), 2), dtype=bool)
    close(simulate(TWO, TIME, u, [effect("dropped_commands", "u", probability=0.3)], [0.3, -0.2], drops), plain, 0.0, "no drops")


def first_order_step_response():
    """Step at 0.2 s delayed by 0.0533 s: 1 - exp(-2(t - 0.2533)), also behind an output delay or a clock offset."""
    u = (TIME >= 0.2 - 1e-9).astype(float)[:, None]
    expected = np.where(TIME > 0.2533, 1.0 - np.exp(-2.0 * (TIME - 0.2533)), 0.0)
    for item in (effect("input_delay", "u", delay=0.0533), effect("output_delay", "*", delay=0.0533), effect("clock_offset", "*", offset=0.0533)):
        close(simulate(FIRST, TIME, u, [item])[:, 0], expected, 1e-12, item["effect"])
    skew = np.where(TIME / 1.03 > 0.2, 1.0 - np.exp(-2.0 * (TIME / 1.03 - 0.2)), 0.0)
    close(simulate(FIRST, TIME, u, [effect("clock_skew", "*", ratio=1.03)])[:, 0], skew, 1e-12, "clock skew")
    early = np.where(TIME + 0.011 > 0.2, 1.0 - np.exp(-2.0 * (TIME + 0.011 - 0.2)), 0.0)
    close(simulate(FIRST, TIME, u, [effect("clock_offset", "*", offset=-0.011)])[:, 0], early, 1e-12, "negative clock offset")
    lag = np.where(TIME > 0.2, 1.0 - 2.0 * np.exp(-(TIME - 0.2) * 2.0) + np.exp(-(TIME - 0.2) * 4.0), 0.0)
    for item in (effect("actuator_lag", "u", time_constant=0.25), effect("sensor_lag", "*", time_constant=0.25)):
        close(simulate(FIRST, TIME, u, [item])[:, 0], lag, 1e-12, item["effect"])


def step_of_a_parameter():
    """x' = -a x + 2 u under u = 1 from x = 0, a = 2 until 0.4173 s and 5 from then on: the solution in closed form, between samples too."""
    at, u = 0.4173, np.ones((len(TIME), 1))
    reached = 1.0 - np.exp(-2.0 * at)
    expected = np.where(TIME < at, 1.0 - np.exp(-2.0 * TIME), 0.4 + (reached - 0.4) * np.exp(-5.0 * (TIME - at)))
    close(simulate(FIRST, TIME, u, [effect("parameter_jump", "A[x,x]", value=-2.0, time=at, later=-5.0)])[:, 0], expected, 1e-9, "step of a parameter")


def losses_are_as_many_and_as_long_as_asked():
    for probability, burst in ((0.2, None), (0.3, 4.0), (0.5, 2.0)):
        lost = losses({"probability": probability, "burst": burst}, np.random.default_rng(3).random(200_000))
        begins = np.count_nonzero(lost[1:] & ~lost[:-1])
        close(lost.mean(), probability, 0.01, "share of lost commands")
        close(lost.sum() / begins, burst or 1 / (1 - probability), 0.05, "mean length of a loss")


def superposition():
    items = [effect("input_delay", "u", delay=0.031), effect("actuator_lag", "v", time_constant=0.07), effect("unmodelled_mode", "u->state:z", frequency=3.1, damping=0.05, gain=2.0),
             effect("output_delay", "w", delay=0.027), effect("misalignment", "w->y", gain=0.2), effect("sensor_lag", "y", time_constant=0.04)]
    one, two = commands(2, 1), commands(2, 2)
    left = simulate(TWO, TIME, one, items) + 2 * simulate(TWO, TIME, two, items)
    close(left, simulate(TWO, TIME, one + 2 * two, items), 1e-11, "superposition")


def static_maps():
    """Through a plant that passes its input on, every sample is what the definition says."""
    new_each_time = np.random.default_rng(4).uniform(-1.0, 1.0, (len(TIME), 1))
    close(simulate(PASS, TIME, new_each_time), new_each_time, 0.0, "each sample sees its own command, the last one too")
    u = commands(1)
    v = u[:, 0]

    def passed(*items):
        return simulate(PASS, TIME, u, items)[:, 0]

    close(passed(effect("deadband", "u", width=0.4)), np.sign(v) * np.maximum(np.abs(v) - 0.4, 0), 1e-15, "dead band")
    close(passed(effect("saturation", "u", lower=-0.5, upper=0.9)), np.clip(v, -0.5, 0.9), 1e-15, "saturation")
    close(passed(effect("input_curve", "u", quadratic=0.2), effect("input_gain", "u", gain=1.1)), 1.1 * v + 0.2 * v * abs(v), 1e-15, "curve")
    at = TIME[len(TIME) // 3]
    close(passed(effect("gain_jump", "u", gain=0.9, time=at, later=1.3)), np.where(TIME < at - 1e-9, 0.9, 1.3) * v, 1e-15, "step of the gain")
    faded = v * (1 - 0.07 * TIME) + 0.1
    close(passed(effect("gain_fade", "u", rate=0.07), effect("input_offset", "u", offset=0.1)), faded, 1e-14, "fade")
    close(passed(effect("gain_fade", "u", rate=0.07), effect("input_offset", "u", offset=0.1), effect("deadband", "u", width=0.9)),
          np.sign(faded) * np.maximum(np.abs(faded) - 0.9, 0), 1e-14, "fade and dead band")
    play, expected = v[0], []
    for value in v:
        play = min(max(play, value - 0.3), value + 0.3)
        expected.append(play)
    close(passed(effect("backlash", "u", width=0.3)), expected, 1e-15, "play")
    limited, expected = v[0], [v[0]]
    for value in v[:-1]:
        limited += min(max(value - limited, -3.0 * TS), 3.0 * TS)
        expected.append(limited)
    close(passed(effect("rate_limit", "u", rate=3.0)), expected, 1e-13, "rate limit")
    grid = passed(effect("sensor_quantisation", "y", step=0.25))
    close(grid, 0.25 * np.sign(v) * np.floor(np.abs(v) / 0.25 + 0.5), 1e-15, "quantisation")
    ways = np.linspace(0.0, 1.0, 20001)[:, None] * v
    risen = np.abs(ways + 0.2 * ways**2 - 0.3 * ways**3).max(axis=0)
    close(passed(effect("static_nonlinearity", "y", quadratic=0.2, cubic=-0.3)), np.sign(v) * risen, 1e-8, "bend, level past its turn")
    # Whole samples and a bit, so that no rounding decides which side of an edge a sample sees.
    index, late = np.arange(len(v)), 1e-6

    def behind(samples):
        return v[np.maximum(index - samples, 0)]

    jump = int(round(0.8 / TS))
    for before, after in ((3, 9), (9, 3)):
        close(passed(effect("delay_jump", "u", delay=before * TS - late, time=jump * TS - late, later=after * TS - late)),
              np.where(index < jump, behind(before), behind(after)), 0.0, "jump of the delay")
    drift = passed(effect("delay_drift", "u", delay=2.5 * TS, rate=0.013))
    close(drift, v[np.maximum(np.floor(index - 2.5 - 0.013 * index), 0).astype(int)], 0.0, "drift of the delay")
    close(passed(effect("multi_rate", "u", period=6 * TS, phase=2 * TS)), v[np.where(index < 2, 0, index - (index - 2) % 6)], 0.0, "slower loop")
    waits = passed(effect("delay_jitter", "u", delay=5 * TS, spread=2 * TS, ordered=1.0))
    assert np.any(waits != v) and np.any(waits != behind(5)), "random delays are neither none nor all alike"
    drops = np.random.default_rng(5).random((len(TIME), 1)) < 0.5
    expected = [v[0]]
    for k in range(1, len(v)):
        expected.append(expected[-1] if drops[k, 0] else v[k])
    close(simulate(PASS, TIME, u, [effect("dropped_commands", "u", probability=0.5)], drops=drops)[:, 0], expected, 0.0, "drops")


def friction_sticks():
    """A 2 kg mass: below the level it rests exactly; above it moves with (force - level*mass)/mass; then it stops for good."""
    force = np.where(TIME < 0.5, 0.9, np.where(TIME < 1.0, 3.0, 0.0))[:, None]
    for integrator in ("fast", "reference"):
        speed = simulate(MASS, TIME, force, [effect("coulomb_friction", "speed", level=0.5)], integrator=integrator)[:, 1]
        expected = np.where(TIME < 0.5, 0.0, np.where(TIME < 1.0, TIME - 0.5, np.maximum(0.5 - 0.5 * (TIME - 1.0), 0.0)))
        close(speed, expected, 1e-9, f"friction, {integrator}")
        assert np.all(speed[TIME < 0.5] == 0.0) and np.all(speed[TIME > 2.001] == 0.0), "friction must hold exactly"
        # A force between the level and what holds at rest moves nothing; where no speed takes the extra away, and where any does, it is dry friction of one level.
        speed = simulate(MASS, TIME, force, [effect("stribeck_friction", "speed", level=0.3, extra=0.2, velocity=1e9)], integrator=integrator)[:, 1]
        close(speed, expected, 1e-9, f"friction that no speed lowers, {integrator}")
        speed = simulate(MASS, TIME, force, [effect("stribeck_friction", "speed", level=0.5, extra=0.9, velocity=1e-6)], integrator=integrator)[:, 1]
        close(speed, expected, 1e-4, f"friction that any speed lowers, {integrator}")
    swing = simulate(TWO, np.arange(600) * TS, np.zeros((600, 2)), [effect("coulomb_friction", "x", level=0.0), effect("coulomb_friction", "z", level=0.6)], x0=[0.5, 0.0])
    half = math.pi / math.sqrt(9 - 0.36)
    shrunk = 0.6 / 9 - (0.5 - 0.6 / 9) * math.exp(-0.6 * half)
    assert abs(swing[:, 0].min() - shrunk) < 1e-3, "the first swing loses what friction takes"
    assert swing[-1, 1] == 0.0 and swing[-1, 0] != 0.0 and abs(swing[-1, 0]) <= 0.6 / 9, "it stops off centre, inside the sticking range"


def one_step_predictions():
    """With gain 0 the predictor is the simulation; a gain pulls a wrong start to the measurement."""
    u = commands(2)
    truth = simulate(TWO, TIME, u, x0=[0.5, 0.0])
    items = [effect("output_delay", "*", delay=0.013)]
    free = Simulator(TWO, TIME, items).predictor(u, truth, np.zeros((2, 2)))
    close(free, simulate(TWO, TIME, u, items), 1e-12, "gain 0")
    pulled = Simulator(TWO, TIME).predictor(u, truth, 0.3 * np.eye(2))
    close(pulled[-10:], truth[-10:], 1e-6, "the predictor forgets the start")


def loop_equals_replay():
    """What a loop commands, replayed in open loop, gives what the loop measured."""
    noise = 0.01 * np.random.default_rng(3).standard_normal((len(TIME), 2))
    items = [effect("input_delay", "u", delay=0.017), effect("backlash", "u", width=0.05), effect("output_delay", "y", delay=0.033), effect("clock_skew", "*", ratio=1.01),
             effect("coulomb_friction", "z", level=0.2), effect("actuator_lag", "v", time_constant=0.03)]
    for chosen in (items, [i for i in items if i["effect"] != "coulomb_friction"]):
        def controller(k, measured):
            last = measured[-1] if k else np.zeros(2)
            return np.array([math.sin(0.3 * k) - 0.4 * last[0], 0.2 * math.cos(0.2 * k) - 0.1 * last[1]])
        u, y, _ = Simulator(TWO, TIME, chosen, [0.1, 0.0]).closed_loop(controller, noise)
        close(simulate(TWO, TIME, u, chosen, [0.1, 0.0], noise=noise), y, 1e-8, "replay")


def endless_friction_is_refused():
    """Friction that almost all vanishes within 1 nm/s: steps of the size of the motion overshoot and stick again without end. An error, not a simulation that never ends."""
    vanishes = effect("stribeck_friction", "speed", level=342.0, extra=3667.0, velocity=1e-9)
    force = np.where(TIME < 0.2, 9e4, np.where(TIME < 0.386, -9e4, 8038.0))[:, None]
    try:
        simulate(MASS, TIME, force, [vanishes])
    except ArithmeticError as problem:
        assert "without end" in str(problem), f"another reason: {problem}"


def hysteresis_keeps_the_books():
    """On a way x that never turns the memory is tanh(x/d) at sharpness 2 and 1 - exp(-x/d) at sharpness 1: the work of both forces is the energy of the mass."""
    level, way = 0.8, 0.05
    works = {2.0: lambda x: way * np.log(np.cosh(x / way)), 1.0: lambda x: x - way * (1.0 - np.exp(-x / way))}
    for sharpness, work in works.items():
        for integrator in ("fast", "reference"):
            bent = effect("hysteresis", "speed", level=level, displacement=way, sharpness=sharpness)
            position, speed = simulate(MASS, TIME, np.full((len(TIME), 1), 3.0), [bent], integrator=integrator).T
            assert position[-1] > 10 * way, "the force must be full in the end"
            close(0.5 * speed**2, 1.5 * position - level * work(position), 1e-6, f"work of a hysteresis of sharpness {sharpness}, {integrator}")


LAWS = [nominal_is_identity, losses_are_as_many_and_as_long_as_asked, first_order_step_response, step_of_a_parameter, superposition, static_maps, friction_sticks, endless_friction_is_refused, hysteresis_keeps_the_books, one_step_predictions, loop_equals_replay]

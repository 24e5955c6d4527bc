"""Case effects: what models with effects log, from the simulator in scripts/withheld."""

import numpy as np

from withheld.simulate import simulate

from .c2d_cases import TOOL
from .discretise import assert_close
from .effect_models import ARM, CRAFT, SAMPLED, TRIMMED, commands, stamps

SAMPLES = 90
LIMIT = 1e-8  # what the reference must reach against a looser integration, relative to the largest output


def _one(effect: str, channel: str, **parameters) -> dict:
    return {"effect": effect, "channel": channel, "parameters": parameters}


def _input_effects(a: str, b: str) -> list[list[dict]]:
    return [
        [_one("input_delay", a, delay=0.0313)], [_one("input_delay", b, delay=0.0071)], [_one("input_gain", b, gain=0.8)],
        [_one("input_curve", a, quadratic=0.25)], [_one("gain_fade", a, rate=0.13)], [_one("input_offset", b, offset=-0.2)],
        [_one("deadband", a, width=0.3)], [_one("backlash", b, width=0.25)], [_one("saturation", a, lower=-0.6, upper=0.5)],
        [_one("saturation", b, lower=None, upper=0.4)], [_one("rate_limit", a, rate=4.0)], [_one("actuator_lag", b, time_constant=0.07)],
        [_one("dropped_commands", a, probability=0.4)],
    ]


def _output_effects(y: str, z: str) -> list[list[dict]]:
    return [
        [_one("output_delay", y, delay=0.0437)], [_one("output_delay", "*", delay=0.0109)], [_one("sensor_lag", z, time_constant=0.05)],
        [_one("sensor_lag", "*", time_constant=0.03)], [_one("sensor_gain", y, gain=1.2)], [_one("sensor_gain", "*", gain=57.29577951)],
        [_one("sensor_bias", z, offset=0.4)], [_one("sensor_drift", y, rate=-0.2)], [_one("sensor_saturation", y, lower=-0.31, upper=0.27)],
        [_one("sensor_saturation", z, lower=-0.4, upper=None)], [_one("sensor_quantisation", z, step=0.13)], [_one("misalignment", f"{y}->{z}", gain=0.15)],
        [_one("clock_skew", "*", ratio=1.013)], [_one("clock_skew", "*", ratio=0.983)], [_one("clock_offset", "*", offset=0.0257)],
        [_one("clock_offset", "*", offset=-0.0123)],
    ]


def _dynamics_effects(a: str, x: str, other: str, y: str) -> list[list[dict]]:
    return [
        [_one("coulomb_friction", x, level=3.0)], [_one("quadratic_drag", x, coefficient=0.8)], [_one("cubic_stiffness", f"{other}->{x}", coefficient=30.0)],
        [_one("unmodelled_mode", f"{a}->input:{a}", frequency=4.0, damping=0.1, gain=0.4)],
        [_one("unmodelled_mode", f"{a}->state:{x}", frequency=6.3, damping=0.05, gain=5.0)],
        [_one("unmodelled_mode", f"{a}->output:{y}", frequency=8.0, damping=0.2, gain=-0.3)],
        [_one("constant_disturbance", x, level=1.5)], [_one("periodic_disturbance", x, frequency=1.3, amplitude=6.0, phase=0.7)],
    ]


COMBINED = {
    "lti": [
        [_one("input_delay", "roll", delay=0.033), _one("saturation", "roll", lower=-0.7, upper=0.6), _one("actuator_lag", "roll", time_constant=0.04), _one("sensor_bias", "rate", offset=0.1)],
        [_one("coulomb_friction", "p", level=2.0), _one("backlash", "roll", width=0.1), _one("output_delay", "*", delay=0.027)],
        [_one("gain_fade", "roll", rate=0.2), _one("deadband", "roll", width=0.25), _one("rate_limit", "pitch", rate=6.0)],
        [_one("clock_skew", "*", ratio=1.02), _one("sensor_drift", "accel", rate=0.1), _one("unmodelled_mode", "pitch->output:accel", frequency=5.0, damping=0.1, gain=0.5)],
        [_one("quadratic_drag", "p", coefficient=0.5), _one("cubic_stiffness", "phi->p", coefficient=20.0)],
        [_one("input_gain", "roll", gain=1.2), _one("input_curve", "roll", quadratic=-0.2), _one("input_offset", "roll", offset=0.1), _one("gain_fade", "roll", rate=0.1),
         _one("backlash", "roll", width=0.08), _one("saturation", "roll", lower=-0.9, upper=0.8), _one("rate_limit", "roll", rate=9.0), _one("actuator_lag", "roll", time_constant=0.03),
         _one("unmodelled_mode", "roll->input:roll", frequency=7.0, damping=0.1, gain=0.3), _one("dropped_commands", "roll", probability=0.2)],
        [_one("misalignment", "rate->accel", gain=0.2), _one("misalignment", "accel->rate", gain=-0.1), _one("sensor_lag", "rate", time_constant=0.04), _one("output_delay", "rate", delay=0.013),
         _one("output_delay", "*", delay=0.008), _one("clock_offset", "*", offset=0.011), _one("clock_skew", "*", ratio=0.99), _one("sensor_gain", "rate", gain=0.9), _one("sensor_gain", "*", gain=1.1),
         _one("sensor_bias", "accel", offset=-0.2), _one("sensor_saturation", "accel", lower=-2.0, upper=2.5), _one("sensor_quantisation", "rate", step=0.05)],
        [_one("cross_coupling", "pitch->v", gain=3.0), _one("parameter_error", "A[v,phi]", value=8.5), _one("parameter_error", "B[p,roll]", value=30.0)],
        [_one("coulomb_friction", "p", level=1.0), _one("coulomb_friction", "v", level=0.3), _one("periodic_disturbance", "p", frequency=0.9, amplitude=5.0, phase=-1.0)],
    ],
    "equations": [
        [_one("input_delay", "torque", delay=0.041), _one("saturation", "torque", lower=-0.5, upper=0.7), _one("actuator_lag", "torque", time_constant=0.05), _one("sensor_bias", "angle", offset=0.05)],
        [_one("coulomb_friction", "speed", level=1.5), _one("backlash", "torque", width=0.15), _one("output_delay", "angle", delay=0.031)],
        [_one("gain_fade", "torque", rate=0.15), _one("deadband", "torque", width=0.2), _one("parameter_error", "weight", value=2.4)],
        [_one("clock_skew", "*", ratio=0.985), _one("sensor_drift", "load", rate=0.1), _one("unmodelled_mode", "torque->output:load", frequency=5.0, damping=0.1, gain=0.5)],
        [_one("quadratic_drag", "speed", coefficient=0.6), _one("coulomb_friction", "speed", level=0.8), _one("constant_disturbance", "spring", level=0.2)],
        [_one("parameter_error", "inertia", value=0.3), _one("unmodelled_mode", "wind->state:speed", frequency=3.0, damping=0.1, gain=2.0), _one("sensor_lag", "*", time_constant=0.04), _one("clock_offset", "*", offset=0.017)],
        [_one("cross_coupling", "speed->spring", gain=0.4), _one("cubic_stiffness", "angle->speed", coefficient=5.0), _one("dropped_commands", "wind", probability=0.3)],
    ],
    "sampled": [
        [_one("input_delay", "roll", delay=0.033), _one("saturation", "roll", lower=-0.7, upper=0.6), _one("actuator_lag", "roll", time_constant=0.04), _one("sensor_bias", "rate", offset=0.1)],
        [_one("gain_fade", "pitch", rate=0.2), _one("deadband", "pitch", width=0.25), _one("rate_limit", "roll", rate=6.0), _one("misalignment", "rate->accel", gain=0.2)],
        [_one("output_delay", "*", delay=0.0113), _one("sensor_lag", "accel", time_constant=0.04), _one("clock_skew", "*", ratio=0.99)],
    ],
}


def _single(kind: str) -> list[list[dict]]:
    if kind == "sampled":
        return _input_effects("roll", "pitch") + _output_effects("rate", "accel")
    if kind == "lti":
        own = [[_one("parameter_error", "A[p,phi]", value=-9.0)], [_one("parameter_error", "B[p,pitch]", value=-6.0)],
               [_one("cross_coupling", "p->v", gain=0.8)], [_one("cross_coupling", "roll->phi", gain=1.5)]]
        return _input_effects("roll", "pitch") + own + _dynamics_effects("roll", "p", "phi", "rate") + _output_effects("rate", "accel")
    own = [[_one("parameter_error", "viscous", value=0.35)], [_one("parameter_error", "area", value=0.5)],
           [_one("cross_coupling", "speed->spring", gain=0.5)], [_one("cross_coupling", "wind->angle", gain=0.4)]]
    return _input_effects("torque", "wind") + own + _dynamics_effects("torque", "speed", "angle", "angle") + _output_effects("angle", "load")


def _case(label: str, model: dict, effects: list[dict], seed: int, x0=None, uneven: bool = False) -> dict:
    time, u = stamps(SAMPLES, uneven), commands(SAMPLES, seed)
    drops = None
    if any(item["effect"] == "dropped_commands" for item in effects):
        drops = np.random.default_rng(seed).random(u.shape) < 0.3
        drops[0] = False
    y = simulate(model, time, u, effects, x0, drops, integrator="reference", tolerance=1e-12)
    if not model.get("sample_time_s"):
        looser = simulate(model, time, u, effects, x0, drops, tolerance=1e-11)
        assert_close(looser, y, LIMIT, label)
    return {"id": label, "model": model, "time": time, "u": u, "x0": x0, "effects": effects, "drops": drops, "y": y}


def effects(stored: dict | None) -> dict:
    models = {"lti": CRAFT, "equations": ARM, "sampled": SAMPLED}
    starts = {"lti": [0.3, 0.5, -0.1], "equations": [-0.4, 0.6, 0.2], "sampled": [0.3, 0.5, -0.1]}
    cases, seed = [], 0
    for kind, model in models.items():
        cases.append(_case(f"{kind}_none", model, [], 1000))
        numbers: dict[str, int] = {}
        for items in _single(kind):
            name = items[0]["effect"]
            numbers[name] = numbers.get(name, 0) + 1
            seed += 1
            cases.append(_case(f"{kind}_{name}_{numbers[name]}", model, items, seed, starts[kind] if seed % 3 else None))
        for number, items in enumerate(COMBINED[kind], start=1):
            seed += 1
            cases.append(_case(f"{kind}_combined_{number}", model, items, seed, starts[kind]))
    for number, items in enumerate([COMBINED["lti"][0], COMBINED["lti"][3], COMBINED["lti"][6], [_one("input_delay", "pitch", delay=0.021)]], start=1):
        cases.append(_case(f"trimmed_uneven_{number}", TRIMMED, items, 500 + number, uneven=True))
    for number, items in enumerate(COMBINED["equations"][:4], start=1):
        cases.append(_case(f"equations_uneven_{number}", ARM, items, 600 + number, uneven=True))
    cases.append(_case("lti_exchange_1", CRAFT, [_one("exchange", "v<->phi", gain=0.7)], 711, starts["lti"]))
    cases.append(_case("equations_exchange_1", ARM, [_one("exchange", "angle<->spring", gain=0.6)], 712, starts["equations"]))
    bend = {"candidates": [{"name": "bend", "state": "p", "adds": "k*tanh(v/w) - m*phi*abs(phi)*roll", "parameters": {"w": {"value": 0.5, "lower": 0.01}}},
                           {"state": "v", "adds": "idle*p^3"}]}
    cases.append(_case("equations_candidate_1", CRAFT | bend, [_one("candidate", "bend", k=2.5, w=0.35, m=1.4)], 721, starts["lti"]))
    coil = {"candidates": [{"state": "speed", "adds": "h*sin(3*angle)*torque"}]}
    items = [_one("candidate", "speed += h*sin(3*angle)*torque", h=1.7), _one("parameter_error", "viscous", value=0.3), _one("input_delay", "torque", delay=0.021)]
    cases.append(_case("equations_candidate_2", ARM | coil, items, 722, starts["equations"], uneven=True))
    stribeck = _one("stribeck_friction", "p", level=1.5, extra=2.5, velocity=0.4)
    cases.append(_case("lti_stribeck_friction_1", CRAFT, [stribeck], 701, starts["lti"]))
    cases.append(_case("lti_stribeck_friction_2", CRAFT, [stribeck, _one("input_delay", "roll", delay=0.0233)], 702, uneven=True))
    cases.append(_case("equations_stribeck_friction_1", ARM, [_one("stribeck_friction", "speed", level=0.6, extra=0.9, velocity=0.25)], 703, starts["equations"]))
    wen = _one("hysteresis", "p", level=2.5, displacement=0.03, sharpness=1.0)
    cases.append(_case("lti_hysteresis_1", CRAFT, [wen], 761, starts["lti"]))
    cases.append(_case("lti_hysteresis_2", CRAFT, [{**wen, "parameters": {"level": 1.5, "displacement": 0.1, "sharpness": 2.6}}, _one("coulomb_friction", "p", level=0.5)], 762, uneven=True))
    cases.append(_case("equations_hysteresis_1", ARM, [_one("hysteresis", "speed", level=0.8, displacement=0.05, sharpness=1.7)], 763, starts["equations"]))
    bends = [_one("static_nonlinearity", "rate", quadratic=0.3, cubic=-0.15), _one("static_nonlinearity", "accel", quadratic=-0.2, cubic=0.05)]
    for number, bent in enumerate(bends, start=1):
        cases.append(_case(f"lti_static_nonlinearity_{number}", CRAFT, [bent], 730 + number, starts["lti"]))
        more = [bent, _one("sensor_gain", bent["channel"], gain=1.2), _one("sensor_bias", bent["channel"], offset=-0.1), _one("sensor_lag", "*", time_constant=0.03)]
        cases.append(_case(f"sampled_static_nonlinearity_{number}", SAMPLED, more, 740 + number, starts["sampled"]))
    cases.append(_case("equations_static_nonlinearity_1", ARM, [_one("static_nonlinearity", "angle", quadratic=0.0, cubic=-0.9)], 751, starts["equations"], uneven=True))
    moving = [
        [_one("delay_jump", "roll", delay=0.0213, time=0.71, later=0.0831)], [_one("delay_jump", "roll", delay=0.0831, time=0.6213, later=0.0113)],
        [_one("delay_drift", "roll", delay=0.0113, rate=0.043)], [_one("delay_drift", "roll", delay=0.061, rate=-0.09)],
        [_one("multi_rate", "roll", period=0.0713, phase=0.0231)], [_one("delay_jitter", "roll", delay=0.0437, spread=0.0, ordered=1.0)],
        [_one("multi_rate", "roll", period=0.0577, phase=0.0117), _one("input_delay", "roll", delay=0.0143), _one("delay_jump", "roll", delay=0.0, time=0.5, later=0.037),
         _one("delay_drift", "roll", delay=0.0091, rate=0.02), _one("gain_fade", "roll", rate=0.2), _one("backlash", "roll", width=0.05)],
    ]
    stepping = {
        "lti": [
            [_one("gain_jump", "roll", gain=1.1, time=0.7113, later=0.6)], [_one("parameter_jump", "A[p,phi]", value=-9.0, time=0.6317, later=-4.0)],
            [_one("parameter_jump", "B[p,roll]", value=25.0, time=0.41, later=12.0), _one("parameter_jump", "A[v,phi]", value=9.0, time=0.93, later=7.0), _one("sensor_lag", "*", time_constant=0.03),
             _one("actuator_lag", "roll", time_constant=0.05), _one("output_delay", "rate", delay=0.0137)],
            [_one("parameter_jump", "A[p,phi]", value=-8.0, time=0.7213, later=-12.0), _one("coulomb_friction", "p", level=1.5), _one("gain_jump", "pitch", gain=1.0, time=0.5, later=-1.0)],
        ],
        "equations": [
            [_one("gain_jump", "torque", gain=0.9, time=0.9, later=1.5), _one("gain_fade", "torque", rate=0.1)], [_one("parameter_jump", "inertia", value=0.25, time=0.6127, later=0.4)],
            [_one("parameter_jump", "viscous", value=0.3, time=0.6, later=0.9), _one("parameter_jump", "inertia", value=0.22, time=0.3333, later=0.3), _one("coulomb_friction", "speed", level=0.7)],
            [_one("parameter_jump", "weight", value=2.0, time=0.8, later=3.0), _one("sensor_lag", "*", time_constant=0.04), _one("clock_skew", "*", ratio=1.02)],
        ],
        "sampled": [[_one("gain_jump", "pitch", gain=0.8, time=0.7131, later=1.4), _one("input_delay", "pitch", delay=0.013)]],
    }
    for kind, model in models.items():
        for number, items in enumerate(stepping[kind], start=1):
            cases.append(_case(f"{kind}_stepping_{number}", model, items, 850 + number, starts[kind], uneven=number == 3))
    renamed = {"lti": "roll", "equations": "torque", "sampled": "pitch"}
    for kind, model in models.items():
        for number, items in enumerate(moving, start=1):
            own = [{**item, "channel": renamed[kind]} for item in items]
            cases.append(_case(f"{kind}_moving_{number}", model, own, 800 + number, starts[kind], uneven=number == 5 and kind != "sampled"))
    for case in cases:
        _assert_no_tie(case)
    return {"tool": TOOL, "tolerance": {"default": 1e-12, "y": LIMIT}, "cases": cases}


def _assert_no_tie(case: dict) -> None:
    """No sample may sit where rounding decides between two lattice points."""
    free = [item for item in case["effects"] if item["effect"] != "sensor_quantisation"]
    if len(free) == len(case["effects"]):
        return
    y = simulate(case["model"], case["time"], case["u"], free, case["x0"], case["drops"])
    outputs = [channel["name"] for channel in case["model"]["outputs"]]
    for item in case["effects"]:
        if item["effect"] == "sensor_quantisation":
            places = y[:, outputs.index(item["channel"])] / item["parameters"]["step"]
            assert np.min(np.abs(places - np.floor(places) - 0.5)) > 1e-4, f"{case['id']}: a sample between two lattice points"

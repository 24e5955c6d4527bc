"""Models and commands of the case `effects`: two inputs and two outputs each, so that every channel can be missed."""

import numpy as np
from scipy import linalg

FORMAT = "deadtime/model@1"


def _channels(*triples, operating=None) -> list[dict]:
    channels = [{"name": name, "unit": unit} for name, unit in triples]
    for channel, value in zip(channels, operating or []):
        channel["operating"] = value
    return channels


CRAFT = {
    "format": FORMAT, "name": "craft", "kind": "lti", "sample_time_s": 0.0,
    "inputs": _channels(("roll", "1"), ("pitch", "1")),
    "states": _channels(("v", "m/s"), ("p", "rad/s"), ("phi", "rad")),
    "outputs": _channels(("rate", "rad/s"), ("accel", "m/s^2")),
    "initial": [0.1, -0.2, 0.05],
    "A": [[-0.4, 0.0, 9.81], [-1.2, -3.0, -12.0], [0.0, 1.0, 0.0]],
    "B": [[2.0, 0.0], [25.0, -4.0], [0.0, 0.7]],
    "C": [[0.0, 1.0, 0.0], [-0.4, 0.0, 0.0]],
    "D": [[0.0, 0.0], [2.0, 0.5]],
}
TRIMMED = {
    **CRAFT, "name": "trimmed craft", "input_delay_s": [0.0, 0.0137],
    "inputs": _channels(("roll", "1"), ("pitch", "1"), operating=[0.3, -0.1]),
    "outputs": _channels(("rate", "rad/s"), ("accel", "m/s^2"), operating=[0.0, 0.25]),
}
ARM = {
    "format": FORMAT, "name": "arm", "kind": "equations",
    "inputs": _channels(("torque", "N m"), ("wind", "m/s")),
    "outputs": _channels(("angle", "rad"), ("load", "N m")),
    "states": {
        "angle": {"unit": "rad", "initial": 0.3}, "speed": {"unit": "rad/s", "initial": 0.0}, "spring": {"unit": "rad", "initial": 0.1},
    },
    "parameters": {
        "inertia": {"unit": "kg m^2", "value": 0.25}, "viscous": {"unit": "N m s/rad", "value": 0.2},
        "weight": {"unit": "N m", "value": 2.0}, "stiffness": {"unit": "N m/rad", "value": 1.5}, "area": {"unit": "N m s^2/m^2", "value": 0.4},
    },
    "derivatives": {
        "angle": "speed",
        "speed": "(torque - viscous*speed - weight*sin(angle) - stiffness*(angle - spring) + area*wind*abs(wind))/inertia",
        "spring": "-2^2*spring/2 + 1.6*tanh(angle)",
    },
    "output_equations": {"angle": "angle", "load": "stiffness*(angle - spring) + 0.1*torque"},
}


def _sampled() -> dict:
    """CRAFT behind a zero-order hold of 20 ms, rounded to six digits."""
    block = linalg.expm(0.02 * np.block([[np.array(CRAFT["A"]), np.array(CRAFT["B"])], [np.zeros((2, 5))]]))
    return {
        **CRAFT, "name": "sampled craft", "sample_time_s": 0.02,
        "A": np.round(block[:3, :3], 6).tolist(), "B": np.round(block[:3, 3:], 6).tolist(),
    }


SAMPLED = _sampled()


def stamps(samples: int, uneven: bool = False) -> np.ndarray:
    """20 ms, or 20 ms with steps between 8 and 40 ms, s."""
    if not uneven:
        return np.round(np.arange(samples) * 0.02, 10)
    steps = np.random.default_rng(77).uniform(0.008, 0.04, samples - 1)
    return np.round(np.concatenate([[0.0], np.cumsum(steps)]), 4)


def commands(samples: int, seed: int) -> np.ndarray:
    """Steps of many levels, then ramps (whose samples are held), then a slow sine; different in both channels."""
    rng = np.random.default_rng(seed)
    columns = []
    for channel in range(2):
        levels = np.repeat(rng.uniform(-1.2, 1.2, samples), 5 + 2 * channel)[:samples]
        ramp = np.interp(np.arange(samples), np.linspace(0, samples, 7), rng.uniform(-1.0, 1.0, 7))
        sine = 0.8 * np.sin(2 * np.pi * np.arange(samples) / (37 - 8 * channel))
        part = np.arange(samples) * 3 // samples
        columns.append(np.choose(part, [levels, ramp, sine]))
    return np.round(np.stack(columns, axis=1), 3)

"""The plants of the blind cases: nominal models and how a run with them looks.

`levels`: usual size of each command about its trim; `trim`: command that holds the initial state; `settling`: the time scale of
the response that matters, s; `forces`: states whose derivative a force acts on; `velocities`: those on which friction and drag act.
"""

from dataclasses import dataclass, field

G = 9.81


@dataclass(frozen=True)
class Plant:
    model: dict
    sample_time: float
    duration: float
    levels: tuple[float, ...]
    settling: float
    forces: tuple[str, ...]
    velocities: tuple[str, ...] = ()
    closed: bool = False  # runs only in a loop
    may_close: bool = False
    trim: tuple[float, ...] = field(default=())


def _lti(name, inputs, states, outputs, a, b, c, d, **more) -> dict:
    def channels(pairs):
        return [{"name": n, "unit": u} for n, u in pairs]

    return {
        "format": "deadtime/model@1", "name": name, "kind": "lti", "sample_time_s": 0.0, "inputs": channels(inputs), "states": channels(states),
        "outputs": channels(outputs), "initial": [0.0] * len(states), "A": a, "B": b, "C": c, "D": d, **more,
    }


def _equations(name, inputs, outputs, states, parameters, derivatives, output_equations) -> dict:
    return {
        "format": "deadtime/model@1", "name": name, "kind": "equations", "inputs": [{"name": n, "unit": u} for n, u in inputs],
        "outputs": [{"name": n, "unit": u} for n, u in outputs], "states": {n: {"unit": u, "initial": v} for n, u, v in states},
        "parameters": {n: {"unit": u, "value": v} for n, u, v in parameters}, "derivatives": derivatives, "output_equations": output_equations,
    }


LATERAL = Plant(_lti(
    "lateral", [("delta_lat", "1")], [("v", "m/s"), ("p", "rad/s"), ("phi", "rad")], [("p", "rad/s"), ("ay", "m/s^2")],
    [[-0.211, 0.0, G], [-3.613, 0.0, 0.0], [0.0, 1.0, 0.0]], [[9.379], [851.287], [0.0]], [[0.0, 1.0, 0.0], [-0.211, 0.0, 0.0]], [[0.0], [9.379]],
), 0.02, 24.0, (0.004,), 0.3, ("v", "p"), ("v", "p"), closed=True)
LONGITUDINAL = Plant(_lti(
    "longitudinal", [("delta_lon", "1")], [("u", "m/s"), ("q", "rad/s"), ("theta", "rad")], [("q", "rad/s"), ("ax", "m/s^2")],
    [[-0.282, 0.0, -G], [6.297, 0.0, 0.0], [0.0, 1.0, 0.0]], [[-8.758], [473.061], [0.0]], [[0.0, 1.0, 0.0], [-0.282, 0.0, 0.0]], [[0.0], [-8.758]],
), 0.02, 24.0, (0.006,), 0.3, ("u", "q"), ("u", "q"), closed=True)
DIRECTIONAL = Plant(_lti(
    "directional", [("delta_dir", "1")], [("r", "rad/s"), ("psi", "rad")], [("r", "rad/s"), ("psi", "rad")],
    [[-8.178, 0.0], [1.0, 0.0]], [[255.59], [0.0]], [[1.0, 0.0], [0.0, 1.0]], [[0.0], [0.0]],
), 0.02, 24.0, (0.02,), 0.12, ("r",), ("r",), closed=True)
VERTICAL = Plant(_lti(
    "vertical", [("delta_ver", "1")], [("w", "m/s")], [("az", "m/s^2")], [[-0.731]], [[-34.35]], [[-0.731]], [[-34.35]],
), 0.02, 20.0, (0.08,), 0.5, ("w",), ("w",), may_close=True)
ROLL = Plant(_lti(
    "stabilised roll", [("roll_command", "rad")], [("p", "rad/s"), ("phi", "rad")], [("p", "rad/s"), ("phi", "rad")],
    [[-11.2, -64.0], [1.0, 0.0]], [[64.0], [0.0]], [[1.0, 0.0], [0.0, 1.0]], [[0.0], [0.0]],
), 0.01, 16.0, (0.25,), 0.15, ("p",), ("p",))
VEHICLE = Plant(_lti(
    "single-track vehicle", [("steering", "rad")], [("v", "m/s"), ("r", "rad/s")], [("yaw_rate", "rad/s"), ("ay", "m/s^2")],
    [[-5.6, -19.4], [1.1, -6.2]], [[59.0], [37.0]], [[0.0, 1.0], [-5.6, 0.6]], [[0.0], [59.0]],
), 0.01, 20.0, (0.04,), 0.2, ("v", "r"), ("v", "r"), may_close=True)
THERMAL = Plant(_lti(
    "thermal process", [("heater", "W"), ("fan", "1")], [("core", "K"), ("shell", "K"), ("air", "K")], [("core", "K"), ("air", "K")],
    [[-0.030, 0.024, 0.0], [0.012, -0.034, 0.014], [0.0, 0.022, -0.041]], [[0.0016, 0.0], [0.0, -0.12], [0.0, 0.31]],
    [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], [[0.0, 0.0], [0.0, 0.0]], input_delay_s=[7.3, 0.0],
), 4.0, 4800.0, (120.0, 0.2), 40.0, ("core", "shell", "air"), trim=(350.0, 0.5))
THERMAL.model["inputs"][0]["operating"], THERMAL.model["inputs"][1]["operating"] = 350.0, 0.5
THERMAL.model["outputs"][0]["operating"], THERMAL.model["outputs"][1]["operating"] = 351.0, 298.0
TWO_MASSES = Plant(_lti(
    "two masses", [("torque", "N m")], [("motor", "rad/s"), ("twist", "rad"), ("load", "rad/s")], [("motor", "rad/s"), ("load", "rad/s")],
    [[-1.5, -400.0, 0.0], [1.0, 0.0, -1.0], [0.0, 150.0, -0.9]], [[50.0], [0.0], [0.0]], [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], [[0.0], [0.0]],
), 0.01, 20.0, (1.2,), 0.15, ("motor", "load"), ("motor", "load"), may_close=True)
AIR_HEATER = Plant(_lti(
    "air heater", [("voltage", "V")], [("wire", "K"), ("air", "K"), ("sensor", "K")], [("temperature", "K")],
    [[-2.9, 0.8, 0.0], [3.1, -4.4, 0.0], [0.0, 2.2, -2.2]], [[2.6], [0.0], [0.0]], [[0.0, 0.0, 1.0]], [[0.0]], input_delay_s=[0.16],
), 0.08, 110.0, (2.0,), 0.6, ("wire", "air"))
GIMBAL = Plant(_lti(
    "stabilised gimbal", [("pan_command", "rad"), ("tilt_command", "rad")],
    [("pan", "rad"), ("pan_rate", "rad/s"), ("tilt", "rad"), ("tilt_rate", "rad/s")], [("pan", "rad"), ("tilt", "rad"), ("tilt_rate", "rad/s")],
    [[0.0, 1.0, 0.0, 0.0], [-90.0, -13.0, 0.0, 1.6], [0.0, 0.0, 0.0, 1.0], [0.0, -2.1, -140.0, -18.0]],
    [[0.0, 0.0], [90.0, 0.0], [0.0, 0.0], [0.0, 140.0]], [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]], [[0.0, 0.0]] * 3,
), 0.01, 14.0, (0.3, 0.2), 0.12, ("pan_rate", "tilt_rate"), ("pan_rate", "tilt_rate"))
SERVO = Plant(_equations(
    "servo", [("voltage", "V")], [("angle", "rad"), ("current", "A")], [("angle", "rad", 0.0), ("speed", "rad/s", 0.0), ("current", "A", 0.0)],
    [("inertia", "kg m^2", 0.012), ("viscous", "N m s/rad", 0.015), ("constant", "N m/A", 0.12), ("resistance", "Ohm", 1.1), ("inductance", "H", 0.03)],
    {"angle": "speed", "speed": "(constant*current - viscous*speed)/inertia", "current": "(voltage - resistance*current - constant*speed)/inductance"},
    {"angle": "angle", "current": "current"},
), 0.01, 18.0, (4.0,), 0.15, ("speed",), ("speed",), closed=True)
MOTOR = Plant(_equations(
    "motor with fan", [("voltage", "V")], [("speed", "rad/s")], [("speed", "rad/s", 40.0)],
    [("inertia", "kg m^2", 0.004), ("viscous", "N m s/rad", 0.001), ("constant", "N m/A", 0.08), ("resistance", "Ohm", 0.9), ("fan", "N m s^2/rad^2", 0.00006)],
    {"speed": "(constant*(voltage - constant*speed)/resistance - viscous*speed - fan*speed*abs(speed))/inertia"}, {"speed": "speed"},
), 0.02, 24.0, (1.5,), 0.4, ("speed",), ("speed",), may_close=True, trim=(4.73,))
TANKS = Plant(_equations(
    "coupled tanks", [("pump_1", "V"), ("pump_2", "V")], [("level_1", "m"), ("level_2", "m")], [("h1", "m", 0.16), ("h2", "m", 0.10)],
    [("area", "m^2", 0.0154), ("pump", "m^3/s/V", 0.0000124), ("valve_12", "m^2.5/s", 0.00035), ("outlet", "m^2.5/s", 0.00033)],
    {"h1": "(pump*pump_1 - valve_12*sign(h1 - h2)*sqrt(abs(h1 - h2)))/area",
     "h2": "(pump*pump_2 + valve_12*sign(h1 - h2)*sqrt(abs(h1 - h2)) - outlet*sqrt(max(h2, 0)))/area"},
    {"level_1": "h1", "level_2": "h2"},
), 2.0, 3000.0, (1.3, 0.6), 60.0, ("h1", "h2"), trim=(6.91, 1.5))
CART = Plant(_equations(
    "cart with pendulum", [("force", "N")], [("position", "m"), ("angle", "rad")],
    [("x", "m", 0.0), ("speed", "m/s", 0.0), ("theta", "rad", 0.0), ("rate", "rad/s", 0.0)],
    [("cart", "kg", 0.8), ("bob", "kg", 0.2), ("length", "m", 0.4), ("damping", "N s/m", 0.6), ("pivot", "1/s", 0.08)],
    {"x": "speed",
     "speed": "(force - damping*speed + bob*length*rate^2*sin(theta) - 9.81*bob*sin(theta)*cos(theta))/(cart + bob*sin(theta)^2)",
     "theta": "rate",
     "rate": "(-(force - damping*speed + bob*length*rate^2*sin(theta))*cos(theta) + (cart + bob)*9.81*sin(theta))/(length*(cart + bob*sin(theta)^2)) - pivot*rate"},
    {"position": "x", "angle": "theta"},
), 0.02, 20.0, (1.2,), 0.2, ("speed", "rate"), ("speed", "rate"), closed=True)
CRUISE = Plant(_equations(
    "car on a road", [("drive", "N")], [("speed", "m/s"), ("accel", "m/s^2")], [("speed", "m/s", 14.0), ("thrust", "N", 600.0)],
    [("mass", "kg", 1250.0), ("air", "kg/m", 0.42), ("rolling", "N s/m", 37.0), ("engine", "s", 0.35)],
    {"speed": "(thrust - rolling*speed - air*speed*abs(speed))/mass", "thrust": "(drive - thrust)/engine"},
    {"speed": "speed", "accel": "(thrust - rolling*speed - air*speed*abs(speed))/mass"},
), 0.1, 160.0, (700.0,), 2.0, ("speed",), ("speed",), trim=(600.32,))

PLANTS = {
    "lateral": LATERAL, "longitudinal": LONGITUDINAL, "directional": DIRECTIONAL, "vertical": VERTICAL, "roll": ROLL, "vehicle": VEHICLE,
    "thermal": THERMAL, "two_masses": TWO_MASSES, "air_heater": AIR_HEATER, "gimbal": GIMBAL,
    "servo": SERVO, "motor": MOTOR, "tanks": TANKS, "cart": CART, "cruise": CRUISE,
}

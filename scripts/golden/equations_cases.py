"""Case equations: nonlinear models under held inputs, integrated between any two samples."""

import math

import numpy as np
from scipy import integrate

from .c2d_cases import TOOL
from .discretise import assert_close

PLAIN = {"abs": abs, "max": max, "min": min, "sign": lambda v: float(v > 0) - float(v < 0)}
NAMES = {name: getattr(math, name) for name in "sin cos tan asin acos atan atan2 sinh cosh tanh exp log sqrt".split()} | PLAIN


def _model(name, inputs, states, parameters, derivatives, outputs) -> dict:
    """A model@1 document of kind equations; states: name -> initial."""
    return {
        "format": "deadtime/model@1", "name": name, "kind": "equations",
        "inputs": [{"name": n} for n in inputs], "outputs": [{"name": n} for n in outputs],
        "states": {n: {"initial": float(v)} for n, v in states.items()},
        "parameters": {n: {"value": float(v)} for n, v in parameters.items()},
        "derivatives": derivatives, "output_equations": outputs,
    }


def cart_pendulum():
    p = {"cart": 0.8, "bob": 0.2, "length": 0.4, "g": 9.81, "viscous": 1.5, "pivot": 0.002}
    model = _model(
        "cart_pendulum", ["force"], {"position": 0.0, "speed": 0.1, "angle": 2.5, "rate": 0.0}, p,
        {
            "position": "speed",
            "speed": "(force - viscous*speed + bob*sin(angle)*(length*rate^2 + g*cos(angle)) + pivot*rate*cos(angle)/length)"
                     "/(cart + bob*sin(angle)^2)",
            "angle": "rate",
            "rate": "(-cos(angle)*(force - viscous*speed + bob*length*rate^2*sin(angle))"
                    " - (cart + bob)*(g*sin(angle) + pivot*rate/(bob*length)))/(length*(cart + bob*sin(angle)^2))",
        },
        {"tip": "position + length*sin(angle)", "height": "-length*cos(angle)"},
    )

    def slope(t, x, u):
        # From the two equations of motion, as a linear system in the accelerations.
        _, v, a, w = x
        mass = np.array([[p["cart"] + p["bob"], p["bob"] * p["length"] * math.cos(a)],
                         [p["bob"] * p["length"] * math.cos(a), p["bob"] * p["length"] ** 2]])
        force = np.array([u[0] - p["viscous"] * v + p["bob"] * p["length"] * w**2 * math.sin(a),
                          -p["bob"] * p["g"] * p["length"] * math.sin(a) - p["pivot"] * w])
        acceleration = np.linalg.solve(mass, force)
        return np.array([v, acceleration[0], w, acceleration[1]])

    def out(t, x, u):
        return [x[0] + p["length"] * math.sin(x[2]), -p["length"] * math.cos(x[2])]

    return model, slope, out, 0.05, 3.0, "DOP853"


def two_tanks():
    p = {"area1": 0.02, "area2": 0.015, "valve12": 3e-4, "valve2": 2.5e-4, "g": 9.81}
    flow12 = "valve12*sign(level1 - level2)*sqrt(2*g*abs(level1 - level2))"
    flow2 = "valve2*sqrt(2*g*level2)"
    model = _model(
        "two_tanks", ["pump"], {"level1": 0.4, "level2": 0.2}, p,
        {"level1": f"(pump - {flow12})/area1", "level2": f"({flow12} - {flow2})/area2"},
        {"level2": "level2", "outflow": flow2},
    )

    def slope(t, x, u):
        d = x[0] - x[1]
        q12 = p["valve12"] * math.copysign(math.sqrt(2 * p["g"] * abs(d)), d)
        return np.array([(u[0] - q12) / p["area1"], (q12 - p["valve2"] * math.sqrt(2 * p["g"] * x[1])) / p["area2"]])

    def out(t, x, u):
        return [x[1], p["valve2"] * math.sqrt(2 * p["g"] * x[1])]

    # The pump keeps level 1 above level 2: no reversal, where the square root has no derivative.
    return model, slope, out, 1.0, (6e-4, 1.4e-3), "DOP853"


def servo():
    p = {"inertia": 2e-4, "constant": 0.05, "resistance": 1.2, "inductance": 2e-3, "viscous": 1e-4, "level": 4e-3, "width": 0.5, "fade": 5.0}
    model = _model(
        "servo", ["voltage", "load"], {"angle": 0.0, "speed": 2.0, "current": 0.0}, p,
        {
            "angle": "speed",
            "speed": "(constant*current - viscous*speed - level*tanh(speed/width) - load)/inertia",
            "current": "(voltage*exp(-time/fade) - resistance*current - constant*speed)/inductance",
        },
        {"angle": "angle", "current": "max(min(current, 2), -2)"},
    )

    def slope(t, x, u):
        _, w, i = x
        torque = p["constant"] * i - p["viscous"] * w - p["level"] * math.tanh(w / p["width"]) - u[1]
        voltage = u[0] * math.exp(-t / p["fade"])
        return np.array([w, torque / p["inertia"], (voltage - p["resistance"] * i - p["constant"] * w) / p["inductance"]])

    def out(t, x, u):
        return [x[0], float(np.clip(x[2], -2.0, 2.0))]

    return model, slope, out, 0.01, (np.array([-3.0, -0.005]), np.array([3.0, 0.005])), "DOP853"


def bicycle():
    p = {"mass": 1400.0, "yaw_inertia": 2100.0, "front": 1.2, "rear": 1.5, "stiff_f": 8.0, "stiff_r": 9.0, "grip": 0.9, "g": 9.81, "speed": 22.0}
    slip_f, slip_r = "(atan2(side + front*yaw_rate, speed) - steer)", "atan2(side - rear*yaw_rate, speed)"
    force_f = f"(-grip*mass*g*rear/(front + rear)*sin(1.4*atan(stiff_f*{slip_f})))"
    force_r = f"(-grip*mass*g*front/(front + rear)*sin(1.4*atan(stiff_r*{slip_r})))"
    model = _model(
        "bicycle", ["steer"], {"side": 0.0, "yaw_rate": 0.0, "heading": 0.1, "offset": 0.0}, p,
        {
            "side": f"({force_f}*cos(steer) + {force_r})/mass - speed*yaw_rate",
            "yaw_rate": f"(front*{force_f}*cos(steer) - rear*{force_r})/yaw_inertia",
            "heading": "yaw_rate",
            "offset": "speed*sin(heading) + side*cos(heading)",
        },
        {"yaw_rate": "yaw_rate", "lateral_acceleration": f"({force_f}*cos(steer) + {force_r})/mass", "offset": "offset"},
    )

    def forces(x, u):
        v, r = x[0], x[1]
        wheelbase, weight = p["front"] + p["rear"], p["mass"] * p["g"]
        alpha_f = math.atan2(v + p["front"] * r, p["speed"]) - u[0]
        alpha_r = math.atan2(v - p["rear"] * r, p["speed"])
        front = -p["grip"] * weight * p["rear"] / wheelbase * math.sin(1.4 * math.atan(p["stiff_f"] * alpha_f))
        rear = -p["grip"] * weight * p["front"] / wheelbase * math.sin(1.4 * math.atan(p["stiff_r"] * alpha_r))
        return front * math.cos(u[0]), rear

    def slope(t, x, u):
        front, rear = forces(x, u)
        return np.array([(front + rear) / p["mass"] - p["speed"] * x[1], (p["front"] * front - p["rear"] * rear) / p["yaw_inertia"],
                         x[1], p["speed"] * math.sin(x[2]) + x[0] * math.cos(x[2])])

    def out(t, x, u):
        return [x[1], sum(forces(x, u)) / p["mass"], x[3]]

    return model, slope, out, 0.1, 0.06, "DOP853"


def oven():
    p = {"capacity": 450.0, "wall_capacity": 900.0, "exchange": 2.0, "emissivity": 0.8, "area": 0.12, "sigma": 5.670374419e-8, "outside": 293.15}
    radiated = "emissivity*sigma*area*(wall^4 - outside^4)"
    model = _model(
        "oven", ["power"], {"core": 300.0, "wall": 293.15}, p,
        {"core": "(power - exchange*(core - wall))/capacity", "wall": f"(exchange*(core - wall) - {radiated})/wall_capacity"},
        {"core": "core - 273.15", "radiated": radiated},
    )

    def radiation(x):
        return p["emissivity"] * p["sigma"] * p["area"] * (x[1] ** 4 - p["outside"] ** 4)

    def slope(t, x, u):
        exchanged = p["exchange"] * (x[0] - x[1])
        return np.array([(u[0] - exchanged) / p["capacity"], (exchanged - radiation(x)) / p["wall_capacity"]])

    def out(t, x, u):
        return [x[0] - 273.15, radiation(x)]

    return model, slope, out, 30.0, (0.0, 900.0), "DOP853"


def van_der_pol():
    p = {"mu": 1e3}
    model = _model(
        "van_der_pol", ["push"], {"x": 2.0, "v": 0.0}, p, {"x": "v", "v": "mu*(1 - x^2)*v - x + push"}, {"x": "x"},
    )

    def slope(t, x, u):
        return np.array([x[1], p["mu"] * (1 - x[0] ** 2) * x[1] - x[0] + u[0]])

    return model, slope, lambda t, x, u: [x[0]], 50.0, 0.3, "Radau"


PLANTS = (cart_pendulum, two_tanks, servo, bicycle, oven, van_der_pol)
SAMPLES = 40


def _by_text(model: dict, t, x, u):
    """The document's own expressions, evaluated by Python."""
    names = dict(zip(model["states"], x)) | dict(zip((c["name"] for c in model["inputs"]), u)) | {"time": t}
    names |= {name: entry["value"] for name, entry in model["parameters"].items()}
    value = lambda text: eval(text.replace("^", "**"), {"__builtins__": {}}, NAMES | names)  # noqa: S307 (our own text)
    return [value(text) for text in model["derivatives"].values()], [value(text) for text in model["output_equations"].values()]


def _run(slope, times, x0, u, method, rtol, atol):
    states = [np.array(x0, dtype=float)]
    for k in range(len(times) - 1):
        answer = integrate.solve_ivp(lambda t, x: slope(t, x, u[k]), (times[k], times[k + 1]), states[-1], method=method, rtol=rtol, atol=atol)
        assert answer.success, answer.message
        states.append(answer.y[:, -1])
    return np.array(states)


def equations(stored: dict | None) -> dict:
    kept = {case["id"]: case for case in stored["cases"]} if stored else {}
    cases = []
    for number, plant in enumerate(PLANTS):
        model, slope, out, step, reach, method = plant()
        x0 = [entry["initial"] for entry in model["states"].values()]
        low, high = reach if isinstance(reach, tuple) else (-reach, reach)
        for grid in ("even", "uneven"):
            generator = np.random.default_rng(1000 + 10 * number + (grid == "uneven"))
            times = np.arange(SAMPLES) * step
            if grid == "uneven":
                times = np.round(times + step * generator.uniform(-0.3, 0.3, SAMPLES), 6)
                times -= times[0]
            draw = generator.uniform(size=(SAMPLES, len(model["inputs"])))
            u = low + (np.asarray(high) - low) * np.round(draw, 3)
            case = kept.get(f"{model['name']}_{grid}")
            if case:
                times, u = np.array(case["time_s"], dtype=float), np.array(case["u"], dtype=float)
            scale = 1e-13 * max(1.0, float(np.max(np.abs(x0)))) if method == "DOP853" else 1e-14
            x = _run(slope, times, x0, u, method, 1e-11, scale)
            second = _run(slope, times, x0, u, "LSODA" if method == "Radau" else "RK45", 1e-11, scale)
            assert_close(second, x, 1e-8, f"{model['name']} second solver")
            y = np.array([out(t, state, now) for t, state, now in zip(times, x, u)])
            for t, state, now, row in zip(times, x, u, y):
                by_text, outputs = _by_text(model, t, state, now)
                assert_close(np.array(by_text), slope(t, state, now), 1e-10, "text of the derivatives")
                assert_close(np.array(outputs), row, 1e-12, "text of the outputs")
            cases.append({"id": f"{model['name']}_{grid}", "method": method, "model": model, "time_s": times, "u": u, "x0": x0, "x": x, "y": y})
    return {"tool": TOOL, "tolerance": {"default": 1e-8}, "cases": cases}

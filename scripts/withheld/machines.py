"""``python -m withheld.machines OUT KIND COUNT``: machines at rest, in loops, with links and events, each with its nominal simulator.

Each case is a folder: model.toml (the nominal simulator), run_1.csv, run_2.csv, fresh.csv and truth.json. The machine is integrated here, by Runge-Kutta steps of a
twentieth of a sample; a contact that comes to rest ends a step, and friction sticks where the other torques cannot move it. Nothing is shared with the program.

Every log begins at rest, at a place of its own: a position within what friction or play holds. The servo is a position loop (inertia, damping, gravity, PD); some
logs are rounded as an encoder does. With ``--off 0.01`` every number of the machine stands 1 % (standard deviation) off the simulator's.
"""

import argparse
import json
import math
import secrets
from pathlib import Path

import numpy as np

SERVO = """format = "deadtime/model@1"
name = "servo"
kind = "equations"
inputs = [{{ name = "target", unit = "rad" }}]
outputs = [{{ name = "q", unit = "rad" }}]
[states]
q = {{ unit = "rad", initial = 0.0, initial_std = 0.5 }}
w = {{ unit = "rad/s", initial = 0.0, initial_std = 0.1 }}
[parameters]
kp = {{ value = {kp!r}, unit = "N*m/rad" }}
kd = {{ value = {kd!r}, unit = "N*m*s/rad" }}
damping = {{ value = {damping!r}, unit = "N*m*s/rad" }}
inertia = {{ value = {inertia!r}, unit = "kg*m^2" }}
gravity = {{ value = {gravity!r}, unit = "N*m" }}
{named}[derivatives]
q = "w"
w = "({torque} - gravity*cos(q) - damping*w)/inertia"
[output_equations]
q = "q"
"""
LINKED = """format = "deadtime/model@1"
name = "drive train"
kind = "equations"
inputs = [{{ name = "torque", unit = "N*m" }}]
outputs = [{{ name = "motor", unit = "rad" }}, {{ name = "load", unit = "rad" }}]
[states]
motor = {{ unit = "rad", initial = 0.0, initial_std = 0.1 }}
load = {{ unit = "rad", initial = 0.0, initial_std = 0.1 }}
wm = {{ unit = "rad/s", initial = 0.0, initial_std = 0.1 }}
wl = {{ unit = "rad/s", initial = 0.0, initial_std = 0.1 }}
[parameters]
stiffness = {{ value = {stiffness!r}, unit = "N*m/rad" }}
link = {{ value = {link!r}, unit = "N*m*s/rad" }}
hold = {{ value = {hold!r}, unit = "N*m/rad" }}
damping = {{ value = {damping!r}, unit = "N*m*s/rad" }}
jm = {{ value = {jm!r}, unit = "kg*m^2" }}
jl = {{ value = {jl!r}, unit = "kg*m^2" }}
[derivatives]
motor = "wm"
load = "wl"
wm = "(torque - stiffness*(motor - load) - link*(wm - wl) - damping*wm)/jm"
wl = "(stiffness*(motor - load) + link*(wm - wl) - hold*load - damping*wl)/jl"
[output_equations]
motor = "motor"
load = "load"
"""
SUBSTEPS = 20
# Bisections of a step for the instant at which a contact comes to rest.
HALVINGS = 20
KINDS = ("friction", "command_play", "output_play", "limit", "dead_zone", "inner_lag", "inner_delay", "payload", "gain_and_delay", "friction_and_delay", "nothing", "gusts", "driveline", "link_friction")
DRIVE_TRAINS = ("driveline", "link_friction")


class Servo:
    """A position loop with what the kind asks for."""

    def __init__(self, rng, kind: str):
        self.kind = kind
        self.inertia = float(10 ** rng.uniform(-2.0, -1.0))
        omega, ratio = rng.uniform(8.0, 25.0), rng.uniform(0.4, 0.9)
        self.kp = float(self.inertia * omega**2)
        total = 2.0 * ratio * omega * self.inertia
        share = rng.uniform(0.0, 0.6) if rng.random() < 0.5 else 0.0
        self.kd, self.damping = float(share * total), float((1.0 - share) * total)
        self.gravity = float(self.kp * rng.uniform(0.0, 0.05))
        self.amplitude = 0.6
        self.named = bool(rng.random() < 0.5)
        self.sample = 0.02
        self.friction = self.play = self.output_play = self.dead_zone = 0.0
        self.limit, self.lag, self.delay, self.command_delay, self.gain = math.inf, 0.0, 0.0, 0.0, 1.0
        self.event, self.gust, self.gusts = None, 0.0, np.zeros(1)
        peak = self.kp * self.amplitude
        if kind == "friction":
            self.friction = peak * rng.uniform(0.02, 0.08)
        if kind == "command_play":
            self.play = self.amplitude * rng.uniform(0.01, 0.05)
        if kind == "output_play":
            self.output_play = self.amplitude * rng.uniform(0.01, 0.05)
        if kind == "limit":
            self.limit = peak * rng.uniform(0.15, 0.5)
        if kind == "dead_zone":
            self.dead_zone = peak * rng.uniform(0.02, 0.06)
        if kind == "inner_lag":
            self.lag = rng.uniform(0.15, 0.5) * ratio / omega
        if kind == "inner_delay":
            # Whole steps of the integration.
            step = self.sample / SUBSTEPS
            self.delay = round(rng.uniform(0.15, 0.4) * ratio / omega / step) * step
        if kind == "gain_and_delay":
            self.gain, self.command_delay = 1.05, float(rng.choice([1, 2, 3])) * self.sample
        if kind == "friction_and_delay":
            self.friction, self.command_delay = peak * rng.uniform(0.03, 0.08), float(rng.choice([1, 2, 3])) * self.sample
        if kind == "gusts":
            self.gust = peak * rng.uniform(0.002, 0.01)
        if kind == "payload":
            self.event = (rng.uniform(6.0, 12.0), rng.uniform(0.2, 0.6) * self.inertia, rng.uniform(0.05, 0.12) * self.kp)

    def model(self) -> str:
        torque = "kp*(target - q) - kd*w" if self.kd else "kp*(target - q)"
        named = f'[definitions]\ntorque = "{torque}"\n' if self.named or self.kd else ""
        text = "torque" if named else torque
        return SERVO.format(kp=self.kp, kd=self.kd, damping=self.damping, inertia=self.inertia, gravity=self.gravity, named=named, torque=text)

    def stand_off(self, rng, size: float) -> None:
        """The machine's numbers are no longer the simulator's."""
        for name in ("inertia", "kp", "kd", "damping", "gravity"):
            setattr(self, name, getattr(self, name) * float(np.exp(size * rng.standard_normal())))

    def truth(self) -> dict:
        channel = "torque" if self.named or self.kd else "kp*(target - q)"
        inside = {"limit": ("internal_saturation", {"lower": -self.limit, "upper": self.limit}), "dead_zone": ("internal_deadband", {"width": self.dead_zone}),
                  "inner_lag": ("internal_lag", {"time_constant": self.lag}), "inner_delay": ("internal_delay", {"delay": self.delay})}
        if self.kind in inside:
            effect, parameters = inside[self.kind]
            return {"effects": [{"effect": effect, "channel": channel, "parameters": parameters}]}
        if self.kind == "friction":
            return {"effects": [{"effect": "coulomb_friction", "channel": "w", "parameters": {"level": self.friction / self.inertia}}]}
        if self.kind == "command_play":
            return {"effects": [{"effect": "backlash", "channel": "target", "parameters": {"width": self.play}}]}
        if self.kind == "output_play":
            return {"effects": [{"effect": "output_backlash", "channel": "q", "parameters": {"width": self.output_play}}]}
        if self.kind == "gain_and_delay":
            return {"effects": [{"effect": "input_delay", "channel": "target", "parameters": {"delay": self.command_delay}},
                                {"effect": "input_gain", "channel": "target", "parameters": {"gain": self.gain}}]}
        if self.kind == "friction_and_delay":
            return {"effects": [{"effect": "input_delay", "channel": "target", "parameters": {"delay": self.command_delay}},
                                {"effect": "coulomb_friction", "channel": "w", "parameters": {"level": self.friction / self.inertia}}]}
        if self.event:
            time, inertia, gravity = self.event
            return {"effects": [], "event": {"time": time, "inertia": self.inertia + inertia, "gravity": self.gravity + gravity}}
        return {"effects": []}

    def run(self, rng, target: np.ndarray) -> np.ndarray:
        """The outputs at the samples of a log that begins at rest, with what holds it there."""
        step = self.sample / SUBSTEPS
        first = target[0]
        play = first + self.play * rng.uniform(-1.0, 1.0)
        command = play if self.play else first
        # Friction holds it anywhere; a dead zone gives nothing but what gravity asks for.
        q, offset = self.gain * command, self.friction * rng.uniform(-0.9, 0.9) + self.dead_zone
        for _ in range(50):
            q = self.gain * command - (self.gravity * math.cos(q) + offset) / self.kp
        state = np.array([q, 0.0, self.kp * (self.gain * command - q)])
        self.gusts = self.gust * slow_noise(rng, len(target) * SUBSTEPS + 1, 1.0 / step)
        # What the controller gives at the start and at the end of every step: its command may jump between two of them.
        steps = round(self.delay / step)
        waiting = [(state[2], state[2])] * steps
        late = [first] * (round(self.command_delay / step) + 1)
        far, outputs, now = q + self.output_play * rng.uniform(-1.0, 1.0), [], 0.0
        for value in target:
            far = min(max(far, state[0] - self.output_play), state[0] + self.output_play)
            outputs.append(far)
            for _ in range(SUBSTEPS):
                late.append(value)
                sent = late[-1 - round(self.command_delay / step)]
                play = min(max(play, sent - self.play), sent + self.play) if self.play else sent
                gives = [self.kp * (self.gain * play - state[0]) - self.kd * state[1]]
                arrived = waiting[-steps] if steps else (0.0, 0.0)
                state = self.advance(state, self.gain * play, arrived, step, now)
                gives.append(self.kp * (self.gain * play - state[0]) - self.kd * state[1])
                waiting.append((gives[0], gives[1]))
                far = min(max(far, state[0] - self.output_play), state[0] + self.output_play)
                now += step
        return np.array(outputs)

    def advance(self, state, command: float, arrived: tuple[float, float], step: float, now: float, done: float = 0.0) -> np.ndarray:
        """The state at the end of the step of which a part is done. Where a sliding contact comes to rest, friction decides anew."""
        inertia, gravity = self.inertia, self.gravity
        if self.event and now >= self.event[0]:
            inertia, gravity = inertia + self.event[1], gravity + self.event[2]
        direction = math.copysign(1.0, state[1]) if state[1] else 0.0
        gust = float(self.gusts[min(round(now / step), len(self.gusts) - 1)])

        def others(x, part: float) -> float:
            raw = arrived[0] + part * (arrived[1] - arrived[0]) if self.delay else self.kp * (command - x[0]) - self.kd * x[1]
            torque = x[2] if self.lag else raw
            torque = torque - min(max(torque, -self.dead_zone), self.dead_zone)
            return min(max(torque, -self.limit), self.limit) - gravity * math.cos(x[0]) - self.damping * x[1] + gust

        if self.friction and direction == 0.0:
            rest = others(state, done)
            if abs(rest) <= self.friction:
                return state
            direction = math.copysign(1.0, rest)

        def rate(x, part: float) -> np.ndarray:
            raw = self.kp * (command - x[0]) - self.kd * x[1]
            return np.array([x[1], (others(x, part) - self.friction * direction) / inertia, (raw - x[2]) / self.lag if self.lag else 0.0])

        def until(end: float) -> np.ndarray:
            h, middle = (end - done) * step, 0.5 * (done + end)
            a = rate(state, done)
            b = rate(state + 0.5 * h * a, middle)
            c = rate(state + 0.5 * h * b, middle)
            return state + h / 6.0 * (a + 2 * b + 2 * c + rate(state + h * c, end))

        new = until(1.0)
        if self.friction and new[1] * direction < 0.0:
            low, high = done, 1.0
            for _ in range(HALVINGS):
                middle = 0.5 * (low + high)
                low, high = (low, middle) if until(middle)[1] * direction < 0.0 else (middle, high)
            stopped = until(high)
            stopped[1] = 0.0
            return self.advance(stopped, command, arrived, step, now, high) if high < 1.0 else stopped
        return new


class DriveTrain:
    """Motor and load with a link that has play or friction."""

    inputs, outputs = ("torque",), ("motor", "load")

    def __init__(self, rng, kind: str):
        self.kind, self.sample = kind, 0.01
        self.jm, self.jl = float(10 ** rng.uniform(-2.5, -2.0)), float(10 ** rng.uniform(-2.0, -1.5))
        # Friction in a stiff link moves neither end.
        self.stiffness = float(self.jl * rng.uniform(*((6.0, 12.0) if kind == "link_friction" else (20.0, 40.0))) ** 2)
        self.link = float(0.1 * math.sqrt(self.stiffness * self.jm))
        self.hold = float(self.jl * rng.uniform(3.0, 6.0) ** 2)
        self.damping = float(0.5 * math.sqrt(self.hold * (self.jm + self.jl)))
        self.width = float(rng.uniform(0.01, 0.04)) if kind == "driveline" else 0.0
        # N*m; the torque reaches a quarter of `hold`.
        self.friction = float(rng.uniform(0.02, 0.08)) * self.hold if kind == "link_friction" else 0.0

    def stand_off(self, rng, size: float) -> None:
        """The machine's numbers are no longer the simulator's."""
        for name in ("jm", "jl", "stiffness", "link", "hold", "damping"):
            setattr(self, name, getattr(self, name) * float(np.exp(size * rng.standard_normal())))

    def model(self) -> str:
        return LINKED.format(**{k: getattr(self, k) for k in ("stiffness", "link", "hold", "damping", "jm", "jl")})

    def truth(self) -> dict:
        if self.kind == "link_friction":
            return {"effects": [{"effect": "driveline_friction", "channel": "motor - load", "parameters": {"level": self.friction / self.stiffness}}]}
        return {"effects": [{"effect": "driveline_backlash", "channel": "motor - load", "parameters": {"width": self.width}}]}

    def run(self, rng, torque: np.ndarray) -> np.ndarray:
        step, x, outputs = self.sample / SUBSTEPS, np.zeros(4), []

        def rate(x, u) -> np.ndarray:
            twist = x[0] - x[1]
            twist = twist - min(max(twist, -self.width), self.width)
            through = self.stiffness * twist + self.link * (x[2] - x[3])
            return np.array([x[2], x[3], (u - through - self.damping * x[2]) / self.jm, (through - self.hold * x[1] - self.damping * x[3]) / self.jl])

        for u in torque:
            outputs.append(x[:2].copy())
            for _ in range(SUBSTEPS):
                a = rate(x, u)
                b = rate(x + 0.5 * step * a, u)
                c = rate(x + 0.5 * step * b, u)
                x = x + step / 6.0 * (a + 2 * b + 2 * c + rate(x + step * c, u))
                # The impulse that ends the relative motion, or as much of it as friction gives in a step (Moreau 1988, doi:10.1007/978-3-7091-2624-0_1).
                impulse = (x[2] - x[3]) / (1.0 / self.jm + 1.0 / self.jl)
                impulse = min(max(impulse, -self.friction * step), self.friction * step)
                x = x - np.array([0.0, 0.0, impulse / self.jm, -impulse / self.jl])
        return np.array(outputs)


def slow_noise(rng, steps: int, rate: float) -> np.ndarray:
    """Noise of unit variance below about 1 Hz."""
    pole, values = math.exp(-2.0 * math.pi / rate), np.zeros(steps)
    for k, kick in enumerate(rng.standard_normal(steps - 1)):
        values[k + 1] = pole * values[k] + math.sqrt(1.0 - pole**2) * kick
    return values


def command(rng, machine, samples: int) -> np.ndarray:
    """At rest, then steps, ramps and sines of several sizes."""
    amplitude = machine.amplitude if isinstance(machine, Servo) else 0.25 * machine.hold
    first = amplitude * rng.uniform(-1.0, 1.0) if isinstance(machine, Servo) else 0.0
    values = [first] * int(0.5 / machine.sample)
    while len(values) < samples:
        length, kind = int(rng.uniform(0.3, 1.5) / machine.sample), rng.integers(3)
        goal, t = amplitude * rng.uniform(-1.0, 1.0), np.arange(length) * machine.sample
        if kind == 0:
            values += [goal] * length
        elif kind == 1:
            values += list(np.linspace(values[-1], goal, length))
        else:
            values += list(values[-1] + 0.3 * amplitude * rng.uniform(0.1, 1.0) * np.sin(2 * math.pi * rng.uniform(0.5, 2.5) * t))
    return np.clip(np.array(values[:samples]), -amplitude, amplitude)


def write(folder: Path, kind: str, seed: int, samples: int, off: float) -> None:
    rng = np.random.default_rng(seed)
    machine = DriveTrain(rng, kind) if kind in DRIVE_TRAINS else Servo(rng, kind)
    folder.mkdir(parents=True)
    (folder / "model.toml").write_text(machine.model())
    if off:
        machine.stand_off(np.random.default_rng(seed + 1), off)
    truth = machine.truth()
    noise = 10 ** rng.uniform(-3.6, -2.8)
    rounded = 2 * math.pi / 4096 if rng.random() < 0.4 else 0.0
    names = ("target", "q") if isinstance(machine, Servo) else ("torque", "motor", "load")
    for log in ("run_1", "run_2", "fresh"):
        u = command(rng, machine, samples)
        y = machine.run(rng, u).reshape(samples, -1)
        y = y + noise * rng.standard_normal(y.shape)
        y = np.round(y / rounded) * rounded if rounded else y
        rows = [",".join(("time", *names))]
        rows += [",".join(f"{v:.7g}" for v in (k * machine.sample, u[k], *y[k])) for k in range(samples)]
        (folder / f"{log}.csv").write_text("\n".join(rows) + "\n")
    (folder / "truth.json").write_text(json.dumps({"kind": kind, "seed": seed, "noise": noise, "off": off, **truth}, indent=1))


def main() -> None:
    parser = argparse.ArgumentParser(prog="withheld.machines", description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("kind", choices=(*KINDS, "all"))
    parser.add_argument("count", type=int)
    parser.add_argument("--seed", type=int, help="default: from the operating system")
    parser.add_argument("--samples", type=int, default=900, help="of each log")
    parser.add_argument("--off", type=float, default=0.0, help="relative standard deviation of the machine's numbers about the simulator's")
    options = parser.parse_args()
    seed = secrets.randbits(32) if options.seed is None else options.seed
    print(f"seed {seed}")
    for kind in KINDS if options.kind == "all" else (options.kind,):
        for number in range(options.count):
            write(options.out / f"{kind}_{number}", kind, seed + 7919 * number + 104729 * KINDS.index(kind), options.samples, options.off)


if __name__ == "__main__":
    main()

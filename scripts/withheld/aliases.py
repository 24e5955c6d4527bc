"""Which other causes explain the noise-free training outputs as well as the true one."""

from dataclasses import dataclass

import numpy as np

from .catalogue import Scales, channels, of_size
from .fit import Problem, fit, free_parameters
from .system import CLOCK, DYNAMICS, INPUT, OUTPUT, STEPPING

EFFECTS = sorted(INPUT | DYNAMICS | OUTPUT | CLOCK)
ALIKE = 0.3  # rms misfit in units of the noise up to which a rival counts as an explanation
SIZES = (0.03, 0.12, 0.4, 1.2)
PROPORTIONAL = {  # outputs change nearly in proportion to the parameter: one size tells the signature, a second one its bend
    "input_gain", "input_curve", "gain_fade", "input_offset", "cross_coupling", "quadratic_drag", "cubic_stiffness", "constant_disturbance", "parameter_error",
    "sensor_gain", "sensor_bias", "sensor_drift", "misalignment",
}
FREQUENCY_SHAPES = (0.05, 0.25, 0.45, 0.65, 0.85)
KEPT = 14  # rivals fitted in full
KEPT_OF_MANY, TURNS_OF_MANY = 5, 6  # beside several others each fit takes long
NEAR, NEAREST = 8.0, 2  # replacements that miss the limit by up to this factor, so many of each effect of a pair, are tried with the other replaced too


def rivals(model: dict) -> list[tuple[str, str]]:
    """Every deterministic effect on every channel (lost commands leave no trajectory of their own to fit)."""
    return [(e, c) for e in EFFECTS if e != "dropped_commands" for c in channels(model, e)]


def other_steps(scales: Scales, truth: list[dict]) -> list[dict]:
    """Steps of every other number, at the time of a true one."""
    steps = [t for t in truth if t["effect"] in STEPPING]
    others = [(e, c) for e in sorted(STEPPING) for c in channels(scales.model, e)]
    shaped = [of_size(scales, e, c, size, sign, (0.5, 0.5, 0.0)) for e, c in others for size in SIZES for sign in (1.0, -1.0)]
    return [{**item, "parameters": item["parameters"] | {"time": t["parameters"]["time"]}} for t in steps for item in shaped]


def starts(scales: Scales, effect: str, channel: str) -> list[dict]:
    """Effects of several sizes, signs and shapes to start from."""
    shapes = [(0.5, 0.5, 0.3)]
    if effect in ("unmodelled_mode", "periodic_disturbance"):
        shapes = [(f, p, 0.3) for f in FREQUENCY_SHAPES for p in ((0.5, 0.75) if effect == "periodic_disturbance" else (0.5,))]
    sizes = (0.3,) if len(shapes) > 1 else SIZES[::2] if effect in PROPORTIONAL else SIZES
    signs = (1.0, -1.0) if effect.startswith("clock") else (1.0,)
    found, seen = [], set()
    for shape in shapes:
        for size in sizes:
            for sign in signs:
                item = of_size(scales, effect, channel, size, sign, shape)
                key = tuple(item["parameters"].items())
                if key not in seen:
                    seen.add(key)
                    found.append(item)
    return found


def parameter_scales(scales: Scales, effects: list[dict]) -> list[float]:
    """A typical size of each free parameter."""
    result = []
    for i, name in free_parameters(effects):
        item = effects[i]
        typical = of_size(scales, item["effect"], item["channel"], 0.3, 1.0, (0.5, 0.5, 0.3))["parameters"][name]
        if name == "frequency":
            typical = 0.1 * item["parameters"][name]
        elif name in ("gain", "ratio") and item["effect"] in ("input_gain", "sensor_gain", "clock_skew"):
            typical -= 1.0
        elif name == "time":
            typical = scales.settling
        elif item["effect"] == "parameter_error" or item["effect"] in STEPPING:
            typical = 0.2 * typical
        elif name == "rate" and item["effect"] == "rate_limit":
            typical = item["parameters"][name]
        elif name == "phase":
            typical = 0.5
        elif name in ("lower", "upper"):
            j = (scales.names.inputs if item["effect"] == "saturation" else scales.names.outputs).index(item["channel"])
            typical = 0.3 * (scales.u if item["effect"] == "saturation" else scales.y)[j]
        elif item["effect"] == "delay_drift":
            typical = item["parameters"][name]
        result.append(max(abs(typical), 0.05 * abs(item["parameters"][name])))
    return result


def _screened(problem: Problem, scales: Scales, items, others, gap: np.ndarray) -> list[tuple[float, float, list[dict]]]:
    """(what a scaled signature leaves, best scale, start effects) of one rival, best first. Small sizes tell the direction for any amplitude."""
    found = []
    for item in items:
        try:
            moved = problem.reduced([item, *others])
        except (ArithmeticError, ValueError):
            continue
        signature = gap - moved
        power = signature @ signature
        if power < 1e-12 * (gap @ gap):
            continue
        scale = float(signature @ gap / power)
        remaining = min(problem.rms(gap - scale * signature), problem.rms(moved))
        found.append((remaining, scale, [item, *others]))
    return sorted(found, key=lambda entry: entry[0])


def _scaled(entry, scales: Scales) -> list[list[dict]]:
    """The start as it is, and with its linear parameters scaled to the gap."""
    _, scale, effects = entry
    item = effects[0]
    linear = {"gain": 0.0, "offset": 0.0, "level": 0.0, "coefficient": 0.0, "amplitude": 0.0, "quadratic": 0.0, "delay": 0.0, "time_constant": 0.0, "ratio": 1.0, "rate": 0.0}
    if item["effect"] in ("input_gain", "sensor_gain"):
        linear["gain"] = 1.0
    name = next((n for n in ("amplitude", "gain", "offset", "level", "coefficient", "quadratic", "delay", "time_constant", "ratio", "rate") if n in item["parameters"]), None)
    if name is None or item["effect"] == "rate_limit" or item["effect"] in STEPPING or (scale < 0 and name in ("delay", "time_constant", "level")):
        return [effects]
    value = linear[name] + np.clip(scale, -20, 20) * (item["parameters"][name] - linear[name])
    return [[{**item, "parameters": {**item["parameters"], name: float(value)}}, *effects[1:]], effects]


@dataclass
class Explained:
    """What came of the rivals of one effect beside fixed others."""

    members: set[str]  # within the limit
    least: float  # misfit of the best on all data, rms in units of the noise
    best: list[dict]
    near: list[tuple[float, list[dict]]]  # not within the limit: misfit and fitted effects, best first


def _fitted(short: Problem, full: Problem, scales: Scales, start: list[dict], limit: float, hopeless: float, worth: float):
    """Effects and misfit on all data and True; or on the part and False, where that shows that the whole leaves more than `worth`: its squares are among the whole's."""
    short.linearise(start)
    fitted, misfit = fit(short, start, parameter_scales(scales, start), 0.5 * limit, hopeless)
    if misfit > worth * np.sqrt(full.count / short.count):
        return fitted, misfit, False
    full.linearise(fitted)
    fitted, misfit = fit(full, fitted, parameter_scales(scales, fitted), limit, hopeless)
    if limit < misfit <= 1.3 * limit:
        full.linearise(fitted)
        fitted, misfit = fit(full, fitted, parameter_scales(scales, fitted), limit, turns=4)
    return fitted, misfit, True


def explanations(short: Problem, full: Problem, scales: Scales, others: list[dict], exclude: set[str], limit: float = ALIKE, worth: float = 0.0, kept: int = KEPT, more: list[dict] | None = None) -> Explained:
    """Rivals, and `more` effects to start from, that with `others` leave at most `limit` (rms, units of the noise) of the noise-free outputs, and the best; misfits above `worth` need not be exact."""
    short.linearise(others)
    gap = short.reduced(others)
    size = short.rms(gap)
    tried = {(effect, channel): starts(scales, effect, channel) for effect, channel in rivals(full.model)}
    for item in more or []:
        tried.setdefault((item["effect"], item["channel"]), []).append(item)
    screened = []
    for (effect, channel), items in tried.items():
        if f"{effect}:{channel}" in exclude:
            continue
        entries = _screened(short, scales, items, others, gap)
        if entries and entries[0][0] <= max(0.3 * size, 0.6):
            screened.append((entries[0][0], effect, channel, entries))
    found = Explained(set(), size, others, [])
    for _, effect, channel, entries in sorted(screened, key=lambda s: s[0])[:kept]:
        tried = []
        for start in (_scaled(entries[0], scales) + ([entries[1][2]] if len(entries) > 1 else []))[:3]:
            try:
                fitted, misfit, exact = _fitted(short, full, scales, start, limit, 0.2 * size + 1.0, max(limit, worth))
            except (ArithmeticError, ValueError):
                continue  # it runs away
            tried.append((misfit, fitted))
            if misfit < found.least:
                found.least, found.best = misfit, fitted
            if exact and misfit <= limit:
                found.members.add(f"{effect}:{channel}")
                break
        else:
            found.near += [min(tried, key=lambda entry: entry[0])] if tried else []
    found.near.sort(key=lambda entry: entry[0])
    return found


def alias_classes(short: Problem, full: Problem, scales: Scales, truth: list[dict]) -> list[list[str]]:
    """For each true effect `effect:channel` of itself and of all that can stand in for it, the other refitted beside it or replaced too.

    short: part of the data, to screen; full: all training data; both with noise-free outputs. Where the machine's parameters differ from the
    model's, the true effects leave something too: a rival may leave that and 0.3 of the noise beside it (as mean squares).
    """
    full.linearise(truth)
    own = fit(full, truth, parameter_scales(scales, truth))[1]
    limit = float(np.hypot(ALIKE, own))
    names = [f"{t['effect']}:{t['channel']}" for t in truth]
    classes = [{name} for name in names]
    for index in range(len(truth)):
        others = [t for k, t in enumerate(truth) if k != index]
        found = explanations(short, full, scales, others, set(names), limit, more=other_steps(scales, [truth[index]]))
        classes[index] |= found.members
        for misfit, (stand_in, *_) in found.near[:NEAREST] if others else []:
            if misfit > NEAR * limit:
                break
            rival = f"{stand_in['effect']}:{stand_in['channel']}"
            both = explanations(short, full, scales, [stand_in], {*names, rival}, limit, kept=KEPT // 3).members
            if both:
                classes[index].add(rival)
                classes[1 - index] |= both
    return [sorted(members) for members in classes]


def alias_classes_of_many(short: Problem, full: Problem, scales: Scales, truth: list[dict], searched: list[bool]) -> list[list[str]]:
    """The same of a mixture, for the effects that are searched; of the others, and of numbers of the model, only themselves. No two are replaced at once."""
    names = [f"{t['effect']}:{t['channel']}" for t in truth]
    classes = [{name} for name in names]
    try:
        full.linearise(truth)
        limit = float(np.hypot(ALIKE, fit(full, truth, parameter_scales(scales, truth), turns=TURNS_OF_MANY)[1]))
        for index in (i for i, wanted in enumerate(searched) if wanted):
            others = [t for k, t in enumerate(truth) if k != index]
            classes[index] |= explanations(short, full, scales, others, set(names), limit, kept=KEPT_OF_MANY).members
    except (ArithmeticError, ValueError):
        pass  # it runs away from where the fit goes: nothing is known to stand in
    return [sorted(members) for members in classes]

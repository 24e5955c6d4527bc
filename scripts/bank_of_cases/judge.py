"""What is judged of one answer, as the sums from which every score follows; the definitions are `SCORES`.

A *claim* is a contribution of the answer, or a parameter of its recalibration with an equal part of the block's share. It is true where it, or something in its `class`, in its
class of `indistinguishable` or among the members of its class, is in the alias class of a true effect. True effects are the label's, all parameters that are off, and hidden parameter errors
below the noise; the last two count for precision and never for recall.
"""

import json
import math
import tomllib
from dataclasses import dataclass, field
from pathlib import Path

from withheld.catalogue import nominal_value
from withheld.system import Names

FIRST = 1.5  # the two largest true shares differ by this factor where the order is judged
WORSE = 1.001  # held-out error after/before above which the model that is handed over is worse
CLIP = (-1.0, 1.5)  # of a case's share of the oracle's shrink
LEAST = 1e-3  # least probability of an outcome in the log loss
BINS = 10

# name: (ratio, median, longest or calibration; +1 where more is better, -1 where less is; definition)
SCORES = {
    "failed": ("ratio", -1, "cases without answer: crash or time limit"),
    "verdict": ("ratio", 1, "the verdict is right: one effect: in its class; mixture: in the class of some true effect (with something outside also unknown); "
                            "none: none (parameters off: or one of them; gusts: or unknown); failures are wrong"),
    "named": ("ratio", 1, "the strongest true effect is in a claim, up to classes; failures are not"),
    "first": ("ratio", 1, f"the answer's largest share holds it (a recalibration counts as one); over cases whose two largest true shares differ by {FIRST} x"),
    "recall": ("ratio", 1, "shares of the true effects that are in a claim over all true shares, mean over cases with effects"),
    "precision": ("ratio", 1, "shares of the true claims over all claimed shares, mean over cases with effects whose claims have a share"),
    "f1": ("ratio", 1, "harmonic mean of recall and precision of a case, 0 where nothing is claimed or nothing is true; mean over cases with effects"),
    "false_complete": ("ratio", -1, "answers called complete (explained: all) that claim something false"),
    "complete_outside": ("ratio", -1, "cases with something outside the catalogue whose answer is called complete"),
    "false_alarm": ("ratio", -1, "none, parameters off, gusts: a contribution or the verdict's effect is false; parameters are recalibrated though none is off; "
                                 "or the verdict is unknown without gusts"),
    "of_oracle": ("ratio", 1, f"(1 - (after/before)^2)/(1 - (oracle_after/before)^2) on held-out data, each with its own before, clipped to {CLIP[0]:g} ... {CLIP[1]:g}; mean"),
    "of_oracle_median": ("median", 1, "its median, not clipped"),
    "worse": ("ratio", -1, f"the written model's held-out error is more than {100 * (WORSE - 1):.1g} % above the nominal one's"),
    "coverage": ("ratio", 1, "true parameters inside the 95 % interval, over parameters with interval of claims that are a true effect itself"),
    "coverage_block": ("ratio", 1, "the same of a recalibration's parameters: the machine's value, nominal where that is right"),
    "log_loss": ("ratio", -1, f"mean -ln of the probability given to what is so (at least {LEAST:g}), over contributions with a probability"),
    "calibration": ("calibration", -1, f"expected calibration error of the same in {BINS} bins: mean distance of mean probability and rate of true ones"),
    "time_median": ("median", -1, "processor seconds of a case"),
    "time_longest": ("longest", -1, "processor seconds of the slowest case"),
}


@dataclass
class Truth:
    """What a case is: classes of the true effects with shares, what else is true, and the machine's own parameters."""

    group: str
    kind: str
    traits: list[str]
    effects: list[dict]
    classes: list[set[str]]
    shares: list[float]
    more: list[set[str]]  # classes of what is true beside these
    outside: bool
    before: float | None
    oracle_after: float | None
    only_output: str | None
    parameters: dict[str, float] = field(default_factory=dict)  # wrong ones, the machine's values
    model: dict = field(default_factory=dict)

    def name(self, text: str) -> str:
        """`effect:channel`, `*` for the only output."""
        effect, _, channel = text.partition(":")
        return f"{effect}:*" if channel and channel == self.only_output else text

    def all_classes(self) -> list[set[str]]:
        return self.classes + self.more


def load(folder: Path) -> Truth:
    """The truth of a drawn case."""
    label, drawn = (json.loads((folder / f"{name}.json").read_text()) for name in ("label", "drawn"))
    model = tomllib.loads((folder / "model.toml").read_text())
    outputs = Names(model).outputs
    effects, listed = label["effects"], label["alias_class"]
    if effects and not isinstance(listed[0], list):
        listed = [listed] * len(effects)
    off = label.get("parameter_errors", []) + drawn["hidden"] + [e for e in effects if e["effect"] == "parameter_error"]
    truth = Truth(
        folder.name.rsplit("-", 1)[0], label["group"], drawn["traits"], effects, [], label.get("shares") or [1.0] * len(effects), [], bool(label.get("outside")),
        label["before"], label["oracle_after"], outputs[0] if len(outputs) == 1 else None, {e["channel"]: e["parameters"]["value"] for e in off}, model,
    )

    def own(item, others):
        name = f"{item['effect']}:{item['channel']}"
        return {truth.name(n) for n in (name, *others, *drawn["same"].get(name, ()))}

    truth.classes = [own(e, others) for e, others in zip(effects, listed)]
    truth.more = [own(e, ()) for e in off if e not in effects]
    return truth


@dataclass
class Claim:
    """One thing that the answer says acts."""

    name: str
    names: set[str]
    share: float
    probability: float | None
    parameters: dict[str, list]
    block: bool = False

    def meets(self, classes) -> bool:
        return any(self.names & c for c in classes)


def claims(answer: dict, truth: Truth) -> list[Claim]:
    found = []
    for c in answer["contributions"]:
        name = truth.name(f"{c['effect']}:{c['channel']}")
        lists = [{truth.name(n) for n in row} for row in answer["indistinguishable"]]
        names = {name, *(truth.name(n) for n in c["class"])}.union(*(row for row in lists if name in row))
        for own in answer.get("classes", ()):  # an alias may be several effects that together do the same
            if truth.name(own["representative"]) == name:
                names.update(truth.name(n) for m in own.get("members", ()) for n in ([m] if isinstance(m, str) else m))
        found.append(Claim(name, names, max(c["share"] or 0.0, 0.0), c["probability"], c["parameters"]))
    block = answer["recalibration"]
    for name, estimate in block["parameters"].items() if block else ():
        full = f"parameter_error:{name}"
        found.append(Claim(full, {full}, max(block["share"] or 0.0, 0.0) / len(block["parameters"]), None, {"value": estimate}, True))
    return found


def _largest(found: list[Claim]) -> list[Claim]:
    """The claims with the answer's largest share, a recalibration being one."""
    block = [c for c in found if c.block]
    parts = [[c] for c in found if not c.block] + ([block] if block else [])
    return max(parts, key=lambda part: sum(c.share for c in part), default=[])


def _verdict_is_right(answer: dict, truth: Truth) -> bool:
    verdict = answer["verdict"]
    leading = {truth.name(f"{verdict}:{answer['channel']}")}
    if truth.kind == "none":
        return verdict == "none" or (verdict == "unknown" and truth.outside) or any(leading & c for c in truth.more)
    return any(leading & c for c in truth.classes) or (truth.kind == "mixture" and truth.outside and verdict == "unknown")


def _inside(name: str, true: float, low: float, high: float) -> bool:
    slack, turns = 1e-12 * abs(true), (-2 * math.pi, 0.0, 2 * math.pi) if name == "phase" else (0.0,)
    return any(low - slack <= true + t <= high + slack for t in turns)


def _coverage(found: list[Claim], truth: Truth) -> tuple[list[bool], list[bool]]:
    """Of true effects' parameters, and of a recalibration's, whether the interval holds the true value."""
    true = {truth.name(f"{e['effect']}:{e['channel']}"): e["parameters"] for e in truth.effects}
    single = [_inside(p, true[c.name][p], low, high) for c in found if not c.block and c.name in true
              for p, (_, low, high) in c.parameters.items() if low is not None and high is not None and true[c.name].get(p) is not None]
    block = []
    replaced = {n for names, e in zip(truth.classes, truth.effects) if e["effect"] != "parameter_error" for n in names}
    unknown = truth.parameters and Names(truth.model).sample_time  # the sampled parameters of a machine that is off are not known
    for c in found if not unknown else ():
        channel, (_, low, high) = c.name.partition(":")[2], c.parameters.get("value", [None] * 3)
        if c.block and low is not None and high is not None and c.name not in replaced:
            block.append(_inside("value", truth.parameters.get(channel, nominal_value(truth.model, channel)), low, high))
    return single, block


def judge(answer: dict, truth: Truth) -> dict[str, list[float]]:
    """By score: of a ratio numerator and denominator, of a calibration per bin number, probabilities and true ones, else the value."""
    result: dict[str, list[float]] = {"failed": [float(bool(answer["failure"])), 1.0], "time_median": [answer["seconds"]], "time_longest": [answer["seconds"]]}
    failed, acting = bool(answer["failure"]), bool(truth.effects)
    clear = acting and (len(truth.shares) < 2 or truth.shares[0] >= FIRST * truth.shares[1])
    if failed:
        wrong = ["verdict", *(["named", "recall", "f1"] if acting else []), *(["first"] if clear else [])]
        return result | {name: [0.0, 1.0] for name in wrong}

    found = claims(answer, truth)
    right = [c.meets(truth.all_classes()) for c in found]
    result["verdict"] = [float(_verdict_is_right(answer, truth)), 1.0]
    if acting:
        recall = sum(s for c, s in zip(truth.classes, truth.shares) if any(k.meets([c]) for k in found)) / sum(truth.shares)
        claimed = sum(c.share for c in found)
        precision = sum(c.share for c, r in zip(found, right) if r) / claimed if claimed > 0 else None
        result["named"] = [float(any(c.meets(truth.classes[:1]) for c in found)), 1.0]
        result["recall"] = [recall, 1.0]
        result["f1"] = [2 * recall * precision / (recall + precision) if precision and recall else 0.0, 1.0]
        if precision is not None:
            result["precision"] = [precision, 1.0]
        if clear:
            result["first"] = [float(any(c.meets(truth.classes[:1]) for c in _largest(found))), 1.0]
    complete = answer["explained"] == "all"
    if complete:
        result["false_complete"] = [float(not all(right)), 1.0]
    if truth.outside:
        result["complete_outside"] = [float(complete), 1.0]
    if truth.kind == "none":
        named = answer["verdict"] != "none" and not _verdict_is_right(answer, truth)
        redundant = any(c.block for c in found) and not truth.parameters
        result["false_alarm"] = [float(named or redundant or not all(r for c, r in zip(found, right) if not c.block)), 1.0]
    before, after = answer["before"], answer["after"]
    if before and after is not None:
        result["worse"] = [float(after > WORSE * before), 1.0]
        oracle = 1 - (truth.oracle_after / truth.before) ** 2 if truth.before and truth.oracle_after is not None else 0.0
        if oracle > 0.0:
            share = (1 - (after / before) ** 2) / oracle
            result |= {"of_oracle": [min(max(share, CLIP[0]), CLIP[1]), 1.0], "of_oracle_median": [share]}
    for name, held in zip(("coverage", "coverage_block"), _coverage(found, truth)):
        if held:
            result[name] = [float(sum(held)), float(len(held))]
    given = [(c.probability, r) for c, r in zip(found, right) if c.probability is not None]
    if given:
        result["log_loss"] = [sum(-math.log(max(p if r else 1 - p, LEAST)) for p, r in given), float(len(given))]
        bins = [0.0] * (3 * BINS)
        for p, r in given:
            at = 3 * min(int(BINS * p), BINS - 1)
            bins[at], bins[at + 1], bins[at + 2] = bins[at] + 1, bins[at + 1] + p, bins[at + 2] + r
        result["calibration"] = bins
    return result

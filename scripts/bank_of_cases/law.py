"""The logistic law of class probabilities (`crates/gap/src/answer/class_probability.rs`): fitted to answers of the development set, and its reliability.

The law has a constant and a weight for the logarithm to base 10 of each ground, between limits. Weights have a normal prior about 0 (`RIDGE`). Reliability is that of laws that
were fitted without the case in question.
"""

import sys
from pathlib import Path

import numpy as np

from . import answers
from .judge import BINS, claims, load

# ground: least and most; the limits of the Rust source
LIMITS = {"evidence": (1.0, 1e4), "deviations": (1.0, 1e3), "share": (1e-3, 1.0)}
RIDGE = 0.3  # precision of each weight's prior
STEPS = 50


def rows(found: dict[str, dict], drawn: Path) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Per class of single effects: its case, its grounds as regressors (n, 1 + 3), and whether it is true (n)."""
    cases, regressors, true = [], [], []
    for case, answer in found.items():
        if answer["failure"]:
            continue
        truth = load(drawn / case)
        own = {truth.name(c["representative"]): c for c in answer["classes"]}
        for claim in (c for c in claims(answer, truth) if not c.block and c.name in own):
            grounds = own[claim.name]
            regressors.append([1.0, *(np.log10(np.clip(grounds[name] or 0.0, *ends)) for name, ends in LIMITS.items())])
            true.append(float(claim.meets(truth.all_classes())))
            cases.append(case)
    return cases, np.array(regressors), np.array(true)


def fit(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The weights (k) that maximise the penalised likelihood, by Newton steps."""
    weights, prior = np.zeros(x.shape[1]), RIDGE * np.eye(x.shape[1])
    prior[0, 0] = 1e-9
    for _ in range(STEPS):
        p = 1 / (1 + np.exp(-x @ weights))
        weights = weights + np.linalg.solve((x.T * (p * (1 - p))) @ x + prior, x.T @ (y - p) - prior @ weights)
    return weights


def report(place: Path, drawn: Path) -> str:
    """The law, and the reliability of laws that leave one case out."""
    cases, x, y = rows(answers.read(place), drawn)
    if len(set(y)) < 2:
        sys.exit(f"{place}: true and false classes are needed")
    law, names = fit(x, y), np.array(cases)
    p = np.empty(len(y))
    for case in set(cases):
        out = names == case
        p[out] = 1 / (1 + np.exp(-x[out] @ fit(x[~out], y[~out])))
    at = np.minimum((BINS * p).astype(int), BINS - 1)
    error = sum(abs(p[at == k].mean() - y[at == k].mean()) * np.sum(at == k) for k in set(at)) / len(y)
    loss = -np.mean(np.where(y > 0, np.log(p), np.log(1 - p)))
    lines = [
        f"{len(y)} classes of {len(set(cases))} cases, {int(y.sum())} true",
        "law: " + ", ".join(f"{w:.3f}" for w in law) + "   (constant, " + ", ".join(LIMITS) + ")",
        f"left out case by case: log loss {loss:.3f}, expected calibration error {error:.3f}",
        "", "| probability | classes | mean | true |", "| ---: | ---: | ---: | ---: |",
    ]
    lines += [f"| {k / BINS:.1f} to {(k + 1) / BINS:.1f} | {np.sum(at == k)} | {p[at == k].mean():.2f} | {y[at == k].mean():.2f} |" for k in sorted(set(at))]
    return "\n".join(lines)

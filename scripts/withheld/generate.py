"""Many cases at once: which are wanted, drawing them until they are adequate, and what came of it."""

import collections
import multiprocessing
import sys
import time
from pathlib import Path

import numpy as np

from .aliases import EFFECTS
from .cases import Case, Wanted
from .experiment import Inadequate
from .files import write
from .outside import KINDS
from .system import MOVING, STEPPING

SHARES = {"single": 0.55, "none": 0.15, "unknown": 0.15, "pair": 0.15, "mixture": 0.0, "moving": 0.0, "stepping": 0.0}
ATTEMPTS = 60
BESIDE = {"none": ("parameters", "gusts"), "mixture": ("nothing", "parameters", "outside")}  # what may be asked to act beside the effects


def plan(counts: dict[str, int], weak_share: float, rng, beside: str | None = None) -> list[Wanted]:
    """Every effect as often as any other, likewise the unknown kinds; in random order."""
    def turns(items, count):
        found: list[str] = []
        while len(found) < count:
            found += [str(item) for item in rng.permutation(items)]
        return found[:count]

    wanted = [Wanted("single", effect, rng.random() < weak_share) for effect in turns(EFFECTS, counts["single"])]
    wanted += [Wanted("moving", effect, False) for effect in turns(sorted(MOVING), counts.get("moving", 0))]
    wanted += [Wanted("stepping", effect, False) for effect in turns(sorted(STEPPING), counts.get("stepping", 0))]
    wanted += [Wanted("unknown", kind, False) for kind in turns(KINDS, counts["unknown"])]
    wanted += [Wanted(group, None, False, beside if beside in BESIDE.get(group, ()) else None) for group in ("none", "pair", "mixture") for _ in range(counts.get(group, 0))]
    return [wanted[i] for i in rng.permutation(len(wanted))]


def make(job: tuple[Wanted, np.random.SeedSequence, Path]) -> dict:
    """Draws until a case is adequate and writes it; what came of it, and why draws were discarded."""
    wanted, seed, folder = job
    began, discarded = time.perf_counter(), collections.Counter()
    for attempt in seed.spawn(ATTEMPTS):
        rng = np.random.default_rng(attempt)
        try:
            with np.errstate(all="ignore"):
                case = Case(rng, wanted)
                label = case.label()
        except Inadequate as reason:
            discarded[str(reason)] += 1
            continue
        except (ArithmeticError, ValueError, np.linalg.LinAlgError) as reason:
            discarded[f"not computable: {type(reason).__name__}"] += 1
            continue
        identity, salt = rng.bytes(6).hex(), rng.bytes(16).hex()
        write(case, label, folder, identity, salt)
        experiment = case.experiment
        return {
            "id": identity, "wanted": wanted, "discarded": discarded, "seconds": time.perf_counter() - began, "plant": experiment.model["name"],
            "loop": "closed" if experiment.closed else "open", "label": label, "traits": experiment.traits(), "hidden": case.hidden,
        }
    return {"id": None, "wanted": wanted, "discarded": discarded, "seconds": time.perf_counter() - began}


def generate(folder: Path, counts: dict[str, int], seed: int, jobs: int, weak_share: float = 0.0, beside: str | None = None) -> list[dict]:
    root = np.random.SeedSequence(seed)
    order, *seeds = root.spawn(1 + sum(counts.values()))
    work = [(w, s, folder) for w, s in zip(plan(counts, weak_share, np.random.default_rng(order), beside), seeds)]
    if jobs == 1:
        return [make(job) for job in work]
    with multiprocessing.get_context("spawn").Pool(jobs) as pool:
        return list(_reported(pool.imap_unordered(make, work), len(work)))


def _reported(results, count):
    for number, result in enumerate(results, start=1):
        print(f"{number}/{count} {result['id']} {result['seconds']:.1f} s", file=sys.stderr, flush=True)
        yield result


def summary(results: list[dict]) -> str:
    """Counts without naming which case is which."""
    reasons = sum((r["discarded"] for r in results), collections.Counter())
    made = [r for r in results if r["id"]]
    tried = len(made) + sum(reasons.values())
    lines = [f"{len(made)} cases of {len(results)}, {tried} draws, {sum(reasons.values())} discarded ({100 * sum(reasons.values()) / max(tried, 1):.0f} %)"]
    lines += [f"  {count} x {reason}" for reason, count in reasons.most_common()]
    lines.append("groups: " + ", ".join(f"{g} {n}" for g, n in sorted(collections.Counter(r["wanted"].group for r in made).items())))
    lines.append("plants: " + ", ".join(f"{g} {n}" for g, n in sorted(collections.Counter(r["plant"] for r in made).items())))
    lines.append("with: " + ", ".join(f"{t} {n}" for t, n in sorted(collections.Counter(t for r in made for t in r["traits"]).items())))
    seconds = [r["seconds"] for r in results]
    lines.append(f"time per case: {np.mean(seconds):.1f} s mean, {np.max(seconds):.1f} s longest")
    return "\n".join(lines)

"""Two sets of cases with fixed seeds: which cases they hold, and how a case is drawn and checked.

A case is a folder SET/GROUP-NN: `model.toml`, `train_1.csv`, `train_2.csv`, `holdout_1.csv`, `label.json` (`deadtime/blind@1`) and `drawn.json`: traits, hidden parameter
errors, and the effects of this model that do the same by construction. The repository stores one SHA-256 over these files per case, golden/bank/SET.sha256.
"""

import contextlib
import hashlib
import json
import multiprocessing
import shutil
import sys
import tempfile
import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from withheld.aliases import EFFECTS
from withheld.cases import Wanted
from withheld.generate import make
from withheld.structure import same_by_construction
from withheld.system import MOVING, STEPPING

ROOT = Path(__file__).resolve().parents[2]
CACHE = ROOT / "target" / "bank"
SEEDS = {"development": 20261127, "locked": 20270911}
FILES = ("model.toml", "train_1.csv", "train_2.csv", "holdout_1.csv", "label.json", "drawn.json")


@dataclass(frozen=True)
class Group:
    """What is drawn: the generator's group, what acts beside its effects, and the effects that take turns."""

    count: int
    kind: str
    beside: str | None = None
    effects: tuple[str, ...] = ()
    weak: bool = False


GROUPS = {
    "mixture": Group(40, "mixture", "nothing"),
    "mixture_outside": Group(20, "mixture", "outside"),
    "mixture_parameters": Group(20, "mixture", "parameters"),
    "single": Group(40, "single", effects=tuple(EFFECTS)),
    "weak": Group(16, "single", effects=tuple(EFFECTS), weak=True),
    "none": Group(16, "none"),
    "none_parameters": Group(12, "none", "parameters"),
    "none_gusts": Group(8, "none", "gusts"),
    "moving": Group(16, "moving", effects=tuple(sorted(MOVING))),
    "stepping": Group(12, "stepping", effects=tuple(sorted(STEPPING))),
}


def names(groups: list[str] | None = None, cases: int | None = None) -> list[str]:
    """The first `cases` cases of each group; every beginning of the list holds about the same part of every group."""
    chosen = [(n / GROUPS[g].count, i, f"{g}-{n:02}") for i, g in enumerate(GROUPS) if not groups or g in groups
              for n in range(min(GROUPS[g].count, cases or GROUPS[g].count))]
    return [name for _, _, name in sorted(chosen)]


def group_of(name: str) -> str:
    return name.rsplit("-", 1)[0]


def wanted(seed: int, name: str) -> tuple[Wanted, np.random.SeedSequence]:
    """What the case is to be, and its own seed."""
    key, number = group_of(name), int(name.rsplit("-", 1)[1])
    group, index = GROUPS[key], list(GROUPS).index(key)
    turns, rng = [], np.random.default_rng([seed, index])
    while group.effects and len(turns) <= number:
        turns += [str(e) for e in rng.permutation(group.effects)]
    return Wanted(group.kind, turns[number] if turns else None, group.weak, group.beside), np.random.SeedSequence([seed, index, number])


def digest(folder: Path) -> str:
    """SHA-256 over the names and bytes of a case's files."""
    total = hashlib.sha256()
    for name in FILES:
        content = (folder / name).read_bytes()
        total.update(f"{name} {len(content)}\n".encode() + content)
    return total.hexdigest()


def draw_one(job: tuple[str, str, Path]) -> tuple[str, float, str]:
    """Draws a case into its folder; its name, the seconds, and why draws were discarded."""
    set_name, name, folder = job
    with tempfile.TemporaryDirectory() as place:
        result = make((*wanted(SEEDS[set_name], name), Path(place)))
        discarded = ", ".join(f"{n} x {reason}" for reason, n in result["discarded"].items())
        if not result["id"]:
            return name, result["seconds"], f"NOTHING ADEQUATE: {discarded}"
        source, part = Path(place) / "cases" / result["id"], folder / f".{name}.part"
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir(parents=True)
        for file in FILES[:4]:
            shutil.copy(source / file, part / file)
        shutil.copy(Path(place) / "labels" / f"{result['id']}.json", part / "label.json")
        model = tomllib.loads((part / "model.toml").read_text())
        kind = "sampled" if model.get("sample_time_s") else {"lti": "linear"}.get(model["kind"], model["kind"])
        same = {effect: sorted(others) for effect, others in same_by_construction(model).items()}
        drawn = {"case": name, "plant": result["plant"], "traits": [kind, *result["traits"]], "hidden": result["hidden"], "same": same}
        (part / "drawn.json").write_text(json.dumps(drawn, indent=1) + "\n")
        part.rename(folder / name)
    return name, result["seconds"], discarded


def sums_file(set_name: str) -> Path:
    return ROOT / "golden" / "bank" / f"{set_name}.sha256"


def sums(set_name: str) -> dict[str, str]:
    """The stored hash of every case that has one."""
    path = sums_file(set_name)
    rows = [line.split() for line in path.read_text().splitlines()] if path.exists() else []
    return {name: value for value, name in rows}


def check(set_name: str, folder: Path, stamp: bool) -> list[str]:
    """The drawn cases whose files are not those that the repository's hashes stand for; with `stamp` new hashes are stored."""
    stored = sums(set_name)
    found = {name: digest(folder / name) for name in names() if (folder / name).is_dir()}
    if stamp:
        stored = found | stored
        rows = [f"{stored[name]}  {name}" for group in GROUPS for name in names([group]) if name in stored]
        sums_file(set_name).parent.mkdir(exist_ok=True)
        sums_file(set_name).write_text("\n".join(rows) + "\n")
    return [name for name, value in found.items() if stored.get(name, value) != value]


def draw(set_name: str, folder: Path, groups: list[str] | None, cases: int | None, jobs: int, stamp: bool) -> int:
    """Draws what is not there yet and checks all that is; exit code."""
    folder.mkdir(parents=True, exist_ok=True)
    work = [(set_name, name, folder) for name in names(groups, cases) if not (folder / name).is_dir()]
    failed = 0
    with multiprocessing.get_context("spawn").Pool(jobs) if jobs > 1 else contextlib.nullcontext() as pool:
        for n, (name, seconds, remark) in enumerate((pool.imap if pool else map)(draw_one, work), start=1):
            failed += remark.startswith("NOTHING")
            print(f"{n}/{len(work)} {name} {seconds:.1f} s {remark}", file=sys.stderr, flush=True)
    differing = check(set_name, folder, stamp)
    known, drawn = sums(set_name), [n for n in names() if (folder / n).is_dir()]
    print(f"{folder}: {len(drawn)} of {len(names())} cases, {sum(n in known for n in drawn)} of them with a stored hash")
    if differing:
        print(f"drawn otherwise than the stored hashes say: {', '.join(differing)}", file=sys.stderr)
    return 1 if differing or failed else 0

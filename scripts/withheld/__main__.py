"""``python -m withheld OUT``: blind cases (`deadtime/blind@1`) below OUT: cases/ID/ for the diagnoser, labels/ID.json to be kept apart."""

import argparse
import secrets
import sys
import time
from pathlib import Path

from .generate import BESIDE, SHARES, generate, summary


def main() -> int:
    parser = argparse.ArgumentParser(prog="withheld", description=__doc__)
    parser.add_argument("out", type=Path, help="a new or empty folder")
    parser.add_argument("--cases", type=int, help="how many, in the usual shares of the groups")
    for group in SHARES:
        parser.add_argument(f"--{group}", type=int, help=f"how many of the group {group}")
    parser.add_argument("--seed", type=int, help="default: from the operating system")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--weak", type=float, default=0.0, metavar="SHARE", help="share of singles between 5 and 10 dB above the noise")
    beside = sorted({name for names in BESIDE.values() for name in names})
    parser.add_argument("--beside", choices=beside, help="what acts on machines without effects (parameters, gusts) and beside mixtures (nothing, parameters, outside)")
    options = parser.parse_args()
    if options.out.exists() and any(options.out.iterdir()):
        parser.error(f"{options.out} is not empty")
    counts = {group: getattr(options, group) for group in SHARES}
    if options.cases is not None or not any(v is not None for v in counts.values()):
        total = 40 if options.cases is None else options.cases
        counts = {g: round(share * total) if counts[g] is None else counts[g] for g, share in SHARES.items()}
        counts["single"] += total - sum(counts.values()) if options.single is None else 0
    counts = {group: max(count or 0, 0) for group, count in counts.items()}
    seed = secrets.randbits(64) if options.seed is None else options.seed
    print(f"seed {seed}", flush=True)
    began = time.perf_counter()
    results = generate(options.out, counts, seed, options.jobs, options.weak, options.beside)
    print(summary(results))
    print(f"{time.perf_counter() - began:.0f} s in all")
    return 0 if all(r["id"] for r in results) else 1


if __name__ == "__main__":
    sys.exit(main())

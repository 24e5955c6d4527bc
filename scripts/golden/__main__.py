"""``python -m golden [--check | --stamp] [CASE ...]``: regenerate the golden files, or compare a regeneration with them.

With all cases, writing or ``--stamp`` (a comparison in which nothing differs) renews their part of golden/HASHES.
"""

import argparse
import sys
import tempfile
import warnings
from pathlib import Path

from . import hashes, registry, store
from .octave import Unavailable


def regenerate(case: str, name: str, build, folder: Path) -> Path:
    """Builds one file (with the inputs stored in the committed one) below `folder`."""
    path = folder / case / name
    store.write(path, build(store.read(store.FOLDER / case / name)))
    return path


def check(case: str, name: str, build, folder: Path) -> tuple[bool, str]:
    """Whether a fresh calculation agrees with the committed file, and how far."""
    committed = store.read(store.FOLDER / case / name)
    if committed is None:
        return False, "no committed file"
    fresh = store.read(regenerate(case, name, build, folder))
    differences = store.compare(fresh, committed, committed["tolerance"])
    excess, place = max(differences, default=(0.0, "nothing compared"))
    text = f"largest difference {excess:.2g} of the tolerance, at {place}"
    return excess <= 1.0, text


def main() -> int:
    parser = argparse.ArgumentParser(prog="golden", description=__doc__)
    parser.add_argument("--check", action="store_true", help="compare instead of writing; exit 1 on a difference")
    parser.add_argument("--stamp", action="store_true", help="compare, and write golden/HASHES where nothing differs")
    parser.add_argument("cases", nargs="*", metavar="CASE", help="folders below golden/ (default: all)")
    options = parser.parse_args()
    if options.stamp and options.cases:
        parser.error("--stamp compares all cases")
    compare = options.check or options.stamp
    unknown = set(options.cases) - set(registry.CASES)
    if unknown:
        parser.error(f"unknown case {', '.join(sorted(unknown))}; there are {', '.join(registry.CASES)}")
    warnings.filterwarnings("ignore")
    failed = False
    with tempfile.TemporaryDirectory() as scratch:
        for case in options.cases or registry.CASES:
            for name, build in registry.CASES[case].items():
                label = f"{case}/{name}"
                try:
                    if compare:
                        agrees, text = check(case, name, build, Path(scratch))
                        failed |= not agrees
                        print(f"{'ok' if agrees else 'DIFFERS'} {label}: {text}", flush=True)
                    else:
                        print(f"wrote {regenerate(case, name, build, store.FOLDER).relative_to(store.FOLDER.parent)}", flush=True)
                except Unavailable:
                    print(f"skipped {label}: no Octave", flush=True)
                except AssertionError as problem:
                    failed = True
                    print(f"{'DIFFERS' if compare else 'FAILED'} {label}: {problem}", flush=True)
    if not failed and not options.check and not options.cases:
        hashes.stamp("cases")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())

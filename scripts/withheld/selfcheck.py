"""``python -m withheld.selfcheck``: the simulator's laws and agreement of its integrators, and three drawn cases; exit 1 on a failure."""

import sys
import time

from . import agreement, generator_check, laws


def main() -> int:
    failed = False
    for check in [*laws.LAWS, *agreement.CHECKS, *generator_check.CHECKS]:
        began = time.perf_counter()
        try:
            check()
            print(f"ok      {check.__name__} ({time.perf_counter() - began:.2f} s)", flush=True)
        except AssertionError as problem:
            failed = True
            print(f"FAILED  {check.__name__}: {problem}", flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())

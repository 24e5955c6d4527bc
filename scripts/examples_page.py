"""Writes what the examples print into docs/examples.md, below each line `$ python examples/NAME.py` there.

    python scripts/examples_page.py [NAME.py ...]

Without names every example of the page is run, with the `deadtime` that this Python imports.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "examples.md"
BLOCK = re.compile(r"^\$ python examples/(\S+)\n(.*?)^```$", flags=re.MULTILINE | re.DOTALL)


def printed(name: str) -> str:
    """The standard output of an example; a path of this machine is none of the page's."""
    environment = {**os.environ, "MPLBACKEND": "Agg"}
    done = subprocess.run([sys.executable, f"examples/{name}"], cwd=ROOT, capture_output=True, text=True, env=environment, check=False)
    if done.returncode != 0:
        raise SystemExit(f"examples/{name} failed:\n{done.stderr}")
    return done.stdout.replace(f"{ROOT}/", "").strip() + "\n"


def main(names: list[str]) -> int:
    page = PAGE.read_text(encoding="utf-8")
    known = [found.group(1) for found in BLOCK.finditer(page)]
    unknown = sorted(set(names) - set(known))
    if unknown:
        raise SystemExit(f"docs/examples.md has no block for {', '.join(unknown)}; it has {', '.join(known)}")

    def renewed(found: re.Match[str]) -> str:
        name = found.group(1)
        return found.group(0) if names and name not in names else f"$ python examples/{name}\n{printed(name)}```"

    PAGE.write_text(BLOCK.sub(renewed, page), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

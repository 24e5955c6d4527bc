"""Runs the Python lines of the README and of docs/python.md as a newcomer would: one page after the other, from the top of the repository, each in a fresh interpreter's names.

    python scripts/readme_lines.py

Files that the lines write go to a temporary folder.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGES = ("README.md", "docs/python.md")


def blocks(page: Path) -> list[str]:
    """The blocks fenced as `python`, in order."""
    return re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)


def main() -> int:
    os.environ.setdefault("MPLBACKEND", "Agg")
    for name in PAGES:
        found = blocks(ROOT / name)
        if not found:
            print(f"{name}: there are no Python lines", file=sys.stderr)
            return 1
        with tempfile.TemporaryDirectory() as folder:
            shutil.copytree(ROOT / "examples", Path(folder) / "examples")
            os.chdir(folder)
            names: dict[str, object] = {"__name__": "__main__"}
            for number, block in enumerate(found, 1):
                exec(compile(block, f"{name}, block {number}", "exec"), names)  # noqa: S102: the page's own lines
            os.chdir(ROOT)
        print(f"{name}: {len(found)} blocks of Python ran")
    return 0


if __name__ == "__main__":
    sys.exit(main())

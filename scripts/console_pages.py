"""Writes what the program prints into the console blocks of the README and of the first pages of the book, below each line `$ deadtime …` that shows its output.

    python scripts/console_pages.py [PROGRAM]

PROGRAM is the built program, target/debug/deadtime unless named. tests/it/readme.rs checks the same blocks.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGES = ("README.md", *(f"docs/{name}.md" for name in ("five-minutes", "estimating", "awkward-records", "reading-a-diagnosis", "identifying", "tutorial", "experiments", "models")))


def renewed(block: str, program: Path, folder: Path) -> str:
    """A block with the output of its commands; a command that shows nothing runs and still shows nothing."""
    sessions = []
    for session in re.split(r"^\$ ", block, flags=re.MULTILINE)[1:]:
        command, _, shown = session.partition("\n")
        words = command.split()
        if words[0] == "deadtime":
            done = subprocess.run([program, *words[1:]], cwd=folder, capture_output=True, text=True, check=True)
            shown = done.stdout if shown.strip() else ""
        else:
            subprocess.run(["sh", "-c", command], cwd=folder, check=True)
        sessions.append(f"$ {command}\n{shown}")
    return "".join(sessions)


def main(words: list[str]) -> int:
    program = Path(words[0] if words else ROOT / "target" / "debug" / "deadtime").resolve()
    for name in PAGES:
        page = ROOT / name
        text = page.read_text(encoding="utf-8")
        with tempfile.TemporaryDirectory() as folder:
            # Paths are as the pages write them; everything written goes to a temporary folder.
            shutil.copytree(ROOT / "examples", Path(folder) / "examples")
            text = re.sub(r"(?<=^```console\n).*?(?=^```$)", lambda found: renewed(found.group(0), program, Path(folder)), text, flags=re.MULTILINE | re.DOTALL)
        page.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

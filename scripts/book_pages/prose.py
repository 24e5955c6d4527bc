"""Sentences of the pages that people write stay under thirty words."""

from __future__ import annotations

import re
from pathlib import Path

#: In SUMMARY.md no sentence stands, and what stands in folders is generated or a table.
NOT_PROSE = {"SUMMARY"}
LONGEST = 29


def long_sentences(root: Path) -> list[str]:
    """Those that are longer, with their page; code, tables, headings and pictures are none."""
    found = []
    pages = ["README", *(f"docs/{path.stem}" for path in sorted((root / "docs").glob("*.md")) if path.stem not in NOT_PROSE)]
    for name in pages:
        text = (root / f"{name}.md").read_text(encoding="utf-8")
        text = re.sub(r"```.*?```|<!--.*?-->|(?<=\n\n)(?:    [^\n]*\n)+", "", text, flags=re.DOTALL)
        for block in re.split(r"\n\s*\n|\n(?=\s*- |\s*\d+\. |\|)", text):
            if block.strip().startswith(("|", "#", "!")):
                continue
            words = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", " ".join(block.split()))
            for sentence in re.split(r"(?<=[.!?:;])\s+", words):
                if len(sentence.split()) > LONGEST:
                    found.append(f"{name}.md: {len(sentence.split())} words: {sentence[:80]}…")
    return found

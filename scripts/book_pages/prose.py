"""Sentences of the pages that newcomers read stay under thirty words."""

from __future__ import annotations

import re
from pathlib import Path

PAGES = ["README", *(f"docs/{name}" for name in "five-minutes install tutorial experiments estimating models formats adding releasing library".split())]
LONGEST = 29


def long_sentences(root: Path) -> list[str]:
    """Those that are longer, with their page; code, tables, headings and pictures are none."""
    found = []
    for name in PAGES:
        text = (root / f"{name}.md").read_text(encoding="utf-8")
        text = re.sub(r"```.*?```|<!--.*?-->", "", text, flags=re.DOTALL)
        for block in re.split(r"\n\s*\n|\n(?=\s*- |\s*\d+\. |\|)", text):
            if block.strip().startswith(("|", "#", "!")):
                continue
            words = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", " ".join(block.split()))
            for sentence in re.split(r"(?<=[.!?:;])\s+", words):
                if len(sentence.split()) > LONGEST:
                    found.append(f"{name}.md: {len(sentence.split())} words: {sentence[:80]}…")
    return found

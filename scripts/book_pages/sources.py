"""What the doc comments beside a method or an effect say: the one place where its equation, assumptions, failures and source are written."""

from __future__ import annotations

import re
import textwrap
from dataclasses import dataclass
from pathlib import Path

SECTIONS = ("Equation", "Inputs", "Assumes", "Resolution and cost", "Interval", "Fails when", "Source")
# A doc comment, the attributes after it, and the struct that it belongs to.
STRUCT = re.compile(r"((?:^[ \t]*///.*\n)+)(?:^#\[.*\n)*^[ \t]*pub(?:\(crate\))? struct (\w+)", re.MULTILINE)
# The line of a method: its name, its summary and its options; those of the process models share one struct.
NAMED = re.compile(r'(?:entry!|method_line!|: |as )\(\s*"(\w+)",\s*"[^"]*",\s*(\w+)|^    \w+, P\w+, "(\w+)"', re.MULTILINE)
EFFECT = re.compile(r'Facts::of\(\s*"(\w+)"')


@dataclass
class About:
    """One method or effect, as its file tells it."""

    file: str
    what: str
    equation: str
    sections: dict[str, str]


def words(text: str) -> str:
    """Doc text as Markdown: links into the library become the names of what they lead to, signs that Markdown would take for its own are escaped."""
    text = re.sub(r"\[`(?:[\w]+::)*(\w+)`\](?:\([^)]*\))?", r"`\1`", text)
    parts = re.split(r"(`[^`]*`)", text)
    return "".join(part if part.startswith("`") else re.sub(r"([*_<|])", r"\\\1", part) for part in parts)


def equation(text: str) -> str:
    """An equation as it stands in the source, in lines that fit a page."""
    return "```text\n" + "\n".join(textwrap.wrap(text, 96, break_long_words=False)) + "\n```"


def about(path: Path, root: Path, struct: str | None) -> About:
    """The head of a file and the doc comment of its struct, taken apart. A struct with an equation of its own stands in a file of several methods."""
    text = path.read_text(encoding="utf-8")
    head = [line[3:].strip() for line in text.splitlines() if line.startswith("//!")]
    paragraphs = " ".join(line or "\n" for line in head).split("\n")
    paragraphs = [p.strip() for p in paragraphs if p.strip()]
    formula = next((p for p in paragraphs if p.startswith("Equation: ")), "").removeprefix("Equation: ")
    docs = {name: doc for doc, name in STRUCT.findall(text)}
    doc = docs[struct] if struct else next(iter(docs.values()))
    sections: dict[str, str] = {}
    current = ""
    for line in doc.splitlines():
        line = line.strip().removeprefix("///").strip()
        if line.startswith("# "):
            break
        begun = re.match(rf"({'|'.join(SECTIONS)}): (.*)", line)
        if begun:
            current = begun.group(1)
            sections[current] = begun.group(2)
        elif current and line:
            sections[current] += " " + line
        elif not line:
            current = ""
    own = sections.pop("Equation", None)
    lines = [line.strip().removeprefix("///").strip() for line in doc.splitlines()]
    what = " ".join(lines[: lines.index("")]) if own else paragraphs[0]
    return About(path.relative_to(root).as_posix(), what, own or formula, sections)


def methods(root: Path) -> dict[str, About]:
    """Every method's text by its name."""
    found: dict[str, About] = {}
    for path in sorted((root / "crates" / "delay" / "src").glob("*/*.rs")):
        text = path.read_text(encoding="utf-8")
        structs = {name for _, name in STRUCT.findall(text)}
        for name, struct, process in NAMED.findall(text):
            # Methods that a macro makes are no pages: they answer under a condition only.
            if (struct or "Process") not in structs:
                continue
            found[name or process] = about(path, root, struct or "Process")
    return found


def effects(root: Path) -> dict[str, About]:
    """Every effect's text by its name."""
    found: dict[str, About] = {}
    for path in sorted((root / "crates" / "model" / "src" / "effect").glob("*/*.rs")):
        named = EFFECT.search(path.read_text(encoding="utf-8"))
        if named:
            found[named[1]] = about(path, root, None)
    return found

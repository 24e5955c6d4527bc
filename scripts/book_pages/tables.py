"""Rows of the generated tables in docs/results, looked up by their first cells."""

from __future__ import annotations

from pathlib import Path


def rows(page: Path, *heading: str) -> list[dict[str, str]]:
    """The rows of the first table whose headings begin so; a heading that comes again gets the place of its column."""
    lines = page.read_text(encoding="utf-8").splitlines()
    for at, line in enumerate(lines):
        names = cells(line)
        if tuple(names[: len(heading)]) == heading:
            names = [name if name not in names[:k] else f"{name} {k}" for k, name in enumerate(names)]
            body = []
            for row in lines[at + 2 :]:
                if not row.startswith("|"):
                    break
                body.append(dict(zip(names, cells(row), strict=False)))
            return body
    raise SystemExit(f"{page}: no table begins with {' | '.join(heading)}")


def cells(line: str) -> list[str]:
    """The cells of a line of a Markdown table."""
    return [cell.strip() for cell in line.strip().strip("|").split("|")] if line.startswith("|") else []

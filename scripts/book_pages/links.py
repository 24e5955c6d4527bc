"""Every link of a built book leads somewhere: files and headings are looked for on the disk, nothing is asked of the network."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit


class Page(HTMLParser):
    """The places that a page links to, and the names that can be linked to in it."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.names: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for key, value in attrs:
            if value and key == "id":
                self.names.add(value)
            elif value and ((tag == "a" and key == "href") or (tag == "img" and key == "src")):
                self.links.append(value)


def mend(folder: Path) -> None:
    """mdBook takes every Markdown file for a page of the book; links to those beside it lead to the file again."""
    for path in folder.rglob("*.html"):
        text = path.read_text(encoding="utf-8")

        def back(found: re.Match[str], path: Path = path) -> str:
            beside = found.group(1)
            made = (path.parent / beside).with_suffix(".html").exists()
            return f'href="{beside}.{"html" if made else "md"}"'

        mended = re.sub(r'href="((?:\.\./)[^":#]*)\.html"', back, text)
        if mended != text:
            path.write_text(mended, encoding="utf-8")


def broken(folder: Path, root: Path) -> list[str]:
    """Links of all pages below `folder` that lead nowhere; `root` holds what may be linked to."""
    pages = {path.resolve(): Page(path.read_text(encoding="utf-8")) for path in sorted(folder.rglob("*.html"))}
    wrong = []
    for path, page in pages.items():
        # The whole book on one page, to be printed, repeats the links of all others from another place.
        if path.name in ("print.html", "404.html", "toc.html"):
            continue
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if target.is_dir() and (target / "index.html").exists():
                target = target / "index.html"
            name = unquote(parts.fragment)
            if not target.exists() or not target.is_relative_to(root.resolve()):
                wrong.append(f"{path.relative_to(folder.resolve())}: {link} leads nowhere")
            elif name and target in pages and name not in pages[target].names:
                wrong.append(f"{path.relative_to(folder.resolve())}: {link}: the page has no heading of that name")
    return wrong

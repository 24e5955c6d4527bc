"""The reference of the command line: what every command says of itself."""

from __future__ import annotations

import os
import re
import subprocess

COMMANDS = re.compile(r"^Commands:\n((?:  .*\n)+)", re.MULTILINE)


def help_of(program: str, words: list[str]) -> str:
    """The long help, as on a terminal of 100 columns without colour."""
    plain = {**os.environ, "COLUMNS": "100", "NO_COLOR": "1"}
    # A terminal at any of the three would give its own width.
    done = subprocess.run([program, *words, "--help"], stdin=subprocess.DEVNULL, capture_output=True, text=True, check=True, env=plain)
    return "\n".join(line.rstrip() for line in done.stdout.splitlines())


def names(text: str) -> list[str]:
    """The commands that a help lists."""
    listed = COMMANDS.search(text + "\n")
    found = re.findall(r"^  (\w[\w-]*)", listed.group(1), re.MULTILINE) if listed else []
    return [name for name in found if name != "help"]


def page(program: str) -> str:
    """All commands on one page."""
    top = help_of(program, [])
    lines = ["# The command line", "", "What `deadtime help COMMAND` prints, command by command. `deadtime man DIR` writes the same as man pages.", ""]
    lines += ["Exit codes: 0 done, 1 a gate or a requested limit was not met, 2 could not run.", "", "## deadtime", "", "```text", top, "```", ""]
    for name in names(top):
        text = help_of(program, [name])
        lines += [f"## deadtime {name}", "", "```text", text, "```", ""]
        for inner in names(text):
            lines += [f"### deadtime {name} {inner}", "", "```text", help_of(program, [name, inner]), "```", ""]
    return "\n".join(lines)

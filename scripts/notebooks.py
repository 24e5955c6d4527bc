#!/usr/bin/env python3
"""Runs the notebooks in examples/ from top to bottom and stores what every cell shows: HTML with its pictures, text, and what it prints.

scripts/notebooks.py        run by the python of scripts/venv, after scripts/wheel
"""

from __future__ import annotations

import ast
import contextlib
import io
import json
import os
import sys
from pathlib import Path
from typing import Any

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"


def run(code: str, names: dict[str, Any], name: str) -> tuple[Any, str]:
    """The value of a cell's last line, if that is an expression, and what the cell prints."""
    tree = ast.parse(code, filename=name)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(tree, name, "exec"), names)
        value = eval(compile(ast.Expression(last.value), name, "eval"), names) if isinstance(last, ast.Expr) else None
    return value, printed.getvalue()


def lines(text: str) -> list[str]:
    return text.splitlines(keepends=True)


def outputs(value: Any, printed: str, count: int) -> list[dict[str, Any]]:
    """As Jupyter stores them (nbformat 4.5)."""
    found: list[dict[str, Any]] = [{"name": "stdout", "output_type": "stream", "text": lines(printed)}] if printed else []
    if value is not None:
        data = {"text/plain": lines(repr(value))}
        if hasattr(value, "_repr_html_"):
            data = {"text/html": lines(value._repr_html_()), **data}
        found.append({"data": data, "execution_count": count, "metadata": {}, "output_type": "execute_result"})
    return found


def main() -> int:
    os.chdir(EXAMPLES)
    for path in sorted(EXAMPLES.glob("*.ipynb")):
        notebook = json.loads(path.read_text(encoding="utf-8"))
        names: dict[str, Any] = {"__name__": "__main__"}
        code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
        for count, cell in enumerate(code, start=1):
            value, printed = run("".join(cell["source"]), names, f"{path.name}, {cell['id']}")
            cell["execution_count"], cell["outputs"] = count, outputs(value, printed, count)
        temporary = path.with_suffix(".tmp")
        temporary.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        temporary.replace(path)
        print(f"{path.name}: {path.stat().st_size / 1e3:.0f} kB")
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""The reference of the Python package, from the docstrings and signatures of its sources."""

from __future__ import annotations

import ast
import re
from pathlib import Path

#: Sections that are lists of names.
LISTS = ("Parameters", "Returns", "Raises", "Attributes", "Yields")
NUMPYDOC = re.compile(r"^(Parameters|Returns|Raises|Attributes|Examples|Notes|Yields|See Also|References)\n-+$", re.MULTILINE)


def page(root: Path) -> str:
    """Every public name, in the order of `deadtime.__all__`."""
    package = root / "python" / "deadtime"
    modules = {path.stem: ast.parse(path.read_text(encoding="utf-8")) for path in [*package.glob("*.py"), package / "_native.pyi"]}
    names = exported(modules["__init__"])
    lines = ["# The Python package", "", "Every public name of `deadtime`, from its docstring; [In Python](../python.md) shows them at work.", ""]
    for module, title in (("blind", "deadtime.blind"), ("bounds", "deadtime.bounds"), ("errors", "deadtime.errors"), ("dask", "deadtime.dask")):
        names += [f"{module}.{name}" for name in public(modules[module])]
        names = [name for name in names if name != module]
    for name in names:
        home, _, plain = name.rpartition(".")
        node = find(modules, plain, home or None)
        if node is None:
            continue
        whole, parts = native(root, node.name) if isinstance(node, ast.ClassDef) and ast.get_docstring(node) is None else (None, {})
        lines += entry(f"deadtime.{name}", node, "##", whole)
        if isinstance(node, ast.ClassDef):
            for part in node.body:
                if isinstance(part, ast.FunctionDef) and not part.name.startswith("_") and (ast.get_docstring(part) or part.name in parts):
                    lines += entry(f"{node.name}.{part.name}", part, "###", parts.get(part.name))
    return "\n".join(lines)


def exported(module: ast.Module) -> list[str]:
    """The names of `__all__`, capitals after the rest of their group as they stand."""
    found: list[str] = []
    for node in module.body:
        if isinstance(node, ast.Assign | ast.AugAssign):
            target = node.targets[0] if isinstance(node, ast.Assign) else node.target
            if isinstance(target, ast.Name) and target.id == "__all__":
                found += [str(name) for name in ast.literal_eval(node.value)]
    return [name for name in found if not name.startswith("__")]


def public(module: ast.Module) -> list[str]:
    """The functions and classes of a module that do not begin with an underscore."""
    return [node.name for node in module.body if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_")]


def find(modules: dict[str, ast.Module], name: str, home: str | None) -> ast.FunctionDef | ast.ClassDef | None:
    """Where a name is defined."""
    for stem, module in modules.items():
        if home is None or stem == home:
            for node in module.body:
                if isinstance(node, ast.FunctionDef | ast.ClassDef) and node.name == name:
                    return node
    return None


def native(root: Path, name: str) -> tuple[str | None, dict[str, str]]:
    """What the Rust sources say of a class of theirs and of its methods: their doc comments are the docstrings."""
    for path in sorted((root / "crates" / "python" / "src").glob("*.rs")):
        text = path.read_text(encoding="utf-8")
        found = re.search(rf'((?:^///.*\n)+)^#\[pyclass\([^\n]*name = "{name}"', text, re.MULTILINE)
        if found:
            body = re.search(rf"^#\[pymethods\]\nimpl {name} \{{\n(.*?)^\}}", text, re.MULTILINE | re.DOTALL)
            documented = re.findall(r"((?:^    ///.*\n)+)(?:^    #\[.*\n)*^    fn (\w+)", body[1] if body else "", re.MULTILINE)
            return comment(found[1]), {method: comment(doc) for doc, method in documented}
    return None, {}


def comment(text: str) -> str:
    """A doc comment of Rust as plain text."""
    return "\n".join(line.strip()[3:].removeprefix(" ") for line in text.splitlines()).strip()


def entry(name: str, node: ast.FunctionDef | ast.ClassDef, level: str, told: str | None = None) -> list[str]:
    """A heading, the signature and the docstring."""
    lines = [f"{level} {name}", ""]
    if isinstance(node, ast.FunctionDef):
        returned = f" -> {ast.unparse(node.returns)}" if node.returns else ""
        arguments = ast.unparse(node.args)
        one = f"{node.name}({arguments}){returned}"
        if any(isinstance(d, ast.Name) and d.id == "property" for d in node.decorator_list):
            one = f"{node.name}: {ast.unparse(node.returns)}" if node.returns else node.name
        elif len(one) > 96:
            one = f"{node.name}(\n    " + ",\n    ".join(split(arguments)) + f"\n){returned}"
        lines += ["```python", one, "```", ""]
    text = ast.get_docstring(node) or told
    if text:
        lines += [markdown(text), ""]
    return lines


def split(arguments: str) -> list[str]:
    """At the commas outside brackets."""
    parts, depth, begun = [], 0, ""
    for letter in arguments:
        depth += (letter in "[({") - (letter in "])}")
        if letter == "," and depth == 0:
            parts.append(begun.strip())
            begun = ""
        else:
            begun += letter
    return [*parts, begun.strip()]


def markdown(text: str) -> str:
    """A NumPy docstring: prose as it is, the sections as blocks of their own."""
    pieces = NUMPYDOC.split(text)
    lines = [prose(pieces[0])]
    for title, body in zip(pieces[1::2], pieces[2::2], strict=True):
        shown = ["```pycon", body.strip("\n"), "```"] if ">>>" in body else entries(body.strip("\n")) if title in LISTS else [prose(body)]
        lines += ["", f"**{title}**", "", *shown]
    return "\n".join(lines)


def entries(body: str) -> list[str]:
    """`name : type` with what it is indented below, as a list."""
    found: list[str] = []
    for line in body.splitlines():
        if line.startswith(" ") and found:
            found[-1] += f" {prose(line)}"
        elif line.strip():
            name, _, kind = line.partition(" : ")
            found.append(f"- `{name}`" + (f" ({prose(kind)}):" if kind else ":"))
    return [line.removesuffix(":") for line in found]


def prose(text: str) -> str:
    """Signs that Markdown would take for its own are escaped outside code."""
    parts = re.split(r"(`+[^`]*`+)", text.strip())
    return "".join(part if part.startswith("`") else re.sub(r"([*_<|\[\]])", r"\\\1", part) for part in parts)

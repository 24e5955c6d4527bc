"""The expressions of an equations model, checked with Python's `ast` and turned into Python source."""

import ast
import math
import re

FUNCTIONS = {
    name: getattr(math, name)
    for name in ("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "exp", "log", "sqrt")
}
FUNCTIONS |= {"abs": abs, "min": min, "max": max, "sign": lambda x: float(x > 0) - float(x < 0)}
_ALLOWED = (
    ast.Expression, ast.BinOp, ast.UnaryOp, ast.Call, ast.Name, ast.Load, ast.Constant,
    ast.Add, ast.Sub, ast.Mult, ast.Div, ast.Pow, ast.USub, ast.UAdd,
)
_NAME = re.compile(r"(?<![\w.])[A-Za-z_]\w*")


def to_source(text: str, names: dict[str, str]) -> str:
    """Python source of `text`, its names replaced by `names`; ValueError for anything that is no plain formula."""

    def replaced(match: re.Match) -> str:
        word = match.group()
        if word in names:
            return names[word]
        if word in FUNCTIONS:
            return word
        raise ValueError(f"unknown name {word!r} in {text!r}")

    source = _NAME.sub(replaced, text).replace("^", "**")
    tree = ast.parse(_NAME.sub("x", text).replace("^", "**"), mode="eval")
    for node in ast.walk(tree):
        if not isinstance(node, _ALLOWED):
            raise ValueError(f"{type(node).__name__} is not allowed in {text!r}")
    return f"({source})"

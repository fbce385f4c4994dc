"""Mutants of the package that the tests should kill: ``python tests/mutate.py --count 40``.

A mutant is a copy of the checkout with one change: a sign, an operator, a comparison, a constant,
an index, a function's opposite, a term dropped. Its folder's tests run first, then all, until one
fails. Survivors are printed with their line; each asks for a test, or for the line to go.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
FOLDERS = ["readings", "film", "problem", "electrodes", "solver", "scene", "batch"]
FOLDERS += ["surrogate", "inverse"]
NOT_COPIED = (".git", ".venv", ".*cache", ".hypothesis", "__pycache__", "out")
#: Seconds after which a run of tests counts as killed.
PATIENCE_S = 1800.0

OPERATORS = {ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*", ast.And: "or", ast.Or: "and"}
OPERATORS |= {ast.Lt: ">=", ast.LtE: "<", ast.Gt: "<=", ast.GtE: ">", ast.Eq: "!=", ast.NotEq: "=="}
OPPOSITES = {"argmin": "argmax", "min": "max", "minimum": "maximum", "sin": "cos", "any": "all"}
OPPOSITES |= {there: here for here, there in OPPOSITES.items()}


class Mutant(NamedTuple):
    """An expression of a module and the text that replaces it."""

    path: Path
    expression: ast.expr  #: On a single line.
    replacement: str

    def apply(self, source: bytes) -> bytes:
        """Return the source text of the module with the expression replaced."""
        lines = source.split(b"\n")
        row = self.expression.lineno - 1
        before = lines[row][: self.expression.col_offset]
        after = lines[row][self.expression.end_col_offset :]
        lines[row] = before + self.replacement.encode() + after
        return b"\n".join(lines)


def list_replacements(node: ast.expr) -> Iterator[str]:
    """Yield texts that may replace an expression and should change a result."""
    if isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
        left = ast.unparse(node.left)
        right = ast.unparse(node.right)
        yield f"(({left}) {OPERATORS[type(node.op)]} ({right}))"
        if isinstance(node.op, ast.Add | ast.Sub):
            yield f"({left})"
    elif isinstance(node, ast.Compare) and type(node.ops[0]) in OPERATORS:
        if len(node.ops) == 1:
            left = ast.unparse(node.left)
            right = ast.unparse(node.comparators[0])
            yield f"({left} {OPERATORS[type(node.ops[0])]} {right})"
    elif isinstance(node, ast.BoolOp):
        operator = f" {OPERATORS[type(node.op)]} "
        yield f"({operator.join(ast.unparse(value) for value in node.values)})"
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not):
        yield f"({ast.unparse(node.operand)})"
    elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
        yield repr({0: 1, 1: 0}.get(node.value, 2 * node.value))
    elif isinstance(node, ast.Attribute) and node.attr in OPPOSITES:
        yield f"{ast.unparse(node.value)}.{OPPOSITES[node.attr]}"
    elif isinstance(node, ast.Name) and node.id in OPPOSITES:
        yield OPPOSITES[node.id]


def list_mutants(path: Path) -> Iterator[Mutant]:
    """Yield all mutants of the functions of a module.

    Expressions that span several lines and parts of f-strings, which are messages, are left out.
    """
    tree = ast.parse(path.read_text("utf-8"))
    in_texts: set[ast.AST] = set()
    in_functions: dict[ast.AST, None] = {}  # a dict keeps the order
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            in_texts.update(ast.walk(node))
        if isinstance(node, ast.FunctionDef):
            for statement in node.body:
                in_functions |= dict.fromkeys(ast.walk(statement))
    for node in in_functions:
        if node in in_texts or not isinstance(node, ast.expr):
            continue
        if node.lineno == node.end_lineno:
            for replacement in list_replacements(node):
                yield Mutant(path, node, replacement)


def is_killed(mutant: Mutant, checkout: Path, only_own: bool) -> bool:
    """Return whether a test fails in a checkout with the mutant. The checkout is restored.

    Parameters
    ----------
    mutant : Mutant
        The mutant.
    checkout : Path
        Copy of the repository.
    only_own : bool
        Whether only the tests of the mutant's folder run.
    """
    path = mutant.path.relative_to(ROOT)
    source = mutant.path.read_bytes()
    (checkout / path).write_bytes(mutant.apply(source))
    environment = {**os.environ, "PYTHONPATH": str(checkout), "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-n", "auto"]
    folders = [f"tests/{path.parts[1]}"]
    if not only_own:
        folders.append("tests")
    try:
        for folder in folders:
            result = subprocess.run(
                [*command, folder],
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                cwd=checkout,
                env=environment,
                timeout=PATIENCE_S,
            )
            if result.returncode:
                return True
        return False
    except subprocess.TimeoutExpired:
        return True
    finally:
        (checkout / path).write_bytes(source)


def main() -> None:
    """Draw mutants, run the tests on each, and print which ones survive."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--folders", nargs="*", default=FOLDERS)
    parser.add_argument("--own", action="store_true", help="only the tests of a mutant's folder")
    options = parser.parse_args()
    mutants: list[Mutant] = []
    for folder in options.folders:
        for path in sorted(ROOT.glob(f"pvdf_fem/{folder}/**/*.py")):
            mutants += list_mutants(path)
    counts: Counter[tuple[str, str]] = Counter()
    with TemporaryDirectory() as folder:
        checkout = Path(folder, "checkout")
        shutil.copytree(ROOT, checkout, ignore=shutil.ignore_patterns(*NOT_COPIED))
        for mutant in random.Random(options.seed).sample(mutants, options.count):
            outcome = "killed" if is_killed(mutant, checkout, options.own) else "SURVIVED"
            path = mutant.path.relative_to(ROOT / "pvdf_fem")
            counts[path.parts[0], outcome] += 1
            row = mutant.expression.lineno
            line = mutant.path.read_text("utf-8").split("\n")[row - 1].strip()
            print(f"{outcome} {path}:{row} {line}\n    {mutant.replacement}", flush=True)
    for (name, outcome), count in sorted(counts.items()):
        print(f"{name}: {count} {outcome}")


if __name__ == "__main__":
    main()

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
FOLDERS = ["film", "charges", "solvers", "solution", "scene", "sweeps"]
FOLDERS += ["response", "touch", "tracking", "calibration"]
NOT_COPIED = (".git", ".venv", ".*cache", ".hypothesis", "__pycache__", "out")
#: Seconds after which a run of tests counts as killed.
PATIENCE_S = 1800.0

OPERATORS = {ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*", ast.And: "or", ast.Or: "and"}
OPERATORS |= {ast.Lt: ">=", ast.LtE: "<", ast.Gt: "<=", ast.GtE: ">", ast.Eq: "!=", ast.NotEq: "=="}
OPPOSITES = {"argmin": "argmax", "min": "max", "minimum": "maximum", "sin": "cos", "any": "all"}
OPPOSITES |= {there: here for here, there in OPPOSITES.items()}


class Mutant(NamedTuple):
    """A change of the text of a module, by offsets in bytes of its line."""

    path: Path
    line: int
    begin: int
    end: int
    text: str

    def applied(self, source: str) -> str:
        lines = source.split("\n")
        line = lines[self.line - 1].encode()
        changed = line[: self.begin] + self.text.encode() + line[self.end :]
        lines[self.line - 1] = changed.decode()
        return "\n".join(lines)


def changes(node: ast.AST) -> Iterator[str]:
    """Texts that may stand in the place of an expression."""
    if isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
        left, right = ast.unparse(node.left), ast.unparse(node.right)
        yield f"(({left}) {OPERATORS[type(node.op)]} ({right}))"
        if isinstance(node.op, ast.Add | ast.Sub):
            yield f"({left})"
    elif isinstance(node, ast.Compare) and type(node.ops[0]) in OPERATORS:
        right = ast.unparse(node.comparators[0])
        if len(node.ops) == 1:
            yield f"({ast.unparse(node.left)} {OPERATORS[type(node.ops[0])]} {right})"
    elif isinstance(node, ast.BoolOp):
        yield f"({f' {OPERATORS[type(node.op)]} '.join(map(ast.unparse, node.values))})"
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not):
        yield f"({ast.unparse(node.operand)})"
    elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
        yield repr({0: 1, 1: 0}.get(node.value, 2 * node.value))
    elif isinstance(node, ast.Attribute) and node.attr in OPPOSITES:
        yield f"{ast.unparse(node.value)}.{OPPOSITES[node.attr]}"
    elif isinstance(node, ast.Name) and node.id in OPPOSITES:
        yield OPPOSITES[node.id]


def mutants_of(path: Path) -> Iterator[Mutant]:
    """All mutants of the functions of a module, but for expressions of several lines."""
    tree = ast.parse(path.read_text("utf-8"))
    functions = [n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef)]
    bodies = [statement for function in functions for statement in function.body]
    texts = [n for n in ast.walk(tree) if isinstance(n, ast.JoinedStr)]
    left_out = {n for text in texts for n in ast.walk(text)}  # messages
    for node in {n: None for statement in bodies for n in ast.walk(statement)}:
        if node in left_out or not isinstance(node, ast.expr):
            continue
        if node.lineno == node.end_lineno:
            for text in changes(node):
                yield Mutant(path, node.lineno, node.col_offset, node.end_col_offset or 0, text)


def killed(mutant: Mutant, checkout: Path, only_own: bool) -> bool:
    """Whether a test fails in a checkout with the mutant; the checkout is left as it was."""
    there = checkout / mutant.path.relative_to(ROOT)
    source, folder = there.read_text("utf-8"), there.relative_to(checkout).parts[1]
    there.write_text(mutant.applied(source), "utf-8")
    environment = {**os.environ, "PYTHONPATH": str(checkout), "OMP_NUM_THREADS": "1"}
    limits = {"cwd": checkout, "env": environment, "timeout": PATIENCE_S}
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    # modules at the root are tested by the modules at the root
    at_root = [str(path.relative_to(ROOT)) for path in ROOT.glob("tests/test_*.py")]
    own = at_root if "." in folder else [f"tests/{folder}"]
    runs = [own] if only_own else [own, ["tests"]]
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-n", "auto"]
    try:
        return any(subprocess.run([*command, *of], **quiet, **limits).returncode for of in runs)
    except subprocess.TimeoutExpired:
        return True
    finally:
        there.write_text(source, "utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--folders", nargs="*", default=FOLDERS)
    parser.add_argument("--own", action="store_true", help="only the tests of a mutant's folder")
    options = parser.parse_args()
    patterns = ["*.py" if name == "." else f"{name}/**/*.py" for name in options.folders]
    paths = [p for pattern in patterns for p in sorted(ROOT.glob(f"pvdf_fem/{pattern}"))]
    every = [mutant for path in paths for mutant in mutants_of(path)]
    drawn, dead = random.Random(options.seed).sample(every, options.count), Counter()
    with TemporaryDirectory() as folder:
        copy = Path(folder, "checkout")
        shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(*NOT_COPIED))
        for mutant in drawn:
            where = mutant.path.relative_to(ROOT / "pvdf_fem")
            end = killed(mutant, copy, options.own)
            dead[where.parts[0]] += end
            told = mutant.path.read_text("utf-8").split("\n")[mutant.line - 1].strip()
            print("killed" if end else "SURVIVED", f"{where}:{mutant.line}", told, flush=True)
            print(f"    {mutant.text}", flush=True)
    asked = Counter(mutant.path.relative_to(ROOT / "pvdf_fem").parts[0] for mutant in drawn)
    for name, count in asked.items():
        print(f"{name}: {dead[name]} of {count} killed")


if __name__ == "__main__":
    main()

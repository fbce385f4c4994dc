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

ROOT = Path(__file__).parents[1]
FOLDERS = ["film", "electrodes", "solver", "scene", "batch"]
FOLDERS += ["surrogate", "inverse"]
NOT_COPIED = (".git", ".venv", ".*cache", ".hypothesis", "__pycache__", "out")
#: Seconds after which a run of tests counts as killed.
PATIENCE_S = 1800.0

OPERATORS = {ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*", ast.And: "or", ast.Or: "and"}
OPERATORS |= {ast.Lt: ">=", ast.LtE: "<", ast.Gt: "<=", ast.GtE: ">", ast.Eq: "!=", ast.NotEq: "=="}
OPPOSITES = {"argmin": "argmax", "min": "max", "minimum": "maximum", "sin": "cos", "any": "all"}
OPPOSITES |= {there: here for here, there in OPPOSITES.items()}


#: A module, an expression on one of its lines, and a text for the expression's place.
Mutant = tuple[Path, ast.expr, str]


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
            yield from ((path, node, text) for text in changes(node))


def killed(mutant: Mutant, checkout: Path, only_own: bool) -> bool:
    """Whether a test fails in a checkout with the mutant; the checkout is left as it was."""
    path, node, text = mutant
    there, source = checkout / path.relative_to(ROOT), path.read_bytes()
    lines = source.split(b"\n")
    line = lines[node.lineno - 1]
    changed = line[: node.col_offset] + text.encode() + line[node.end_col_offset :]
    there.write_bytes(b"\n".join([*lines[: node.lineno - 1], changed, *lines[node.lineno :]]))
    environment = {**os.environ, "PYTHONPATH": str(checkout), "OMP_NUM_THREADS": "1"}
    limits = {"cwd": checkout, "env": environment, "timeout": PATIENCE_S}
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    own = f"tests/{path.relative_to(ROOT).parts[1]}"
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-n", "auto"]
    runs = [[*command, own]] if only_own else [[*command, own], [*command, "tests"]]
    try:
        return any(subprocess.run(run, **quiet, **limits).returncode for run in runs)
    except subprocess.TimeoutExpired:
        return True
    finally:
        there.write_bytes(source)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--folders", nargs="*", default=FOLDERS)
    parser.add_argument("--own", action="store_true", help="only the tests of a mutant's folder")
    options = parser.parse_args()
    paths = [p for of in options.folders for p in sorted(ROOT.glob(f"pvdf_fem/{of}/**/*.py"))]
    every = [mutant for path in paths for mutant in mutants_of(path)]
    drawn, ends = random.Random(options.seed).sample(every, options.count), Counter()
    with TemporaryDirectory() as folder:
        copy = Path(folder, "checkout")
        shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(*NOT_COPIED))
        for path, node, text in drawn:
            where, end = path.relative_to(ROOT / "pvdf_fem"), "SURVIVED"
            if killed((path, node, text), copy, options.own):
                end = "killed"
            ends[where.parts[0], end] += 1
            told = path.read_text("utf-8").split("\n")[node.lineno - 1].strip()
            print(f"{end} {where}:{node.lineno} {told}\n    {text}", flush=True)
    for (name, end), count in sorted(ends.items()):
        print(f"{name}: {count} {end}")


if __name__ == "__main__":
    main()

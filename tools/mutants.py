"""Plant one fault after another, and see whether the tests of its module find it.

    python tools/mutants.py --count 60 --seed 0
    python tools/mutants.py --only perfcap/solve --count 20
    python tools/mutants.py --case 0:17            # show one, and run its tests

A fault changes one place: a comparison, an operator, a sign, a number, a condition, a word of
``and`` and ``or``. It is planted in a copy of the tree. First the tests that import the module are
run, then those of modules that import it, and so on outwards while there are none. "found later" is
what the first do not find. Survivors are printed with their line: each is a test that is missing,
or code that does nothing.
"""

from __future__ import annotations

import argparse
import ast
import copy
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

_ROOT = Path(__file__).resolve().parents[1]
_LONGEST = 300  # s of the tests of a fault
_FARTHEST = 5  # steps from a module to tests
_TWINS = ("_numba.py",)  # compiled anew for every fault, and compared with twins that are not
_COMPARED = {
    ast.Lt: ast.GtE, ast.GtE: ast.Lt, ast.Gt: ast.LtE, ast.LtE: ast.Gt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip
_OPERATED = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd, ast.FloorDiv: ast.Mult, ast.Pow: ast.Mult,
}  # fmt: skip


@dataclass(frozen=True)
class Fault:
    """A place in a module, and its text before and after."""

    path: Path
    line: int
    before: str
    after: str
    source: str


class _Planter(ast.NodeTransformer):
    """Changes the ``target``-th place that can be changed; counts them all."""

    def __init__(self, target: int) -> None:
        self.target, self.count = target, 0
        self.found: tuple[int, str, str] | None = None

    def _change(self, node: ast.expr, changed: ast.expr) -> ast.expr:
        self.count += 1
        if self.count - 1 != self.target:
            return node
        self.found = node.lineno, ast.unparse(node), ast.unparse(changed)
        return changed

    def visit_Compare(self, node: ast.Compare) -> ast.expr:
        self.generic_visit(node)
        kind = _COMPARED[type(node.ops[0])]
        return self._change(node, ast.Compare(node.left, [kind(), *node.ops[1:]], node.comparators))

    def visit_BinOp(self, node: ast.BinOp) -> ast.expr:
        self.generic_visit(node)
        kind = _OPERATED.get(type(node.op))
        is_type = isinstance(node.op, ast.BitOr) and isinstance(node.left, ast.Name)
        if kind is None or is_type or isinstance(node.left, ast.Constant | ast.JoinedStr):
            return node
        return self._change(node, ast.BinOp(node.left, kind(), node.right))

    def visit_BoolOp(self, node: ast.BoolOp) -> ast.expr:
        self.generic_visit(node)
        kind = ast.Or() if isinstance(node.op, ast.And) else ast.And()
        return self._change(node, ast.BoolOp(kind, node.values))

    def visit_UnaryOp(self, node: ast.UnaryOp) -> ast.expr:
        self.generic_visit(node)
        if not isinstance(node.op, ast.USub | ast.Not | ast.Invert):
            return node
        return self._change(node, node.operand)

    def visit_IfExp(self, node: ast.IfExp) -> ast.expr:
        self.generic_visit(node)
        return self._change(node, ast.IfExp(node.test, node.orelse, node.body))

    def visit_Constant(self, node: ast.Constant) -> ast.expr:
        if type(node.value) is float:
            return self._change(node, ast.Constant(3 * node.value if node.value else 1.0))
        if type(node.value) is int and node.value > 1:
            return self._change(node, ast.Constant(node.value + 1))
        return node

    # what is said, and what types are, has no tests to fail
    def visit_Raise(self, node: ast.Raise) -> ast.Raise:
        return node

    def visit_JoinedStr(self, node: ast.JoinedStr) -> ast.JoinedStr:
        return node

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AnnAssign:
        if node.value is not None:
            node.value = self.visit(node.value)
        return node

    def visit_arguments(self, node: ast.arguments) -> ast.arguments:
        return node


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="perfcap", help="a folder or a file")
    parser.add_argument("--case", help="SEED:NUMBER, one alone, with what its tests say")
    options = parser.parse_args()
    seed, numbers = options.seed, range(options.count)
    if options.case:
        seed, number = (int(part) for part in options.case.split(":"))
        numbers = range(number, number + 1)
    modules = _modules(_ROOT / options.only)
    counts: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        tree = _copy(Path(folder) / "perfcap")
        for number in numbers:
            fault = _fault(modules, random.Random(f"{seed} {number}"))
            where = f"{seed}:{number} {fault.path.relative_to(_ROOT)}:{fault.line}"
            outcome = _judged(tree, fault, bool(options.case))
            counts[outcome] += 1
            _say(f"{outcome:11} {where}: {fault.before}  ->  {fault.after}")
    _say(f"{len(numbers)} faults: {', '.join(f'{n} {what}' for what, n in counts.items())}")
    return 1 if counts.keys() - {"found", "found later"} else 0


def _modules(place: Path) -> list[Path]:
    found = [place] if place.is_file() else sorted(place.rglob("*.py"))
    return [p for p in found if not p.name.endswith(_TWINS) and _places(p.read_text())]


def _places(source: str) -> int:
    planter = _Planter(-1)
    planter.visit(ast.parse(source))
    return planter.count


def _fault(modules: list[Path], rng: random.Random) -> Fault:
    """A random place; every line of code is as likely as any other."""
    sizes = [_places(path.read_text()) for path in modules]
    path = rng.choices(modules, sizes)[0]
    tree = ast.parse(path.read_text())
    planter = _Planter(rng.randrange(_places(path.read_text())))
    changed = ast.fix_missing_locations(planter.visit(copy.deepcopy(tree)))
    assert planter.found is not None
    return Fault(path, *planter.found, ast.unparse(changed))


def _judged(tree: Path, fault: Fault, shown: bool) -> str:
    outcome = "no tests"
    for ring, tests in enumerate(_rings(fault.path)):
        outcome = _outcome(tree, fault, tests, shown)
        if outcome == "found":
            return outcome if ring == 0 else "found later"
    return outcome


def _rings(path: Path) -> Iterator[list[str]]:
    """Tests that name a module; then those of modules that use it, or of the nearest with any."""
    known, seen = set[str](), {str(path.relative_to(_ROOT))}
    near = seen
    for ring in range(_FARTHEST):
        tests = {t for user in near for t in _naming(_module(_ROOT / user), "tests")} - known
        if tests:
            yield sorted(tests)
        if known and ring:
            return
        known |= tests
        near = {u for user in near for u in _naming(_module(_ROOT / user), "perfcap")} - seen
        seen |= near


def _module(path: Path) -> str:
    return ".".join(path.relative_to(_ROOT).with_suffix("").parts).removesuffix(".__init__")


def _naming(module: str, folder: str) -> Iterator[str]:
    """Files that import a module, or one of its names from its package."""
    package, _, name = module.rpartition(".")
    for path in sorted((_ROOT / folder).rglob("*.py" if folder == "perfcap" else "test_*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and (
                node.module == module
                or (node.module == package and name in {alias.name for alias in node.names})
            ):
                yield str(path.relative_to(_ROOT))
                break


def _copy(place: Path) -> Path:
    """The tree, without what is built, beside the recordings that some tests use."""
    skip = shutil.ignore_patterns(".git", ".venv", "build", "dist", "*.egg-info", "__pycache__")
    shutil.copytree(_ROOT, place, ignore=skip)
    if (_ROOT.parent / "shared").is_dir():
        (place.parent / "shared").symlink_to((_ROOT.parent / "shared").resolve())
    return place


def _outcome(tree: Path, fault: Fault, tests: list[str], shown: bool) -> str:
    """``found``, ``survived`` where the tests pass, ``unfinished`` where they take too long."""
    planted = tree / fault.path.relative_to(_ROOT)
    genuine = planted.read_text()
    planted.write_text(fault.source)
    call = [sys.executable, "-m", "pytest", "-q", "-x", "-n0", "-p", "no:cacheprovider", *tests]
    try:
        ended = subprocess.run(
            call,
            cwd=tree,
            env={**os.environ, "PYTHONPATH": str(tree)},
            capture_output=not shown,
            timeout=_LONGEST,
            check=False,
        )
        return "survived" if ended.returncode == 0 else "found"
    except subprocess.TimeoutExpired:
        return "unfinished"
    finally:
        planted.write_text(genuine)


def _say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())

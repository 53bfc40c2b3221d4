"""SECURITY.md promises nothing without a test of it."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LEFT_OUT = ("mark.skip", "mark.slow", "mark.long")
ROWS = re.findall(
    r"^\| (.+?) \| (`tests/.+?) \|$", (ROOT / "SECURITY.md").read_text(), re.MULTILINE
)


def test_every_row_is_looked_at() -> None:
    rows = [line for line in (ROOT / "SECURITY.md").read_text().splitlines() if line[:1] == "|"]
    assert len(ROWS) == len(rows) - 2 > 5  # a head and a rule


@pytest.mark.parametrize(("promise", "tests"), ROWS)
def test_the_tests_of_a_promise_are_there(promise: str, tests: str) -> None:
    for name in re.findall(r"`([^`]+)`", tests):
        file, _, function = name.partition("::")
        tree = ast.parse((ROOT / file).read_text())
        known = {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}
        assert function in known, f"{promise}: no {name}"
        marks = [ast.unparse(mark) for mark in known[function].decorator_list]
        assert not any(word in mark for mark in marks for word in LEFT_OUT), name

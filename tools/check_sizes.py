"""Print Python files that have grown too long; exit with 1 if one is in the package or in tests."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

LIMIT = 350  # lines: more than that has more than one job
ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("perfcap", "tests", "experiments", "tools")
STRICT = ("perfcap", "tests")


def long_files(root: Path, limit: int = LIMIT) -> Iterator[tuple[Path, int]]:
    """Files of more than ``limit`` lines and how many they have, longest first."""
    sizes = [
        (path.relative_to(root), len(path.read_text(encoding="utf-8").splitlines()))
        for folder in FOLDERS
        for path in (root / folder).rglob("*.py")
    ]
    yield from sorted((s for s in sizes if s[1] > limit), key=lambda s: -s[1])


def main() -> int:
    """Run the check; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--limit", type=int, default=LIMIT, help="lines a file may have")
    found = list(long_files(ROOT, parser.parse_args().limit))
    for path, lines in found:
        print(f"{path}: {lines} lines")
    return int(any(path.parts[0] in STRICT for path, _ in found))


if __name__ == "__main__":
    raise SystemExit(main())

"""Fail if axe-core finds something serious in pages, in every browser that is installed.

npm pack axe-core && tar xzf axe-core-*.tgz
python tools/check_access.py --axe package/axe.min.js dance/report.html takes/index.html

axe-core is no dependency of perfcap. Chromium looks at pages in light and in dark colours, wide and
as on a phone. Serious are the impacts ``serious`` and ``critical``; what axe-core leaves to a
person (``incomplete``, such as text over a picture) is counted only.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

sys.path.append(str(Path(__file__).resolve().parents[1] / "tests"))
from chromium import browser, find_chromium
from firefox import find_firefox, firefox

SERIOUS = ("serious", "critical")
RUN = """axe.run(document, {resultTypes: ["violations", "incomplete"]}).then((found) => ({
  violations: found.violations.map((one) => ({id: one.id, impact: one.impact, help: one.help,
    places: one.nodes.map((node) => [node.target.join(" "), node.failureSummary])})),
  incomplete: found.incomplete.length, passes: found.passes.length}))"""
READY = """new Promise((done) => { const look = () => document.readyState === "complete" &&
  (document.documentElement.dataset.state ?? "ready") === "ready" ? done(true)
  : setTimeout(look, 50); look(); })"""
# what is folded is looked at as well; transitions of colours end
UNFOLDED = """new Promise((done) => { for (const one of document.querySelectorAll("details"))
  one.open = true; setTimeout(() => done(true), 500); })"""


class Seen(Protocol):
    """A page of a browser."""

    def evaluate(self, expression: str) -> Any:
        """The value of an expression, promises awaited."""


@dataclass(frozen=True)
class Look:
    """One way to look at a page: its name, and what opens a file so."""

    name: str
    opened: Callable[[Path, Path], AbstractContextManager[Seen]]


def looks() -> Iterator[Look]:
    """Browsers that are installed; Chromium with both schemes of colours and both sizes."""
    if find_chromium() is not None:
        for scheme in ("light", "dark"):
            for width, height in ((1440, 900), (390, 844)):
                yield Look(f"Chromium {scheme} {width}", _in_chromium(scheme, width, height))
    if find_firefox() is not None:
        yield Look("Firefox", _in_firefox)


def _in_chromium(
    scheme: str, width: int, height: int
) -> Callable[[Path, Path], AbstractContextManager[Seen]]:
    @contextmanager
    def opened(profile: Path, path: Path) -> Iterator[Seen]:
        with browser(profile) as page:
            page.media(prefers_color_scheme=scheme)
            page.resize(width, height)
            page.send("Page.navigate", url=path.resolve().as_uri())
            yield page

    return opened


@contextmanager
def _in_firefox(profile: Path, path: Path) -> Iterator[Seen]:
    with firefox(profile) as page:
        page.go(path)
        yield page


def findings(look: Look, path: Path, axe: str) -> dict[str, Any]:
    """What axe-core says of a page: violations, and counts of the rest."""
    with (
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder,
        look.opened(Path(folder) / "profile", path) as page,
    ):
        page.evaluate(READY)
        page.evaluate(UNFOLDED)
        page.evaluate(f"(() => {{ {axe}\n; return true; }})()")
        found: dict[str, Any] = page.evaluate(RUN)
    return found


def main() -> None:
    """Print what is found, and fail if anything is serious."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--axe", type=Path, required=True, help="axe.min.js of the npm package")
    parser.add_argument("pages", type=Path, nargs="+")
    wanted = parser.parse_args()
    axe, serious, every = wanted.axe.read_text(encoding="utf-8"), 0, list(looks())
    if not every:
        raise SystemExit("neither Chromium nor Firefox is installed")
    for path in wanted.pages:
        for look in every:
            found = findings(look, path, axe)
            bad = [one for one in found["violations"] if one["impact"] in SERIOUS]
            serious += len(bad)
            print(
                f"{path.name} in {look.name}: {len(bad)} serious, "
                f"{len(found['violations']) - len(bad)} lesser, {found['incomplete']} for a person"
            )
            for one in found["violations"]:
                print(f"  {one['impact']} {one['id']}: {one['help']}")
                for place, why in one["places"][:4]:
                    print(f"    {place}: {json.dumps(why)}")
    raise SystemExit(1 if serious else 0)


if __name__ == "__main__":
    main()

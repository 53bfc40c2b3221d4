"""Fail if a page of a built site would ask the network for anything when it is opened.

python tools/check_site.py build/docs

Links that a reader may follow are fine; scripts, styles, fonts, pictures and frames from elsewhere
are not.
"""

from __future__ import annotations

import argparse
import re
from html.parser import HTMLParser
from pathlib import Path

REMOTE = re.compile(r"(?:https?|wss?|ftp)?:?//", re.IGNORECASE)
# loads from elsewhere in a style; namespaces of inline pictures are names, not addresses
STYLE = re.compile(r"(?:url\(|@import)\s*['\"]?((?:https?:)?//[^'\")\s]+)", re.IGNORECASE)
CALL = r"(?:fetch|import|importScripts|WebSocket)"
SCRIPT = re.compile(CALL + r"\(\s*['\"]((?:https?:|wss?:)?//[^'\"]+)")


class Loads(HTMLParser):
    """Collects what a page loads by itself."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note addresses of a tag, but those of links to follow."""
        values = {name: value or "" for name, value in attrs}
        names = ["src", "srcset", "data", "poster"]
        if tag == "link" and values.get("rel") not in ("canonical", "next", "prev", "license"):
            names.append("href")
        self.found += [values[name] for name in names if REMOTE.match(values.get(name, ""))]
        self.found += STYLE.findall(values.get("style", ""))


def loads(path: Path) -> list[str]:
    """Addresses that a file of the site loads from elsewhere."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".css":
        return STYLE.findall(text)
    if path.suffix == ".js":
        return SCRIPT.findall(text)
    page = Loads()
    page.feed(text)
    return [*page.found, *STYLE.findall(text), *SCRIPT.findall(text)]


def main() -> None:
    """Print what is loaded, and fail if anything is."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("site", type=Path)
    site = parser.parse_args().site
    files = [path for path in sorted(site.rglob("*")) if path.suffix in (".html", ".css", ".js")]
    if not any(path.name == "index.html" for path in files):
        raise SystemExit(f"{site}: no index.html; build the site first")
    wrong = [f"{path}: loads {address}" for path in files for address in loads(path)]
    if wrong:
        raise SystemExit("\n".join(wrong))


if __name__ == "__main__":
    main()

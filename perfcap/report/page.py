"""One HTML file out of a template, a style sheet, the viewer's modules, and data."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

from perfcap.report.bundle import bundle
from perfcap.report.markup import Markup, element

_HOLE = re.compile(r"\{\{ (\w+) \}\}")
_PART = re.compile(r"\{\{> ([\w-]+\.html) \}\}\n")
_STYLES = ("base.css", "layout.css", "controls.css", "sections.css")
# what JSON inside a script element may not contain, so that the element cannot end early
_UNSAFE = re.compile("[<>&\u2028\u2029]")


@dataclass(frozen=True)
class Layout:
    """A kind of page: its template and the module that runs it."""

    template: str
    entry: str


REPORT_PAGE = Layout("template.html", "main.js")
COMPARISON = Layout("compare.html", "compare.js")


def assemble(
    name: str,
    sections: Mapping[str, Markup],
    data: Mapping[str, Any],
    blobs: Mapping[str, str],
    layout: Layout = REPORT_PAGE,
) -> str:
    """The page.

    Its policy lets run the one script and the one style sheet of the page, and nothing connect to
    anywhere.

    Args:
        name: of the result, plain text.
        sections: HTML for the template's places.
        data: for the viewer, plain values.
        blobs: for the viewer, base64 by name.
        layout: which page.
    """
    style = "\n".join(_asset(name) for name in _STYLES)
    script = bundle(_modules(), layout.entry)
    content: dict[str, str] = {
        "title": element("title", f"{name} · perfcap"),
        "heading": element("h1", name),
        "policy": _policy(style, script),
        "style": Markup(f"<style>{style}</style>"),
        "script": Markup(f'<script type="module">{script}</script>'),
        "data": Markup("\n".join(_scripts(data, blobs))),
        **sections,
    }
    template = _PART.sub(lambda match: _asset(match[1]), _asset(layout.template))
    return _HOLE.sub(lambda match: _fill(match[1], content), template)


def _fill(name: str, content: Mapping[str, str]) -> str:
    part = content[name]
    if not isinstance(part, Markup):
        raise TypeError(f"{name} is plain text; the page takes markup only")
    return part


def _policy(style: str, script: str) -> Markup:
    policy = (
        "default-src 'none'; "
        f"script-src {_hash(script)}; style-src {_hash(style)}; "
        "img-src data: blob:; media-src blob:; base-uri 'none'; form-action 'none'"
    )
    return element("meta", http_equiv="Content-Security-Policy", content=policy)


def _hash(text: str) -> str:
    digest = hashlib.sha256(text.encode("utf-8")).digest()
    return f"'sha256-{base64.b64encode(digest).decode('ascii')}'"


def _scripts(data: Mapping[str, Any], blobs: Mapping[str, str]) -> list[str]:
    """Blocks of data: scripts of a type that no browser runs."""
    text = json.dumps(data, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    escaped = _UNSAFE.sub(lambda match: f"\\u{ord(match[0]):04x}", text)
    blocks = [f'<script type="application/json" id="data">{escaped}</script>']
    for name, blob in blobs.items():
        if not re.fullmatch(r"[A-Za-z0-9+/=]*", blob):
            raise ValueError(f"{name} is not base64")
        blocks.append(f'<script type="text/plain" id="blob-{name}">{blob}</script>')
    return blocks


def _modules() -> dict[str, str]:
    scripts = [each for each in files("perfcap.report").joinpath("assets").iterdir()]
    return {s.name: s.read_text(encoding="utf-8") for s in scripts if s.name.endswith(".js")}


def _asset(name: str) -> str:
    return files("perfcap.report").joinpath("assets", name).read_text(encoding="utf-8")

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

from perfcap.report.markup import Markup, element

# --- ES modules put together into one script, so that a page needs no file beside it --------------
#
# Only what the viewer's modules use is understood: ``import { a, b } from "./other.js"`` on one
# line, and ``export`` in front of a ``function``, ``class`` or ``const``. Every module keeps a
# scope of its own.

_IMPORT = re.compile(r'^import \{ ([\w, ]+) \} from "\./([\w-]+\.js)";$', re.MULTILINE)
_EXPORT = re.compile(r"^export (?=(?:async )?(?:function|class|const) (\w+))", re.MULTILINE)
_LEFT = re.compile(r"^\s*(?:import|export)\b", re.MULTILINE)


def bundle(modules: Mapping[str, str], entry: str) -> str:
    """One script that runs the module ``entry`` and those it imports, each once.

    Args:
        modules: source text by file name.
        entry: name of the module to run.

    Raises:
        ValueError: a module or a name that does not exist, modules that import each other in a
            circle, or another form of import or export.
    """
    order: list[str] = []
    _visit(entry, modules, order, ())
    exports = {name: _exported(modules[name]) for name in order}
    parts = [_wrapped(name, modules[name], exports) for name in order]
    return '"use strict";\n' + "\n".join(parts)


def _visit(name: str, modules: Mapping[str, str], order: list[str], path: tuple[str, ...]) -> None:
    """Append a module after those it needs."""
    if name in path:
        raise ValueError(f"modules import each other: {' -> '.join((*path, name))}")
    if name in order:
        return
    if name not in modules:
        raise ValueError(f"{path[-1] if path else 'page'} imports {name}, which does not exist")
    for _, other in _IMPORT.findall(modules[name]):
        _visit(other, modules, order, (*path, name))
    order.append(name)


def _exported(source: str) -> list[str]:
    return _EXPORT.findall(source)


def _wrapped(name: str, source: str, exports: Mapping[str, list[str]]) -> str:
    """A module as a function that returns what it exports."""

    def bind(match: re.Match[str]) -> str:
        names, other = match.groups()
        missing = set(re.findall(r"\w+", names)) - set(exports[other])
        if missing:
            raise ValueError(f"{name} imports {', '.join(sorted(missing))}, which {other} lacks")
        return f"const {{ {names} }} = {_variable(other)};"

    body = _EXPORT.sub("", _IMPORT.sub(bind, source))
    left = _LEFT.search(body)
    if left:
        raise ValueError(f"{name}: cannot bundle {body[left.start() :].splitlines()[0]!r}")
    given = ", ".join(exports[name])
    return f"const {_variable(name)} = (() => {{\n{body}\nreturn {{ {given} }};\n}})();"


def _variable(name: str) -> str:
    return "module_" + re.sub(r"\W", "_", name.removesuffix(".js"))


# --- One HTML file out of a template, a style sheet, the viewer's modules, and data ---------------

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

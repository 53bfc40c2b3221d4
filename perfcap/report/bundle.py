"""ES modules put together into one script, so that a page needs no file beside it.

Only what the viewer's modules use is understood: ``import { a, b } from "./other.js"`` on one
line, and ``export`` in front of a ``function``, ``class`` or ``const``. Every module keeps a scope
of its own.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

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

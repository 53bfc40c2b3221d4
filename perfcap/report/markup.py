"""HTML that cannot be broken out of: text is escaped unless it is already markup."""

from __future__ import annotations

import html
from collections.abc import Iterable


class Markup(str):
    """Text that is HTML already; everything else that is put into a page is escaped."""

    __slots__ = ()


Content = str | int | float | None | Iterable["Content"]

_VOID = frozenset({"br", "col", "hr", "img", "input", "link", "meta"})


def element(tag: str, *content: Content, **attributes: str | int | float | bool | None) -> Markup:
    """An HTML element.

    Args:
        tag: its name.
        content: text, markup, or nested sequences of them; None is nothing.
        attributes: ``class_`` and ``data_frame`` become ``class`` and ``data-frame``; True stands
            for an attribute without a value, None and False leave it out.

    Example:
        >>> element("p", "a < b", class_="note")
        '<p class="note">a &lt; b</p>'
    """
    opening = "".join(_attribute(name, value) for name, value in attributes.items())
    if tag in _VOID:
        return Markup(f"<{tag}{opening}>")
    return Markup(f"<{tag}{opening}>{join(content)}</{tag}>")


def join(content: Content) -> Markup:
    """Content one after the other, escaped where it is not markup."""
    if content is None:
        return Markup("")
    if isinstance(content, Markup):
        return content
    if isinstance(content, str | int | float):
        return Markup(html.escape(str(content)))
    return Markup("".join(join(part) for part in content))


def _attribute(name: str, value: str | int | float | bool | None) -> str:
    name = name.rstrip("_").replace("_", "-")
    if value is None or value is False:
        return ""
    return f" {name}" if value is True else f' {name}="{html.escape(str(value))}"'

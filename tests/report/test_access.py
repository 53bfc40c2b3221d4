"""Everybody can use the pages: names of controls, and colours that can be told apart."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from itertools import pairwise

import pytest
from viewer import ASSETS

from perfcap.report.markup import Markup
from perfcap.report.page import COMPARISON, REPORT_PAGE, Layout, assemble

_CONTROLS = {"button", "input", "select", "textarea"}
_VOID = {"input", "meta", "link", "br", "use", "path"}
# text on a background, as the style sheets put them together
_PAIRS = [
    *((ink, ground) for ink in ("ink", "soft") for ground in ("page", "card")),
    *(("ink", "sunk"), ("accent", "card"), ("accent", "page"), ("on-accent", "accent")),
    *((name, "card") for name in ("good", "bad", "odd")),
]


class Controls(HTMLParser):
    """Controls of a page, each with the words that it is called by."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.names: list[list[str]] = []
        self.inside: dict[str, list[list[str]]] = {"label": [], "button": []}
        self.ids: list[str] = []
        self.pointed: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = {name: value or "" for name, value in attrs}
        self.ids += [found["id"]] if "id" in found else []
        for name in ("aria-labelledby", "aria-describedby", "for"):
            self.pointed += found.get(name, "").split()
        if tag in self.inside:
            self.inside[tag] = []
        if tag in _CONTROLS:
            self.names.append([found["aria-label"]] if found.get("aria-label") else [])
            for around in ("label", "button"):
                if around in (*self.open, tag):
                    self.inside[around].append(self.names[-1])
        if tag not in _VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Pictures: without a name."""

    def handle_endtag(self, tag: str) -> None:
        if tag == "label" and self.text:
            for names in self.inside["label"]:
                names.append(self.text)
        while self.open and self.open.pop() != tag:
            pass
        self.text = "" if tag == "label" else self.text

    text = ""

    def handle_data(self, data: str) -> None:
        words = data.strip()
        if words and "label" in self.open and "select" not in self.open:
            self.text += words
        elif words and "button" in self.open:
            for names in self.inside["button"]:
                names.append(words)


def html(layout: Layout) -> str:
    names = set(re.findall(r"\{\{ (\w+) \}\}", (ASSETS / layout.template).read_text()))
    parts = {name: Markup("") for name in names}
    for letter in "ab":  # headings that this part of the page brings along
        parts[f"about_{letter}"] = Markup(f'<h2 id="{letter}-title">{letter}</h2>')
    return assemble("x", parts, {}, {}, layout)


@pytest.mark.parametrize("layout", [REPORT_PAGE, COMPARISON], ids=lambda x: x.entry)
def test_every_control_has_a_name(layout: Layout) -> None:
    page = html(layout)
    found = Controls()
    found.feed(page)
    assert len(found.names) >= 20 and all(found.names)
    assert set(found.pointed) <= set(found.ids)
    assert len(found.ids) == len(set(found.ids))
    assert '<html lang="en"' in page
    levels = [int(level) for level in re.findall(r"<h(\d)", page)]
    assert all(after <= before + 1 for before, after in pairwise(levels))


def test_a_control_without_a_name_is_noticed() -> None:
    found = Controls()
    found.feed("<label><input></label><button><svg></svg></button><select></select>")
    assert found.names == [[], [], []]
    found = Controls()
    found.feed('<label>A <input></label><button>B</button><input aria-label="C">')
    assert found.names == [["A"], ["B"], ["C"]]


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_texts_stand_out_from_what_is_behind_them(theme: str) -> None:
    colors = palette(theme)
    found = {pair: contrast(colors[pair[0]], colors[pair[1]]) for pair in _PAIRS}
    assert min(found.values()) >= 4.5, found  # WCAG 2, level AA


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_curves_stand_out_from_the_chart(theme: str) -> None:
    colors = palette(theme)
    lines = [name for name in colors if name.startswith("line-")]
    assert len(lines) == 6
    assert min(contrast(colors[name], colors["sunk"]) for name in lines) >= 3.0


def palette(theme: str) -> dict[str, str]:
    """Colours of a theme; those for the system's dark mode are the dark ones."""
    css = (ASSETS / "base.css").read_text()
    blocks = re.findall(r":root([^{]*)\{([^{}]*)\}", css)
    dark = [body for selector, body in blocks if "dark" in selector or "not" in selector]
    assert len(dark) == 2 and " ".join(dark[0].split()) == " ".join(dark[1].split())
    body = dark[0] if theme == "dark" else blocks[0][1]
    return dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6})", body))


def contrast(a: str, b: str) -> float:
    """Of two sRGB colours, 1 to 21 (WCAG 2)."""
    high, low = sorted((_luminance(a), _luminance(b)), reverse=True)
    return (high + 0.05) / (low + 0.05)


def _luminance(color: str) -> float:
    channels = [int(color[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def test_contrast_of_known_colours() -> None:
    assert contrast("#000000", "#ffffff") == pytest.approx(21)
    assert contrast("#777777", "#ffffff") == pytest.approx(4.48, abs=0.01)

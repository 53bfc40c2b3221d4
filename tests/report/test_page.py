"""The page: closed to the outside, and to what names and texts may hold."""

import base64
import hashlib
import json
import re

import pytest

from perfcap.report.markup import Markup, element
from perfcap.report.page import assemble

SECTIONS = ("summary", "status", "warnings", "metrics", "stages", "windows", "configuration")
NASTY = "</script><script>alert(1)</script><!-- \u2028 & 'x'"


def page(name: str = "x", data: object = None, **blobs: str) -> str:
    sections = {key: element("p", key) for key in (*SECTIONS, "files")}
    return assemble(name, sections, {"value": data}, blobs)


def test_one_script_runs_and_its_hash_is_in_the_policy() -> None:
    html = page()
    policy = re.search(r'http-equiv="Content-Security-Policy" content="([^"]*)"', html)
    assert policy is not None
    allowed = policy[1].replace("&#x27;", "'")
    assert "default-src 'none'" in allowed and "unsafe" not in allowed and "http" not in allowed
    assert "connect-src" not in allowed  # nothing: the default
    for tag, source in (("script", "script-src"), ("style", "style-src")):
        (content,) = re.findall(rf'<{tag}(?: type="module")?>(.*?)</{tag}>', html, re.DOTALL)
        digest = base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()
        assert f"{source} 'sha256-{digest}'" in allowed
    assert html.index("Content-Security-Policy") < html.index("<style>") < html.index("<script")


def test_nothing_is_asked_from_elsewhere() -> None:
    html = page()
    addresses = re.findall(r"""(?:src|href|action)\s*=\s*["']?([^"'\s>]+)""", html)
    made = ("#", "data:", "URL.createObjectURL(")  # of what the page holds
    outside = [a for a in addresses if not a.startswith(made) and "this" not in a]
    assert outside == []
    assert "//cdn" not in html and "@import" not in html and "url(" not in html
    assert re.findall(r"https?://[^\s\"']+", html) == ["http://www.w3.org/2000/svg"]  # a name


def test_no_handler_or_style_is_inline() -> None:
    html = page()
    assert not re.search(r"<[^>]+\s(?:on\w+|style)=", html.split("<script", 1)[0])


def test_texts_stay_texts() -> None:
    html = page(NASTY, {NASTY: [NASTY]})
    assert "alert(1)</script>" not in html
    assert html.count("<script") == 2  # the data and the viewer
    data = re.search(r'id="data">(.*?)</script>', html, re.DOTALL)
    assert data is not None and json.loads(data[1]) == {"value": {NASTY: [NASTY]}}


def test_what_is_not_meant_for_the_page() -> None:
    with pytest.raises(ValueError, match="x is not base64"):
        page(x="<b>")
    with pytest.raises(ValueError, match="JSON"):
        page(data=float("nan"))
    sections = {key: Markup("") for key in (*SECTIONS, "files")} | {"files": "plain"}
    with pytest.raises(TypeError, match="files is plain text"):
        assemble("x", sections, {}, {})  # type: ignore[arg-type]

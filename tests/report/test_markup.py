"""Nothing that comes from outside becomes HTML."""

from perfcap.report.markup import Markup, element, join

NASTY = """</p><script>alert("1")</script> & 'ö'"""


def test_text_is_escaped_and_markup_is_not() -> None:
    found = element("p", NASTY, element("b", NASTY), [NASTY, 3, None])
    assert "<script" not in found and found.count("&lt;script&gt;") == 3
    assert found.startswith("<p>") and found.count("<b>") == 1 and "ö" in found
    assert isinstance(found, Markup) and join(found) == found


def test_attributes() -> None:
    found = element("a", href=f'"{NASTY}', class_="x", data_frame=3, hidden=True, title=None)
    assert "<script" not in found
    assert found.startswith('<a href="&quot;&lt;/p&gt;') and found.endswith("></a>")
    assert ' class="x" data-frame="3" hidden>' in found
    assert element("br") == "<br>"

"""A result below the cell of a notebook."""

import html
import re
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from takes import make_take

import perfcap
from perfcap.errors import InputError
from perfcap.pipeline import Stage


@pytest.fixture
def notebook(monkeypatch: pytest.MonkeyPatch) -> None:
    display = SimpleNamespace(HTML=lambda text: text)
    monkeypatch.setitem(
        sys.modules, "IPython", SimpleNamespace(display=display, get_ipython=lambda: None)
    )
    monkeypatch.setitem(sys.modules, "IPython.display", display)


def test_a_performance_and_its_folder(notebook: None, tmp_path: Path) -> None:
    take = make_take(8)
    parts = take.actor, take.cameras, take.detections, take.rate
    found = perfcap.capture(*parts, until=Stage.INITIALIZE)
    shown = perfcap.show(found, height=300)
    assert shown.startswith("<iframe") and "height: 300px" in shown
    found.save(tmp_path)
    before = sorted(path.name for path in tmp_path.iterdir())
    folder = perfcap.show(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == before
    for each in (shown, folder):
        page = html.unescape(each.split('srcdoc="')[1])
        assert "<canvas" in page and re.search(r'"frames": ?8\b', page) and "</html>" in page


def test_what_cannot_be_shown(notebook: None, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nowhere"):
        perfcap.show(tmp_path / "nowhere")


def test_where_there_is_no_notebook(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "IPython.display", None)
    with pytest.raises(InputError, match="perfcap view opens a folder"):
        perfcap.show(tmp_path)

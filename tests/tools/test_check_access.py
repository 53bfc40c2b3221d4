"""Pages are looked at in every browser that is installed, and what is serious fails."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[2] / "tools"))
import check_access

pytestmark = pytest.mark.slow
# what axe-core would answer of a page with a button without a name
AXE = """window.axe = {run: () => Promise.resolve({incomplete: [], passes: [1],
  violations: [...document.querySelectorAll("button")].filter((b) => !b.innerText).map((b) =>
    ({id: "button-name", impact: "critical", help: "names",
      nodes: [{target: ["button"], failureSummary: document.URL}]}))})}"""


@pytest.mark.parametrize("name", ["Chromium light 390", "Chromium dark 1440", "Firefox"])
def test_what_is_serious_is_found(name: str, tmp_path: Path) -> None:
    look = next((look for look in check_access.looks() if look.name == name), None)
    if look is None:
        pytest.skip(f"needs {name.split()[0]}")
    page = tmp_path / "page.html"
    for text, count in (("", 1), ("play", 0)):
        page.write_text(f"<details><button>{text}</button></details>")
        found = check_access.findings(look, page, AXE)
        assert len(found["violations"]) == count
    assert found["passes"] == 1


def test_the_exit_code_says_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    every = list(check_access.looks())
    if not every:
        pytest.skip("needs Chromium or Firefox")
    monkeypatch.setattr(check_access, "looks", lambda: iter(every[-1:]))
    axe, page = tmp_path / "axe.js", tmp_path / "page.html"
    axe.write_text(AXE)
    page.write_text("<button></button>")
    monkeypatch.setattr(sys, "argv", ["check_access.py", "--axe", str(axe), str(page)])
    with pytest.raises(SystemExit, match="1"):
        check_access.main()
    assert "1 serious" in capsys.readouterr().out

"""What docs/learning.md says about learning is so."""

import re
from pathlib import Path

import pytest
import torch

from perfcap.solve import Detached, Implicit, Unrolled

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "learning.md").read_text(encoding="utf-8")


def block(text: str, marker: str) -> str:
    """The fenced block after an HTML comment."""
    found = re.search(rf"<!-- {marker} -->\n```\w+\n(.*?)```", text, re.DOTALL)
    assert found, f"no block after <!-- {marker} -->"
    return found.group(1)


@pytest.mark.long
def test_layer_example_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code = block(PAGE, "learning")
    assert len(code.splitlines()) <= 15
    monkeypatch.chdir(tmp_path)
    state = torch.random.get_rng_state()
    exec(compile(code, "learning.md", "exec"), {})
    assert capsys.readouterr().out == "(2, 50, 16, 3) True\n"
    assert not list(tmp_path.iterdir())
    assert torch.equal(torch.random.get_rng_state(), state)


def test_every_adjoint_is_named() -> None:
    for adjoint in (Detached, Implicit, Unrolled):
        assert f"`{adjoint.__name__}(" in PAGE


def test_links_lead_somewhere() -> None:
    for target in re.findall(r"\]\(([^)#]+)", PAGE):
        assert target.startswith("http") or (ROOT / "docs" / target).exists(), target

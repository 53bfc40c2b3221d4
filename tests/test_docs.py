"""What the pages of docs/ say is so, as far as a machine can tell."""

import re
import shlex
from importlib import import_module
from pathlib import Path

import pytest
import torch
import tyro

import perfcap
from perfcap.cli import Command

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
LARGEST = 60_000  # bytes of a picture of the method


def text(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def name_of(page: Path) -> str:
    return page.relative_to(DOCS).as_posix()


def commands() -> list[str]:
    """Every ``perfcap ...`` line of a shell block or of an indented one, once."""
    shell = (block for page in PAGES for block in re.findall(r"```sh\n(.*?)```", text(page), re.S))
    lines = {line for block in shell for line in block.split("\n")}
    lines |= {
        line for page in PAGES for line in re.findall(r"^ {4}(perfcap .*)$", text(page), re.M)
    }
    return sorted(line for line in lines if line.startswith("perfcap ") and " ... " not in line)


def blocks() -> list[object]:
    """Python that a page says can be run."""
    marked = re.compile(r"<!-- run -->\n```python\n(.*?)```", re.DOTALL)
    return [
        pytest.param(code, id=name_of(page))
        for page in PAGES
        for code in marked.findall(text(page))
    ]


@pytest.mark.parametrize("line", commands())
def test_commands_parse(line: str) -> None:
    command = tyro.cli(Command, prog="perfcap", args=shlex.split(line, comments=True)[1:])
    assert command is not None


def test_files_of_equations_are_there() -> None:
    page = text(DOCS / "method.md")
    files = set(re.findall(r"`((?:[a-z_]+/)+[a-z_]+\.py)`", page))
    assert len(files) > 30
    assert {file for file in files if not (ROOT / "perfcap" / file).is_file()} <= {
        file for file in files if (ROOT / file).is_file()
    }


@pytest.mark.long
@pytest.mark.parametrize("code", blocks())
def test_code_runs(code: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    torch.manual_seed(0)
    exec(compile(code, "docs", "exec"), {})
    assert not list(tmp_path.iterdir())


@pytest.mark.long
def test_the_start_goes_on_to_the_surface(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page = text(DOCS / "start.md")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for marker, printed in (("run", "torch.Size([120, 16, 3])"), ("surface", "torch.Size([12, ")):
        found = re.search(rf"<!-- {marker} -->\n```python\n(.*?)```", page, re.DOTALL)
        assert found
        exec(compile(found[1], "start.md", "exec"), names)
        assert capsys.readouterr().out.startswith(printed)


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)", text(page)):
        assert target.startswith("http") or (page.parent / target).exists(), target


def test_every_page_is_in_the_contents() -> None:
    listed = {line for page in PAGES for line in text(page).split("\n") if line}
    for page in PAGES:
        name = page.relative_to(DOCS).with_suffix("").as_posix()
        assert name == "index" or name in listed or page.stem in listed, name


def test_public_names_are_listed() -> None:
    listed = set(re.findall(r"`(\w+)`", text(DOCS / "api" / "index.md")))
    assert {name for name in perfcap.__all__ if name != "__version__"} <= listed


def test_public_folders_have_a_page() -> None:
    for folder in sorted((ROOT / "perfcap").iterdir()):
        if not (folder / "__init__.py").exists():
            continue
        if getattr(import_module(f"perfcap.{folder.name}"), "__all__", ()):
            assert (DOCS / "api" / f"{folder.name}.md").exists(), folder.name


def test_pictures_say_whose_they_are() -> None:
    named = set(re.findall(r"`([\w/.]+)`", text(DOCS / "credits.md")))
    for picture in (DOCS / "images").iterdir():
        assert (picture.name if picture.is_file() else f"{picture.name}/") in named, picture


def test_pictures_are_small() -> None:
    pictures = sorted((DOCS / "images" / "method").iterdir())
    assert len(pictures) == 7
    assert max(picture.stat().st_size for picture in pictures) < LARGEST
    shown = set(re.findall(r"images/method/([\w.]+)", text(DOCS / "method.md")))
    assert shown == {picture.name for picture in pictures}

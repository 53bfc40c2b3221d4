"""Lists of clips: what a line says, and what is refused."""

from pathlib import Path

import pytest

from perfcap.errors import InputError
from perfcap.io.clip_list import ListedClip, read_clip_list

COLUMNS, PATHS, EITHER = ("videos", "cameras", "actor", "height"), ("videos", "cameras"), ("actor",)


def read(folder: Path, text: str) -> tuple[ListedClip, ...]:
    path = folder / "clips.csv"
    path.write_text(text)
    return read_clip_list(path, COLUMNS, PATHS, EITHER, ("index.html",))


def test_cells_are_values(tmp_path: Path) -> None:
    (tmp_path / "hero.glb").write_text("")
    text = (
        '\ufeffname,videos,Cameras,actor,height\n"a, b",x.mp4; y z.mp4,c.toml,hero.glb;sam,1.8\n\n'
    )
    with pytest.raises(InputError, match="'Cameras' is no column; did you mean cameras"):
        read(tmp_path, text)
    (clip,) = read(tmp_path, text.replace("Cameras", "cameras").replace("a, b", "a b"))
    assert clip.name == "a b"
    assert clip.values == {
        "videos": (f"{tmp_path}/x.mp4", f"{tmp_path}/y z.mp4"),
        "cameras": (f"{tmp_path}/c.toml",),
        "actor": (f"{tmp_path}/hero.glb", "sam"),
        "height": ("1.8",),
    }


def test_a_line_that_ends_early_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="line 2 has 1 cells under 2 columns"):
        read(tmp_path, "videos,height\na.mp4\n")


def test_names_are_those_of_videos_and_all_unlike(tmp_path: Path) -> None:
    text = (
        "videos,name\nday 1/dance.mp4,\nday 2/Dance.mp4,\nx?.mp4,\n.mp4,\nindex.html,\nv.mp4,dance"
    )
    names = [clip.name for clip in read(tmp_path, text)]
    assert names == ["dance", "Dance_2", "x_", "mp4", "index", "dance_3"]
    assert [clip.name for clip in read(tmp_path, "videos,name\na.mp4,index.html\n")] == [
        "index.html_2"
    ]


WRONG = {
    "nothing": ("", "is empty"),
    "semicolons": ("name;videos;actor\na;a.mp4;sam\n", "apart by semicolons or tabs"),
    "no header": ("a.mp4\nb.mp4\n", "names no column videos"),
    "no lines": ("videos\n\n", "lists no clips"),
    "no videos": ("videos,height\n,1.8\n", "line 2 has no videos"),
    "more cells": ("videos\na.mp4,b.mp4\n", "line 2 has 2 cells under 1 columns"),
    "twice": ("videos,videos\na,b\n", "names a column twice"),
    "an option": ("videos,height\na.mp4,--out=/\n", "options have columns of their own"),
    "up and away": ("videos,name\na.mp4,../b\n", "cannot be the name of a folder"),
    "hidden": ("videos,name\na.mp4,.b\n", "cannot be the name of a folder"),
    "long": (f"videos,name\na.mp4,{'x' * 300}\n", "cannot be the name of a folder"),
    "quotes": ('videos\n"a"b.mp4\n', "is no CSV"),
    "letters": ("videos\na\x1b[2J.mp4\n", "cannot be printed"),
    "out": ("videos,out\na.mp4,/tmp\n", "'out' is no column"),
}


@pytest.mark.parametrize("fault", WRONG)
def test_wrong_lists(fault: str, tmp_path: Path) -> None:
    text, said = WRONG[fault]
    with pytest.raises(InputError, match=said):
        read(tmp_path, text)


def test_negative_numbers_are_no_options(tmp_path: Path) -> None:
    assert read(tmp_path, "videos,height\na.mp4,-1.5\n")[0].values["height"] == ("-1.5",)

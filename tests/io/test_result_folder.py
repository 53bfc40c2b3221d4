"""One writer at a time, an older result until the new one is complete, nothing outside."""

import errno
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from takes import make_take

from perfcap.actor.motion import Motion
from perfcap.errors import InputError
from perfcap.io.result import read_result, require_one_capture
from perfcap.io.result_folder import (
    OWN,
    WORK,
    finish,
    is_between,
    locked,
    own_file,
    replacing,
    require_places,
)
from perfcap.pipeline.jobs import capture
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.stage import Stage


@pytest.fixture(scope="module")
def performance() -> Performance:
    take = make_take(4)
    parts = (take.actor, take.cameras, take.detections, take.rate)
    return capture(*parts, until=Stage.INITIALIZE)


def moved(performance: Performance) -> Performance:
    """Another capture."""
    from dataclasses import replace

    motion, cameras = performance.motion, performance.cameras
    ahead = cameras.translation - cameras.rotation.sum(-1)  # of all by a metre along each axis
    return replace(
        performance,
        motion=Motion(motion.translation + 1, motion.rotation, motion.angles),
        cameras=replace(cameras, translation=ahead),
    )


def content(folder: Path) -> dict[str, bytes]:
    """All files, also hidden ones, by their place."""
    found = (path for path in folder.rglob("*") if path.is_file() and not path.is_symlink())
    return {str(path.relative_to(folder)): path.read_bytes() for path in found}


# --- locks ----------------------------------------------------------------------------------------


def test_one_writer_at_a_time(performance: Performance, tmp_path: Path) -> None:
    with locked(tmp_path):
        with pytest.raises(InputError, match="another perfcap writes"):
            performance.save(tmp_path)
        assert content(tmp_path) == {}
    performance.save(tmp_path)
    assert sorted(content(tmp_path)) == sorted(
        ["capture.glb", "config.yaml", "motion.bvh", "motion.npz", "run.json"]
    )


@pytest.mark.long
def test_a_lock_ends_with_its_process(tmp_path: Path) -> None:
    code = (
        "import sys, time, pathlib\nfrom perfcap.io.result_folder import locked\n"
        "with locked(pathlib.Path(sys.argv[1])):\n    print('held', flush=True); time.sleep(60)"
    )
    holder = subprocess.Popen(
        [sys.executable, "-c", code, str(tmp_path)], stdout=subprocess.PIPE, text=True
    )
    assert holder.stdout is not None and holder.stdout.readline() == "held\n"
    with pytest.raises(InputError, match="another perfcap"), locked(tmp_path):
        pass
    holder.kill()
    holder.wait()
    holder.stdout.close()
    with locked(tmp_path):
        pass


# --- identity -------------------------------------------------------------------------------------


def test_files_of_two_captures_are_refused(performance: Performance, tmp_path: Path) -> None:
    one, other = tmp_path / "one", tmp_path / "other"
    performance.save(one)
    moved(performance).save(other)
    for name in ("motion.npz", "capture.glb", "run.json"):
        kept = (one / name).read_bytes()
        (one / name).write_bytes((other / name).read_bytes())
        with pytest.raises(InputError, match="different captures"):
            read_result(one)
        if name != "capture.glb":
            with pytest.raises(InputError, match="different captures"):
                require_one_capture(one)
        (one / name).write_bytes(kept)
    require_one_capture(one)
    assert read_result(one).frames == 4


def test_equal_captures_have_equal_files(performance: Performance, tmp_path: Path) -> None:
    performance.save(tmp_path / "one")
    performance.save(tmp_path / "other")
    one, other = content(tmp_path / "one"), content(tmp_path / "other")
    assert one.keys() == other.keys()
    with np.load(tmp_path / "one/motion.npz") as a, np.load(tmp_path / "other/motion.npz") as b:
        assert all(np.array_equal(a[name], b[name]) for name in a.files)
    assert all(one[name] == other[name] for name in one if name != "motion.npz")


# --- older results --------------------------------------------------------------------------------


@pytest.mark.parametrize("number", range(1, 9))
def test_a_full_disk_at_every_write_leaves_the_older_result(
    performance: Performance, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    """Whichever rename, folder or flush is refused, one of the two results is there in full."""
    performance.save(tmp_path)
    older, newer = content(tmp_path), moved(performance)
    calls = [0]

    def refusing(name: str) -> None:
        genuine = getattr(os, name)

        def call(*arguments: object, **options: object) -> object:
            calls[0] += 1
            if calls[0] == number + 1:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            return genuine(*arguments, **options)

        monkeypatch.setattr(os, name, call)

    for name in ("replace", "mkdir"):
        refusing(name)
    with pytest.raises(InputError, match="No space left"):
        newer.save(tmp_path)
    monkeypatch.undo()
    if not is_between(tmp_path):
        assert content(tmp_path) == older
        newer.save(tmp_path)
    else:
        with pytest.raises(InputError, match="put its files into place"):
            read_result(tmp_path)
        finish(tmp_path)
    reference = tmp_path / "reference"
    newer.save(reference)
    assert (tmp_path / "run.json").read_bytes() == (reference / "run.json").read_bytes()
    assert read_result(tmp_path).frames == 4 and not (tmp_path / WORK).exists()


def test_a_kill_leaves_nothing_that_stays(performance: Performance, tmp_path: Path) -> None:
    (tmp_path / WORK / "next").mkdir(parents=True)
    (tmp_path / WORK / "next" / "surface.npz").write_bytes(b"half of it")
    performance.save(tmp_path)
    assert not (tmp_path / WORK).exists() and "surface.npz" not in content(tmp_path)


def test_a_kill_while_checkpoints_are_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Never blocks of work without what says whose they are, but where the next call goes on."""

    class Killed(BaseException):
        pass

    real = {name: getattr(os, name) for name in ("replace", "unlink", "rmdir")}
    for last in range(1, 40):
        folder, calls = tmp_path / str(last), 0
        work = folder / ".perfcap" / "checkpoint"
        work.mkdir(parents=True)
        for name in ("a.log", "call.json", "z.log"):
            (work / name).write_text("x")

        def dying(name: str, last: int = last) -> Any:
            def call(*args: Any, **kwargs: Any) -> Any:
                nonlocal calls
                calls += 1
                if calls >= last:
                    raise Killed
                return real[name](*args, **kwargs)

            return call

        with monkeypatch.context() as patch:
            for name in real:
                patch.setattr(os, name, dying(name))
            try:
                with replacing(folder, last=True) as scratch:
                    (scratch / "run.json").write_text("{}")
            except Killed:
                pass
            else:
                break
        finish(folder)
        assert (work / "call.json").exists() or not list(work.glob("*.log")), last
    assert last > 5 and not (folder / ".perfcap").exists()


def test_a_plan_cannot_name_files_of_others(tmp_path: Path) -> None:
    (tmp_path / WORK / "next").mkdir(parents=True)
    for name in ("../x", "/etc/x", "masks/../../000001.png", "notes.txt", 3):
        (tmp_path / WORK / "publish.json").write_text(json.dumps({"names": [name]}))
        with pytest.raises(InputError, match="damaged"):
            finish(tmp_path)


# --- links ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [WORK, "masks", "masks/left"])
def test_nothing_behind_a_link_is_touched(tmp_path: Path, name: str) -> None:
    elsewhere, out = tmp_path / "elsewhere", tmp_path / "out"
    (elsewhere / "next").mkdir(parents=True)
    for mine in ("000001.png", "next/motion.npz"):
        (elsewhere / mine).write_bytes(b"mine")
    (out / name).parent.mkdir(parents=True)
    (out / name).symlink_to(elsewhere)
    before = content(elsewhere)
    with pytest.raises(InputError, match="is a link"):
        require_places(out, ["left"])
    with pytest.raises(InputError, match="is a link"), replacing(out) as scratch:
        (scratch / "masks" / "left").mkdir(parents=True)
        (scratch / "masks" / "left" / "000001.png").write_bytes(b"x")
    assert content(elsewhere) == before


def test_links_in_place_of_files_are_replaced_not_followed(
    performance: Performance, tmp_path: Path
) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.write_bytes(b"mine")
    for name in ("run.json", "motion.npz", "surface.npz", "overlay.mp4"):
        (tmp_path / name).symlink_to(elsewhere)
    performance.save(tmp_path)
    assert elsewhere.read_bytes() == b"mine"
    assert read_result(tmp_path).surface is None


@pytest.mark.parametrize("name", OWN)
def test_folders_in_the_place_of_files(performance: Performance, tmp_path: Path, name: str) -> None:
    (tmp_path / name).mkdir()
    with pytest.raises(InputError, match="is a folder"):
        performance.save(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_only_regular_files_of_the_folder_are_its_own(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "real" / "a.png").write_bytes(b"x")
    (tmp_path / "masks").symlink_to(tmp_path / "real")
    (tmp_path / "run.json").symlink_to(tmp_path / "real" / "a.png")
    os.mkfifo(tmp_path / "motion.npz")
    assert own_file(tmp_path, "real/a.png") is not None
    assert all(own_file(tmp_path, n) is None for n in ("masks/a.png", "run.json", "motion.npz"))
    assert all(own_file(tmp_path, n) is None for n in ("real", "none", "none/a", "real/a.png/b"))


def test_a_result_that_links_elsewhere_is_not_read(
    performance: Performance, tmp_path: Path
) -> None:
    performance.save(tmp_path)
    (tmp_path / "motion.npz").rename(tmp_path / "moved.npz")
    (tmp_path / "motion.npz").symlink_to(tmp_path / "moved.npz")
    with pytest.raises(InputError, match=r"lacks motion\.npz"):
        read_result(tmp_path)


def test_exports_of_an_older_result_are_said_to_be_of_that(
    performance: Performance, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    export = tmp_path / "export"
    export.mkdir()
    performance.save(tmp_path)
    (export / "dance.glb").write_bytes(b"of the first")
    assert not caplog.messages
    moved(performance).save(tmp_path)
    (line,) = caplog.messages
    assert line.startswith(f"{export}: holds files of the result that was replaced; ")
    assert (export / "dance.glb").read_bytes() == b"of the first"
    (export / "dance.glb").unlink()
    performance.save(tmp_path)
    assert len(caplog.messages) == 1


def test_files_that_were_put_beside_an_older_result_are_named(
    performance: Performance, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "clip.mp4").write_bytes(b"captured from")
    performance.save(tmp_path)
    before = (tmp_path / "run.json").stat().st_mtime_ns
    os.utime(tmp_path / "clip.mp4", ns=(before - 1, before - 1))
    later = [f"around{n}.mp4" for n in range(6)]
    for name in later:
        (tmp_path / name).write_bytes(b"of the first")
        os.utime(tmp_path / name, ns=(before + 1, before + 1))
    moved(performance).save(tmp_path)
    (line,) = caplog.messages
    named = ", ".join(later[:5])
    assert line.startswith(f"{tmp_path}: keeps {named} and 1 more from before; ")
    assert (tmp_path / later[0]).read_bytes() == b"of the first"
    performance.save(tmp_path)  # they are older than this one, and were said to be
    assert len(caplog.messages) == 1

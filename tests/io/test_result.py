"""The folder of a capture, read back: whole, or refused in one line."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from takes import make_take

from perfcap.errors import InputError
from perfcap.io.gltf_read import load_template
from perfcap.io.gltf_write import save_animation
from perfcap.io.result import read_result
from perfcap.io.surface_file import save_surface
from perfcap.pipeline import CaptureConfig
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.surface import SkinnedSurface, StoredSurface

FRAMES = 12


@pytest.fixture(scope="module")
def performance() -> Performance:
    take = make_take(FRAMES, turns=0.5)
    parts = (take.actor, take.cameras, take.detections, take.truth, take.rate, CaptureConfig())
    skinned = SkinnedSurface(take.actor, take.truth)
    return Performance(*parts, surface=StoredSurface(skinned[:].float() + 0.02))


@pytest.fixture(scope="module")
def saved(performance: Performance, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("results") / "a result"
    performance.save(folder, first_frame=40)
    return folder


@pytest.fixture
def folder(saved: Path, tmp_path: Path) -> Path:
    """A copy to spoil."""
    return Path(shutil.copytree(saved, tmp_path / "result"))


def test_everything_comes_back(saved: Path, performance: Performance) -> None:
    result = read_result(saved)
    assert result.frames == FRAMES and result.rate == 30
    assert result.frame_numbers.tolist() == list(range(40, 40 + FRAMES))
    np.testing.assert_array_equal(result.joints, performance.joints().numpy())
    transforms = performance.bone_transforms()
    np.testing.assert_allclose(result.bone_transforms, transforms, atol=1e-6)
    assert result.template.bone_names == performance.actor.template.bone_names
    assert result.report["complete"] is True
    np.testing.assert_array_equal(result.vertices(slice(3, 6)), performance.shown[3:6].numpy())


def test_without_a_surface_the_skeleton_moves_the_skin(
    performance: Performance, tmp_path: Path
) -> None:
    """Folders of skeleton captures, older ones too."""
    plain = replace(performance, surface=None)
    plain.save(tmp_path)
    result = read_result(tmp_path)
    assert result.surface is None
    expected = plain.shown[:].numpy()
    np.testing.assert_allclose(np.concatenate(list(result.blocks(5))), expected, atol=1e-5)
    assert result.vertices(slice(2, 4)).dtype == np.float32


def test_bones_that_put_vertices_nowhere_are_refused(folder: Path) -> None:
    """Finite transforms may overflow in single precision."""
    result = read_result(folder)
    far = result.bone_transforms.copy()
    far[1, :, :3, 3] = 1e39
    damaged = replace(result, bone_transforms=far, surface=None)
    assert np.isfinite(damaged.vertices(slice(0, 1))).all()
    with pytest.raises(InputError, match="put vertices nowhere"):
        damaged.vertices(slice(0, 2))


def test_the_surface_is_read_when_it_is_asked_for(saved: Path) -> None:
    result = read_result(saved)
    assert result.surface is not None and isinstance(result.surface.vertices, np.memmap)
    assert [len(block) for block in result.blocks(5)] == [5, 5, 2]


def remove(name: str) -> Callable[[Path], None]:
    return lambda folder: (folder / name).unlink()


def cut(name: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        data = (folder / name).read_bytes()
        (folder / name).write_bytes(data[: len(data) // 2])

    return change


def motion(**arrays: np.ndarray | None) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        with np.load(folder / "motion.npz", allow_pickle=False) as data:
            kept = {name: data[name] for name in data.files} | arrays
        np.savez(folder / "motion.npz", **{k: v for k, v in kept.items() if v is not None})

    return change


def surface(frames: int, vertices: int, start: int = 40) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        faces = load_template(folder / "capture.glb").faces
        blocks = [np.zeros((frames, vertices, 3))]
        numbers = np.arange(start, start + frames)
        save_surface(folder / "surface.npz", blocks, faces, numbers, 30)

    return change


def glb(frames: int) -> Callable[[Path], None]:
    """A motion of another length in the GLB."""

    def change(folder: Path) -> None:
        template = load_template(folder / "capture.glb")
        moving = np.tile(np.eye(4), (frames, len(template.bone_names), 1, 1))
        moving[:, :, 1, 3] = np.arange(frames)[:, None]
        save_animation(folder / "capture.glb", template, moving, 30)

    return change


def report(content: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        (folder / "run.json").write_text(content)

    return change


def foreign(folder: Path) -> None:
    """A GLB whose bones are other nodes."""
    path = folder / "capture.glb"
    data = bytearray(path.read_bytes())
    at = data.index(b'"joints":[0,1,')
    data[at + 10 : at + 14] = b"1,0,"
    path.write_bytes(data)


VERTICES = 288


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (remove("run.json"), "no run.json"),
        (remove("motion.npz"), "lacks motion.npz"),
        (remove("capture.glb"), "lacks capture.glb"),
        (remove("surface.npz"), "lacks surface.npz"),
        (cut("run.json"), "not valid JSON"),
        (cut("motion.npz"), "not a readable npz"),
        (cut("capture.glb"), "truncated"),
        (cut("surface.npz"), "not a readable npz"),
        (report("[]"), "no report"),
        (report('{"frames": 7}'), "run.json says 7"),
        (report('{"frames": "many"}'), "run.json says 'many'"),
        (motion(joints3d=None), "lacks joints3d"),
        (motion(joints3d=np.zeros((FRAMES, 15, 3))), "joints3d is"),
        (motion(joints3d=np.full((FRAMES, 16, 3), np.nan)), "finite"),
        (motion(frames=np.arange(FRAMES - 1)), "expected finite"),
        (motion(frames=np.arange(FRAMES)[::-1]), "one after the other"),
        (motion(frames=np.arange(FRAMES) - 1), "one after the other"),
        (motion(frames=2 * np.arange(FRAMES)), "one after the other"),
        (motion(frames=np.arange(0.0, FRAMES)), "frames is"),
        (motion(fps=np.array(-1.0)), "fps is"),
        (motion(fps=np.array(1e-5)), "fps is"),
        (motion(fps=np.array("x")), "fps is"),
        (surface(FRAMES - 1, VERTICES), "expected"),
        (surface(FRAMES, VERTICES + 1), "expected"),
        (surface(FRAMES, VERTICES, start=0), "expected"),
        (glb(FRAMES + 1), f"moves for {FRAMES + 1} frames"),
        (foreign, "bones are not its first"),
    ],
)
def test_half_a_result_is_refused_in_one_line(
    folder: Path, change: Callable[[Path], None], message: str
) -> None:
    change(folder)
    with pytest.raises(InputError, match=message) as caught:
        read_result(folder)
    assert "\n" not in str(caught.value) and str(folder) in str(caught.value)


def test_no_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for name in ("missing", "file"):
        with pytest.raises(InputError, match="no such folder"):
            read_result(tmp_path / name)


def test_damage_anywhere_in_the_animation_ends_in_one_line(folder: Path) -> None:
    path, rng = folder / "capture.glb", np.random.default_rng(0)
    data = path.read_bytes()
    begin, end = data.index(b'"animations"'), data.index(b'"accessors"')
    for _ in range(100):
        damaged = bytearray(data)
        for place in rng.integers(begin, end, 3):
            damaged[place] = rng.integers(32, 127)
        path.write_bytes(damaged)
        try:
            assert np.isfinite(read_result(folder).bone_transforms).all()
        except InputError as error:
            assert "\n" not in str(error)


def test_a_report_of_an_older_version_is_enough(folder: Path) -> None:
    (folder / "run.json").write_text(json.dumps({"complete": True}))
    assert read_result(folder).frames == FRAMES

"""Captured surfaces: providers of vertices, and the files a performance makes of them."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from takes import make_take

from perfcap.errors import InputError
from perfcap.io.gltf_document import open_document
from perfcap.io.surface_file import open_surface
from perfcap.pipeline import CaptureConfig
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.surface import SkinnedSurface, StoredSurface, surface_blocks

FRAMES = 20


@pytest.fixture(scope="module")
def performance() -> Performance:
    take = make_take(FRAMES)
    return Performance(
        take.actor, take.cameras, take.detections, take.truth, take.rate, CaptureConfig()
    )


def stored(performance: Performance, offset: float = 0.0) -> StoredSurface:
    """The skinned surface, kept, and moved aside."""
    skinned = SkinnedSurface(performance.actor, performance.motion)
    kept = StoredSurface.empty(FRAMES, len(performance.actor.vertices))
    for start in range(0, FRAMES, 7):
        kept.write(start, skinned[start : start + 7] + offset)
    return kept


def test_kept_and_skinned_are_the_same_surface(performance: Performance) -> None:
    skinned, kept = SkinnedSurface(performance.actor, performance.motion), stored(performance)
    assert skinned.frames == kept.frames == FRAMES
    for span in (slice(0, 5), slice(15, 40), slice(None), slice(4, 4)):
        torch.testing.assert_close(kept[span], skinned[span].float())
    assert len(skinned[18:30]) == 2
    for surface in (skinned, kept):
        blocks = list(surface_blocks(surface, 8))
        assert [len(b) for b in blocks] == [8, 8, 4] and blocks[0].dtype == np.float32


def test_what_is_shown_is_what_was_captured(performance: Performance) -> None:
    kept = stored(performance, 0.1)
    assert replace(performance, surface=kept).shown is kept
    torch.testing.assert_close(
        performance.shown[2:4], performance.actor.surface(performance.motion[2:4])
    )


def test_saving_without_a_surface_writes_none_and_removes_an_old_one(
    performance: Performance, tmp_path: Path
) -> None:
    replace(performance, surface=stored(performance)).save(tmp_path)
    assert (tmp_path / "surface.npz").is_file()
    performance.save(tmp_path)
    assert not (tmp_path / "surface.npz").exists()
    assert "surface" not in json.loads((tmp_path / "run.json").read_text())
    tree = open_document(tmp_path / "capture.glb").tree
    assert "targets" not in tree["meshes"][0]["primitives"][0]


def test_saving_writes_the_surface_in_both_files(performance: Performance, tmp_path: Path) -> None:
    surface = stored(performance, 0.1)
    for odd in (2.5, -1, float("nan"), "3", 1 << 70):
        with pytest.raises(InputError, match="expected a whole number of 0 or more"):
            performance.save(tmp_path, first_frame=odd)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="rate is 0"):
        replace(performance, rate=0.0).save(tmp_path)
    with pytest.warns(UserWarning, match="the surface is not that of the motion: 9 of 9 frames"):
        replace(performance, surface=surface).save(tmp_path, first_frame=6)
    written = open_surface(tmp_path / "surface.npz")
    np.testing.assert_array_equal(written.vertices, surface.vertices.numpy())
    np.testing.assert_array_equal(written.faces, performance.actor.template.faces)
    assert written.frames.tolist() == list(range(6, 6 + FRAMES)) and written.rate == 30
    tree = open_document(tmp_path / "capture.glb").tree
    assert len(tree["meshes"][0]["primitives"][0]["targets"]) == FRAMES
    report = json.loads((tmp_path / "run.json").read_text())
    assert report["surface"] == {"vertices": len(performance.actor.vertices), "in_glb": True}


def test_a_surface_too_large_for_a_glb_is_reported(
    performance: Performance, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from perfcap.io import gltf_morph

    monkeypatch.setattr(gltf_morph, "MAX_TARGETS", FRAMES - 1)
    replace(performance, surface=stored(performance)).save(tmp_path)
    report = json.loads((tmp_path / "run.json").read_text())
    assert report["surface"]["in_glb"] is False
    assert open_surface(tmp_path / "surface.npz").vertices.shape[0] == FRAMES


def test_frames_never_written_are_not_saved(performance: Performance, tmp_path: Path) -> None:
    room = StoredSurface.empty(FRAMES, len(performance.actor.vertices))
    room.write(0, SkinnedSurface(performance.actor, performance.motion)[0:9])
    with pytest.raises(InputError, match="frame 9 has vertices that are not finite"):
        replace(performance, surface=room).save(tmp_path)
    assert not (tmp_path / "run.json").exists() and not (tmp_path / "surface.npz").exists()


def test_a_surface_of_other_frames_is_refused(performance: Performance, tmp_path: Path) -> None:
    class Short(StoredSurface):
        def __getitem__(self, span: slice) -> torch.Tensor:
            return self.vertices[span][:3]

    surface = Short(stored(performance).vertices)
    with pytest.raises(InputError, match="frames of vertices"):
        replace(performance, surface=surface).save(tmp_path)


def test_blocks_are_lazy(performance: Performance) -> None:
    calls = []

    class Counting(StoredSurface):
        def __getitem__(self, span: slice) -> torch.Tensor:
            calls.append(span)
            return super().__getitem__(span)

    stream: Iterator[np.ndarray] = surface_blocks(Counting(stored(performance).vertices), 5)
    next(stream)
    assert calls == [slice(0, 5)]

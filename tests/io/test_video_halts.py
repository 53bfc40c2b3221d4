"""Videos in which pictures are stored more than once."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from video_files import write_frames

from perfcap.app.capture_checks import doubts
from perfcap.app.inputs import Inputs
from perfcap.io import load_actor, models_folder, read_cameras, read_detections
from perfcap.io.calibration import match_image
from perfcap.io.clip import Clip
from perfcap.io.doctor.finding import Finding
from perfcap.io.doctor.halts import examine_halts
from perfcap.io.doctor.inputs import examine_inputs
from perfcap.io.late_source import LateSource
from perfcap.pipeline.images import Images
from perfcap.pipeline.input_doubts import scene_doubts
from perfcap.pipeline.people import Person, Scene

SHIPPED = models_folder() / "demo"
DEMO = SHIPPED / "video.mp4"
FRAMES = 60
THIRTY = Fraction(1, 30)


@pytest.fixture(scope="module")
def pictures() -> np.ndarray:
    return Clip.open(DEMO, frames=slice(0, FRAMES)).read_view(0, 0, FRAMES)[:, ::2, ::2].copy()


def examined(
    path: Path,
    pictures: np.ndarray,
    shown: Sequence[int],
    options: dict[str, str] | None = None,
    frames: slice | None = None,
) -> list[Finding]:
    write_frames(path, [(pictures[k], i) for i, k in enumerate(shown)], THIRTY, options)
    return found(Clip.open(path, frames=frames))


def found(clip: Clip) -> list[Finding]:
    return examine_halts(clip, clip.names, clip.start)


@pytest.mark.long
@pytest.mark.parametrize("crf", ["5", "18", "24"])
def test_pictures_that_are_stored_twice(tmp_path: Path, pictures: np.ndarray, crf: str) -> None:
    twice = [frame // 2 for frame in range(FRAMES)]
    (told,) = examined(tmp_path / "a.mp4", pictures, twice, {"crf": crf})
    assert told.subject == "a" and not told.frames
    assert f"30 of {FRAMES} frames" in told.what and "15 pictures a second, not 30" in told.what
    assert "setpts=N/15/TB -r 15" in told.remedy


@pytest.mark.long
def test_film_in_a_faster_video(tmp_path: Path, pictures: np.ndarray) -> None:
    """Four pictures in five frames, as converters make 30 a second of 24."""
    (told,) = examined(tmp_path / "a.mp4", pictures, [4 * f // 5 for f in range(FRAMES)])
    assert "24 pictures a second" in told.what and "frames 1, 6, 11" in told.what


@pytest.mark.long
def test_a_webcam_in_the_dark(tmp_path: Path, pictures: np.ndarray) -> None:
    """It has a new picture now and then: without the others, times would be wrong all the more."""
    shown = np.maximum.accumulate(
        [k if k % 12 in (0, 1, 2, 3, 4, 7) else 0 for k in range(FRAMES)]
    ).tolist()
    (told,) = examined(tmp_path / "a.mp4", pictures, shown)
    assert "15 pictures a second" in told.what and "ffmpeg" not in told.remedy


@pytest.mark.long
def test_a_picture_that_is_held(tmp_path: Path, pictures: np.ndarray) -> None:
    """Within the clip, and at its end."""
    shown = [*range(20), *[20] * 12, *range(32, 50), *[50] * 10]
    (told,) = examined(tmp_path / "a.mp4", pictures, shown)
    assert told.frames == (*range(21, 32), *range(51, 60)) and told.views == (0,)
    assert "in frames 21-31, 51-59" in told.what
    (told,) = found(Clip.open(tmp_path / "a.mp4", frames=slice(25, 45)))
    assert told.frames == () and "(frames 26-31)" in told.what and "a second" not in told.what


@pytest.mark.long
def test_frames_as_they_were_filmed(tmp_path: Path, pictures: np.ndarray) -> None:
    """Also a few that are repeated, as where 29.97 pictures became 30, and who comes to rest."""
    assert found(Clip.open(DEMO)) == []
    shown = [*range(30), *range(29, FRAMES - 1)]
    assert examined(tmp_path / "a.mp4", pictures, shown) == []
    slower = np.cumsum(np.geomspace(1, 0.01, FRAMES))
    blended = np.stack([between(pictures, at) for at in slower])
    assert examined(tmp_path / "b.mp4", blended, range(FRAMES)) == []


def between(pictures: np.ndarray, at: float) -> np.ndarray:
    """A picture between two, as of a motion that slows down."""
    first, share = int(at), at - int(at)
    mixed = (1 - share) * pictures[first] + share * pictures[first + 1]
    picture: np.ndarray = mixed.round().astype(np.uint8)
    return picture


def test_a_clip_in_which_nobody_moves(tmp_path: Path, pictures: np.ndarray) -> None:
    assert examined(tmp_path / "a.mp4", pictures, [0] * FRAMES) == []


@pytest.mark.long
def test_ten_bits(tmp_path: Path, pictures: np.ndarray) -> None:
    """As phones record them."""
    path = tmp_path / "a.mkv"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", 30, options={"crf": "12"})
        stream.height, stream.width = pictures.shape[1:3]
        stream.pix_fmt = "yuv420p10le"
        for i in range(FRAMES):
            frame = av.VideoFrame.from_ndarray(pictures[i // 2], format="rgb24")
            container.mux(stream.encode(frame.reformat(format="yuv420p10le")))
        container.mux(stream.encode())
    (told,) = found(Clip.open(path))
    assert "15 pictures a second" in told.what


@pytest.mark.long
def test_a_view_that_is_late(tmp_path: Path, pictures: np.ndarray) -> None:
    """``--sync auto`` reads it from other frames on."""
    examined(tmp_path / "a.mp4", pictures, [*range(20), *[20] * 12, *range(32, FRAMES)])
    source = Clip.open(tmp_path / "a.mp4").sources[0]
    (told,) = found(Clip([LateSource(source, 5)], 30.0))
    assert told.frames == tuple(range(16, 27))


@pytest.mark.long
def test_every_way_in_says_so(tmp_path: Path) -> None:
    """``doctor``, ``capture``, and captures in Python."""
    whole = Clip.open(DEMO, frames=slice(0, FRAMES)).read_view(0, 0, FRAMES)
    path, words = tmp_path / "video.mp4", "show the picture of the frame before once more"
    twice = [(whole[frame // 2], frame) for frame in range(FRAMES)]
    write_frames(path, twice, THIRTY, {"preset": "ultrafast"})
    told = examine_inputs(SHIPPED / "camera.json", videos=[path])
    assert sum(words in each.what for each in told) == 1
    rig = read_cameras(SHIPPED / "camera.json")
    detections, _ = read_detections([SHIPPED / "detections.npz"], views=rig.names)
    clip, part = Clip.open(path), detections.frames(slice(0, FRAMES))
    inputs = Inputs(clip, rig, part, match_image(rig, clip.sizes, None), ())
    seen = doubts(inputs, needs_images=False, detected=False)
    assert sum(words in each.what for each in seen) == 1
    person = Person(load_actor("sam"), part)
    images = Images(clip, rig.cameras)
    scene = Scene(rig.cameras, (person,), 30.0, images)
    assert sum(words in line for line in scene_doubts(scene, person, True).sentences) == 1

"""Videos, whole and damaged."""

import struct
import wave
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import av
import numpy as np
import pytest
from video_files import make_video, number, picture, write_frames

from perfcap.errors import InputError
from perfcap.io.clip import Clip
from perfcap.io.video import VideoFile
from perfcap.io.video_index import Orientation, VideoIndex, frame_rate, promised_frames
from perfcap.io.video_writer import VideoWriter

DATA = Path(__file__).parents[2] / "../shared/data"
needs_data = pytest.mark.skipif(not DATA.exists(), reason="needs the shared data beside this tree")


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """80 frames with key frames every 12 and B-frames, as cameras and editors write them."""
    path = tmp_path_factory.mktemp("video") / "cam01.mp4"
    options = {"crf": "5", "preset": "veryfast", "g": "12", "bf": "2"}
    write_frames(path, [(picture(i), i) for i in range(80)], Fraction(1, 30), options)
    return path


@pytest.fixture(scope="module")
def whole(video: Path) -> np.ndarray:
    return VideoFile(video).read(0, 80)


# --- reading --------------------------------------------------------------------------------------


def test_writer_and_reader_agree(tmp_path: Path) -> None:
    clip = Clip.open(make_video(tmp_path / "a.mp4", 7))
    frames = clip.read(0, 7)
    assert frames.shape == (7, 1, 48, 64, 3) and frames.dtype == np.uint8
    assert (clip.fps, clip.names, clip.sizes, clip.warnings) == (30, ("a",), ((48, 64),), ())
    assert [number(frame[0]) for frame in frames] == list(range(7))
    np.testing.assert_allclose(clip.timestamps, np.arange(7) / 30, atol=1e-3)
    assert np.abs(frames[3, 0].astype(int) - picture(3)).mean() < 2


@pytest.mark.parametrize("start", [0, 1, 11, 12, 13, 40, 79])
def test_random_access_equals_sequential(video: Path, whole: np.ndarray, start: int) -> None:
    assert [number(frame) for frame in whole] == list(range(80))
    source = VideoFile(video)
    source.read(70, 71)  # somewhere else first
    part = source.read(start, min(start + 3, 80))
    assert np.array_equal(part, whole[start : start + 3])
    assert np.array_equal(source.read(5, 6), whole[5:6])
    source.close()
    assert np.array_equal(source.read(60, 61), whole[60:61])


def test_batches_cover_the_clip_once(video: Path) -> None:
    clip = Clip.open([video, video])
    batches = list(clip.iter(batch=32))
    assert [len(batch) for batch in batches] == [32, 32, 16]
    assert np.array_equal(np.concatenate(batches), clip.read(0, 80))


def test_a_part_of_a_clip(video: Path) -> None:
    clip = Clip.open(video, frames=slice(20, 30))
    assert len(clip) == 10 and clip.start == 20
    assert [number(f[0]) for f in clip.read(2, 5)] == [22, 23, 24]
    assert clip.timestamps[0] == 0
    assert len(clip.sources[0]) == 30  # nothing after the part was decoded
    assert len(Clip.open(video, frames=slice(70, 100))) == 10


def test_a_part_knows_how_long_the_video_is(video: Path, tmp_path: Path) -> None:
    for part in (slice(20, 30), slice(70, 100), slice(5, None), None):
        assert Clip.open(video, frames=part).total == 80
    short = make_video(tmp_path / "short.mp4", 20)
    assert Clip.open([video, short], frames=slice(0, 5)).total == 20
    write_frames(tmp_path / "a.mkv", [(picture(i), 33 * i) for i in range(9)], Fraction(1, 1000))
    # Matroska does not count its frames
    assert Clip.open(tmp_path / "a.mkv", frames=slice(0, 5)).total is None
    assert Clip.open(tmp_path / "a.mkv").total == 9


def test_a_promise_is_believed_where_the_duration_agrees() -> None:
    def promise(frames: int, seconds: float | None) -> int | None:
        duration = None if seconds is None else round(seconds * 1000)
        return promised_frames(
            SimpleNamespace(
                frames=frames, duration=duration, time_base=Fraction(1, 1000), average_rate=30
            )
        )

    assert promise(300, 10.0) == promise(300, 10.02) == promise(300, None) == 300
    assert promise(300, 5.0) is None  # trimmed without being encoded again
    assert promise(0, 5.0) is None and promise(2**31, None) is None


@pytest.mark.parametrize("part", ["0:10", (0, 10), slice(0, 8, 2), range(0, 8, 2)])
def test_parts_of_another_kind(video: Path, part: object) -> None:
    with pytest.raises(InputError, match=r"frames is .* expected slice\(A, B\)"):
        Clip.open(video, frames=part)  # type: ignore[arg-type]


@pytest.mark.parametrize("part", [slice(80, 90), slice(5, 5), slice(-3, 5)])
def test_empty_or_odd_parts(video: Path, part: slice) -> None:
    with pytest.raises(InputError, match="--frames"):
        Clip.open(video, frames=part)


def test_out_of_range_is_an_error(video: Path) -> None:
    clip = Clip.open(video)
    for start, stop in ((0, 81), (-1, 3), (5, 4)):
        with pytest.raises(IndexError):
            clip.read(start, stop)
    assert clip.read(3, 3).shape == (0, 1, 48, 64, 3)


def test_views_of_different_size(tmp_path: Path) -> None:
    paths = [make_video(tmp_path / "a.mp4", 3), make_video(tmp_path / "b.mp4", 3, (32, 40))]
    clip = Clip.open(paths)
    assert [view.shape for view in clip.read_views(0, 2)] == [(2, 48, 64, 3), (2, 32, 40, 3)]
    with pytest.raises(ValueError, match="use read_views"):
        clip.read(0, 2)
    with pytest.raises(ValueError, match="use read_views"):
        clip.iter()


@pytest.mark.parametrize(
    "matrix",
    [(0, 1, -1, 0), (-1, 0, 0, -1), (0, -1, 1, 0), (-1, 0, 0, 1), (1, 0, 0, -1), (0, 1, 1, 0),
     (0, -1, -1, 0), (1, 0, 0, 1)],
)  # fmt: skip
def test_frames_are_as_shown(tmp_path: Path, matrix: tuple[int, int, int, int]) -> None:
    """Turned or mirrored: shown x = a x + c y, shown y = b x + d y of a stored pixel, y down."""
    path = make_video(tmp_path / "phone.mp4", 3)
    stored = VideoFile(path).read(0, 3)
    data = bytearray(path.read_bytes())
    a, b, c, d = matrix
    at = data.index(b"tkhd") + 4 + 40  # of the track's header, in 16.16 numbers
    rows = (a << 16, b << 16, 0, c << 16, d << 16, 0, 0, 0, 1 << 30)
    data[at : at + 36] = struct.pack(">9i", *rows)
    path.write_bytes(data)
    video = VideoFile(path)
    assert video.size == ((64, 48) if a == 0 else (48, 64))
    y, x = np.indices((48, 64))
    across, down = a * x + c * y, b * x + d * y
    shown = np.empty((3, *video.size, 3), np.uint8)
    shown[:, down - down.min(), across - across.min()] = stored
    assert np.array_equal(video.read(0, 3), shown)
    assert any("mirror" in line for line in video.warnings) == (a * d - b * c < 0)


def test_variable_frame_rate_keeps_stored_frames_and_says_so(tmp_path: Path) -> None:
    ticks = [0, 33, 67, 100, 300, 333, 367, 400]
    write_frames(
        tmp_path / "vfr.mp4", [(picture(i), t) for i, t in enumerate(ticks)], Fraction(1, 1000)
    )
    clip = Clip.open(tmp_path / "vfr.mp4")
    assert len(clip) == 8 and 28 < clip.fps < 32
    assert "variable frame rate" in clip.warnings[0]
    np.testing.assert_allclose(clip.timestamps * 1000, ticks, atol=1)


def test_frames_that_mostly_have_one_time_have_their_average_rate() -> None:
    times = np.array([0.0, 1.0, 1.0, 1.0, 1.0]) / 30
    index = VideoIndex((0, 512, 512, 512, 512), 1 / 15360, 30.0, (32, 40), Orientation(), 0, 5, ())
    rate, (note,) = frame_rate(times, index)
    assert rate == pytest.approx(120.0) and "at the average rate of 120.00" in note


def test_rounded_time_stamps_are_a_constant_rate(tmp_path: Path) -> None:
    ticks = [round(i * 1001 / 30) for i in range(60)]
    write_frames(
        tmp_path / "a.mkv", [(picture(i), t) for i, t in enumerate(ticks)], Fraction(1, 1000)
    )
    clip = Clip.open(tmp_path / "a.mkv")
    assert not clip.warnings and abs(clip.fps - 29.97) < 0.05


def test_stream_without_time_stamps(tmp_path: Path, video: Path) -> None:
    path = tmp_path / "raw.h264"
    with av.open(str(video)) as source, av.open(str(path), "w", format="h264") as target:
        stream = target.add_stream_from_template(source.streams.video[0])
        for packet in source.demux(video=0):
            if packet.dts is not None:
                packet.stream = stream
                target.mux(packet)
    raw = VideoFile(path)
    assert len(raw) == 80
    assert [number(raw.read(i, i + 1)[0]) for i in (50, 3, 79)] == [50, 3, 79]


@pytest.mark.long
@needs_data
def test_real_videos() -> None:
    clip = Clip.open(DATA / "rendered/dev_tight/video.mp4")
    assert (len(clip), clip.fps, clip.sizes) == (100, 30, ((640, 640),))
    folder = Clip.open(DATA / "rendered/dev_tight/frames", fps=30)
    assert len(folder) == 100
    difference = clip.read(42, 43).astype(int) - folder.read(42, 43)
    assert np.abs(difference).mean() < 4
    assert (
        np.abs(clip.read(42, 43).astype(int) - folder.read(43, 44)).mean()
        > np.abs(difference).mean()
    )


# --- damaged and wrong files ----------------------------------------------------------------------


def test_truncated_video_gives_its_frames_and_says_how_many(tmp_path: Path, video: Path) -> None:
    cut = tmp_path / "cut.mp4"
    data = video.read_bytes()
    cut.write_bytes(data[: len(data) * 9 // 10])
    clip = Clip.open(cut)
    assert 20 < len(clip) < 80
    assert any(str(len(clip)) in warning for warning in clip.warnings)
    assert number(clip.read(len(clip) - 1, len(clip))[0, 0]) == len(clip) - 1


def cut_before_index(path: Path) -> None:
    """A recording that was never finished: pictures but no index."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", 30)
        stream.height, stream.width, stream.pix_fmt = 48, 64, "yuv420p"
        for i in range(20):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture(i), format="rgb24")))
        container.mux(stream.encode())
    path.write_bytes(path.read_bytes()[: path.read_bytes().index(b"moov") - 4])


def sound(path: Path) -> None:
    with wave.open(str(path), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(8000)
        file.writeframes(b"\0\0" * 800)


def test_unfinished_recording(tmp_path: Path) -> None:
    cut_before_index(tmp_path / "a.mp4")
    with pytest.raises(InputError, match="not a video that can be opened"):
        Clip.open(tmp_path / "a.mp4")


def test_sound_only(tmp_path: Path) -> None:
    sound(tmp_path / "a.wav")
    with pytest.raises(InputError, match="holds no video"):
        Clip.open(tmp_path / "a.wav")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is empty"),
        (b"hello, this is text", "not a video"),
        (b"\0" * 4096, "not a video"),
        (b"#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\n/etc/hostname\n", "video"),
        (b"ffconcat version 1.0\nfile cam01.mp4\n", "video"),
    ],
)
def test_not_a_video(tmp_path: Path, content: bytes, words: str) -> None:
    (tmp_path / "a.mp4").write_bytes(content)
    with pytest.raises(InputError, match=words) as caught:
        Clip.open(tmp_path / "a.mp4")
    assert "\n" not in str(caught.value) and "a.mp4" in str(caught.value)


def test_playlists_do_not_open_other_files(tmp_path: Path, video: Path) -> None:
    (tmp_path / "other.mp4").write_bytes(video.read_bytes())
    playlist = tmp_path / "list.ffconcat"
    playlist.write_text("ffconcat version 1.0\nfile other.mp4\n")
    with pytest.raises(InputError, match="video"):
        Clip.open(playlist)


def test_missing(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        Clip.open(tmp_path / "nothing.mp4")


def test_resolution_change(tmp_path: Path) -> None:
    paths = [tmp_path / "a.h264", tmp_path / "b.h264"]
    for path, size in zip(paths, ((48, 64), (64, 96)), strict=True):
        with av.open(str(path), "w", format="h264") as container:
            stream = container.add_stream("libx264", 30)
            stream.height, stream.width, stream.pix_fmt = *size, "yuv420p"
            for i in range(4):
                frame = av.VideoFrame.from_ndarray(picture(i, *size), format="rgb24")
                container.mux(stream.encode(frame))
            container.mux(stream.encode())
    paths[0].write_bytes(paths[0].read_bytes() + paths[1].read_bytes())
    with pytest.raises(InputError, match="expected one size"):
        Clip.open(paths[0])


@pytest.mark.parametrize("fps", [0, -25, "25", float("nan")])
def test_rates_that_are_none(video: Path, fps: Any) -> None:
    with pytest.raises(InputError, match="fps is"):
        Clip.open(video, fps=fps)


def test_views_of_different_rate_and_length(tmp_path: Path, video: Path) -> None:
    with VideoWriter(tmp_path / "slow.mp4", 25) as writer:
        for i in range(80):
            writer.write(picture(i))
    with pytest.raises(InputError, match="different rates"):
        Clip.open([video, tmp_path / "slow.mp4"])
    with pytest.raises(InputError, match="different numbers of frames"):
        Clip.open([video, make_video(tmp_path / "short.mp4", 20)])
    clip = Clip.open([video, make_video(tmp_path / "almost.mp4", 78)])
    assert len(clip) == 78 and "first 78 are used" in clip.warnings[0]


def test_damage_inside_never_raises_anything_else(tmp_path: Path, video: Path) -> None:
    generator = np.random.default_rng(0)
    for _ in range(12):
        data = bytearray(video.read_bytes())
        for at in generator.integers(0, len(data), 20):
            data[at] = generator.integers(256)
        path = tmp_path / "damaged.mp4"
        path.write_bytes(data)
        try:
            clip = Clip.open(path)
            clip.read(0, min(len(clip), 40))
        except InputError as error:
            assert "damaged.mp4" in str(error)

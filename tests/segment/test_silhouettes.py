"""Compressed labels of a clip."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from disc_scene import disc

from perfcap.errors import InputError
from perfcap.segment.silhouettes import Silhouettes, _unfiltered, decode_labels, encode_labels


def labels(frame, view):
    picture = np.zeros((60 + 10 * view, 50), np.uint8)
    picture[disc((15 + frame, 20), 9, picture.shape)] = 1
    picture[disc((35, 30), 7, picture.shape)] = 2
    return picture


@pytest.fixture(scope="module")
def clip():
    return Silhouettes.collect([labels(f, c) for c in range(2)] for f in range(4))


def test_labels_survive(clip):
    assert len(clip) == 4
    assert clip.views == 2
    for frame in range(4):
        for view in range(2):
            np.testing.assert_array_equal(clip.labels(frame, view), labels(frame, view))
            np.testing.assert_array_equal(clip.mask(frame, view, 2), labels(frame, view) == 2)


def test_one_person_alone(clip):
    second = clip.of(2)
    np.testing.assert_array_equal(second.labels(1), labels(1, 0) == 2)
    assert second.labels(1).max() == 1
    assert second.of(1) is second
    for wrong in (0, -1, 256):
        with pytest.raises(InputError, match="person"):
            clip.of(wrong)
    with pytest.raises(InputError, match="person"):
        second.of(2)


def test_files_are_plain_png(clip, tmp_path):
    for index, (everybody, alone) in enumerate(zip(clip.png(1), clip.of(1).png(1), strict=True)):
        path = tmp_path / f"{index:06d}.png"
        path.write_bytes(everybody)
        picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        np.testing.assert_array_equal(picture, labels(index, 1))
        np.testing.assert_array_equal(decode_labels(alone), labels(index, 1) == 1)


def test_memory_is_small():
    large = np.zeros((1000, 1000), np.uint8)
    large[disc((500, 500), 300, large.shape)] = 1
    kept = Silhouettes.collect([[large]] * 5)
    assert kept.size_bytes < 5 * 20_000


def test_masks_and_other_pictures():
    mask = disc((5, 5), 3, (12, 11))
    np.testing.assert_array_equal(decode_labels(encode_labels(mask)), mask)
    for wrong in (mask.astype(float), np.zeros((4, 4, 3), np.uint8), np.zeros((0, 4), np.uint8)):
        with pytest.raises(InputError, match="labels"):
            encode_labels(wrong)
    with pytest.raises(InputError, match="views"):
        Silhouettes.collect([[mask], [mask, mask]])


def test_nothing():
    empty = Silhouettes.collect([])
    assert len(empty) == 0
    assert empty.views == 0
    assert list(empty.png()) == []


def test_everybody_but_one(clip):
    for person in (1, 2):
        others = clip.of(person).others(1, 1)
        np.testing.assert_array_equal(others, labels(1, 1) == 3 - person)
    assert not clip.others(1, 1).any()


def test_what_is_no_plain_png_is_left_to_opencv() -> None:
    picture = np.random.default_rng(0).integers(0, 3, (40, 31)).astype(np.uint8)
    own = encode_labels(picture)
    filtered = cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_STRATEGY, 0])[1]
    color = cv2.imencode(".png", np.dstack([picture] * 3))[1]
    for png in (own, filtered.tobytes(), color.tobytes()):
        np.testing.assert_array_equal(decode_labels(png), picture)
    longer = own[:20] + (41).to_bytes(4, "big") + own[24:]
    for damaged in (longer, own[:60], own[:-30] + bytes(30), b"", own[:24]):
        assert _unfiltered(damaged) is None
    np.testing.assert_array_equal(_unfiltered(own), picture)

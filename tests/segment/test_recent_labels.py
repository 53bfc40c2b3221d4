"""Labels that are remembered are those that were decoded, and few."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

from perfcap.segment.recent_labels import RecentLabels
from perfcap.segment.silhouettes import decode_labels, encode_labels


def picture(number: int, most: int) -> np.ndarray:
    rng = np.random.default_rng(number)
    labels = np.zeros((70, 90), np.uint8)
    labels[20:50, 30:61] = rng.integers(0, most + 1, (30, 31))
    return labels


@pytest.mark.parametrize("most", [0, 1, 5])
def test_what_is_remembered_is_what_was_decoded(most: int) -> None:
    recent, decoded = RecentLabels(), []

    def decode(png: bytes) -> np.ndarray:
        decoded.append(png)
        return decode_labels(png)

    for number in (0, 1, 0, 1, 0):
        labels = picture(number, most)
        found = recent.labels(encode_labels(labels), decode)
        np.testing.assert_array_equal(found, labels)
        found[:] = 7  # whoever asked may write to them
    assert len(decoded) == (1 if most == 0 else 2)


def test_what_was_not_asked_for_lately_is_forgotten() -> None:
    recent = RecentLabels(room=1200)  # bytes: two parts of 930 do not fit
    pngs = [encode_labels(picture(number, 5)) for number in range(3)]
    decoded = []
    for number in (0, 0, 1, 1, 0, 2, 2):
        recent.labels(pngs[number], lambda png: decoded.append(png) or decode_labels(png))
    assert decoded == [pngs[0], pngs[1], pngs[0], pngs[2]]


@pytest.mark.parametrize(
    "again", [copy.deepcopy, lambda recent: pickle.loads(pickle.dumps(recent))]
)
def test_copies_begin_with_nothing(again) -> None:
    recent, png, decoded = RecentLabels(), encode_labels(picture(0, 1)), []
    for each in (recent, again(recent)):
        each.labels(png, lambda png: decoded.append(png) or decode_labels(png))
    assert len(decoded) == 2

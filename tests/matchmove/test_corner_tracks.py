"""Corners that are followed through painted pictures."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from perfcap.matchmove import CornerTracks, Sightings, TrackSettings

SIDE, FRAMES = 200, 6
STEP = np.array([2.5, -1.0])  # px a frame, by which the picture moves


def wall(seed: int = 0) -> NDArray[np.uint8]:
    """Soft spots, larger than a picture."""
    spots = np.random.default_rng(seed).integers(0, 255, (60, 60), dtype=np.uint8)
    large = cv2.resize(spots, (3 * SIDE, 3 * SIDE), interpolation=cv2.INTER_CUBIC)
    return np.asarray(large, np.uint8)


def followed(hidden: NDArray[np.bool_], scale: int = 1, side: int = 640) -> Sightings:
    tracks = CornerTracks(TrackSettings(side=side, corners=80))
    for frame in range(FRAMES):
        middle = 1.5 * SIDE - frame * STEP
        picture = cv2.getRectSubPix(wall(), (SIDE, SIDE), middle.tolist())
        large = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_LINEAR)
        closed = np.kron(hidden, np.ones((scale, scale), np.bool_))
        tracks.add(large[..., None].repeat(3, -1), closed)
    return tracks.sightings()


def steps(seen: Sightings) -> NDArray[np.float64]:
    """By which points move from a frame to the next, (n, 2)."""
    order = np.lexsort((seen.frame, seen.point))
    point, frame, pixels = seen.point[order], seen.frame[order], seen.pixels[order]
    again = (np.diff(point) == 0) & (np.diff(frame) == 1)
    return np.asarray(np.diff(pixels, axis=0)[again])


@pytest.mark.parametrize("scale", [1, 2])
def test_corners_move_with_the_picture(scale: int) -> None:
    seen = followed(np.zeros((SIDE, SIDE), np.bool_), scale, side=SIDE)
    assert seen.scale == 1 / scale
    found = steps(seen)
    assert len(found) > 200
    assert np.abs(np.median(found, axis=0) - STEP).max() < 0.05
    assert np.quantile(np.abs(found - STEP).max(-1), 0.9) < 0.25
    assert (np.bincount(seen.frame) >= 50).all() and (np.bincount(seen.frame) <= 80).all()
    pairs = np.stack((seen.frame, seen.point), -1)
    assert len(np.unique(pairs, axis=0)) == len(seen)


def test_nothing_is_followed_where_people_may_be() -> None:
    hidden = np.zeros((SIDE, SIDE), np.bool_)
    hidden[:, 60:140] = True
    seen = followed(hidden)
    at = np.rint(seen.pixels).astype(int)
    assert len(seen) > 100 and not hidden[at[:, 1], at[:, 0]].any()
    assert len(followed(np.ones((SIDE, SIDE), np.bool_))) == 0


def test_a_plain_picture_and_none_show_nothing() -> None:
    tracks = CornerTracks()
    assert len(tracks.sightings()) == 0
    for _ in range(2):
        tracks.add(np.full((90, 120, 3), 70, np.uint8), np.zeros((90, 120), np.bool_))
    assert len(tracks.sightings()) == 0


def test_corners_of_a_cut_do_not_go_on() -> None:
    tracks = CornerTracks(TrackSettings(corners=60))
    for seed in (0, 0, 1, 1):
        picture = wall(seed)[:SIDE, :SIDE]
        tracks.add(picture[..., None].repeat(3, -1), np.zeros((SIDE, SIDE), np.bool_))
    seen = tracks.sightings()
    points = [set(seen.point[seen.frame == frame].tolist()) for frame in range(4)]
    assert len(points[0] & points[1]) > 40 and len(points[2] & points[3]) > 40
    assert len(points[1] & points[2]) < 5


def test_cuts_are_frames_before_which_all_corners_are_new() -> None:
    """Corners that people hide go on behind them, and are no cut."""
    tracks = CornerTracks(TrackSettings(corners=80))
    for frame in range(3 * FRAMES):
        middle = 1.5 * SIDE - (frame % FRAMES) * STEP
        picture = cv2.getRectSubPix(wall(frame // FRAMES), (SIDE, SIDE), middle.tolist())
        hidden = np.full((SIDE, SIDE), frame == 2 * FRAMES + 3)
        tracks.add(picture[..., None].repeat(3, -1), hidden)
    assert tracks.cuts() == (FRAMES, 2 * FRAMES)


def test_a_strip_that_goes_out_of_the_picture_is_no_cut() -> None:
    """All that a crowd leaves open, at the edge of a picture that is panned fast."""
    tracks = CornerTracks(TrackSettings(corners=80, side=SIDE))
    for frame in range(FRAMES):
        picture = cv2.getRectSubPix(wall(), (SIDE, SIDE), [SIDE + 25 * frame, 1.5 * SIDE])
        hidden = np.zeros((SIDE, SIDE), np.bool_)
        hidden[:, 18:] = frame < 3
        tracks.add(picture[..., None].repeat(3, -1), hidden)
    assert tracks.cuts() == ()

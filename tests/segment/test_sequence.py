"""Consecutive frames: blocks, cuts and moving cameras."""

from __future__ import annotations

import numpy as np
import pytest
from disc_scene import disc_clip, overlap

from perfcap.errors import InputError
from perfcap.segment.scene import Scene, survey
from perfcap.segment.sequence import Footage, SequenceSettings, segment_block


def footage(clip, start=0, stop=None):
    part = slice(start, stop)
    return Footage(clip.images[part], clip.models[part], clip.bones[part])


def test_block_follows_a_moving_person():
    clip = disc_clip(frames=15)
    scene = survey(clip.images, clip.models)
    found = list(segment_block(footage(clip), range(5, 10), scene))
    assert len(found) == 5
    for index, frame in zip(range(5, 10), found, strict=True):
        assert overlap(frame.mask, clip.truth[index]) > 0.97
        assert frame.report.motion
        assert not frame.report.cut


def test_block_does_not_depend_on_what_lies_further_off():
    clip = disc_clip(frames=15)
    scene = survey(clip.images, clip.models)
    whole = segment_block(footage(clip), range(5, 8), scene)
    part = segment_block(footage(clip, 4, 9), range(1, 4), scene)
    for one, other in zip(whole, part, strict=True):
        np.testing.assert_array_equal(one.mask, other.mask)


def test_moving_camera_is_followed():
    clip = disc_clip(frames=25, pan=3.0, speed=-2.0)
    scene = survey(clip.images, clip.models)
    assert scene.plate is None
    found = list(segment_block(footage(clip), range(12, 14), scene))
    for index, frame in zip(range(12, 14), found, strict=True):
        assert overlap(frame.mask, clip.truth[index]) > 0.93
        assert frame.report.motion
        assert frame.report.change < 6
        assert frame.report.plate > 0.2


def test_nothing_is_carried_across_a_cut():
    clip = disc_clip(frames=6)
    other = disc_clip(
        frames=6,
        seed=3,
        person=((20, 20, 120), (60, 60, 250)),
        scene=((200, 90, 20), (250, 250, 90)),
    )
    images, models, bones = (
        np.concatenate([getattr(c, name) for c in (clip, other)])
        for name in ("images", "models", "bones")
    )
    scene = Scene(None, float("nan"), 0)
    joined = list(segment_block(Footage(images, models, bones), range(4, 8), scene))
    assert [frame.report.cut for frame in joined] == [False, False, True, False]
    alone = list(segment_block(footage(other), range(0, 2), scene))
    for one, two in zip(joined[2:], alone, strict=True):
        np.testing.assert_array_equal(one.mask, two.mask)


def test_carried_colors_start_anew_with_every_block():
    clip = disc_clip(frames=12)
    scene = survey(clip.images, clip.models)
    settings = SequenceSettings(carry=True)
    late = list(segment_block(footage(clip), range(5, 8), scene, settings))
    fresh = next(segment_block(footage(clip), range(5, 6), scene))
    np.testing.assert_array_equal(late[0].mask, fresh.mask)
    for index, frame in zip(range(5, 8), late, strict=True):
        assert overlap(frame.mask, clip.truth[index]) > 0.95


def test_person_leaves_the_image():
    clip = disc_clip(frames=6)
    models = clip.models.copy()
    models[3] = False
    scene = survey(clip.images, models)
    found = list(segment_block(Footage(clip.images, models, clip.bones), range(6), scene))
    assert [frame.report.person for frame in found] == [True, True, True, False, True, True]
    assert not found[3].mask.any()
    assert overlap(found[4].mask, clip.truth[4]) > 0.97


def test_unequal_lengths_are_refused():
    clip = disc_clip(frames=3)
    with pytest.raises(InputError, match="footage"):
        Footage(clip.images, clip.models[:2], clip.bones)

"""Several models in what knew one: plates, trimaps, masks of everybody."""

import numpy as np
import pytest
from disc_scene import disc, disc_clip, overlap

from perfcap.errors import InputError
from perfcap.segment import Footage, segment_block, survey
from perfcap.segment.people_trimap import joined, own_trimaps, trimap_of
from perfcap.segment.scene import hide
from perfcap.segment.trimap import FOREGROUND, build_trimap

NO_BONES = np.zeros((2, 0, 2, 2))


def test_one_model_of_several_has_the_same_bits() -> None:
    clip = disc_clip()
    scene = survey(clip.images, clip.models)
    alone = Footage(list(clip.images), list(clip.models), clip.bones)
    listed = Footage(list(clip.images), [m[None] for m in clip.models], clip.bones[:, None])
    same = survey(clip.images, [model[None] for model in clip.models])
    assert scene.plate is not None and same.plate is not None
    np.testing.assert_array_equal(scene.plate.color, same.plate.color)
    pairs = zip(
        segment_block(alone, range(4, 7), scene),
        segment_block(listed, range(4, 7), same),
        strict=True,
    )
    for one, other in pairs:
        np.testing.assert_array_equal(one.mask, other.mask)
        np.testing.assert_array_equal(one.evidence, other.evidence)
        np.testing.assert_array_equal(one.trimap.labels, other.trimap.labels)
        assert one.trimap.box == other.trimap.box
        assert repr(one.report) == repr(other.report)  # NaN is not itself


def test_each_is_hidden_by_a_width_of_their_own() -> None:
    large, small = disc((50, 50), 40), disc((130, 130), 8)
    both = hide(np.stack([large, small]), 0.2)
    np.testing.assert_array_equal(both, hide(large, 0.2) | hide(small, 0.2))


def test_regions_of_everybody_are_those_of_anybody() -> None:
    models = np.stack([disc((50, 60), 30), disc((90, 80), 20)])
    trimaps = own_trimaps(models, NO_BONES)
    both = joined(trimaps)
    assert trimaps[0].box == trimaps[1].box == both.box
    assert [each.size for each in trimaps] == [build_trimap(m, NO_BONES[0]).size for m in models]
    sure = [each.labels == FOREGROUND for each in trimaps]
    np.testing.assert_array_equal(both.labels == FOREGROUND, sure[0] | sure[1])
    np.testing.assert_array_equal(both.model, trimaps[0].model | trimaps[1].model)
    nobody = (trimaps[0].labels == 0) & (trimaps[1].labels == 0)
    np.testing.assert_array_equal(both.labels == 0, nobody)
    # what each one's own box holds is as it was alone
    alone = build_trimap(models[1], NO_BONES[0])
    np.testing.assert_array_equal(trimaps[1].full(), alone.full())


def test_who_is_outside_the_image_changes_nothing() -> None:
    model = disc((70, 70), 30)
    there = trimap_of(np.stack([model, np.zeros_like(model)]), NO_BONES)
    alone = build_trimap(model, NO_BONES[0])
    np.testing.assert_array_equal(there.labels, alone.labels)
    np.testing.assert_array_equal(there.distance, alone.distance)
    assert there.box == alone.box
    nobody = trimap_of(np.zeros((2, 20, 20), bool), NO_BONES)
    assert nobody.size == 0 and nobody.labels.size == 0


def test_two_are_found_in_front_of_one_plate() -> None:
    clip = disc_clip()
    second = disc((25, 25), 14)
    rng = np.random.default_rng(2)
    images = clip.images.copy()
    images[:, second] = rng.integers(150, 200, (len(images), int(second.sum()), 3))
    models = [np.stack([model, disc((27, 25), 14)]) for model in clip.models]
    bones = np.stack([clip.bones, clip.bones], 1)
    bones[:, 1] = [[[25, 20], [25, 30]]]
    scene = survey(images, models)
    assert scene.plate is not None
    assert not scene.plate.known[25, 25]  # hidden in every frame: not learnt as background
    footage = Footage(list(images), models, bones)
    for index, found in zip(range(4, 7), segment_block(footage, range(4, 7), scene), strict=True):
        truth = clip.truth[index]
        assert overlap(found.mask & ~second, truth & ~second) > 0.97
        assert overlap(found.mask[:45, :45], second[:45, :45]) > 0.9


def test_models_and_skeletons_must_fit() -> None:
    with pytest.raises(InputError, match="expected masks"):
        own_trimaps(np.zeros((3, 5, 5), bool), NO_BONES)

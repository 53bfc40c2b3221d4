"""How far a network's mask is trusted, and what it changes."""

from __future__ import annotations

import numpy as np
import pytest
from disc_scene import disc_clip, overlap

from perfcap.segment.network_cue import learn_trust
from perfcap.segment.scene import Scene, survey
from perfcap.segment.sequence import Footage, SequenceSettings, ask, segment_block

LEARNED, SCORED = range(2, 9, 2), range(3, 10)
KNOWN = 2.0  # deviations between the odds of either side


def drawn(count=40000, apart=KNOWN, seed=0):
    """Odds of two normal distributions, whose log ratio is ``apart`` times the odds."""
    rng = np.random.default_rng(seed)
    person = rng.uniform(size=count) < 0.5
    odds = rng.normal(size=count) + np.where(person, apart / 2, -apart / 2)
    return odds.astype(np.float32), person


def test_the_ratio_of_densities_is_recovered():
    trust = learn_trust([drawn()], 10.0)
    inner = np.abs(trust.odds) < 1.5
    assert np.abs(trust.nats - KNOWN * trust.odds)[inner].max() < 0.3
    assert (np.diff(trust.odds) > 0).all()
    assert (np.diff(trust.nats) >= 0).all()


def test_samples_in_parts_are_samples_together():
    odds, person = drawn()
    parts = [(odds[i::3], person[i::3]) for i in range(3)]
    together = learn_trust([tuple(np.concatenate(p) for p in zip(*parts, strict=True))], 10.0)
    apart = learn_trust(parts, 10.0)
    np.testing.assert_allclose(apart.nats, together.nats)


def test_a_network_that_says_nothing_is_worth_nothing():
    odds, person = drawn()
    shuffled = np.random.default_rng(1).permutation(person)
    assert np.abs(learn_trust([(odds, shuffled)], 10.0).nats).max() < 0.15
    assert np.abs(learn_trust([(-odds, person)], 10.0).nats).max() < 0.15  # or the reverse


def test_few_pixels_say_little_and_nats_are_limited():
    few = learn_trust([drawn(200, apart=20.0)], 10.0)
    many = learn_trust([drawn(40000, apart=20.0)], 10.0)
    assert np.abs(few.nats).max() < 3 < np.abs(many.nats).max()
    assert np.abs(learn_trust([drawn(40000, apart=20.0)], 2.0).nats).max() == 2.0


@pytest.mark.parametrize("person", [True, False])
def test_one_side_alone_teaches_nothing(person):
    odds, _ = drawn(1000)
    assert learn_trust([(odds, np.full(1000, person))], 3.0) is None
    assert learn_trust([], 3.0) is None
    assert learn_trust([(np.zeros(1000, np.float32), np.arange(1000) < 500)], 3.0) is None


class Oracle:
    """The truth of a clip as a network would say it, wrong where ``wrong`` says."""

    def __init__(self, clip, wrong=None):
        self.clip, self.wrong = clip, wrong

    def __call__(self, image, model, spine, part):
        frame = next(i for i, other in enumerate(self.clip.images) if np.array_equal(other, image))
        said = self.clip.truth[frame] if self.wrong is None else self.clip.truth[frame] | self.wrong
        return np.where(said[part], 6.0, -6.0).astype(np.float32)


def learned(clip, network, scene):
    footage = Footage(list(clip.images), list(clip.models), clip.bones)
    pairs = []
    for found, index in zip(segment_block(footage, LEARNED, scene), LEARNED, strict=True):
        band = found.trimap.band
        pairs.append(
            (ask(network, footage, index, found.trimap)[band], found.mask[found.trimap.box][band])
        )
    return footage, learn_trust(pairs, SequenceSettings().frame.network)


def scores(clip, network=None):
    """Mean overlap without a plate: colours and model are the only other cues."""
    scene = Scene(None, float("nan"), 0)
    footage, trust = learned(clip, network or Oracle(clip), scene)
    scene = Scene(None, float("nan"), 0, trust=trust)
    found = segment_block(footage, SCORED, scene, network=network)
    return np.mean([overlap(f.mask, clip.truth[i]) for i, f in zip(SCORED, found, strict=True)])


def test_a_good_network_finds_who_wears_the_color_of_the_wall():
    same = ((60, 90, 70), (130, 170, 150))
    clip = disc_clip(person=same)
    assert scores(clip, Oracle(clip)) > scores(clip) + 0.02


def test_a_portrait_on_the_wall_does_little_harm():
    clip = disc_clip()
    wrong = np.zeros(clip.truth.shape[1:], np.bool_)
    wrong[20:130, 100:140] = True
    assert scores(clip, Oracle(clip, wrong)) > scores(clip) - 0.02


def test_without_trust_it_is_not_asked():
    clip = disc_clip()
    scene = survey(clip.images, clip.models)
    footage = Footage(clip.images, clip.models, clip.bones)
    plain, asked = (
        next(segment_block(footage, range(5, 6), scene, network=network))
        for network in (None, Oracle(clip))
    )
    np.testing.assert_array_equal(plain.mask, asked.mask)

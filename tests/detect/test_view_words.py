"""Sentences of several views name them, and ask nothing of pixels that are right."""

from __future__ import annotations

from dataclasses import replace

import pytest
from crowds import RATE, make_crowd

from perfcap.detect.association import AssociationConfig, associate
from perfcap.detect.joint_set import LANDMARKS16
from perfcap.detect.view_words import view_words
from perfcap.errors import InputError

NAMES = ["front", "left", "back"]


def test_views_are_called_by_name_or_counted() -> None:
    assert view_words([1], NAMES) == "view left"
    assert view_words([0, 2], NAMES) == "views front and back"
    assert view_words([1], None) == "view 1, counted from 0,"


@pytest.mark.long
def test_notes_name_the_views() -> None:
    crowd = make_crowd(1, views=3)
    joints = crowd.candidates.joints2d.clone()
    joints[:, :, 2] = joints[:, :, 2, list(LANDMARKS16.mirrored())]
    swapped = replace(crowd.candidates, joints2d=joints)
    notes = associate(crowd.cameras, swapped, RATE, names=NAMES).notes
    assert notes[0].startswith("left and right joints look swapped in view back: check")
    exchanged = crowd.candidates.select([2, 1, 0])
    try:
        notes = associate(crowd.cameras, exchanged, RATE, people=2, names=NAMES).notes
    except InputError as error:
        notes = (str(error),)
    assert any("views front and back look exchanged" in note for note in notes)
    assert not any("counted from 0" in note for note in notes)


def test_each_view_has_a_name() -> None:
    crowd = make_crowd(1, views=3)
    with pytest.raises(InputError, match="names are 2, expected one for each of 3 views"):
        associate(crowd.cameras, crowd.candidates, RATE, names=NAMES[:2])


def test_pixels_of_the_very_images_are_not_of_another_size() -> None:
    """Networks that follow one of two people by turns looked so, and cannot be given otherwise."""
    crowd = make_crowd(1, count=2, views=3)
    other = replace(crowd.candidates, joints2d=2.0 * crowd.candidates.joints2d)
    notes = []
    for resized in (True, False):
        config = AssociationConfig(resized=resized)
        try:
            notes.append(associate(crowd.cameras, other, RATE, config=config).notes)
        except InputError as error:
            notes.append((str(error),))
    said = [any("in pixels of videos of" in note for note in each) for each in notes]
    assert said == [True, False]

"""Bodies from what is known of a person."""

from __future__ import annotations

import pytest

from perfcap.actor.body_model import BodyModel
from perfcap.errors import InputError
from perfcap.io.body_model import load_body_model
from perfcap.rigging.build_body import Person, build_body


@pytest.fixture(scope="module")
def model() -> BodyModel:
    return load_body_model()


def test_nothing_known_is_the_mean(model: BodyModel) -> None:
    assert not build_body(model, Person()).shape.any()


@pytest.mark.slow
def test_height_and_weight_are_met(model: BodyModel) -> None:
    found = build_body(model, Person(height=1.81, weight=74.0, gender=0.0))
    assert found.measurements.height == pytest.approx(1.81, abs=0.006)
    assert found.weight == pytest.approx(74.0, abs=1.5)


@pytest.mark.slow
def test_girths_are_met(model: BodyModel) -> None:
    found = build_body(model, Person(height=1.70, chest=0.95, waist=0.80, hip=1.02)).measurements
    assert found.height == pytest.approx(1.70, abs=0.006)
    assert found.chest == pytest.approx(0.95, abs=0.01)
    assert found.waist == pytest.approx(0.80, abs=0.01)
    assert found.hip == pytest.approx(1.02, abs=0.01)


def test_weight_and_gender_are_met(model: BodyModel) -> None:
    found = build_body(model, Person(weight=74.0, gender=0.0))
    assert found.weight == pytest.approx(74.0, abs=1.5)
    mean, slope = model.rig.attributes["gender"]
    assert mean + float(found.shape.numpy() @ slope) == pytest.approx(0.0, abs=0.1)


def test_older_people_are_older(model: BodyModel) -> None:
    young, old = (build_body(model, Person(age=age)).shape for age in (25.0, 75.0))
    assert (young - old).norm() > 0.5


@pytest.mark.long
def test_measures_that_nobody_has_are_told(model: BodyModel) -> None:
    person = Person(waist=1.3, hip=0.7)
    first, second = build_body(model, person).doubts(person)
    assert first.startswith("waist is 0.") and "metres, 1.3 was asked for" in first
    assert second.startswith("hip is 0.") and "0.7 was asked for" in second
    likely = Person(waist=0.9, hip=1.0)
    assert not list(build_body(model, likely).doubts(likely))


@pytest.mark.parametrize(
    ("values", "words"),
    [({"height": 175.0}, "height is 175; expected 1.3 to 2.2 metres"), ({"age": 4.0}, "years")],
)
def test_implausible_values_are_refused(values: dict[str, float], words: str) -> None:
    with pytest.raises(InputError, match=words):
        Person(**values)


@pytest.mark.long
def test_a_waist_that_was_measured_across_is_told(model: BodyModel) -> None:
    for waist, words in ((0.42, "kg and is 1.75 m tall"), (0.65, "")):
        person = Person(height=1.75, waist=waist)
        doubts = " ".join(build_body(model, person).doubts(person))
        assert words in doubts and bool(words) == bool(doubts)


def test_what_a_body_misses_is_logged(
    model: BodyModel, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Callers in Python had a waist 0.47 m smaller than was asked for, with no word."""
    monkeypatch.setitem(build_body.__globals__, "_ROUNDS", 1)  # the module has the function's name
    person = Person(chest=0.5, waist=1.0)
    built = build_body(model, person)
    assert [record.message for record in caplog.records] == list(built.doubts(person))
    assert caplog.records and "was asked for" in caplog.text

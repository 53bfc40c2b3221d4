"""What is said of the height of a body: to give it, where it can be given."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from perfcap.app import personal_body
from perfcap.app.auto_actor import Casting
from perfcap.app.capture_request import casting_of
from perfcap.app.personal_body import PersonalBody
from perfcap.commands.capture import Capture


def body() -> PersonalBody:
    fit: Any = SimpleNamespace(deviations=SimpleNamespace(height=0.04))
    clip = SimpleNamespace(views=3, start=0, names=())
    chosen: Any = SimpleNamespace(
        clip=clip, cameras=SimpleNamespace(views=3), detections=None, frames=()
    )
    return PersonalBody(cast(Any, None), fit, chosen, None)


@pytest.mark.parametrize(("alone", "said"), [(True, "only; give --height"), (False, "cm only")])
def test_a_height_that_is_not_known(
    alone: bool, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(personal_body, "fit_doubts", lambda *_, **__: ())
    (line,) = body().doubts(alone=alone)
    assert line.endswith(said)


@pytest.mark.parametrize("people", [None, 2])
def test_people_have_no_height(people: int | None) -> None:
    request = Capture(videos=(Path("a.mp4"), Path("b.mp4")), people=people)
    casting = casting_of(request, "auto")
    assert isinstance(casting, Casting)
    assert casting.alone == (people is None)

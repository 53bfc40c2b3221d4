"""Whole bodies that a file holds more than once, and clothes, which are none."""

from dataclasses import replace

import numpy as np
import pytest
from foreign_rigs import person

from perfcap.actor.anatomy import JOINTS
from perfcap.actor.template import Template
from perfcap.io.actor_layers import layer_findings

CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
FACES = np.array([(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7),
                  (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)])  # fmt: skip


def boxes(*tops: float) -> Template:
    """The joints of a person in boxes that end at these shares of the height."""
    plain = person()
    joints = {name: plain.bone(name) for name in JOINTS}
    low, high = plain.vertices.min(0) - 0.1, plain.vertices.max(0) + 0.1
    wide = [low + CORNERS * (high - low) * (1, top, 1) for top in tops]
    vertices = np.concatenate(wide)
    return replace(
        plain,
        joint_bones=joints,
        vertices=vertices,
        faces=np.concatenate([FACES + 8 * k for k in range(len(tops))]),
        weight_bones=np.zeros((len(vertices), 1), dtype=np.int64),
        weights=np.ones((len(vertices), 1)),
        uv=None,
        texture=None,
    )


def told(template: Template, *names: str) -> list[str]:
    return [found.what for found in layer_findings(template, [(name, 8) for name in names])]


def test_a_body_within_a_body_is_named() -> None:
    (what,) = told(boxes(1, 1.1), "body", "cage")
    assert what == "'body', 'cage' are each a whole body, one inside the other"


def test_clothes_over_a_body_are_none() -> None:
    assert not told(boxes(1, 0.8), "body", "overall")


@pytest.mark.parametrize(
    ("names", "count"),
    [
        (("hero_LOD0", "hero_LOD1", "hero_LOD2"), 1),
        (("lod 0", "lod 1", "eyes"), 1),
        (("face_LOD0", "body_LOD1", "hair"), 0),
        (("melody 1", "melody 2", "hair"), 0),
    ],
)
def test_levels_of_detail_are_known_by_their_names(names: tuple[str, ...], count: int) -> None:
    found = told(boxes(0.1, 0.1, 0.1), *names)
    assert len(found) == count and all("levels of detail" in what for what in found)

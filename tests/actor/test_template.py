"""Templates: what a constructor must refuse, keep and normalise."""

from dataclasses import replace

import numpy as np
import pytest

from perfcap.actor.template import Template, strongest_influences
from perfcap.errors import InputError

PNG = b"\x89PNG\r\n\x1a\n" + bytes(8)


def make(**changes: object) -> Template:
    rest = np.tile(np.eye(4), (2, 1, 1))
    rest[1, 1, 3] = 1.0
    fields = {
        "vertices": np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0]], dtype=float),
        "faces": np.array([[0, 1, 2]]),
        "bone_names": ("root", "tip"),
        "bone_parents": np.array([-1, 0]),
        "bone_rest": rest,
        "weight_bones": np.array([[0, 1], [0, 1], [1, 0], [0, 1]]),
        "weights": np.array([[0.25, 0.75], [1, 0], [1, 0], [1, 0]]),
    }
    return Template(**(fields | changes))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"vertices": np.full((4, 3), np.nan)}, "vertices has NaN"),
        ({"vertices": np.zeros((4, 2))}, "vertices has shape"),
        ({"faces": np.array([[0, 1, 4]])}, "faces has indices 0 to 4"),
        ({"faces": np.array([[0.0, 1.0, 2.0]])}, "faces has dtype"),
        ({"faces": np.zeros((0, 3), dtype=int)}, "empty mesh"),
        ({"bone_names": ("a", "a")}, "unique"),
        ({"bone_parents": np.array([1, -1])}, "before its parent"),
        ({"bone_parents": np.array([-1, 1])}, "before its parent"),
        ({"bone_rest": 2 * np.tile(np.eye(4), (2, 1, 1))}, "bone_rest has scale"),
        ({"bone_rest": np.tile(np.diag([-1.0, 1, 1, 1]), (2, 1, 1))}, "mirroring"),
        ({"weight_bones": np.full((4, 2), 2)}, "weight_bones has indices"),
        ({"weights": np.array([[1.5, -0.5]] * 4)}, "non-negative"),
        ({"weights": np.array([[0.5, 0.4]] * 4)}, "sum to 1"),
        ({"uv": np.zeros((3, 2))}, "uv has shape"),
        ({"texture": b"GIF89a"}, "a JPEG or a PNG"),
        ({"texture": PNG, "texture_mime": "image/jpeg"}, "texture"),
        ({"landmarks": {"toe": (2, np.zeros(3))}}, "landmarks"),
    ],
)
def test_refuses_what_cannot_be_used_in_one_line(changes: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        make(**changes)
    assert "\n" not in str(caught.value)


def test_arrays_are_own_read_only_copies() -> None:
    vertices = np.zeros((4, 3))
    template = make(vertices=vertices)
    vertices[0] = 5.0
    assert template.vertices[0, 0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        template.weights[0, 0] = 1.0


def test_replacing_a_field_checks_again_and_keeps_the_rest() -> None:
    template = make()
    assert np.array_equal(replace(template, name="b").weights, template.weights)
    with pytest.raises(InputError):
        replace(template, faces=np.array([[7, 8, 9]]))


def test_texture_type_is_found() -> None:
    assert make(texture=PNG).texture_mime == "image/png"


def test_dense_weights_put_each_share_on_its_bone() -> None:
    dense = make().dense_weights()
    np.testing.assert_allclose(dense, [[0.25, 0.75], [1, 0], [0, 1], [1, 0]])


def test_strongest_influences_merges_repeats_and_keeps_four() -> None:
    bones = np.array([[3, 1, 3, 2, 5, 6]])
    weights = np.array([[0.2, 0.3, 0.2, 0.15, 0.1, 0.05]])
    kept, shares = strongest_influences(bones, weights)
    assert kept.tolist() == [[3, 1, 2, 5]]
    np.testing.assert_allclose(shares, np.array([[0.4, 0.3, 0.15, 0.1]]) / 0.95)


def test_weld_merges_seams_but_not_layers_that_move_apart() -> None:
    template = make()
    index, representative = template.weld()
    assert index.tolist() == [0, 1, 2, 1]
    assert representative.tolist() == [0, 1, 2]
    np.testing.assert_array_equal(template.vertices[representative][index], template.vertices)
    other = template.weights[:, :2].copy()
    other[3] = (0.5, 0.5)
    apart = make(weights=other)
    assert len(apart.weld()[1]) == 4


def test_unknown_bone_names_the_known_ones() -> None:
    assert make().bone("tip") == 1
    with pytest.raises(InputError, match="root, tip"):
        make().bone("tail")

"""Rendered and augmented crops: reproducible, and their joints stay where they are."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from motion_files import write_library

from perfcap.detect.joint_set import LANDMARKS
from perfcap.errors import InputError
from perfcap.io.body_model import load_body_model
from perfcap.train.augment import Framing, cut, random_framing, spoil
from perfcap.train.backgrounds import Backgrounds
from perfcap.train.cast import Cast
from perfcap.train.config import Augmentation, SceneData
from perfcap.train.crop_batches import Ahead, CropBatches
from perfcap.train.crop_store import CropStore, render_crops
from perfcap.train.motion_library import MotionLibrary
from perfcap.train.photographs import Mixture
from perfcap.train.scenes import Scenes, Shot

DATA = SceneData(size=64, group=1, places=1, texture=32, shadowed=0.0)


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> Scenes:
    library = MotionLibrary.read(write_library(tmp_path_factory.mktemp("motion"), frames=30))
    return Scenes(Cast(load_body_model(), (), library, DATA), Backgrounds(), DATA, 0)


def dotted(side: int = 96) -> Shot:
    """A dark picture with a bright dot at each of four joints."""
    rng = np.random.default_rng(0)
    joints = rng.uniform(30, 60, (16, 2)).astype(np.float32)
    image = np.zeros((side, side, 3), np.uint8)
    for x, y in joints[:4]:
        cv2.circle(image, (round(float(x)), round(float(y))), 2, (255, 255, 255), -1)
    parts = np.zeros((side // 4,) * 2, np.uint8)
    return Shot(image, joints, rng.normal(size=(16, 3)).astype(np.float32), 200.0, True, parts)


def test_a_number_is_a_picture(scenes: Scenes) -> None:
    one, same, other = (scenes.group(n)[0] for n in (1, 1, 2))
    assert np.array_equal(one.image, same.image) and np.array_equal(one.joints3d, same.joints3d)
    assert not np.array_equal(one.image, other.image)
    assert one.image.shape == (64, 64, 3) and one.image.std() > 3


def test_joints_fill_the_middle_of_a_shot(scenes: Scenes) -> None:
    for number in range(4, 9):
        shot = scenes.group(number)[0]
        if not shot.present:
            continue
        low, high = shot.joints2d.min(0), shot.joints2d.max(0)
        np.testing.assert_allclose(0.5 * (low + high), 31.5, atol=1.5)
        assert (high - low).max() * DATA.margin == pytest.approx(64, rel=0.1)
        # 3D positions seen from the distance that their size tells are the 2D ones
        hips = [LANDMARKS.index("l_hip"), LANDMARKS.index("r_hip")]
        rays = (shot.joints2d - 31.5) / shot.focal
        rows = np.concatenate([np.eye(2)[None].repeat(16, 0), -rays[:, :, None]], 2).reshape(-1, 3)
        right = (rays * shot.joints3d[:, 2:] - shot.joints3d[:, :2]).reshape(-1)
        root = np.linalg.lstsq(rows, right, rcond=None)[0]
        seen = shot.joints3d + root
        np.testing.assert_allclose(seen[:, :2] / seen[:, 2:], rays, atol=2e-4)
        np.testing.assert_allclose(shot.joints3d[hips].mean(0), 0, atol=1e-5)


@pytest.mark.parametrize(
    "framing",
    [
        Framing(),
        Framing(zoom=1.3, turn=0.4, shift=(0.1, -0.05)),
        Framing(zoom=0.8, turn=-0.7, mirror=True),
    ],
)
def test_joints_go_with_the_picture(framing: Framing) -> None:
    shot = dotted()
    view = cut(shot, framing, 128, 1.8)
    names = [LANDMARKS[j] for j in range(4)]
    if framing.mirror:  # dots are on what is the other side now
        names = [{"r": "l"}.get(n[0], n[0]) + n[1:] if n[1] == "_" else n for n in names]
    for name in names:
        x, y = view.joints2d[LANDMARKS.index(name)]
        assert view.image[round(float(y)), round(float(x))].mean() > 120
    assert view.inside.all() and view.known.all() and view.posed
    lengths = np.linalg.norm(view.joints3d, axis=1)
    if framing.mirror:
        assert sorted(lengths) == pytest.approx(sorted(np.linalg.norm(shot.joints3d, axis=1)))
    else:
        np.testing.assert_allclose(lengths, np.linalg.norm(shot.joints3d, axis=1), rtol=1e-5)


def test_turning_turns_positions_alike() -> None:
    shot = dotted()
    plain, turned = (cut(shot, Framing(turn=t), 128, 1.8) for t in (0.0, 0.5))
    c, s = np.cos(0.5), np.sin(0.5)
    turn = np.array([[c, -s], [s, c]])
    for before, after in (
        (plain.joints2d - 63.5, turned.joints2d - 63.5),
        (plain.joints3d[:, :2], turned.joints3d[:, :2]),
    ):
        forth, back = before @ turn.T, before @ turn
        assert np.abs(after - forth).max() < 1e-3 or np.abs(after - back).max() < 1e-3
    angle = [np.arctan2(*v.joints2d[3] - 63.5) - np.arctan2(*v.joints3d[3, :2]) for v in
             (plain, turned)]  # fmt: skip
    assert np.cos(angle[0] - angle[1]) == pytest.approx(1, abs=1e-5)  # the same way round


def test_what_is_unknown_is_neither_inside_nor_nan() -> None:
    shot = dotted()
    joints = shot.joints2d.copy()
    joints[5] = np.nan
    view = cut(
        replace(shot, joints2d=joints, joints3d=0 * shot.joints3d + np.nan), Framing(), 64, 1.8
    )
    assert not view.known[5] and not view.inside[5] and not view.posed
    assert np.isfinite(view.joints2d).all() and np.isfinite(view.joints3d).all()
    nobody = cut(replace(shot, present=False), Framing(), 64, 1.8)
    assert not nobody.inside.any() and nobody.known.all()


def test_spoiling_keeps_bytes() -> None:
    rng = np.random.default_rng(0)
    always = Augmentation(blur=1.0, noise=1.0, jpeg=1.0, cut=1.0)
    picture = np.full((48, 48, 3), 120, np.uint8)
    spoilt = spoil(picture.copy(), always, rng)
    assert spoilt.dtype == np.uint8 and spoilt.shape == picture.shape and spoilt.std() > 2
    framings = [random_framing(always, rng) for _ in range(200)]
    assert 0.3 < np.mean([f.mirror for f in framings]) < 0.7
    assert min(f.zoom for f in framings) < 0.8 < 1.1 < max(f.zoom for f in framings)


@pytest.mark.long
def test_store_is_made_once_and_read_back(scenes: Scenes, tmp_path: Path) -> None:
    told: list[tuple[str, int, int]] = []
    store = render_crops(tmp_path, scenes, 3, {"a": 1}, lambda *what: told.append(what))
    assert len(store) == 32 and told == [("render", 0, 1)]
    shot, original = store[2], scenes.group(2)[0]
    assert np.abs(shot.image.astype(float) - original.image).mean() < 12  # JPEG
    assert np.array_equal(shot.joints2d, original.joints2d) and shot.focal == original.focal
    stamp = (tmp_path / "crops_0000.npz").stat().st_mtime_ns
    render_crops(tmp_path, scenes, 3, {"a": 1})
    assert (tmp_path / "crops_0000.npz").stat().st_mtime_ns == stamp
    with pytest.raises(InputError, match="crops of other settings"):
        render_crops(tmp_path, scenes, 3, {"a": 2})
    part = dict(np.load(tmp_path / "crops_0000.npz"))
    np.savez(tmp_path / "crops_0000.npz", **(part | {"joints3d": part["joints3d"] * np.nan}))
    with pytest.raises(InputError, match="not finite; delete it"):
        CropStore(tmp_path)[0]
    (tmp_path / "crops_0000.npz").write_bytes(b"nothing")
    with pytest.raises(InputError, match="is damaged"):
        CropStore(tmp_path)[0]
    (tmp_path / "crops_0000.npz").unlink()
    with pytest.raises(InputError, match="no such file"):
        CropStore(tmp_path)
    with pytest.raises(InputError, match="has no crops"):
        CropStore(tmp_path / "nowhere")


class Killed(Exception):
    pass


@pytest.mark.long
def test_parts_of_a_killed_call_are_taken_for_those_of_its_settings_alone(
    scenes: Scenes, tmp_path: Path
) -> None:
    def kill(stage: str, done: int, total: int) -> None:
        if done == 1:
            raise Killed

    with pytest.raises(Killed):
        render_crops(tmp_path, scenes, 33, {"a": 1}, kill)
    part = tmp_path / "crops_0000.npz"
    stamp = part.stat().st_mtime_ns
    with pytest.raises(InputError, match="complete them"):
        CropStore(tmp_path)
    with pytest.raises(InputError, match="crops of other settings"):
        render_crops(tmp_path, scenes, 32, {"a": 2})
    assert len(render_crops(tmp_path, scenes, 33, {"a": 1})) == 64
    assert part.stat().st_mtime_ns == stamp  # it went on
    (tmp_path / "crops.json").unlink()
    with pytest.raises(InputError, match=r"holds crops_0000.npz but no crops.json.*delete them"):
        render_crops(tmp_path, scenes, 33, {"a": 1})


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "is not valid JSON"), ("", "is empty"), ("[1]", "has no numbers of parts"),
        ('{"each": 32}', "has no numbers of parts"), ('{"parts": "a", "each": 1}', "no numbers"),
    ],
)  # fmt: skip
def test_a_damaged_description_is_a_sentence(
    scenes: Scenes, tmp_path: Path, text: str, said: str
) -> None:
    (tmp_path / "crops.json").write_text(text)
    for use in (lambda: CropStore(tmp_path), lambda: render_crops(tmp_path, scenes, 1, {"a": 1})):
        with pytest.raises(InputError, match=f"crops.json: .*{said}"):
            use()


class Few:
    def __len__(self) -> int:
        return 5

    def __getitem__(self, number: int) -> Shot:
        shot = dotted()
        return replace(shot, focal=100.0 + number)


def test_batches_depend_on_their_number_alone() -> None:
    batches = CropBatches(Few(), 1.8, Augmentation(), 3)
    ahead = Ahead(batches.batch)
    for number in (0, 1, 2, 7, 8):
        direct, guessed = batches.batch(number, 3, 32), ahead(number, 3, 32)
        assert torch.equal(direct.crops, guessed.crops)
        assert torch.equal(direct.joints3d, guessed.joints3d)
    assert direct.crops.shape == (3, 3, 32, 32) and direct.crops.dtype == torch.float32


def test_an_epoch_shows_every_shot_once() -> None:
    seen: list[int] = []

    class Counted(Few):
        def __getitem__(self, number: int) -> Shot:
            seen.append(number)
            return super().__getitem__(number)

    batches = CropBatches(Counted(), 1.8, Augmentation(), 0)
    for number in range(4):
        batches.batch(number, 5, 32)
    assert all(sorted(seen[k : k + 5]) == [0, 1, 2, 3, 4] for k in range(0, 20, 5))
    assert seen[:5] != seen[5:10] or seen[5:10] != seen[10:15]


def test_mixtures_take_turns() -> None:
    class Many(Few):
        def __len__(self) -> int:
            return 8

    mixture = Mixture(Few(), Many())
    assert len(mixture) == 16 and [mixture[n].focal for n in range(4)] == [100, 100, 101, 101]
    assert mixture[15].focal == 107 and mixture[14].focal == 102


def test_no_shots() -> None:
    class Nothing(Few):
        def __len__(self) -> int:
            return 0

    with pytest.raises(InputError, match="crops: are none"):
        CropBatches(Nothing(), 1.8, Augmentation(), 0)


def test_backgrounds_of_a_folder(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(InputError, match="no such folder"):
        Backgrounds(tmp_path / "none")
    with pytest.raises(InputError, match="has no pictures"):
        Backgrounds(tmp_path)
    cv2.imwrite(str(tmp_path / "red.png"), np.full((40, 60, 3), (0, 0, 255), np.uint8))
    assert Backgrounds().digest is None
    assert Backgrounds(tmp_path).digest == Backgrounds(tmp_path).digest is not None
    drawn = [Backgrounds(tmp_path).draw(32, rng) for _ in range(12)]
    assert sum(bool((d == (255, 0, 0)).all()) for d in drawn) >= 6
    (tmp_path / "red.png").write_bytes(b"not a picture")
    with pytest.raises(InputError, match="cannot be read as a picture"):
        for _ in range(12):
            Backgrounds(tmp_path).draw(32, rng)

"""USD: what its own library reads, skins and samples is what was captured."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from takes import make_take, person

from perfcap.actor.actor import Actor
from perfcap.io.export import FORMATS, Options, Recording
from perfcap.io.export.recording import Z_UP
from perfcap.io.result import read_result
from perfcap.pipeline import CaptureConfig
from perfcap.pipeline.performance import Performance
from perfcap.pipeline.surface import SkinnedSurface, StoredSurface

pytest.importorskip("pxr", reason="the extra usd is not installed")

FRAMES = 5
PNG = bytes.fromhex(
    "89504e470d0a1a0a0000000d4948445200000001000000010802000000907753de0000000c4944415408d7"
    "63f8ffff3f0005fe02fea735818e0000000049454e44ae426082"
)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    template = person().template
    joints = {name: bone for bone, name in enumerate(template.bone_names)}
    names = ("mixamorig:Hips", *template.bone_names[1:])
    uv = np.random.default_rng(0).random((len(template.vertices), 2))
    named = replace(template, bone_names=names, joint_bones=joints, uv=uv, texture=PNG)
    take = make_take(FRAMES, turns=2.0, rate=25.0, actor=Actor(named))
    parts = (take.actor, take.cameras, take.detections, take.truth, take.rate, CaptureConfig())
    folder = tmp_path_factory.mktemp("results") / "r"
    surface = StoredSurface(SkinnedSurface(take.actor, take.truth)[:].float() + 0.02)
    Performance(*parts, surface=surface).save(folder)
    return Recording(read_result(folder), "Zoë", 0, FRAMES)


def stage(path: Path):  # type: ignore[no-untyped-def]
    from pxr import Usd

    return Usd.Stage.Open(str(path))


def skinned_points(path: Path, time: float) -> np.ndarray:
    """Points as the library's own skinning poses them."""
    from pxr import Usd, UsdGeom, UsdSkel, Vt

    opened = stage(path)
    cache = UsdSkel.Cache()
    root = UsdSkel.Root(opened.GetDefaultPrim())
    cache.Populate(root, Usd.TraverseInstanceProxies())
    prims = {prim.GetName(): prim for prim in opened.Traverse()}
    query = cache.GetSkelQuery(UsdSkel.Skeleton(prims["skeleton"]))
    points = Vt.Vec3fArray(UsdGeom.Mesh(prims["body"]).GetPointsAttr().Get())
    transforms = query.ComputeSkinningTransforms(time)
    skinning = cache.GetSkinningQuery(prims["body"])
    assert skinning.ComputeSkinnedPoints(transforms, points, time)
    return np.array(points)


@pytest.mark.parametrize(("unit", "scale", "up"), [("m", 1.0, "y"), ("cm", 100.0, "z")])
@pytest.mark.parametrize("kind", ["usd", "usdz"])
def test_skin_surface_axes_and_units(
    kind: str, unit: str, scale: float, up: str, recording: Recording, tmp_path: Path
) -> None:
    from pxr import UsdGeom

    plain = replace(recording, name="Zoë")
    FORMATS[kind].write(tmp_path, plain.facing_up(up), Options(unit=unit))
    suffix = {"usd": ".usdc", "usdz": ".usdz"}[kind]
    texture = ["Zoë_texture.png"] if kind == "usd" else []
    names = [f"Zoë{suffix}", f"Zoë_surface{suffix}", *texture]
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(names)
    turn = Z_UP if up == "z" else np.eye(3)
    posed = replace(plain.result, surface=None).vertices(slice(0, FRAMES))
    for time in range(FRAMES):
        found = skinned_points(tmp_path / names[0], time) / scale
        np.testing.assert_allclose(found, posed[time] @ turn.T, atol=1e-5)
    opened = stage(tmp_path / names[1])
    assert UsdGeom.GetStageUpAxis(opened) == up.upper()
    assert UsdGeom.GetStageMetersPerUnit(opened) == pytest.approx(1 / scale)
    assert opened.GetTimeCodesPerSecond() == 25 and opened.GetEndTimeCode() == FRAMES - 1
    mesh = UsdGeom.Mesh(opened.GetDefaultPrim().GetChild("body"))
    surface = plain.vertices(0, FRAMES) @ turn.T
    for time in range(FRAMES):
        points = np.array(mesh.GetPointsAttr().Get(time)) / scale
        np.testing.assert_allclose(points, surface[time], atol=1e-6)
        extent = np.array(mesh.GetExtentAttr().Get(time)) / scale
        np.testing.assert_allclose(extent, [points.min(0), points.max(0)], atol=1e-6)


def test_names_textures_and_turns(recording: Recording, tmp_path: Path) -> None:
    from pxr import Sdf, UsdShade, UsdSkel

    folder = tmp_path / "out"
    folder.mkdir()
    named = replace(recording, name="tänzer")
    FORMATS["usd"].write(folder, named, Options())
    opened = stage(folder / "tänzer.usdc")
    prims = {prim.GetName(): prim for prim in opened.Traverse()}
    skeleton = UsdSkel.Skeleton(prims["skeleton"])
    assert skeleton.GetJointsAttr().Get()[0] == "mixamorig_Hips"
    assert skeleton.GetJointNamesAttr().Get()[0] == "mixamorig:Hips"
    asset = UsdShade.Shader(prims["texture"]).GetInput("file").Get()
    assert isinstance(asset, Sdf.AssetPath) and Path(asset.resolvedPath).read_bytes() == PNG
    wraps = [UsdShade.Shader(prims["texture"]).GetInput(f"wrap{axis}").Get() for axis in "ST"]
    assert wraps == ["repeat", "repeat"]
    clip = UsdSkel.Animation(prims["clip"]).GetRotationsAttr()
    turns = np.array([[(q.GetReal(), *q.GetImaginary()) for q in clip.Get(t)]
                      for t in range(FRAMES)])  # fmt: skip
    assert (turns[1:] * turns[:-1]).sum(-1).min() > 0  # no jumps between q and -q


def test_without_a_surface_there_is_one_file(recording: Recording, tmp_path: Path) -> None:
    named = replace(recording, name="a")
    FORMATS["usdz"].write(tmp_path, named, Options(surface=False))
    assert [p.name for p in tmp_path.iterdir()] == ["a.usdz"]


def test_surfaces_of_long_clips_come_in_pieces(
    recording: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from pxr import UsdGeom

    from perfcap.io.export import usd

    monkeypatch.setattr(usd, "_MOST_BYTES", 3 * 24 * len(recording.template.vertices))
    FORMATS["usdz"].write(tmp_path, replace(recording, name="a"), Options())
    names = ["a.usdz", "a_surface_000000-000001.usdz", "a_surface_000002-000004.usdz"]
    assert sorted(p.name for p in tmp_path.iterdir()) == names
    opened = stage(tmp_path / names[2])
    assert (opened.GetStartTimeCode(), opened.GetEndTimeCode()) == (2, 4)
    points = UsdGeom.Mesh(opened.GetDefaultPrim().GetChild("body")).GetPointsAttr().Get(3)
    np.testing.assert_allclose(np.array(points), recording.vertices(3, 4)[0], atol=1e-6)

"""Prims of a USD stage: mesh, material, skeleton, animation and points in time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from perfcap.actor.template import Template
from perfcap.geometry.rotation import aligned
from perfcap.io.export.meshes import SeamlessNormals
from perfcap.io.export.options import Options, identifier, unique_names
from perfcap.io.export.recording import Recording

Floats = NDArray[np.float64]
Prim = Any  # the bindings have no types


@dataclass(frozen=True, eq=False)
class Scene:
    """A stage under construction.

    Attributes:
        stage: with its axes, unit and times set.
        root: path of the default prim.
        recording: what moves.
        scale: units of the stage in a metre.
        start: time code of the first frame.
    """

    stage: Prim
    root: str
    recording: Recording
    scale: float
    start: int = 0

    @classmethod
    def begin(cls, stage: Prim, recording: Recording, options: Options, start: int = 0) -> Self:
        """Axes, unit, frame rate and the prim that holds everything; a frame is a time code."""
        from pxr import UsdGeom, UsdSkel

        up = UsdGeom.Tokens.z if recording.axes[2, 1] > 0.5 else UsdGeom.Tokens.y
        UsdGeom.SetStageUpAxis(stage, up)
        UsdGeom.SetStageMetersPerUnit(stage, 1 / options.per_metre)
        stage.SetFramesPerSecond(recording.rate)
        stage.SetTimeCodesPerSecond(recording.rate)
        stage.SetStartTimeCode(start)
        stage.SetEndTimeCode(start + recording.frames - 1)
        root = f"/{identifier(recording.name)}"
        prim = UsdSkel.Root.Define(stage, root).GetPrim()
        prim.SetDisplayName(recording.name)
        stage.SetDefaultPrim(prim)
        return cls(stage, root, recording, options.per_metre, start)


def add_mesh(scene: Scene, texture: str | None) -> Prim:
    """The mesh in its rest pose, painted."""
    from pxr import UsdGeom, Vt

    template = scene.recording.template
    mesh = UsdGeom.Mesh.Define(scene.stage, f"{scene.root}/body")
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateDoubleSidedAttr(True)
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(template.faces), 3, "i4")))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(template.faces.astype("i4").ravel()))
    points = template.vertices * scene.scale
    mesh.CreatePointsAttr(_vectors(points))
    mesh.CreateExtentAttr(_extent(points))
    mesh.CreateNormalsAttr(_vectors(SeamlessNormals(template)(points)))
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    _paint(scene, mesh, template, texture)
    return mesh


def add_surface(scene: Scene, mesh: Prim) -> None:
    """Points and normals of every frame."""
    recording = scene.recording
    normals = SeamlessNormals(recording.template)
    time = scene.start
    for block in recording.blocks():
        for vertices in block * np.float32(scene.scale):
            mesh.GetPointsAttr().Set(_vectors(vertices), time)
            mesh.GetExtentAttr().Set(_extent(vertices), time)
            mesh.GetNormalsAttr().Set(_vectors(normals(vertices)), time)
            time += 1


def add_skeleton(scene: Scene, mesh: Prim) -> None:
    """Skeleton, skinning and clip.

    Bones carry their own names in ``jointNames``; paths of joints are made of what USD allows.
    """
    from pxr import Gf, UsdSkel, Vt

    template, recording = scene.recording.template, scene.recording
    joints = Vt.TokenArray(_joint_paths(template))
    skeleton = UsdSkel.Skeleton.Define(scene.stage, f"{scene.root}/skeleton")
    skeleton.CreateJointsAttr(joints)
    skeleton.CreateJointNamesAttr(Vt.TokenArray(template.bone_names))
    skeleton.CreateBindTransformsAttr(_matrices(_scaled(template.bone_rest, scene.scale)))
    rest = _scaled(to_parents(template, template.bone_rest), scene.scale)
    skeleton.CreateRestTransformsAttr(_matrices(rest))
    binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    binding.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    binding.CreateGeomBindTransformAttr(Gf.Matrix4d(1))
    binding.CreateSkinningMethodAttr(UsdSkel.Tokens.dualQuaternion)  # as captured with
    width = template.weights.shape[1]
    indices = np.where(template.weights > 0, template.weight_bones, 0).astype("i4")
    binding.CreateJointIndicesPrimvar(False, width).Set(Vt.IntArray.FromNumpy(indices.ravel()))
    weights = template.weights.astype("f4")
    binding.CreateJointWeightsPrimvar(False, width).Set(Vt.FloatArray.FromNumpy(weights.ravel()))
    clip = UsdSkel.Animation.Define(scene.stage, f"{scene.root}/skeleton/clip")
    clip.CreateJointsAttr(joints)
    moving = to_parents(template, recording.posed_bones)
    _add_clip(clip, moving, scene.scale)
    UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel().SetTargets(
        [clip.GetPath()]
    )
    # what the character reaches at any time, for programs that cull by it
    places = recording.posed_bones[..., :3, 3].reshape(-1, 3)
    reach = np.linalg.norm(np.ptp(template.vertices, axis=0)) / 2
    bounds = np.stack([places.min(0) - reach, places.max(0) + reach]) * scene.scale
    UsdSkel.Root(scene.stage.GetDefaultPrim()).CreateExtentAttr(_extent(bounds))


def to_parents(template: Template, bones: Floats) -> Floats:
    """Bone-to-parent transforms of bone-to-world ones, (..., B, 4, 4)."""
    parents = template.bone_parents
    above = np.where(
        (parents < 0)[:, None, None], np.eye(4), np.linalg.inv(bones[..., parents, :, :])
    )
    local: Floats = above @ bones
    return local


def _add_clip(clip: Prim, moving: Floats, scale: float) -> None:
    from pxr import Gf, Vt

    shape = moving.shape[:2]
    turns = Rotation.from_matrix(moving[..., :3, :3].reshape(-1, 3, 3)).as_quat()
    quaternions = torch.from_numpy(turns.reshape(*shape, 4).transpose(1, 0, 2))
    smooth = aligned(quaternions).numpy().transpose(1, 0, 2).astype("f4")  # x, y, z, w
    places = (moving[..., :3, 3] * scale).astype("f4")
    clip.CreateScalesAttr(Vt.Vec3hArray(shape[1], Gf.Vec3h(1, 1, 1)))
    translations, rotations = clip.CreateTranslationsAttr(), clip.CreateRotationsAttr()
    for time in range(shape[0]):
        translations.Set(_vectors(places[time]), time)
        rotations.Set(Vt.QuatfArray.FromNumpy(np.ascontiguousarray(smooth[time])), time)


def _joint_paths(template: Template) -> tuple[str, ...]:
    paths: list[str] = []
    names = unique_names(template.bone_names, identifier)
    for name, parent in zip(names, template.bone_parents.tolist(), strict=True):
        paths.append(name if parent < 0 else f"{paths[parent]}/{name}")
    return tuple(paths)


def _paint(scene: Scene, mesh: Prim, template: Template, texture: str | None) -> None:
    from pxr import Gf, Sdf, UsdGeom, UsdShade, Vt

    types = Sdf.ValueTypeNames
    material = UsdShade.Material.Define(scene.stage, f"{scene.root}/material")
    shader = UsdShade.Shader.Define(scene.stage, f"{scene.root}/material/surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    shader.CreateInput("roughness", types.Float).Set(0.9)
    color = shader.CreateInput("diffuseColor", types.Color3f)
    color.Set(Gf.Vec3f(0.7))
    output = shader.CreateOutput("surface", types.Token)
    material.CreateSurfaceOutput().ConnectToSource(output)
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)
    if template.uv is None:
        return
    flipped = template.uv * (1.0, -1.0) + (0.0, 1.0)  # the origin is at the bottom left
    primvars = UsdGeom.PrimvarsAPI(mesh)
    coordinates = primvars.CreatePrimvar("st", types.TexCoord2fArray, UsdGeom.Tokens.vertex)
    coordinates.Set(Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(flipped, "f4")))
    if texture is None:
        return
    reader = UsdShade.Shader.Define(scene.stage, f"{scene.root}/material/coordinates")
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", types.String).Set("st")
    image = UsdShade.Shader.Define(scene.stage, f"{scene.root}/material/texture")
    image.CreateIdAttr("UsdUVTexture")
    image.CreateInput("file", types.Asset).Set(f"./{texture}")
    image.CreateInput("sourceColorSpace", types.Token).Set("sRGB")
    for wrap in ("wrapS", "wrapT"):
        image.CreateInput(wrap, types.Token).Set("repeat")
    found = reader.CreateOutput("result", types.Float2)
    image.CreateInput("st", types.Float2).ConnectToSource(found)
    color.ConnectToSource(image.CreateOutput("rgb", types.Float3))


def _vectors(values: NDArray[Any]) -> Any:
    from pxr import Vt

    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(values, "f4"))


def _extent(points: NDArray[Any]) -> Any:
    return _vectors(np.stack([points.min(0), points.max(0)]))


def _matrices(transforms: Floats) -> Any:
    """Matrices of row vectors, as USD has them."""
    from pxr import Vt

    return Vt.Matrix4dArray.FromNumpy(np.ascontiguousarray(transforms.mT))


def _scaled(transforms: Floats, scale: float) -> Floats:
    scaled = transforms.copy()
    scaled[..., :3, 3] *= scale
    return scaled

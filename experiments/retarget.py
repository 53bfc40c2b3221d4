"""Recorded motion on six rigs of six conventions: what of it is kept.

Expect limbs within 3 degrees of the source's, feet that slide at most 1.2 times as far, and wrists
within 2 cm, scaled. Bodies differ in build: their limbs are lengthened and shortened by up to 15 %.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import torch
from makehuman_rigs import build, rigs
from numpy.typing import NDArray
from report import DATA, Report, Table, data_folder, main

from perfcap.actor.actor import Actor
from perfcap.actor.template import Template
from perfcap.io import models_folder
from perfcap.io.actor import load_actor
from perfcap.io.actor_import import import_actor
from perfcap.io.gltf_write import save_animation
from perfcap.io.moving_rig import MovingRig, read_moving_rig
from perfcap.pipeline.camera_path import orbit
from perfcap.pipeline.free_view import draw_free_view
from perfcap.pipeline.joint_motion import JointMotion
from perfcap.pipeline.retarget_scores import retarget_scores
from perfcap.pipeline.retargeting import retarget
from perfcap.pipeline.surface import SkinnedSurface
from perfcap.pipeline.surroundings import Surroundings

sys.path.append(str(Path(__file__).resolve().parents[1] / "tests"))
from foreign_rigs import MIXAMO, UNREAL, VRM, sided

MMD = {
    "pelvis": "下半身", "spine": "上半身2", "neck": "首", "head": "頭",
    **sided("左", "右", shoulder="{}腕", elbow="{}ひじ", wrist="{}手首", hip="{}足", knee="{}ひざ",
            ankle="{}足首"),
}  # fmt: skip
# log factors of trunk, head, shoulders, upper arm, forearm, hips, thigh, shank, foot
BUILDS = {
    "tall": dict(thigh=0.12, shank=0.14, upper_arm=0.08, forearm=0.08),
    "stocky": dict(thigh=-0.12, shank=-0.14, shoulders=0.12, hips=0.1, upper_arm=-0.05,
                   forearm=-0.05),
    "young": dict(head=0.15, thigh=-0.15, shank=-0.15, upper_arm=-0.12, forearm=-0.12,
                  trunk=-0.1),
    "long forearms": dict(forearm=0.1, shank=-0.05),
}  # fmt: skip
SHOWN, AZIMUTH = 70, 60.0  # frame of the demo, degrees around from ahead
CMU = ("02_01", "02_04", "07_04", "05_02")
OTHERS = ("kick", "dance-short", "walk-back", "bow")


@dataclass(frozen=True)
class Experiment:
    """Which data."""

    data: Path = DATA
    """Folder of the recordings and of the MakeHuman assets."""
    frames: int = 240
    """At most, of each clip."""
    picture: Path | None = None
    """Draw one frame of the demo on every rig into this file."""


def run(config: Experiment) -> Report:
    """Put every clip on every rig."""
    clips = list(_clips(config))
    panels: list[NDArray[np.uint8]] = []
    rows, all_limbs, worst = [], [], []
    with tempfile.TemporaryDirectory() as scratch:
        for name, target in _targets(config.data, Path(scratch)):
            if config.picture is not None:
                panels.append(panel(name, target, clips[0][1]))
            limbs, reach, slides, seconds, frames = [], [], [], 0.0, 0
            for clip, rig in clips:
                joints = JointMotion(torch.tensor(rig.rotation), torch.tensor(rig.position))
                started = time.perf_counter()
                found = retarget(rig.actor, joints, target, rig.rate)
                seconds += time.perf_counter() - started
                frames += len(rig.frames)
                scores = retarget_scores(rig.actor, joints, target, found, rig.rate)
                limbs.append(scores.limbs.flatten())
                reach.append(scores.reach.flatten())
                slides.append((scores.slide, scores.source_slide))
                worst.append(
                    (
                        f"{clip} on {name}",
                        float(scores.limbs.median()),
                        float(scores.reach.median()),
                        scores.slide,
                        scores.source_slide,
                    )
                )
            limb, hand = torch.cat(limbs), torch.cat(reach)
            own, theirs = np.nanmean(np.array(slides), 0)
            all_limbs.append(limb)
            rows.append((name, float(limb.median()), float(limb.mean()), float(limb.quantile(0.95)),
                         float(hand.median()), float(hand.quantile(0.95)), own, theirs,
                         own / theirs, 1000 * seconds / frames))  # fmt: skip
    if config.picture is not None:
        cv2.imwrite(str(config.picture), np.concatenate(panels, 1)[..., ::-1])
    columns = ("rig", "limbs °", "mean", "95 %", "wrists mm", "95 %", "slide mm", "source's",
               "ratio", "ms a frame")  # fmt: skip
    each = ("clip", "limbs °", "wrists mm", "slide mm", "source's")
    tables = (
        Table(f"{len(clips)} clips on each rig; medians where not stated", columns, tuple(rows), 2),
        Table("each", each, tuple(worst), 2),
    )
    return Report(tables)


def panel(name: str, target: Actor, rig: MovingRig) -> NDArray[np.uint8]:
    """A frame of a clip on a target, as perfcap render draws it."""
    joints = JointMotion(torch.tensor(rig.rotation), torch.tensor(rig.position))
    motion = retarget(rig.actor, joints, target, rig.rate).motion
    places, surface = target.joints(motion).detach(), SkinnedSurface(target, motion)
    around = Surroundings.around(places, surface, shown=slice(SHOWN, SHOWN + 1))
    # of two pictures of an orbit, the first is from ahead and the second half the way around
    path = orbit(places, around, [SHOWN, SHOWN], (300, 240), rig.rate, 2 * AZIMUTH)
    picture = np.ascontiguousarray(list(draw_free_view(target.template, surface, around, path))[1])
    place, font = (8, 288), cv2.FONT_HERSHEY_SIMPLEX
    cv2.putText(picture, name, place, font, 0.45, (30, 30, 30), 1, cv2.LINE_AA)
    return picture


def _clips(config: Experiment) -> Iterator[tuple[str, MovingRig]]:
    """Recorded motion of two sources, and the shipped demo's."""
    yield "demo", shipped_clip()
    cmu, bandai = (data_folder(config.data, f"mocap_{n}_bvh") for n in ("cmu", "bandai"))
    for name in CMU:  # at 120 a second, behind an inserted T-pose
        rig = read_moving_rig(cmu / f"{name}.bvh", slice(1, 1 + 4 * config.frames))
        yield f"CMU {name}", _every(rig, 4)
    for name in OTHERS:
        path = bandai / f"dataset-1_{name}_normal_001.bvh"
        yield f"Bandai {name}", read_moving_rig(path, slice(0, config.frames))


def _every(rig: MovingRig, step: int) -> MovingRig:
    return replace(rig, rotation=rig.rotation[::step], position=rig.position[::step],
                   rate=rig.rate / step, frames=rig.frames[::step])  # fmt: skip


def shipped_clip() -> MovingRig:
    """The true motion of the shipped clip, on the shipped actor."""
    from perfcap.actor.motion import Motion

    actor = load_actor("sam")
    with np.load(models_folder() / "demo" / "truth.npz", allow_pickle=False) as data:
        values = [torch.tensor(data[n]) for n in ("root_translation", "root_rotation", "angles")]
        rate, numbers = float(data["fps"]), data["frames"]
    translation, rotation, angles = (each.to(actor.vertices) for each in values)
    pose = actor.skeleton(Motion(translation, rotation, angles))
    return MovingRig(actor, pose.rotation.numpy(), pose.position.numpy(), rate, numbers)


def _targets(data: Path, folder: Path) -> Iterator[tuple[str, Actor]]:
    """Six rigs, read from files as other programs write them."""
    yield "perfcap (sam)", load_actor("sam")
    skeleton, weights = rigs(data_folder(data, "makehuman"))["default"]
    assert weights is not None
    body = build(data_folder(data, "makehuman"), skeleton, weights)
    yield "MakeHuman default", _read(body, folder / "makehuman.glb")
    for number, (convention, names, kind) in enumerate((
        ("Mixamo, tall", MIXAMO, "tall"),
        ("Unreal, stocky", UNREAL, "stocky"),
        ("VRM, young", VRM, "young"),
        ("MMD, long forearms", MMD, "long forearms"),
    )):  # fmt: skip
        actor = _read(body, folder / f"body_{number}.glb")
        scales = [BUILDS[kind].get(group, 0.0) for group in actor.skeleton.group_names]
        grown = actor.resized(torch.tensor(scales).to(actor.vertices)).template
        yield convention, _read(_named(grown, names), folder / f"rig_{number}.glb")


def _named(template: Template, names: dict[str, str]) -> Template:
    """Bones of the joints as a convention calls them, others by numbers."""
    own = {bone: names[joint] for joint, bone in template.joint_bones.items()}
    called = (own.get(bone, f"extra_{bone:03}") for bone in range(len(template.bone_names)))
    return replace(template, bone_names=tuple(called), joint_bones={}, landmarks={})


def _read(template: Template, path: Path) -> Actor:
    still = np.tile(np.eye(4), (1, len(template.bone_names), 1, 1))
    save_animation(path, template, still, 30.0)
    return import_actor(path).actor


if __name__ == "__main__":
    main(run, Experiment, "retarget")

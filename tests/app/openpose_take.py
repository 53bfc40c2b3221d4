"""The joints of a take as OpenPose writes them."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from takes import Take, write_json

from perfcap.detect.joint_set import BODY_25, LANDMARKS

_TOES = {"l_big_toe": "l_toe", "r_big_toe": "r_toe"}


def write_openpose(
    folder: Path, take: Take, frames: Sequence[int], offset: int = 0, shift: float = 0.0
) -> None:
    """A file a frame, over those that are there.

    Args:
        folder: made if missing.
        take: of one view.
        frames: those that get a file.
        offset: number of the first frame.
        shift: added to all coordinates, pixels.
    """
    folder.mkdir(exist_ok=True)
    for f in frames:
        points = np.zeros((len(BODY_25.joints), 3))
        for i, name in enumerate(_TOES.get(joint, joint) for joint in BODY_25.joints):
            if name in LANDMARKS:
                joint = take.detections.joints2d[f, 0, LANDMARKS.index(name)].numpy()
                points[i] = (*(joint + shift), 0.9)
        points[8] = (points[9] + points[12]) / 2  # the middle of the hips tells the set
        people = [{"pose_keypoints_2d": points.ravel().tolist()}]
        write_json(folder / f"take_{offset + f:012d}_keypoints.json", {"people": people})

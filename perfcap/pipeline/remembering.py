"""A network whose answers are kept: asked again in the same order, it need not run."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from perfcap.detect.candidates import Candidates
from perfcap.detect.decode import Estimate
from perfcap.detect.joint_set import JointSet
from perfcap.detect.look import CropNetwork
from perfcap.detect.manifest import Manifest
from perfcap.io.journal import Record
from perfcap.pipeline.checkpoint import Codec, Kept

_FIELDS = ("joints2d", "confidence", "joints3d")


class RememberingNetwork:
    """A joint network that follows a person through a view, frame after frame.

    Which crops it is asked about follows from its own answers, so a run that starts over asks the
    same questions until the kept answers end.
    """

    def __init__(self, network: CropNetwork, kept: Kept) -> None:
        self.manifest: Manifest = network.manifest
        self.network, self.kept = network, kept
        self._known = kept.recall(ESTIMATES)

    @property
    def joint_set(self) -> JointSet:
        """Names of its joints."""
        return self.network.joint_set

    def estimate(self, crops: NDArray[np.uint8]) -> Estimate:
        """Joints of crops (N, h, w, 3)."""
        known = next(self._known, None)
        if known is not None and len(known.joints2d) == len(crops):
            return known
        self._known = iter(())
        return self.kept.add(ESTIMATES, self.network.estimate(crops))


def _pack(estimate: Estimate) -> Record:
    found = {name: getattr(estimate, name) for name in _FIELDS}
    if estimate.candidates is not None:
        found |= {"places": estimate.candidates.places, "support": estimate.candidates.support}
    return {name: value.numpy(force=True) for name, value in found.items() if value is not None}


def _unpack(record: dict[str, Any]) -> Estimate:
    found = {name: torch.from_numpy(value) for name, value in record.items()}
    candidates = Candidates(found["places"], found["support"]) if "places" in found else None
    return Estimate(found["joints2d"], found["confidence"], found.get("joints3d"), candidates)


ESTIMATES: Codec[Estimate] = Codec(_pack, _unpack)

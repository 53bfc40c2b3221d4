"""A temporal network from 2D joint tracks to 3D poses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import torch
from torch import Tensor, nn

from perfcap.detect.joint_set import LANDMARKS
from perfcap.detect.lifting import FEATURES
from perfcap.detect.retarget import mid_hip
from perfcap.train.config import LifterConfig

_JOINTS = len(LANDMARKS)


class Lifter(nn.Module):
    """Root-relative 3D joints of every frame of a track (after Pavllo et al. 2019).

    Residual blocks of three dilated taps see 81 frames. Unlike there, every frame of the input is
    answered: beyond its ends a track goes on as it ends.
    """

    def __init__(self, config: LifterConfig | None = None) -> None:
        super().__init__()
        self.config = config or LifterConfig()
        width = self.config.channels
        self.enter = nn.Linear(FEATURES, width)
        self.blocks = nn.ModuleList(
            _Block(width, dilation, self.config.dropout) for dilation in self.config.dilations
        )
        self.across = nn.Linear(FEATURES, 4 * _JOINTS)
        self.leave = nn.Sequential(nn.LayerNorm(width), nn.Linear(width, 4 * _JOINTS))

    @property
    def has_thirds(self) -> bool:
        """Whether taps are apart by powers of three, as ``sparse`` needs them."""
        taps = self.config.dilations
        return taps == tuple(3**k for k in range(len(taps)))

    def forward(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """Poses of tracks.

        Args:
            features: (N, F, 49) of ``lifting_features``.

        Returns:
            Joints (N, F, 16, 3), metres, relative to the middle of the hips, in axes whose z is
            the ray to the person; and the expected distance of each from the truth, (N, F, 16).
        """
        hidden = self.enter(features)
        for block in self.blocks:
            hidden = block(hidden)
        return self._answer(features, hidden)

    def sparse(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """Three poses of tracks of just the frames that an answer depends on, for learning.

        A tenth of the cost a track: where taps are apart by powers of three, each block is needed
        at a third of the frames of the one before. The middle one of the three is ``forward``'s;
        the outer ones have neighbours on one side only, as at the ends of a track.

        Args:
            features: (N, 81, 49).

        Returns:
            As ``forward``, at the frames 13, 40 and 67.

        Raises:
            ValueError: another number of frames, or taps that are not apart by powers of three.
        """
        frames = 3 ** len(self.blocks)
        apart = tuple(3**k for k in range(len(self.blocks)))
        if features.shape[1] != frames or not self.has_thirds:
            raise ValueError(
                f"{features.shape[1]} frames with taps {self.config.dilations} apart; expected "
                f"{frames} frames and {apart}"
            )
        hidden = self.enter(features)
        blocks = [cast(_Block, block) for block in self.blocks]
        for block in blocks[:-1]:
            hidden = block.thirds(hidden)
        hidden = blocks[-1].neighbors(hidden)
        return self._answer(features[:, apart[-1] // 2 :: apart[-1]], hidden)

    def _answer(self, features: Tensor, hidden: Tensor) -> tuple[Tensor, Tensor]:
        # what lies across the image is nearly what is seen: the blocks need not carry it
        found = self.leave(hidden) + self.across(features)
        joints = found[..., : 3 * _JOINTS].unflatten(-1, (_JOINTS, 3))
        spread = 0.1 * found[..., 3 * _JOINTS :].clamp(-4.0, 3.0).exp()
        return joints - mid_hip(joints).unsqueeze(-2), spread


class LifterCommittee(nn.Module):
    """Lifters of one size whose answers are averaged: each errs a little otherwise.

    Args:
        members: at least one.
    """

    def __init__(self, members: Sequence[Lifter]) -> None:
        super().__init__()
        self.config = members[0].config
        self.members = nn.ModuleList(members)

    def forward(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """As a ``Lifter``'s; where its members are apart, more is to be expected than each says.

        The spread is the root of their mean squared spread and of the variance among them (the law
        of total variance; Lakshminarayanan and others 2017).
        """
        joints, spread = zip(*(member(features) for member in self.members), strict=True)
        places = torch.stack(joints)
        middle = places.mean(0)
        apart = (places - middle).square().sum(-1).mean(0)
        return middle, (torch.stack(spread).square().mean(0) + apart).sqrt()


class _Block(nn.Module):
    """Three taps in time and two layers a frame, around a residual."""

    def __init__(self, width: int, dilation: int, dropout: float) -> None:
        super().__init__()
        self.dilation = dilation
        self.before = nn.LayerNorm(width)
        self.taps = nn.Linear(3 * width, width)
        self.mix = nn.Linear(width, width)
        self.dropout = nn.Dropout(dropout)

    def forward(self, hidden: Tensor) -> Tensor:
        """(N, F, width) to the same."""
        return self._tap(hidden, self.dilation)

    def neighbors(self, hidden: Tensor) -> Tensor:
        """The same for frames that are as far apart as the taps."""
        return self._tap(hidden, 1)

    def thirds(self, hidden: Tensor) -> Tensor:
        """The same at every third of frames that are as far apart as the taps."""
        tracks, frames, width = hidden.shape
        taps = self.before(hidden).reshape(tracks, frames // 3, 3 * width)
        return self._update(hidden[:, 1::3], taps)

    def _tap(self, hidden: Tensor, step: int) -> Tensor:
        frames = hidden.shape[1]
        normed = self.before(hidden)
        # the ends repeated, by joining rather than padding: exports keep any number of frames
        first, last = normed[:, :1], normed[:, -1:]
        long = torch.cat((first.expand(-1, step, -1), normed, last.expand(-1, step, -1)), 1)
        taps = [long[:, k * step : k * step + frames] for k in range(3)]
        return self._update(hidden, torch.cat(taps, -1))

    def _update(self, hidden: Tensor, taps: Tensor) -> Tensor:
        result: Tensor = hidden + self.dropout(self.mix(torch.relu(self.taps(taps))))
        return result

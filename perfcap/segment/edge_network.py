"""A network that says where contours belong: edges as they are, weighed by what is around them.

It looks at an image and at its edges, and says how much each edge counts and what a unit of contour
costs there. It has no labels to learn from: the distance of joints from the truth after a solve
goes back through pose and visibility to its weights (``experiments/learned_edges.py``).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from torch import Tensor, nn

from perfcap.errors import InputError
from perfcap.segment.edge_field import EdgeSettings
from perfcap.segment.edge_tensors import edge_tensors

_WIDE = 16  # channels
_MOST = 1 << 20  # bytes of a file of weights
_SMALL = 16  # px, below which an image is padded


class EdgeNetwork(nn.Module):
    """How much edges count and what contours cost, of an image and its edges.

    With its first weights both are those of ``find_edges``. In the mean of a picture they always
    are: the network says where, and the weight of contours how much.

    Args:
        settings: how edges are found.
    """

    def __init__(self, settings: EdgeSettings | None = None) -> None:
        super().__init__()
        self.settings = settings or EdgeSettings()
        last = nn.Conv2d(_WIDE, 2, 1)
        nn.init.zeros_(last.weight)
        assert last.bias is not None
        nn.init.zeros_(last.bias)
        self.layers = nn.Sequential(
            nn.Conv2d(6, _WIDE, 5, padding=2),
            nn.ReLU(),
            nn.Conv2d(_WIDE, _WIDE, 5, padding=2),
            nn.ReLU(),
            last,
        )

    @classmethod
    def load(cls, path: Path, settings: EdgeSettings | None = None) -> EdgeNetwork:
        """With weights of a safetensors file.

        Raises:
            InputError: it is none, too large, or of another network.
        """
        network = cls(settings)
        try:
            if path.stat().st_size > _MOST:
                raise InputError(
                    f"{path}: is larger than {_MOST} bytes; expected weights of an EdgeNetwork"
                )
            with safe_open(str(path), "pt") as file:
                weights = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        except (SafetensorError, OSError, ValueError) as error:
            raise InputError(f"{path}: holds no weights ({error})") from None
        own = network.state_dict()
        fits = own.keys() == weights.keys() and all(
            own[name].shape == each.shape and bool(each.isfinite().all())
            for name, each in weights.items()
        )
        if not fits:
            raise InputError(f"{path}: holds no finite weights of an EdgeNetwork; train it again")
        network.load_state_dict(weights)
        return network.eval()

    def forward(self, image: Tensor) -> Tensor:
        """Edges in two numbers and price (3, h, w) of an image, RGB from 0 to 1, (3, h, w)."""
        plain = edge_tensors(image, self.settings)
        seen = torch.cat((image - 0.5, 5 * plain))
        gain, price = self.layers(seen[None])[0]
        edges = plain[:2] * gain.clamp(-3, 3).exp()
        # how much contours count beside joints is another question
        usual, now = (
            each.square().sum(0).clamp(min=1e-12).sqrt().mean() for each in (plain[:2], edges)
        )
        return torch.cat((edges * (usual / now), plain[2:] + 0.1 * (price - price.mean())))

    def look(self, picture: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Edges and price (3, h, w) of an RGB picture (h, w, 3).

        Raises:
            InputError: they are not finite.
        """
        height, width = picture.shape[:2]
        rim = max(0, _SMALL - height), max(0, _SMALL - width)
        padded = np.pad(picture, ((0, rim[0]), (0, rim[1]), (0, 0)), mode="edge")
        image = torch.from_numpy(padded).permute(2, 0, 1).float() / 255
        with torch.no_grad():
            found: NDArray[np.float32] = self(image).numpy()
        if not np.isfinite(found).all():
            raise InputError(
                "an edge network answers with NaN or infinity; its weights are too large, train it "
                "again"
            )
        return found[:, :height, :width]

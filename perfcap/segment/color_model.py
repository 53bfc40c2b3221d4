"""Colours of a region as a mixture of Gaussians (Rother et al. 2004).

Nothing here is random: clusters start from splits along principal axes (Orchard and Bouman
1991), and large regions are thinned by taking every n-th pixel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perfcap.array_checks import require_shape
from perfcap.segment import _color_numba
from perfcap.setting_checks import Settings, require_counts

Colors = NDArray[np.float32]

_LOG_2PI = float(np.log(2 * np.pi))


@dataclass(frozen=True)
class ColorSettings(Settings):
    """How colours are modelled.

    Attributes:
        components: Gaussians of a mixture.
        rounds: assignments and refits from the splits; one round when there is a model to start
            from.
        noise: standard deviation added to every component, grey levels: what the camera and the
            video codec do to a flat colour.
        samples: pixels looked at, at most.
    """

    components: int = 5
    rounds: int = 4
    noise: float = 3.0
    samples: int = 8000

    def __post_init__(self) -> None:
        super().__post_init__()
        require_counts(self, "components", "samples")


@dataclass(frozen=True)
class ColorModel:
    """A mixture of K Gaussians over RGB in grey levels.

    Attributes:
        weights: (K,), sum to one.
        means: (K, 3).
        covariances: (K, 3, 3).
    """

    weights: NDArray[np.float64]
    means: NDArray[np.float64]
    covariances: NDArray[np.float64]

    def __post_init__(self) -> None:
        count = len(self.weights)
        require_shape(self.means, "means", (count, 3), "(K, 3), of each weight")
        require_shape(self.covariances, "covariances", (count, 3, 3), "(K, 3, 3), of each weight")

    def log_density(self, pixels: Colors) -> Colors:
        """Natural log of the density per cubic grey level at colours (n, 3), (n,)."""
        _require_colors(pixels)
        out = np.empty(len(pixels), np.float32)
        _color_numba.log_density(np.ascontiguousarray(pixels, np.float32), *self._kernel(), out)
        return out

    def refit(self, pixels: Colors, settings: ColorSettings) -> ColorModel:
        """Assign each pixel to its component and fit these anew; components that lost all go."""
        _require_colors(pixels)
        moments = np.zeros((len(self.weights), 10))
        _color_numba.gather(np.ascontiguousarray(pixels, np.float32), *self._kernel(), moments)
        return _from_moments(moments, settings.noise)

    def _kernel(self) -> tuple[Colors, Colors, Colors]:
        whitening = np.linalg.inv(np.linalg.cholesky(self.covariances))
        log_scale = np.log(np.diagonal(whitening, axis1=1, axis2=2)).sum(1)
        offset = np.log(self.weights) + log_scale - 1.5 * _LOG_2PI
        return (
            self.means.astype(np.float32),
            np.ascontiguousarray(whitening, np.float32),
            offset.astype(np.float32),
        )


def fit_color_model(
    pixels: Colors, settings: ColorSettings, start: ColorModel | None = None
) -> ColorModel | None:
    """The mixture that describes colours (n, 3); None if there are none.

    Args:
        pixels: in grey levels.
        settings: of the mixture.
        start: a similar region's, such as the previous frame's.
    """
    if not len(pixels):
        return None
    _require_colors(pixels)
    chosen = np.ascontiguousarray(pixels[:: _step(len(pixels), settings)], np.float32)
    model, rounds = start, 1
    if model is None:
        model, rounds = _split(chosen, settings), settings.rounds
    for _ in range(rounds):
        model = model.refit(chosen, settings)
    return model


def _require_colors(pixels: Colors) -> None:
    require_shape(pixels, "pixels", (None, 3), "(n, 3), the colours of each")


def thinned(image: Colors, region: NDArray[np.bool_], settings: ColorSettings) -> Colors:
    """Colours (n, 3) of an image (h, w, 3) in a region (h, w), no more than are looked at."""
    places = np.flatnonzero(region)
    chosen: Colors = image.reshape(-1, 3)[places[:: _step(len(places), settings)]]
    return chosen


def _step(count: int, settings: ColorSettings) -> int:
    return max(1, -(-count // settings.samples))


def _split(pixels: Colors, settings: ColorSettings) -> ColorModel:
    """Clusters by halving, again and again, the one that is spread most along one direction."""
    clusters = [pixels.astype(np.float64)]
    while len(clusters) < settings.components:
        spreads = [_principal(c) for c in clusters]
        widest = int(np.argmax([len(c) * s for c, (s, _) in zip(clusters, spreads, strict=True)]))
        cluster = clusters[widest]
        along = (cluster - cluster.mean(0)) @ spreads[widest][1]
        if not (along > 0).any():
            break  # one single colour
        clusters[widest : widest + 1] = [cluster[along > 0], cluster[along <= 0]]
    products = [np.stack([c[:, i] * c[:, j] for i, j in _PAIRS], 1) for c in clusters]
    moments = np.stack(
        [
            np.concatenate([[len(c)], c.sum(0), p.sum(0)])
            for c, p in zip(clusters, products, strict=True)
        ]
    )
    return _from_moments(moments, settings.noise)


_PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


def _principal(cluster: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
    """Variance along, and direction of, the longest axis of a cluster (n, 3)."""
    offset = cluster - cluster.mean(0)
    values, vectors = np.linalg.eigh(offset.T @ offset / len(cluster))
    return float(values[-1]), vectors[:, -1]


def _from_moments(moments: NDArray[np.float64], noise: float) -> ColorModel:
    moments = moments[moments[:, 0] > 0]
    count = moments[:, :1]
    means = moments[:, 1:4] / count
    covariances = np.empty((len(moments), 3, 3))
    for column, (i, j) in enumerate(_PAIRS):
        value = moments[:, 4 + column] / count[:, 0] - means[:, i] * means[:, j]
        covariances[:, i, j] = covariances[:, j, i] = value
    covariances += noise**2 * np.eye(3)
    return ColorModel(count[:, 0] / count.sum(), means, covariances)

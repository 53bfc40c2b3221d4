"""Colours of Gaussians: true ones are found, wrong candidates are dropped."""

import numpy as np
import torch
from synthetic import actor
from synthetic import cameras as circle
from test_refine_contours import Film

from perfcap.actor.volume import GaussianCentres, Volume
from perfcap.pipeline.images import Images
from perfcap.pipeline.volume_colors import color_volume, trimmed_means
from perfcap.render.density import visibilities
from perfcap.render.texture import to_linear, to_srgb

F64 = torch.float64


def test_half_of_the_candidates_is_dropped() -> None:
    good = torch.tensor([0.2, 0.5, 0.7], dtype=F64).expand(6, 1, 3)
    bad = torch.rand(5, 1, 3, generator=torch.Generator().manual_seed(1), dtype=F64)
    none = torch.full((3, 1, 3), torch.nan, dtype=F64)
    torch.testing.assert_close(trimmed_means(torch.cat((bad, good, none)))[0], good[0, 0])
    assert bool(trimmed_means(none).isnan().all())


def test_colours_of_a_rendered_volume() -> None:
    skeleton = actor().skeleton
    joints = torch.tensor([skeleton.rig.joints.index(n) for n in ("head", "spine", "l_knee")])
    ones = torch.ones(3, dtype=F64)
    places = skeleton.rest_positions[joints]
    volume = Volume(places, 0.1 * ones, 60 * ones, joints)
    points, motion = GaussianCentres(skeleton, volume), skeleton.rest_motion(2)
    true = torch.tensor([[0.9, 0.1, 0.1], [0.1, 0.8, 0.2], [0.1, 0.2, 0.9]], dtype=F64)
    size, cameras = 100, circle(3, size=100)
    y, x = torch.meshgrid(torch.arange(size), torch.arange(size), indexing="ij")
    grid = torch.stack((x, y), -1).reshape(-1, 2).double()
    views = []
    for view in range(3):
        widths = volume.deviations, volume.densities
        seen, left = visibilities(cameras.select([view]), points(motion)[0], *widths, grid)
        light = seen @ true + left[:, None] * 0.3
        image = to_srgb(light).reshape(size, size, 3).numpy()
        views.append(np.stack([image, image]))
    found = color_volume(volume, points, motion, Images(Film(views), cameras)).colors
    assert found is not None
    assert float((found - true).abs().max()) < 0.25
    assert bool((found.argmax(-1) == true.argmax(-1)).all())
    assert float(to_linear(torch.tensor([255], dtype=torch.uint8))) == 1

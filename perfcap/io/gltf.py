"""Characters as glTF 2.0: `load_template` reads a rig, `save_animation` writes it in motion."""

from perfcap.io.gltf_read import load_template
from perfcap.io.gltf_write import save_animation

__all__ = ["load_template", "save_animation"]

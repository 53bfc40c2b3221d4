"""Files to types and back."""

from perfcap.io.actor import find_actor, load_actor, models_folder
from perfcap.io.actor_folder import save_actor
from perfcap.io.actor_import import import_actor
from perfcap.io.body_model import load_body_model
from perfcap.io.bvh_read import BvhMotion, load_bvh
from perfcap.io.bvh_write import save_bvh
from perfcap.io.calibration import CameraRig, PixelMap, read_cameras, read_pixel_map
from perfcap.io.clip import Clip
from perfcap.io.detections import read_candidates, read_detections
from perfcap.io.gltf_read import load_template
from perfcap.io.gltf_write import save_animation
from perfcap.io.mask_files import save_masks
from perfcap.io.mesh import read_mesh
from perfcap.io.result import Result, read_result
from perfcap.io.surface_file import SurfaceFile, open_surface, save_surface
from perfcap.io.video_writer import VideoWriter

__all__ = [
    "BvhMotion",
    "CameraRig",
    "Clip",
    "PixelMap",
    "Result",
    "SurfaceFile",
    "VideoWriter",
    "find_actor",
    "import_actor",
    "load_actor",
    "load_body_model",
    "load_bvh",
    "load_template",
    "models_folder",
    "open_surface",
    "read_cameras",
    "read_candidates",
    "read_detections",
    "read_mesh",
    "read_pixel_map",
    "read_result",
    "save_actor",
    "save_animation",
    "save_bvh",
    "save_masks",
    "save_surface",
]

"""A camera: its file, its chain of effects, its random spread."""

from visaug.camera.camera import Camera, camera_file, shipped
from visaug.camera.randomize import draw

__all__ = ["Camera", "camera_file", "draw", "shipped"]

"""A camera from ordinary pictures of which nothing is known."""

from visaug.pictures.camera import camera_of_pictures

__all__ = ["camera_of_pictures"]

"""Random numbers of a camera: counter-based, one stream per image and one per camera."""

from visaug.core.sampling.stream import Stream, derive_key, signed

__all__ = ["Stream", "derive_key", "signed"]

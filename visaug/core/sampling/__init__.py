"""Random numbers of a camera: counter-based, one stream per image and one per camera."""

from visaug.core.sampling.stream import Stream, as_seed, derive_key, signed

__all__ = ["Stream", "as_seed", "derive_key", "signed"]

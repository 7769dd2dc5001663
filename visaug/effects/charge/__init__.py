"""In the pixel: from photons to electrons, their generation, storage, sharing and transfer."""

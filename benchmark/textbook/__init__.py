"""A second simulated camera: five sensors and 35 effects, written from textbooks without sight of visaug or of the other camera.

It shares with the other one how a sensor and a frame are described, the Tukey-lambda distribution, and how a set is
written. One generator serves a whole set, in a fixed order: the numbers of the effects, the targets, the maps of the
specimen, then frame by frame.
"""

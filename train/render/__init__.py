"""Rendered data: views of a spacecraft, and the cameras of the test domains."""

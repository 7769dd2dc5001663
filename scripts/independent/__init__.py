"""A camera in plain NumPy and SciPy, written from the physics and apart from visaug, to test it with.

Nothing here imports visaug: what the package is judged on must not share its mistakes.
"""

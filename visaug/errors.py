"""The one exception that a user's mistake raises."""


class InputError(ValueError):
    """Input that cannot be used.

    The message is ONE line that names the file, the field and what was expected, for example
    ``camera.yaml: read_noise.sigma_e: expected a number >= 0, got -1``. The program prints it and ends
    with exit status 2.
    """

"""Everything stands in pyproject.toml; only the mapping of `train/` to `visaug_train` needs code."""

from setuptools import find_packages, setup

setup(
    packages=[
        *find_packages(include=["visaug", "visaug.*"]),
        "visaug_train",
        *(f"visaug_train.{name}" for name in find_packages("train")),
    ],
    package_dir={"visaug_train": "train"},
)

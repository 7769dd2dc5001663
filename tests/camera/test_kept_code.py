"""Machine code that numba keeps on disk is never that of an older text."""

import ast
import hashlib
from pathlib import Path

import pytest

pytest.importorskip("numba")

from visaug.camera import colour_kernel, fast_kernel
from visaug.core.sampling import kernels


@pytest.mark.parametrize("function", [fast_kernel.expose, kernels.fill_poisson])
def test_it_lies_in_a_folder_named_after_the_text_of_the_shared_functions(function):
    text = hashlib.blake2b(Path(kernels.__file__).read_bytes(), digest_size=8).hexdigest()
    assert text in Path(str(function.stats.cache_path)).parts[-2]


@pytest.mark.parametrize("module", [fast_kernel, colour_kernel, kernels])
def test_nothing_else_of_the_package_is_compiled_into_it(module):
    """numba notices changes of a function's own file, the folder's name those of kernels.py."""
    tree = ast.parse(Path(module.__file__).read_text())
    taken = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module}
    taken |= {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    assert {name for name in taken if name.startswith("visaug")} <= {"visaug.core.sampling.kernels"}

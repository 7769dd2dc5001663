"""A Ray cluster, or Ray on this machine (extra `cluster`)."""

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from visaug.core.errors import InputError
from visaug.core.extras import extra


@contextmanager
def connected(address: str | None) -> Iterator[Any]:
    """The `ray` module, connected; a connection that is already there is used and left as it is.

    `address` is as `ray start --head` printed it, or `auto`; None or `local` for this machine.
    """
    with extra(field="cluster"):
        import ray
    ours = not ray.is_initialized()
    if ours:
        _connect(ray, None if address == "local" else address)
    try:
        yield ray
    finally:
        if ours:
            ray.shutdown()


def _connect(ray: Any, address: str | None) -> None:
    # or Ray says what a future release will do
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    _knock(address)
    try:
        ray.init(address=address, logging_level="ERROR", include_dashboard=False if not address else None)
    except (ConnectionError, ValueError, RuntimeError) as error:
        raise _no_answer(address, error) from None


def _knock(address: str | None) -> None:
    """Refuse an address where nobody listens at once: Ray itself tries for minutes."""
    host, _, port = (address or "").removeprefix("ray://").rpartition(":")
    if not (host and port.isdigit()):
        return  # this machine, or a word that Ray knows
    try:
        socket.create_connection((host, int(port)), timeout=10).close()
    except (OSError, OverflowError) as error:
        raise _no_answer(address, error) from None


def _no_answer(address: str | None, error: Exception) -> InputError:
    return InputError(
        f"no Ray cluster answers at {address}: {' '.join(str(error).split())[:200]}",
        field="cluster.address",
        expected="the address that `ray start --head` printed, auto, or nothing for this machine",
    )

"""Frame sets as a camera would take them."""

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import torch
from torch import Tensor

from visaug.camera import Camera
from visaug.errors import InputError
from visaug.frames import FrameRecord, FrameSet
from visaug.sampling import Stream, derive_key

BATCH_PIXELS = 600_000  # about what stays in a processor's cache while a batch goes through the chain


def simulate(
    camera: Camera,
    plan: FrameSet,
    seed: int = 0,
    progress: Callable[[str, int, int], None] | None = None,
) -> FrameSet:
    """The frames of `plan` as `camera` would take them: one camera, its fixed patterns kept, in order.

    Args:
        camera: the camera; randomize is not used, a camera under test is one camera.
        plan: what to take: its records, and its noiseless targets for scenes. Its pixels are not read.
        seed: chooses the individual camera (its maps) and the noise.
        progress: called with (description, done, total).

    Returns:
        A frame set in memory, uint16 DN.

    Raises:
        InputError: a flat without `photons`, a scene without `clean`, an image of which nothing is known.
    """
    frames: list[np.ndarray] = []
    for positions, block in exposures(camera, plan, seed):
        frames.extend(block.squeeze(1).numpy().astype(np.uint16))
        if progress is not None:
            progress("simulating frames", positions[-1] + 1, len(plan))
    cleans = {r.clean: plan.clean(i) for i, r in enumerate(plan.records) if r.kind == "scene" and r.clean}
    return FrameSet.from_arrays(plan.records, frames, cleans, bit_depth=camera.bit_depth)


def exposures(camera: Camera, plan: FrameSet, seed: int) -> Iterator[tuple[Sequence[int], Tensor]]:
    """The same frames batch by batch: positions in the plan and (B, 1, H, W) float32 DN."""
    memory: dict[str, Tensor] = {}
    camera_key = derive_key(seed, "camera")
    shown = None
    for positions in list(_batches(camera, plan)):
        records = [plan.records[i] for i in positions]
        r0, r1, c0, c1 = _window(camera, records[0])
        if shown not in (None, (r0, r1, c0, c1)):  # what the pixels of another window held is not known
            memory = {name: state for name, state in memory.items() if state.shape[-2:] == (1, 1)}
        shown = (r0, r1, c0, c1)
        keys = [derive_key(seed, "frame", record.sequence) for record in records]
        stream = Stream(keys, [camera_key] * len(records), 1, (range(r0, r1), range(c0, c1)))
        values = {
            "exposure_s": torch.tensor([record.exposure_s for record in records]),
            "gain_db": torch.tensor([float(record.gain_db) for record in records]),
            "temperature_c": torch.tensor([_temperature(camera, record) for record in records]),
        }
        photons = torch.stack([_photons(plan, i, (r1 - r0, c1 - c0)) for i in positions])
        yield positions, camera.expose(photons, stream, values, sequence=True, memory=memory)


def _batches(camera: Camera, plan: FrameSet) -> Iterator[list[int]]:
    batch: list[int] = []
    for i, record in enumerate(plan.records):
        r0, r1, c0, c1 = _window(camera, record)
        size = max(1, BATCH_PIXELS // ((r1 - r0) * (c1 - c0)))
        if batch and (len(batch) >= size or _window(camera, plan.records[batch[0]]) != (r0, r1, c0, c1)):
            yield batch
            batch = []
        batch.append(i)
    if batch:
        yield batch


def _window(camera: Camera, record: FrameRecord) -> tuple[int, int, int, int]:
    rows, columns = camera.resolution
    window = record.window or (0, rows, 0, columns)
    if window[1] > rows or window[3] > columns:
        raise InputError(
            f"{window} lies outside the sensor",
            file=record.file,
            field="region",
            expected=f"rows up to {rows}, columns up to {columns}",
        )
    return window


def _temperature(camera: Camera, record: FrameRecord) -> float:
    return camera.spec.temperature_c if record.temperature_c is None else float(record.temperature_c)


def _photons(plan: FrameSet, i: int, shape: tuple[int, int]) -> Tensor:
    record = plan.records[i]
    if record.kind in ("bias", "dark"):
        return torch.zeros(1, *shape)
    if record.kind == "flat":
        if record.photons is None:
            raise InputError(
                "a flat needs its photons to be simulated",
                file=record.file,
                field="photons",
                expected="mean photons per pixel",
            )
        return torch.full((1, *shape), float(record.photons))
    if record.kind == "scene":
        clean = torch.from_numpy(np.ascontiguousarray(plan.clean(i), np.float32))
        if tuple(clean.shape) != shape:
            raise InputError(f"is {tuple(clean.shape)}", file=record.clean, expected=f"{shape}, as the frame")
        return clean[None]
    raise InputError(
        f"a frame of kind {record.kind!r} cannot be simulated",
        file=record.file,
        field="kind",
        expected="bias, dark, flat or scene",
    )

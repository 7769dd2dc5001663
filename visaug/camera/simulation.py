"""Frame sets as a camera would take them."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from visaug.camera import Camera
from visaug.camera.chain import SharedSignals
from visaug.camera.history import DEEPEST, NOTHING, SMALL, Reach, is_of_whole_frame
from visaug.core.errors import InputError
from visaug.core.recurrent import Recurrent
from visaug.core.sampling import Stream, as_seed, derive_key
from visaug.frames import FrameRecord, FrameSet
from visaug.frames.frameset import simulated_set
from visaug.frames.record import Window

BATCH_PIXELS = 600_000  # about what stays in a processor's cache while a batch goes through the chain


def simulate(
    camera: Camera | str | Path,
    plan: FrameSet | str | Path,
    seed: int = 0,
    progress: Callable[[str, int, int], None] | None = None,
    keep: Sequence[int] | None = None,
    deepest: int = DEEPEST,
) -> FrameSet:
    """Simulates the frames of `plan`, in order, with one camera whose fixed patterns stay the same.

    Args:
        camera: the camera, or its file or name. Its `randomize` entries are not used: all frames are from one specimen.
        plan: records of the frames to simulate, with noiseless targets for scenes, or the path of a frames.csv or frame set.
            Its pixels are not read.
        seed: of the specimen (its fixed patterns) and of the temporal noise.
        progress: called with (description, done, total).
        keep: positions of the frames to simulate; None simulates all. See `exposures`.
        deepest: see `exposures`.

    Returns:
        A frame set in memory, uint16 DN.

    Raises:
        InputError: a flat frame without `photons`, a scene without `clean`, or a frame of kind image.

    Examples:
        >>> import numpy as np, visaug
        >>> from visaug.frames import FrameRecord
        >>> camera = visaug.Camera.load({"resolution": [8, 8], "gain_e_per_dn": 0.5, "black_level_dn": 100})
        >>> records = [FrameRecord(sequence=k, file=f"{k}", kind="bias", exposure_s=0.0, temperature_c=20.0) for k in range(2)]
        >>> plan = visaug.FrameSet.from_arrays(records, np.zeros((2, 8, 8)))
        >>> visaug.simulate(camera, plan).read(0).shape
        (8, 8)
    """
    camera, seed = Camera.load(camera), as_seed(seed)
    plan = FrameSet.of(plan, camera.resolution)
    frames: list[np.ndarray] = []
    places = range(len(plan)) if keep is None else sorted(keep)
    for positions, block in exposures(camera, plan, seed, keep, deepest):
        frames.extend(block.squeeze(1).numpy().astype(np.uint16))
        if progress is not None:
            progress("simulating frames", positions[-1] + 1, len(plan))
    records = [plan.records[i] for i in places]
    cleans = {
        r.clean: plan.clean(i) for i, r in zip(places, records, strict=True) if r.kind == "scene" and r.clean
    }
    return simulated_set(records, frames, cleans, camera.bit_depth, not camera.has_own_effects)


def with_chart(camera: Camera, plan: FrameSet) -> FrameSet:
    """The plan with a chart of edges and one small bright spot wherever a scene names no target.

    Levels are shares of the camera's saturation, 0.02 to 0.8; the spot is 5 times saturation.
    """
    open_scenes = [i for i, r in enumerate(plan.records) if r.kind == "scene" and not r.clean]
    if not open_scenes:
        return plan
    records = list(plan.records)
    cleans = {r.clean: plan.clean(i) for i, r in enumerate(records) if r.kind == "scene" and r.clean}
    for i in open_scenes:
        r0, r1, c0, c1 = window_of(camera, records[i])
        name = f"chart_{r1 - r0}x{c1 - c0}.npy"
        cleans.setdefault(name, _chart(r1 - r0, c1 - c0) * np.float32(camera.spec.saturation_photons))
        records[i] = replace(records[i], clean=name)
    windows = [window_of(camera, record) for record in records]
    unread = [np.broadcast_to(np.uint16(0), (r1 - r0, c1 - c0)) for r0, r1, c0, c1 in windows]
    return FrameSet.from_arrays(records, unread, cleans, bit_depth=camera.bit_depth)


def _chart(rows: int, columns: int) -> np.ndarray:
    """Squares of rising level on a dim ground, a slanted edge below, a spot, as shares of saturation."""
    y, x = np.mgrid[:rows, :columns]
    chart = np.full((rows, columns), 0.02, np.float32)
    side = max(columns // 8, 1)
    square = (y >= rows // 8) & (y < rows // 8 + side) & (x % side >= side // 3)
    chart[square] = 0.1 + 0.7 * (x[square] // side) / 7
    chart[(y > rows // 2) & (x > columns // 2 + (y - rows // 2) / 10)] = 0.5
    chart[3 * rows // 4 : 3 * rows // 4 + 3, columns // 4 : columns // 4 + 3] = 5.0
    return chart


def plan_for(camera: Camera) -> dict[str, Any]:
    """Options of `visaug.frames.plan.plan_groups` that suit a camera: its saturation, exposure, temperature and
    gain, and a dark ladder on which the dark current's shot noise passes the read noise.

    Where the camera has dark current of D e-/s and read noise of sigma e-, both variances are equal at
    sigma^2 / D seconds; the ladder stands at a quarter of that, at it, and at four times, below half of
    saturation. The temperature is the camera's alone, for not every camera can change it.
    """
    spec = camera.spec
    options: dict[str, Any] = {
        "saturation_photons": spec.saturation_photons,
        "exposure_s": spec.exposure_s,
        "temperatures_c": (spec.temperature_c,),
        "gains_db": (spec.gain_db,),
    }
    rate = camera.dark_rate_at()
    if rate > 0 and spec.read_noise.sigma_e > 0:
        equal = spec.read_noise.sigma_e**2 / rate
        longest = 0.5 * spec.saturation_photons * spec.quantum_efficiency / rate
        ladder = (min(x * equal, longest) for x in (0.25, 1.0, 4.0))
        options["dark_exposures_s"] = tuple(dict.fromkeys(float(f"{t:.2g}") for t in ladder))
    return options


def exposures(
    camera: Camera,
    plan: FrameSet,
    seed: int,
    keep: Iterable[int] | None = None,
    deepest: int = DEEPEST,
    shared: Recurrent | None = None,
) -> Iterator[tuple[Sequence[int], Tensor]]:
    """The same frames batch by batch: positions in the plan and (B, 1, H, W) float32 DN.

    Args:
        keep: positions of the frames that are wanted; all where left out. They come as they would out of the whole plan: the
            state of the camera before them is found as `visaug.camera.history` says.
        deepest: frames before a wanted one that are simulated at most, where the camera's pixels remember them.
        shared: signals of this plan and seed that other cameras have in common with this one: those that differ in late effects
            start from the same electrons. Cameras with memory make their own.
    """
    wanted = set(range(len(plan)) if keep is None else keep)
    reach = Reach.of(camera) if len(wanted) < len(plan) or shared is not None else NOTHING
    if reach != NOTHING:
        shared = None
    memory: dict[str, Tensor] = {}
    maps: dict[tuple, Tensor] = {}
    shown, done = None, 0
    for positions in batches(camera, plan, reach.simulated(wanted, deepest), reach.whole_frames):
        if reach.whole_frames:
            memory = _stepped(camera, plan, seed, memory, range(done, positions[0]))
        done = positions[-1] + 1
        window = window_of(camera, plan.records[positions[0]])
        if shown not in (None, window):  # the charge in the pixels of another window is unknown
            memory = {name: state for name, state in memory.items() if is_of_whole_frame(state)}
        shown = window
        shape = (window[1] - window[0], window[3] - window[2])
        photons = torch.stack([_photons(plan, i, shape) for i in positions])
        alike = None
        if shared is not None:
            lit = tuple(plan.records[i].photons for i in positions)
            alike = SharedSignals(shared, (camera.base, window, lit, *positions), camera.further)
        block = _exposed(camera, plan, positions, photons, seed, window, memory, maps, alike)
        got = [k for k, i in enumerate(positions) if i in wanted]
        if got:
            yield [positions[k] for k in got], block if len(got) == len(positions) else block[got]


def _exposed(
    camera: Camera,
    plan: FrameSet,
    positions: Sequence[int],
    photons: Tensor,
    seed: int,
    window: Window,
    memory: dict[str, Tensor],
    maps: dict[tuple, Tensor] | None = None,
    shared: SharedSignals | None = None,
) -> Tensor:
    """Frames of the plan under its conditions; `memory` and `maps`, the camera's own random numbers (see `Stream`), are carried
    from batch to batch.
    """
    records = [plan.records[i] for i in positions]
    r0, r1, c0, c1 = window
    keys = [derive_key(seed, "frame", record.sequence) for record in records]
    cameras = [derive_key(seed, "camera")] * len(records)
    stream = Stream(keys, cameras, 1, (range(r0, r1), range(c0, c1)), drawn=maps)
    own = camera.spec.temperature_c
    values: dict[str, Tensor | float] = {
        "exposure_s": torch.tensor([record.exposure_s for record in records]),
        "gain_db": torch.tensor([float(record.gain_db) for record in records]),
        "temperature_c": torch.tensor([float(own if (t := r.temperature_c) is None else t) for r in records]),
    }
    return camera.expose(photons, stream, values, sequence=True, memory=memory, shared=shared)


def _stepped(
    camera: Camera, plan: FrameSet, seed: int, memory: dict[str, Tensor], skipped: range
) -> dict[str, Tensor]:
    """The memory after frames that are not wanted, as far as it is one number for a whole frame."""
    state = {name: value for name, value in memory.items() if is_of_whole_frame(value)}
    for first in range(skipped.start, skipped.stop, 1000):  # frames whose states are stepped at a time
        positions = range(first, min(first + 1000, skipped.stop))
        levels = [_mean_photons(plan, i) for i in positions]
        photons = torch.tensor(levels).view(-1, 1, 1, 1).expand(-1, 1, SMALL, SMALL)
        _exposed(camera, plan, positions, photons, seed, (0, SMALL, 0, SMALL), state)
        state = {name: value for name, value in state.items() if is_of_whole_frame(value)}
    return memory | state


def _mean_photons(plan: FrameSet, i: int) -> float:
    record = plan.records[i]
    if record.kind != "scene":
        return float(record.photons or 0.0)
    return float(plan.clean(i).mean(dtype=np.float64)) if has_clean(plan, i) else 0.0


def has_clean(plan: FrameSet, i: int) -> bool:
    """Whether a plan holds the target of a scene: a part of a set leaves out those of frames long before any that is wanted."""
    try:
        plan.clean(i)
    except InputError:
        return False
    return True


def batches(
    camera: Camera, plan: FrameSet, positions: Sequence[int], consecutive: bool = False
) -> Iterator[list[int]]:
    """Positions that are taken together; `consecutive`: without any that are left out between them."""
    batch: list[int] = []
    for i in positions:
        r0, r1, c0, c1 = window_of(camera, plan.records[i])
        size = max(1, BATCH_PIXELS // ((r1 - r0) * (c1 - c0)))
        full = len(batch) >= size or (consecutive and batch and i > batch[-1] + 1)
        if batch and (full or window_of(camera, plan.records[batch[0]]) != (r0, r1, c0, c1)):
            yield batch
            batch = []
        batch.append(i)
    if batch:
        yield batch


def window_of(camera: Camera, record: FrameRecord) -> Window:
    rows, columns = camera.resolution
    window = record.window or (0, rows, 0, columns)
    if window[1] > rows or window[3] > columns:
        expected = f"rows up to {rows}, columns up to {columns}"
        raise InputError(
            f"{window} lies outside the sensor", file=record.file, field="region", expected=expected
        )
    return window


def _photons(plan: FrameSet, i: int, shape: tuple[int, int]) -> Tensor:
    record = plan.records[i]
    if record.kind in ("bias", "dark"):
        return torch.zeros(1, 1, 1).expand(1, *shape)
    if record.kind == "flat":
        if record.photons is None:
            problem = "a flat cannot be simulated without photons"
            raise InputError(problem, file=record.file, field="photons", expected="mean photons per pixel")
        return torch.full((1, 1, 1), float(record.photons)).expand(1, *shape)
    if record.kind == "scene":
        clean = torch.from_numpy(np.ascontiguousarray(plan.clean(i), np.float32))
        if tuple(clean.shape) != shape:
            raise InputError(f"is {tuple(clean.shape)}", file=record.clean, expected=f"{shape}, as the frame")
        if clean.isnan().any():
            raise InputError(
                "holds values that are no numbers", file=record.clean, expected="photons per pixel"
            )
        return clean[None]
    problem = f"a frame of kind {record.kind!r} cannot be simulated"
    raise InputError(problem, file=record.file, field="kind", expected="bias, dark, flat or scene")

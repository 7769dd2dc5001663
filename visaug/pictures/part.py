"""Pictures of unknown scenes, measured and simulated as a laboratory does frames.

Each picture's own smoothed version is taken for its scene: the black sky without light, flat lit regions at their own level.
The camera takes these scenes again, and both sets are looked at in the same regions (`visaug.pictures.regions`), so
that the content of the pictures is the same on both sides.
"""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from scipy import ndimage, stats
from torch import Tensor

from visaug.camera import Camera
from visaug.camera.chain import PAPER_ORDER
from visaug.core.sampling import Stream, derive_key
from visaug.effects import Effect, Stage
from visaug.frames import FrameRecord, FrameSet
from visaug.frames.stores import MemoryStore
from visaug.pictures.regions import dark_residuals, lit_residuals
from visaug.pictures.scenes import Scenes, decoded, encoded, scenes_of
from visaug.pictures.symmetry import STATISTICS, Sums, symmetry_sums
from visaug.statistics import OF_PICTURES, Fingerprint, View, fingerprint, fingerprint_values
from visaug.statistics.split import CONFIRM, FIND, WHOLE, Folds, share_out
from visaug.statistics.subsample import Selection

PLACE = "regions of pictures"


class _Residuals(MemoryStore):
    """Frames of what is left after the scene was taken off: of either sign."""

    def read(self, i: int) -> np.ndarray:
        return self._frames[i]

    numbers = read


def with_a_well(camera: Camera) -> Camera:
    """The camera with the converter's end as its full well, marked as assumed, where the file has none: pictures tell no other."""
    spec = camera.spec
    if spec.full_well_e is not None:
        return camera
    content = camera.to_dict()
    content["full_well_e"] = spec.range_e
    content["assumed"] = [*spec.assumed, "full_well_e"]
    return camera.with_content(content)


def _white(camera: Camera) -> float:
    """Photons of a pixel that the converter's range holds."""
    return camera.spec.range_e / camera.spec.quantum_efficiency


@dataclass(frozen=True)
class PicturePart:
    """Pictures in the place of a `Part` of a frame set."""

    scenes: Scenes  # what is simulated
    # (n, H, W) as measured, in 1/255 of full scale; empty where only simulations are wanted
    pictures: np.ndarray
    resolution: tuple[int, int]  # rows and columns of the sensor
    dn: float  # DN of the camera per 1/255 of full scale
    exposure_s: float
    place: str = PLACE
    views: tuple[View, ...] = OF_PICTURES
    given: Sums | None = None  # symmetries of these scenes as the camera file takes them

    @cached_property
    def frames(self) -> FrameSet:
        """What the regions of the measured pictures leave: a dark frame of each, and a flat of each class of its lit regions."""
        return self._frames(self.pictures, np.arange(len(self.scenes.numbers)))

    @cached_property
    def folds(self) -> Folds:
        return share_out(self.frames)

    def _chosen(self, use: str) -> np.ndarray:
        """Numbers of the pictures that find, or confirm, or of all: every third confirms."""
        every = np.arange(len(self.scenes.numbers))
        return {FIND: every[every % 3 != 2], CONFIRM: every[every % 3 == 2], WHOLE: every}[use]

    def measured(self, use: str) -> Fingerprint:
        chosen = self._chosen(use)
        found = fingerprint(self._frames(self.pictures[chosen], chosen), None, self.views, self.place)
        symmetry = self._symmetry(self.pictures[chosen], chosen).ratio - self.scenes.expected[0]
        values = np.concatenate([found.values, self._as_normal(symmetry, chosen)])
        return Fingerprint((*found.statistics, *STATISTICS), values)

    def simulated(self, camera: Camera, seed: int, uses: Sequence[str], shared: object) -> list[np.ndarray]:
        """Fingerprint values of one simulated set, for each use of its pictures; `shared` is of use for frames only."""
        taken_of = self._chosen(uses[0] if len(uses) == 1 else WHOLE)
        pictures, shaded = self._taken(camera, seed, taken_of)
        place = {int(n): k for k, n in enumerate(taken_of)}
        found = []
        for use in uses:
            chosen = self._chosen(use)
            here = [place[int(n)] for n in chosen]
            (values,) = fingerprint_values(self._frames(pictures[here], chosen), views=self.views)
            lens = None if shaded is None else shaded[here]
            found.append(np.concatenate([values, self._moved(pictures[here], lens, chosen, seed)]))
        return found

    def take(self, camera: Camera, seed: int) -> FrameSet:
        """What the regions of simulated pictures leave."""
        chosen = self._chosen(WHOLE)
        return self._frames(self._taken(camera, seed, chosen)[0], chosen)

    def _moved(
        self, pictures: np.ndarray, shaded: np.ndarray | None, chosen: np.ndarray, seed: int
    ) -> np.ndarray:
        """What the camera does to the symmetries, with what scenes and their expectation do to them by chance."""
        pictured, variance = self.scenes.symmetry.of(chosen), self.scenes.expected[1]
        rng = np.random.default_rng(derive_key(seed, "scenes") % 2**63)
        freedom = self._error(chosen)[1]
        # discovery and hold-out frames share the expectation, and each picture its sign with that in the whole set
        expectation = np.sqrt(variance) * rng.standard_normal(len(variance))
        rank = rng.random(len(variance))
        signs = rng.choice([-1.0, 1.0], len(self.scenes.numbers))[chosen]
        by_chance = signs @ pictured.deviations + expectation
        # as wide as an error that few pictures tell
        by_chance /= np.sqrt(stats.chi2.ppf(rank, freedom) / freedom)
        own = self._behind_the_lens(pictures, shaded, chosen).ratio
        given = np.zeros_like(own) if self.given is None else self.given.of(chosen).ratio
        return self._as_normal(own - given + by_chance, chosen)

    def compared_with(self, camera: Camera) -> "PicturePart":
        """The same, with the symmetries as the camera file takes these scenes: simulations differ from these by effects alone."""
        every = self._chosen(WHOLE)
        seeds = range(2**40, 2**40 + 8)  # of takes that no simulated set has
        sums = [self._behind_the_lens(*self._taken(camera, seed, every), every) for seed in seeds]
        above, below = (np.sum([getattr(s, part) for s in sums], axis=0) for part in ("above", "below"))
        return replace(self, given=Sums(above, below))

    def _behind_the_lens(self, pictures: np.ndarray, shaded: np.ndarray | None, chosen: np.ndarray) -> Sums:
        """The sums of pictures; those of falloff of the scenes as the optics shades them."""
        sums = self._symmetry(pictures, chosen)
        if shaded is None:
            return sums
        lens, is_falloff = self._symmetry(shaded, chosen), [s.view == "falloff" for s in STATISTICS]
        pairs = (lens.above, sums.above), (lens.below, sums.below)
        return Sums(*(np.where(is_falloff, *pair) for pair in pairs))

    def _error(self, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(statistics,) standard error of the symmetries less their expectation, and its degrees of freedom (Welch 1947)."""
        scenes, (_, variance, freedom) = self.scenes.symmetry.of(chosen), self.scenes.expected
        parts = np.stack([scenes.variance, np.nan_to_num(variance)])
        degrees = np.stack([scenes.freedom, np.nan_to_num(freedom, nan=1.0)])
        whole, fourth = parts.sum(0), (parts**2 / degrees).sum(0)
        return np.sqrt(whole), np.divide(whole**2, fourth, out=np.ones_like(whole), where=fourth > 0)

    def _as_normal(self, deviation: np.ndarray, chosen: np.ndarray) -> np.ndarray:
        """A deviation of the symmetries, from Student's t to a normal distribution; 0 where too few pictures tell."""
        error, freedom = self._error(chosen)
        size = np.divide(np.abs(deviation), error, out=np.zeros_like(error), where=error > 0)
        normal = stats.norm.isf(np.maximum(stats.t.sf(size, freedom), np.finfo(float).tiny))
        told = self.scenes.symmetry.of(chosen).told & np.isfinite(deviation)
        return np.where(told, np.sign(deviation) * error * normal, 0.0)

    def _symmetry(self, pictures: np.ndarray, chosen: np.ndarray) -> Sums:
        s = self.scenes
        lit, corner = s.regions.lit[chosen] >= 0, (s.window[0], s.window[2])
        return symmetry_sums(pictures, lit, s.black, s.saturated, corner, self.resolution)

    def _frames(self, pictures: np.ndarray, chosen: np.ndarray) -> FrameSet:
        regions = self.scenes.regions.of(chosen).without_saturated(pictures, self.scenes.saturated)
        names = self.scenes.numbers
        stacks: list[tuple[str, float | None, np.ndarray]] = []
        if regions.sky is not None:
            stacks.append(("dark", None, dark_residuals(pictures, regions.dark)))
        for level, stack in zip(regions.levels, lit_residuals(pictures, regions), strict=True):
            stacks.append(("flat", float(f"{level - self.scenes.black:.3g}"), stack))
        records, frames = [], []
        shared = {"exposure_s": self.exposure_s, "window": self.scenes.window}
        for kind, light, stack in stacks:
            for n, frame in zip(chosen, stack, strict=True):
                records.append(FrameRecord(len(records), f"{names[n]}", kind, photons=light, **shared))
                frames.append(frame * np.float32(self.dn))
        return FrameSet(records, _Residuals(records, frames, {}, None))

    def _taken(self, camera: Camera, seed: int, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """The scenes (chosen, H, W) as the camera would have taken them, in 1/255 of full scale, and as its optics shades them.
        None for the second without optics.
        """
        s = self.scenes
        if s.quality is not None and "jpeg" not in camera.effect_names:
            camera = camera.with_effect("jpeg", quality=s.quality, chroma="full")
        r0, r1, c0, c1 = s.window
        maps: dict = {}
        taken, shaded = [], []
        step = max(1, 300_000 // ((r1 - r0) * (c1 - c0)))  # pixels that go through the chain at a time
        for first in range(0, len(chosen), step):
            numbers = chosen[first : first + step]
            keys = [derive_key(seed, "frame", int(n)) for n in numbers]
            own = [derive_key(seed, "camera")] * len(numbers)
            stream = Stream(keys, own, 1, (range(r0, r1), range(c0, c1)), drawn=maps)
            light = torch.from_numpy(s.light[numbers])[:, None]
            with torch.no_grad():
                light, lens = self._before_the_lens(camera, light, stream)
                dn = camera.expose(light * _white(camera), stream, resolution=self.resolution)
                picture = encoded(dn / (2**camera.bit_depth - 1), s.transfer)
                picture = camera.finish(picture, stream) if camera.finishes else picture
            taken.append((torch.round(s.codes * picture[:, 0].clamp(0, 1)) * (255 / s.codes)).numpy())
            shaded += [] if lens is None else [lens]
        return np.concatenate(taken), np.concatenate(shaded) if shaded else None

    def _before_the_lens(
        self, camera: Camera, light: Tensor, stream: Stream
    ) -> tuple[Tensor, np.ndarray | None]:
        """Light of which the camera's optics makes the scenes' levels, but for what is finer than shading, and the scenes behind.
        A picture shows its scene behind the lens; its noise goes by the levels that it has. Without optics: the light, None.
        """
        if not any(effect.stage == Stage.OPTICS for effect in camera.effects):
            return light, None
        seen: list[Tensor] = []
        white = _white(camera)

        def watch(effect: Effect, signal: Tensor) -> None:
            if effect.stage == Stage.OPTICS and effect.name not in PAPER_ORDER:
                seen.append(signal / white)

        camera.expose(light * white, stream, resolution=self.resolution, watch=watch)
        if not seen:
            return light, None
        passed = seen[-1]
        # Shading is slower than a Gaussian of 8 px, blur is faster. No light is raised or lowered by more than a factor of 4.
        wide = (0, 0, 8.0, 8.0)
        slow = [torch.from_numpy(ndimage.gaussian_filter(x.numpy(), wide)) for x in (light, passed)]
        through = (slow[0] / slow[1].clamp_min(1e-6)).clamp(1 / 4.0, 4.0)
        s = self.scenes
        dark = decoded(torch.tensor(s.black / 255), s.transfer)
        level = encoded(dark + (1 - dark) * passed, s.transfer)
        return light * through, (255 * level[:, 0]).numpy()

    def without_pixels(self) -> "PicturePart":
        """The same for simulations alone."""
        return replace(self, pictures=np.zeros((0, 0, 0), np.float32))

    def identity(self) -> tuple:
        """What a simulation depends on, as something that prints as what it is."""
        s = self.scenes
        digest = hashlib.blake2b(digest_size=12)
        given = () if self.given is None else (self.given.above, self.given.below)
        for part in (s.light, s.regions.dark, s.regions.lit, s.symmetry.above, s.expected, *given):
            digest.update(np.ascontiguousarray(part).tobytes())
        numbers = (s.black, s.saturated, s.regions.levels, self.dn, self.exposure_s, s.codes)
        return s.numbers, s.window, self.resolution, s.transfer, s.quality, numbers, digest.hexdigest()


def picture_part(
    frames: FrameSet, camera: Camera, transfer: str, scenes: FrameSet | None, warn: Callable[[str], object]
) -> tuple[PicturePart, Selection]:
    """The pictures of a set as a part, and which of them and what window are used; arguments and errors as of `scenes_of`."""
    own, taken, used = scenes_of(frames, camera, transfer, scenes, warn)
    dn = (2**camera.bit_depth - 1) / 255
    return PicturePart(own, taken, used.size, dn, camera.spec.exposure_s).compared_with(camera), used

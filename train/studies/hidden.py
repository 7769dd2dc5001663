"""Cameras with an effect that their file does not contain: their images are a test set, their diagnosis is an arm.

For each effect the noiseless views of a test set are taken by the camera with the effect, and a frame set of
the same specimen is diagnosed, starting from the camera's file, which lacks it. The diagnosed camera is the
noise of a further arm, so the study shows the loss by the effect and the gain by its diagnosis. All
of it lies in files and is made once.
"""

import hashlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

import visaug
from visaug.camera.simulation import simulate, with_chart
from visaug.core.documents import read_json
from visaug.core.errors import InputError
from visaug.core.files import write_json
from visaug.core.progress import Progress
from visaug.frames import FrameRecord, FrameSet
from visaug.frames.plan import default_plan
from visaug.report.html import Figure, Section, Table, Text, figure
from visaug.report.plots.error import plot_error_steps
from visaug.report.plots.learning import plot_images
from visaug_train import tables
from visaug_train.config import Arm, Config
from visaug_train.convert import identity
from visaug_train.plots import plot_scores
from visaug_train.record import taken_from_files
from visaug_train.reduction import read_pixels, write_png
from visaug_train.render.dataset import LINEAR_WHITE_DN
from visaug_train.speed import PoseSet, write_listing
from visaug_train.statistics import sign

if TYPE_CHECKING:
    from visaug_train.results import Ablation

PLAIN = "plain"  # the test set of the camera that hides nothing
SPECIMEN = 1  # the seed of the one camera that takes frames and test images: its fixed patterns are the same
MEASURE = "keypoint_ap_coco"
VERDICTS = ("does not clearly change", "raises", "lowers")  # by the sign of an interval


@dataclass(frozen=True)
class HiddenEffect:
    """One effect that a test camera has and its file leaves out."""

    domain: str  # name of its test set
    effect: dict[str, Any]  # name and parameters, as in camera.yaml
    answer: dict[str, Any]  # the diagnosis as `visaug diagnose --json` has it
    found: list[dict[str, Any]]  # name and parameters of the effects that the diagnosed camera has
    named: str | None  # the arm that trains with the diagnosed camera; None where nothing was named
    known: str  # the arm that knew the effect: the same one where the name was right
    wrong: str | None = None  # the arm of another of the effects, the control; None where there is no other

    @property
    def right(self) -> bool:
        """Whether the diagnosis named this effect and no other."""
        return self.answer["accepted"] == [self.effect["name"]]


def hidden_cameras(config: Config) -> dict[str, visaug.Camera]:
    """The test cameras by test set: the plain one, then one for each hidden effect; none where a config hides nothing."""
    if config.hidden is None:
        return {}
    if (vis := config.arm(config.baseline).vis) is None:
        raise InputError("has no `vis`", field=f"arms.{config.baseline}", expected="the noise of a camera")
    if len(vis.cameras) != 1:
        raise InputError("is a list", field=f"arms.{config.baseline}.vis.camera", expected="one camera")
    plain = visaug.Camera.load(vis.cameras[0])
    cameras = {PLAIN: plain}
    for domain, effect in config.hidden.effects.items():
        if domain in (PLAIN, *config.data.test) or domain in config.arms:
            raise InputError("is taken", field=f"hidden.effects.{domain}", expected="another name")
        cameras[domain] = plain.with_effect(**effect)
    return cameras


def hide_effects(
    config: Config, tests: Mapping[str, PoseSet], progress: Progress | None = None
) -> tuple[Config, dict[str, PoseSet], list[HiddenEffect]]:
    """The config with the arms, and the test sets, that a study of hidden effects adds; and what was diagnosed."""
    hidden, vis = config.hidden, config.arm(config.baseline).vis
    cameras = hidden_cameras(config)
    assert hidden is not None and vis is not None  # noqa: PT018 - hidden_cameras saw to it
    if hidden.views not in tests:
        raise InputError("is not a test set", field="hidden.views", expected=f"one of {', '.join(tests)}")
    views, plain = tests[hidden.views], cameras[PLAIN]
    size = views.camera.size[::-1]
    if plain.resolution != size:
        expected = f"{list(size)}, rows and columns of the views"
        raise InputError(f"resolution is {list(plain.resolution)}", file=vis.cameras[0], expected=expected)
    taken: dict[str, PoseSet] = {}
    arms, found = dict(config.arms), []

    def add_arm(name: str, camera: Path, why: str) -> str:
        """The baseline with another camera."""
        part = vis.model_copy(update={"camera": str(camera)})
        arms[name] = Arm(like=config.baseline, why=why, vis=part)
        return name

    for domain, camera in cameras.items():
        decides = f"{camera.to_yaml()} {hidden.light} {identity(views)}"
        decides += f" {files}" if (files := taken_from_files(camera)) else ""
        folder = config.output / "cameras" / f"{domain}-{hashlib.sha256(decides.encode()).hexdigest()[:8]}"
        taken[domain] = take_views(camera, views, folder, domain, hidden.light, progress)
        if domain == PLAIN:
            continue
        file, spreads = folder / "diagnosed.yaml", plain.to_dict().get("randomize", {})
        take = partial(_frames_of, camera, plain)
        told = progress and partial(_titled, progress, domain)
        answer = kept_diagnosis(folder / "diagnosis.json", file, plain, take, spreads, progress=told)
        each = HiddenEffect(domain, hidden.effects[domain], answer, [], None, f"{domain}_known")
        named = ", ".join(answer["accepted"])
        why = f"the baseline's noise by the diagnosed camera: with {named}"
        arm = add_arm(f"{domain}_named", file, why) if named else None
        if each.right and arm:
            each = replace(each, known=arm)
        else:
            add_arm(each.known, folder / "camera.yaml", f"the baseline's noise with {domain} as it is")
        effects = visaug.Camera.load(file).to_dict().get("effects", [])
        found.append(replace(each, named=arm, found=effects))
    for i, each in enumerate(found):
        if len(found) > 1:  # the control: the arm of the next effect, one that does not contain this one too
            other = found[(i + 1) % len(found)]
            unknowing = other.named and each.effect["name"] not in other.answer["accepted"]
            found[i] = replace(each, wrong=other.named if unknowing else other.known)
    return config.model_copy(update={"arms": arms}), {**tests, **taken}, found


def _frames_of(camera: visaug.Camera, plain: visaug.Camera) -> FrameSet:
    return simulate(camera, plan_of(plain), seed=SPECIMEN)


def _titled(progress: Progress, title: str, what: str, done: int, total: int) -> None:
    progress(f"{title}: {what}", done, total)


def kept_diagnosis(
    answer: Path,
    found: Path,
    stated: visaug.Camera,
    frames: Callable[[], FrameSet],
    spreads: Mapping[str, Any] | None = None,
    **options: Any,
) -> dict[str, Any]:
    """The answer of a diagnosis of frames, starting from the stated camera, and `found`, the camera that it gives; made once.

    `frames` takes the frames; `spreads` is what `randomize` of the camera that is found is to be, for the numbers that it has,
    and stays as it was where left out; `options` are those of `visaug.diagnose`.
    """
    if not answer.is_file():
        diagnosis = visaug.diagnose(stated, frames(), **options)
        camera = diagnosis.camera
        if spreads is not None:
            known = {path: spread for path, spread in spreads.items() if path in camera.values()}
            camera = camera.with_content(camera.to_dict() | {"randomize": known})
        camera.save(found)
        write_json(answer, diagnosis.to_json())  # last: where it stands, the camera does
    return read_json(answer)


def take_views(
    camera: visaug.Camera, views: PoseSet, folder: Path, domain: str, light: float, progress: Progress | None
) -> PoseSet:
    """The views as the camera sees them, 8 bit, black level off, in SPEED+'s layout; kept where they are there.

    `light` 1: white of a view is what fills the camera's converter, as in training. Sequence numbers, and so the noise,
    are the same for all cameras: they differ by their effects alone.
    """
    listing, images = folder / domain / "test.json", folder / domain / "images"
    files = tuple(images / file.name for file in views.files)
    if listing.is_file():
        return replace(views, name=domain, files=files)
    spec, full_dn = camera.spec, 2**camera.bit_depth - 1
    white_photons = light * full_dn * spec.gain_e_per_dn / spec.quantum_efficiency
    # sequence numbers of test images, so that their noise is not that of the frame set; images in memory at once
    first_view, together = 1_000_000, 16
    for first in range(0, len(views), together):
        chosen = views.files[first : first + together]
        cleans = {file.name: noiseless(file) * np.float32(white_photons) for file in chosen}
        conditions = ("scene", spec.exposure_s, spec.temperature_c, spec.gain_db)
        numbered = enumerate((file.name for file in chosen), start=first_view + first)
        records = [FrameRecord(number, name, *conditions, clean=name) for number, name in numbered]
        unread = np.broadcast_to(np.uint16(0), (len(records), *camera.resolution))
        plan = FrameSet.from_arrays(records, unread, cleans, bit_depth=camera.bit_depth)
        frames = simulate(camera, plan, seed=SPECIMEN)
        for i, file in enumerate(chosen):
            dn = frames.read(i).astype(float) - spec.black_level_dn
            picture = np.clip(np.rint(dn / full_dn * 255), 0, 255).astype(np.uint8)
            write_png(images / file.name, picture)
        if progress:
            progress(f"taking views: {domain}", min(first + together, len(views)), len(views))
    camera.save(folder / "camera.yaml")
    write_json(folder / "camera.json", views.camera.to_json())
    write_listing(listing, [file.name for file in files], views.quaternions, views.translations)
    return replace(views, name=domain, files=files)


def noiseless(file: Path) -> np.ndarray:
    """A view as it came from the renderer, (rows, columns), 1 is white; beyond white where that was kept."""
    linear = file.parent.with_name("images_linear") / file.name
    if not linear.is_file():
        return read_pixels(file).astype(np.float32) / 255
    return read_pixels(linear, cv2.IMREAD_UNCHANGED).astype(np.float32) / LINEAR_WHITE_DN


def plan_of(camera: visaug.Camera) -> FrameSet:
    """The frames to take of a camera, as `visaug plan` names them, at two temperatures and one gain."""
    spec = camera.spec
    records = default_plan(
        saturation_photons=spec.saturation_photons,
        exposure_s=spec.exposure_s,
        temperatures_c=(spec.temperature_c, spec.temperature_c + 10),
        gains_db=(spec.gain_db,),
    )
    unread = np.broadcast_to(np.uint16(0), (len(records), *camera.resolution))
    return with_chart(camera, FrameSet.from_arrays(records, unread, bit_depth=camera.bit_depth))


@dataclass(frozen=True)
class Change:
    """A difference of keypoint AP50-95 (COCO's) with its 95 % interval over images and seeds."""

    before: float
    after: float
    low: float
    high: float

    @property
    def clear(self) -> int:
        return sign(self.low, self.high)

    def __str__(self) -> str:
        return tables.signed(self.after - self.before, self.low, self.high)


@dataclass(frozen=True)
class Outcome:
    """One hidden effect: the loss of the baseline, and the change by each other training on its test set.

    `named`, `wrong` and `known` are against the baseline, `over_wrong` is named against wrong; None where there
    is no such arm, or not yet.
    """

    hidden: HiddenEffect
    cost: Change
    named: Change | None
    wrong: Change | None
    known: Change | None
    over_wrong: Change | None

    def finding(self) -> str:
        name, domain = self.hidden.effect["name"], self.hidden.domain
        cost, lost = self.cost, self.cost.before - self.cost.after
        costs = f"costs the network {lost:.3f}" if cost.clear < 0 else "costs nothing clear:"
        accepted = ", ".join(self.hidden.answer["accepted"]) or "nothing"
        points = f"{cost.before:.3f} without it, {cost.after:.3f} with it; {cost}"
        said = [
            f"{domain} ({name}): the effect {costs} keypoint AP ({points}).",
            f"The diagnosis named {accepted}, which is {'right' if self.hidden.right else 'wrong'}.",
        ]
        if (named := self.named) is not None:
            change = f"{named.before:.3f} to {named.after:.3f}; {named}"
            said.append(f"Training with it {VERDICTS[named.clear]} the AP ({change}).")
        if self.wrong is not None and self.over_wrong is not None:
            better = ("not clearly other than", "better than", "worse than")[self.over_wrong.clear]
            control = f"The control, {self.hidden.wrong}, changes it by {self.wrong}"
            said.append(f"{control}: the named effect is {better} that ({self.over_wrong}).")
        if self.hidden.known == self.hidden.named:
            said.append("Who knew the effect would have trained the same way.")
        elif self.known is not None:
            said.append(f"Who knew the effect gains {self.known}.")
        least = 0.15  # loss of keypoint AP that an effect should cause, so that a few seeds can show the gain
        if lost < least:
            said.append(f"It costs less than {least}, so there is little to win back.")
        return " ".join(said)

    def to_json(self) -> dict[str, Any]:
        hidden, parts = self.hidden, ("cost", "named", "wrong", "known", "over_wrong")
        changes = {name: getattr(self, name) for name in parts}
        return {
            "domain": hidden.domain,
            "effect": hidden.effect,
            "accepted": hidden.answer["accepted"],
            "found": hidden.found,
            "arms": {"named": hidden.named, "known": hidden.known, "wrong": hidden.wrong},
            **{name: None if change is None else asdict(change) for name, change in changes.items()},
        }


def outcomes(ablation: "Ablation") -> list[Outcome]:
    """The outcome of each hidden effect whose baseline was trained."""

    def change(arm: str | None, domain: str, other: str | None, at: str) -> Change | None:
        found = ablation.compare((arm, domain), (other, at)).get(MEASURE) if arm and other else None
        return found and Change(found[0], found[0] + found[1], found[2], found[3])

    made, baseline = [], ablation.config.baseline
    for each in ablation.study.hidden:
        d = each.domain
        if (cost := change(baseline, d, baseline, PLAIN)) is not None:
            named, wrong, known = (change(a, d, baseline, d) for a in (each.named, each.wrong, each.known))
            made.append(Outcome(each, cost, named, wrong, known, change(each.named, d, each.wrong, d)))
    return made


def effect_table(ablation: "Ablation") -> tables.ResultTable:
    """A row for each hidden effect: the diagnosis, the loss, and the gain by each training."""
    columns: dict[str, Callable[[Outcome], object]] = {
        "hidden effect": lambda o: o.hidden.effect["name"],
        "named": lambda o: ", ".join(o.hidden.answer["accepted"]) or "nothing",
        "AP without it": lambda o: f"{o.cost.before:.3f}",
        "AP with it": lambda o: f"{o.cost.after:.3f}",
        "cost": lambda o: o.cost,
        "trained with what was named": lambda o: o.named and f"{o.named.after:.3f}",
        "change": lambda o: o.named,
        "change by a wrong effect": lambda o: o.wrong and f"{o.wrong} ({o.hidden.wrong})",
        "named over wrong": lambda o: o.over_wrong,
        "change by who knew": lambda o: "the same run" if o.hidden.known == o.hidden.named else o.known,
    }
    rows = [[str(of(o) or "") for of in columns.values()] for o in outcomes(ablation)]
    title = "Hidden effects: keypoint AP50-95 (COCO's) on the camera that has them"
    return tables.ResultTable(title, list(columns), rows)


def proof_sections(ablation: "Ablation") -> list[Section]:
    """The sections of a report: the outcome, what the cameras see, and each diagnosis."""
    if not ablation.study.hidden:
        return []
    title = "What a hidden effect costs, and how much accuracy the diagnosis recovers"
    return [
        Section(title, list(_outcome(ablation))),
        Section("What the cameras see", [_views(ablation)]),
        Section("How the effects were found", list(_diagnoses(ablation))),
    ]


def _outcome(ablation: "Ablation") -> Iterator[Text | Table | Figure]:
    made = outcomes(ablation)
    yield Text(
        "A camera has an effect that its file leaves out. The network was trained with the noise of the file; frames"
        " of the camera were diagnosed, starting from that file; and the same network was trained again with the"
        " noise of the diagnosed camera. The control was trained with an effect that this camera does not have."
    )
    for outcome in made:
        yield Text(outcome.finding(), "finding")
    points: dict[str, dict[str, list[float]]] = {}  # effect -> training -> AP of each seed
    for o in (outcome.hidden for outcome in made):
        trained = {
            "camera without the effect": (ablation.config.baseline, PLAIN),
            "with it, trained without": (ablation.config.baseline, o.domain),
            "trained with a wrong effect": (o.wrong, o.domain),
            "trained with what was named": (o.named, o.domain),
        }
        trained |= {"trained knowing it": (o.known, o.domain)} if o.known != o.named else {}
        scores = {n: ablation.of_seeds(arm, at, MEASURE) if arm else [] for n, (arm, at) in trained.items()}
        points[o.effect["name"]] = scores
    if made:
        yield figure(
            plot_scores(points),
            "Keypoint AP50-95 (COCO's) on the same views, taken by the camera without and with the effect. Bars: mean"
            " over seeds; dots: seeds.",
        )
    table = effect_table(ablation)
    page = ("hidden effect", "named", "cost", "change", "change by a wrong effect", "change by who knew")
    shown = [table.head.index(name) for name in page]  # the rest is in the sentences above
    rows = [[row[i].split(" (")[0] for i in shown] for row in table.rows]
    head = [name.removeprefix("change ") for name in page]
    yield Table(head, rows, "Keypoint AP50-95 (COCO's): cost and changes, with 95 % intervals.")
    yield Text(f"95 % intervals: {ablation.interval_covers}.", "note")
    yield Text(
        "The strengths were chosen beforehand on one baseline network alone, so that each effect costs it something;"
        " nothing was chosen by what the other networks score.",
        "note",
    )


def _views(ablation: "Ablation") -> Figure:
    shown = [PLAIN, *(each.domain for each in ablation.study.hidden)]
    tests = ablation.study.tests
    chosen = np.linspace(0, len(tests[PLAIN]) - 1, 4).astype(int)
    pictures = [read_pixels(tests[domain].files[i]) / 255 for domain in shown for i in chosen]
    return figure(
        plot_images(pictures, [domain for domain in shown for _ in chosen]),
        "The same views by the camera without an effect (plain) and with each.",
        raster=True,
    )


def _diagnoses(ablation: "Ablation") -> Iterator[Text | Table | Figure]:
    def shown(value: Any) -> str:
        return f"{value:.4g}" if isinstance(value, int | float) else str(value)

    rows = []
    for each in ablation.study.hidden:
        name = each.effect["name"]
        found = next((e for e in each.found if e["name"] == name), {})
        for key, value in each.effect.items():
            if key != "name":
                other = found.get(key, "not named" if not found else "default")
                rows.append([name, key, shown(value), shown(other)])
    head = ["effect", "parameter", "hidden", "found"]
    yield Table(head, rows, "What was hidden, and what the diagnosis found.")
    for each in ablation.study.hidden:
        error, steps = each.answer["error"], [s for s in each.answer["steps"] if s["error"] is not None]
        if steps:
            said = "the error of the camera's file falling, on frames that were not used for finding."
            yield figure(plot_error_steps(steps, error["before"], error["floor"]), f"{each.domain}: {said}")

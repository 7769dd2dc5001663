"""The harness's YAML: data, network, arms, seeds; checked, with the key's path in every complaint."""

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError, model_validator

from visaug.core.documents import read_yaml
from visaug.core.errors import InputError
from visaug.core.nearest import did_you_mean
from visaug_train.arms import Arm, Vis
from visaug_train.geometry import Pinhole
from visaug_train.reduction import fitting
from visaug_train.render.dataset import RenderSettings
from visaug_train.sections import ConfigSection, Seed, SharePair

# Arms, domains and splits name files: a letter or digit, then no more than what every file system takes.
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9 _.+-]{0,63}$")]
LARGEST_SIDE = 65535  # of an image, pixels
Side = Annotated[int, Field(ge=1, le=LARGEST_SIDE)]


class Source(ConfigSection):
    """A domain and split of the data's folder or, with `root`, of another one (SPEED and SPEED+ are two folders)."""

    domain: str
    split: Literal["train", "validation", "test"] | None = None
    root: Path | None = None
    # of the images in random order (by split_seed): [0.9, 1.0] are the last tenth
    share: SharePair | None = None


class Data(ConfigSection):
    """Either `rendered` or `root`, a SPEED or SPEED+ folder or one of your own in that layout."""

    root: Path | None = None
    rendered: RenderSettings | None = None
    keypoints: str = "tango"
    # width and height to which training and test images are reduced first, and how; area where left out
    image_size: tuple[Side, Side] | None = None
    reduce: Literal["area", "linear"] | None = None
    channels: Literal[1, 3] = 3  # 1: a network with one input channel, for gray images
    split_seed: Seed = 0
    train: Source = Source(domain="synthetic", split="train")
    validation: Source = Source(domain="synthetic", split="validation")
    test: dict[Name, Source] = Field(
        {
            "synthetic": Source(domain="synthetic", split="test"),
            "lightbox": Source(domain="lightbox"),
            "sunlamp": Source(domain="sunlamp"),
        }
    )

    @property
    def reduction(self) -> str:
        """How images are reduced before the network sees them; without `image_size` ultralytics does it, linearly."""
        return (self.reduce or "area") if self.image_size else "linear"

    @property
    def copies(self) -> list[str]:
        """Identity of a set of training copies."""
        size = [f"{self.image_size[0]}x{self.image_size[1]}", self.reduction] if self.image_size else []
        return [*size, *(["gray"] if self.channels == 1 else [])]


class Start(ConfigSection):
    """A network that all runs start from: trained once, without an arm's noise, and kept; or weights from a file.

    Its training arguments are the study's with `training` on top; `seed` is its own, so all seeds of the study share it.
    With `weights`, a safetensors file of the state of `model` whose SHA-256 is `sha256`, nothing is trained.
    """

    epochs: int | None = Field(None, ge=1)
    weights: str | None = None  # a safetensors file, in place of `epochs`
    sha256: str | None = None  # of that file, in hexadecimal digits
    like: str | None = None  # the arm whose augmentation it has; none where left out
    seed: Seed = 0
    training: dict[str, Any] = Field({})


class Hidden(ConfigSection):
    """Effects that a test camera has and its file does not contain, each with a test set and an arm.

    The camera is that of the baseline's `vis`; `views` is the test set whose noiseless images it takes, at
    `light` times the light of the training images.
    """

    effects: dict[Annotated[str, Field(pattern="^[a-z][a-z0-9_]*$")], dict[str, Any]] = Field(min_length=1)
    views: str = "synthetic"
    light: float = Field(1.0, gt=0, le=100)


class MadeCamera(ConfigSection):
    """A camera that is made before any training; arms name it like a camera file.

    Either estimated from `pictures`, whose labels are not used, or (`rendered`) the true camera of a rendered domain.
    """

    pictures: Source | None = None
    rendered: str | None = None

    @property
    def domain(self) -> str:
        """The domain whose camera it is."""
        return self.pictures.domain if self.pictures else str(self.rendered)

    @model_validator(mode="after")
    def _one_origin(self) -> "MadeCamera":
        if (self.pictures is None) == (self.rendered is None):
            raise ValueError("expected one of pictures and rendered")
        return self


class Cluster(ConfigSection):
    """Runs spread by Ray: on this machine, or with an `address` on a cluster whose nodes share the output folder."""

    address: str | None = None  # as ray.init takes it: auto, or host:port; none is this machine
    cpus_per_run: float = Field(2, gt=0)
    gpus_per_run: float = Field(0, ge=0)
    retries: int = Field(3, ge=0)  # of a run whose node or process was lost


class Config(ConfigSection):
    """One study."""

    name: str
    output: Path
    data: Data
    model: str = "yolov8n-pose.yaml"  # a YAML, or the file of trained weights, NAME.pt
    training: dict[str, Any] = Field({})  # ultralytics' training arguments, the same in all arms
    arms: dict[Name, Arm] = Field(min_length=1)
    baseline: str = "baseline"
    # the arm that knows the test cameras: the others' gains are given as a share of its gain
    oracle: str | None = None
    cameras: dict[Name, MadeCamera] = Field({})  # made before the training, for arms to name
    seeds: list[Seed] = Field([0])
    # resamples of the test images, for the variance between images
    bootstrap: int = Field(400, ge=0, le=10**6)
    # the headline; `best` by the clean validation images; both are reported
    weights: Literal["best", "last"] = "last"
    published: bool = False  # put the paper's tables 2 to 4 beside one's own
    start: Start | None = None
    hidden: Hidden | None = None
    cluster: Cluster | None = None  # `{}` spreads the runs over this machine
    tracking: list[Literal["tensorboard", "mlflow", "wandb", "comet", "clearml", "dvc"]] = Field([])

    def arm(self, name: str) -> Arm:
        """An arm with the values that it takes from others."""
        if name not in self.arms:
            problem, expected = f"{name} is not an arm{did_you_mean(name, self.arms)}", ", ".join(self.arms)
            raise InputError(problem, field="arms", expected=f"one of {expected}")
        chain = [name]
        while (like := self.arms[chain[-1]].like) is not None:
            if like in chain or like not in self.arms:
                problem, field = f"{like} cannot be built on", f"arms.{name}.like"
                raise InputError(problem, field=field, expected="another arm")
            chain.append(like)
        merged: dict[str, Any] = {}
        training: dict[str, Any] = {}
        for each in reversed(chain):
            given = self.arms[each].model_dump(exclude_unset=True, exclude={"like"})
            training |= given.pop("training", {})
            merged |= given
        return Arm.model_validate({**merged, "training": training})

    def seen_size(self, camera: Pinhole) -> tuple[int, int]:
        """Width and height of a camera's images as the network gets them."""
        return self.data.image_size or fitting(camera, self.training.get("imgsz", 640))

    def arguments(self, arm: str) -> dict[str, Any]:
        return {**self.training, **self.arm(arm).training}


# Arguments that the harness sets itself, so that runs can be found again, compared and kept off the network.
RESERVED = {"data", "project", "name", "save_dir", "exist_ok", "seed", "resume", "task", "mode", "model"}
RESERVED |= {"pretrained", "plots"}


def load_config(path: str | Path) -> Config:
    """Read and check a config; paths in it are relative to the working directory, cameras and networks also to the config."""
    path = Path(path)
    config = check_config(_extended(path), path)
    config.model = _beside(path, config.model)
    if config.start and config.start.weights:
        config.start.weights = _beside(path, config.start.weights)
    for arm in config.arms.values():
        for part in filter(None, (arm.white, arm.vis)):
            names = [n if n in config.cameras else _beside(path, n) for n in part.cameras]
            part.camera = names[0] if isinstance(part.camera, str) else names
    return config


def _extended(path: Path, below: tuple[Path, ...] = ()) -> Any:
    """The content of a config on top of the one beside it that it `extends`: `data` and `training` key by key."""
    content = read_yaml(path, "a YAML config such as configs/demo.yaml")
    if not isinstance(content, dict) or "extends" not in content:
        return content
    other = content.pop("extends")
    if not isinstance(other, str) or path.resolve() in below:
        expected = "another config's file, beside it"
        raise InputError(f"is {other!r}", file=path, field="extends", expected=expected)
    base = _extended(path.parent / other, (*below, path.resolve()))
    if not isinstance(base, dict):
        raise InputError("holds no keys", file=path.parent / other)
    for key in ("data", "training"):
        if isinstance(base.get(key), dict) and isinstance(content.get(key), dict):
            content[key] = {**base[key], **content[key]}
    return {**base, **content}


def _beside(path: Path, name: str) -> str:
    """A file that lies beside the config, by its path; another name as it is."""
    return str(path.parent / name) if (path.parent / name).is_file() else name


def check_config(content: Any, path: Path | None = None) -> Config:
    """A checked Config, or an InputError that names the first key at fault."""
    if not isinstance(content, dict):
        expected = "name, output, data, arms as in configs/demo.yaml"
        raise InputError("holds no keys", file=path, expected=expected)
    try:
        config = Config.model_validate(content)
    except ValidationError as error:
        errors = error.errors()  # a key that is not known explains one that is missing
        first = next((e for e in errors if e["type"] == "extra_forbidden"), errors[0])
        key = ".".join(str(part) for part in first["loc"])
        problems = {"extra_forbidden": "is not a key of a config", "missing": "is missing"}
        problem = problems.get(first["type"], first["msg"])
        if first["type"] == "extra_forbidden":
            parts = (Config, Data, RenderSettings, Source, Start, Hidden, MadeCamera, Cluster, Arm, Vis)
            own = str(first["loc"][-1])  # known elsewhere, where it is a key of another part
            known = sorted({key for part in parts for key in part.model_fields} - {own})
            problem += did_you_mean(own, known)
        raise InputError(problem, file=path, field=key) from None
    arguments = {"training": config.training}
    arguments |= {"start.training": config.start.training} if config.start else {}
    arguments |= {f"arms.{name}.training": arm.training for name, arm in config.arms.items()}
    reserved = [f"{where}.{key}" for where, given in arguments.items() for key in RESERVED & given.keys()]
    # ultralytics' default adds augmentations where albumentations happens to be installed.
    config.training.setdefault("augmentations", [])
    data, start, oracle, seeds = config.data, config.start or Start(epochs=1), config.oracle, config.seeds
    no_oracle = oracle is not None and (oracle not in config.arms or oracle == config.baseline)
    mistakes = [
        ((data.root is None) == (data.rendered is None), "data", "give one of root and rendered", None),
        (reserved, (reserved or [""])[0], "is set by the harness", "another argument"),
        (data.reduce and not data.image_size, "data.reduce", "needs data.image_size", "[width, height]"),
        ((start.epochs is None) == (start.weights is None), "start", "give one of epochs and weights", None),
        (start.weights and start.sha256 is None, "start.sha256", "is missing", "SHA-256 of start.weights"),
        (start.like and start.like not in config.arms, "start.like", f"{start.like} is not an arm", None),
        (config.baseline not in config.arms, "baseline", f"{config.baseline} is not an arm", None),
        (no_oracle, "oracle", f"{oracle} is not an arm beside the baseline", "such an arm"),
        (not seeds, "seeds", "is empty", "a list of whole numbers"),
        (len(set(seeds)) < len(seeds), "seeds", f"{seeds} repeats one", "each seed once"),
    ]
    for is_so, field, problem, expected in mistakes:
        if is_so:
            raise InputError(problem, file=path, field=field, expected=expected)
    for name in config.arms:
        config.arm(name)
    return config

"""The harness's YAML: data, network, arms, seeds; checked, with the key's path in every complaint."""

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from visaug.documents import read_yaml
from visaug.errors import InputError


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid")


class Rendered(_Part):
    """A dataset of the built-in ray-caster: see `visaug_train.render.dataset.RenderSettings`."""

    width: int = Field(240, ge=32)
    height: int = Field(150, ge=32)
    images: dict[str, dict[str, int]] | None = None
    distance_m: tuple[float, float] = (2.6, 5.5)
    attitude_deg: float = Field(45.0, ge=0, le=180)
    samples: int = Field(2, ge=1, le=8)
    linear_frames: bool = False
    seed: int = 0


class Source(_Part):
    """A domain and split of the data's folder, or (with `root`) of another:

    SPEED and SPEED+ are two folders.
    """

    domain: str
    split: Literal["train", "validation", "test"] | None = None
    root: Path | None = None


class Data(_Part):
    """Either `rendered` or `root`, a SPEED or SPEED+ folder or one of your own in that layout."""

    root: Path | None = None
    rendered: Rendered | None = None
    keypoints: str = "tango"
    image_size: tuple[int, int] | None = Field(None, description="width, height of resized training copies")
    split_seed: int = 0
    train: Source = Source(domain="synthetic", split="train")
    validation: Source = Source(domain="synthetic", split="validation")
    test: dict[str, Source] = {
        "synthetic": Source(domain="synthetic", split="test"),
        "lightbox": Source(domain="lightbox"),
        "sunlamp": Source(domain="sunlamp"),
    }


class Blur(_Part):
    p: float = Field(0.1, ge=0, le=1)
    sigma_px: tuple[float, float] = (0.3, 1.0)


class Gaussian(_Part):
    p: float = Field(0.5, ge=0, le=1)
    std: tuple[float, float] = Field((0.0, 0.02), description="of full scale, drawn per image")


class White(_Part):
    """White noise of a camera's variance (the paper's eq. 6)."""

    camera: str
    p: float = Field(1.0, ge=0, le=1)


class Vis(_Part):
    """The sensor noise. `set` changes values of the camera, which are then not randomised; `effects` are
    added to it.

    `white_std_present` is what white noise the images carry already (1 is full scale): its variance is taken
    off the read noise.
    """

    camera: str
    p: float = Field(1.0, ge=0, le=1)
    resolution: Literal["network", "sensor"] = "network"
    fixed_pattern: Literal["image", "camera"] = "image"
    transfer: Literal["linear", "srgb"] = "linear"
    black_level: Literal["subtract", "keep"] = "subtract"
    set: dict[str, float] = {}
    effects: list[dict[str, Any]] = []
    white_std_present: float = Field(0.0, ge=0, le=1)


class Arm(_Part):
    """What a run does to its training images.

    `like` names an arm to take everything from that is not said here.
    """

    like: str | None = None
    why: str | None = None
    blur: Blur | None = None
    gaussian: Gaussian | None = None
    white: White | None = None
    vis: Vis | None = None
    training: dict[str, Any] = {}


class Hidden(_Part):
    """Effects that a test camera has and its file leaves out, each with a test set and an arm of its own.

    The camera is that of the baseline's `vis`; `views` is the test set whose noiseless images it takes, at
    `light` times the light of the training images.
    """

    effects: dict[Annotated[str, Field(pattern="^[a-z][a-z0-9_]*$")], dict[str, Any]] = Field(min_length=1)
    views: str = "synthetic"
    light: float = Field(1.0, gt=0, le=100)


class Cluster(_Part):
    """Runs spread by Ray: on this machine, or with an `address` on a cluster whose nodes share the output folder."""

    address: str | None = Field(
        None, description="as ray.init takes it: auto, or host:port; none is this machine"
    )
    cpus_per_run: float = Field(2, gt=0)
    gpus_per_run: float = Field(0, ge=0)
    retries: int = Field(3, ge=0, description="of a run whose node or process was lost")


class Config(_Part):
    """One study."""

    name: str
    output: Path
    data: Data
    model: str = "yolov8n-pose.yaml"
    training: dict[str, Any] = Field({}, description="ultralytics' training arguments, the same in all arms")
    arms: dict[str, Arm]
    baseline: str = "baseline"
    seeds: list[int] = [0]
    bootstrap: int = Field(2000, ge=0)
    hidden: Hidden | None = None
    cluster: Cluster | None = Field(None, description="`{}` spreads the runs over this machine")
    tracking: list[Literal["tensorboard", "mlflow", "wandb", "comet", "clearml", "dvc"]] = []

    def arm(self, name: str) -> Arm:
        """An arm with what it takes from others filled in."""
        if name not in self.arms:
            raise InputError(f"{name} is no arm", field="arms", expected=f"one of {', '.join(self.arms)}")
        seen, merged = [], {}
        current: str | None = name
        while current is not None:
            if current in seen or current not in self.arms:
                raise InputError(
                    f"{current} cannot be built on", field=f"arms.{name}.like", expected="another arm"
                )
            seen.append(current)
            arm = self.arms[current]
            given = arm.model_dump(exclude_unset=True)
            training = {**given.pop("training", {}), **merged.pop("training", {})}
            merged = {**given, **merged, "training": training}
            current = arm.like
        merged.pop("like", None)
        return Arm.model_validate(merged)


# Arguments that the harness sets itself, so that runs can be found again, compared and kept off the network.
RESERVED = {
    "data",
    "project",
    "name",
    "save_dir",
    "exist_ok",
    "seed",
    "resume",
    "task",
    "mode",
    "model",
    "pretrained",
    "plots",
}


def load_config(path: str | Path) -> Config:
    """Read and check a config; paths in it are relative to the working directory, cameras also to the config."""
    path = Path(path)
    content = read_yaml(path, "a YAML config such as configs/demo.yaml")
    config = check_config(content, path)
    for arm in config.arms.values():
        for part in (arm.white, arm.vis):
            if part is not None and (path.parent / part.camera).is_file():
                part.camera = str(path.parent / part.camera)
    return config


def check_config(content: Any, path: Path | None = None) -> Config:
    """A checked Config, or an InputError that names the first key at fault."""
    if not isinstance(content, dict):
        raise InputError(
            "holds no keys", file=path, expected="name, output, data, arms as in configs/demo.yaml"
        )
    try:
        config = Config.model_validate(content)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        problems = {"extra_forbidden": "is not a key of a config", "missing": "is missing"}
        raise InputError(problems.get(first["type"], first["msg"]), file=path, field=key) from None
    if (config.data.root is None) == (config.data.rendered is None):
        raise InputError("give one of root and rendered", file=path, field="data")
    arguments = {"training": config.training}
    arguments |= {f"arms.{name}.training": arm.training for name, arm in config.arms.items()}
    for where, given in arguments.items():
        for key in RESERVED & given.keys():
            raise InputError(
                "is set by the harness", file=path, field=f"{where}.{key}", expected="another argument"
            )
    if config.baseline not in config.arms:
        raise InputError(f"{config.baseline} is no arm", file=path, field="baseline")
    if not config.seeds:
        raise InputError("is empty", file=path, field="seeds", expected="a list of whole numbers")
    for name in config.arms:
        config.arm(name)
    return config

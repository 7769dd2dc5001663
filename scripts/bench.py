"""What the noise costs: against Gaussian noise by others, and against the chain as one would write it.

    python scripts/bench.py -o docs/speed.md --machine "two cores of a shared x86-64 virtual machine"

Every rival runs in turn, over and over in one process, so a busy machine slows all alike: only ratios count. A round
takes the rivals in an order of its own, and each runs once untimed before it is timed, so that none pays for the memory
that the one before gave back. A ratio is the median over rounds of (time / time of kornia's RandomGaussianNoise in the
same round); its spread is the range from the 25th to the 75th percentile.
"""

import argparse
import io
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from unittest import mock

import numpy as np
import torch

import visaug
from visaug.core.files import write_bytes, write_text

SIZES = {"640 x 640": (640, 640), "1920 x 1200": (1200, 1920)}
BASE = "kornia RandomGaussianNoise"
CAMERA = {
    "resolution": [1200, 1920],
    "bit_depth": 16,
    "gain_e_per_dn": 0.19,
    "quantum_efficiency": 0.61,
    "black_level_dn": 240,
    "exposure_s": 0.01,
    "temperature_c": 20,
    "read_noise": {"sigma_e": 2.37, "shape": -0.1},
    "dark_current": {"a_e_per_s": 0.136, "b_per_c": 0.14},
    "prnu": {"column": 0.002, "row": 0.0015, "pixel": 0.006},
    "dsnu": {"column_e": 1.4, "row_e": 0.3, "pixel_e": 1.1},
    "randomize": {"gain_db": {"std": 2.0}, "read_noise.sigma_e": 0.2, "read_noise.shape": {"std": 0.05}},
}
COLOUR = {
    "cfa": "RGGB",
    "white_balance": [2.0, 1.0, 1.7],
    "matrix": [[1.6, -0.45, -0.15], [-0.25, 1.5, -0.25], [-0.05, -0.55, 1.6]],
}
Rival = Callable[[], object]


def numpy_chain(images: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The same chain as a paper's code has it: float64 arrays, one step a line, one camera an image."""
    from scipy.stats import tukeylambda

    out = np.empty_like(images)
    for i, image in enumerate(images[:, 0]):
        gain = 0.19 * 10 ** (rng.normal(0, 2.0) / 20)
        sigma, shape = 2.37 * (1 + 0.2 * rng.normal()), -0.1 + 0.05 * rng.normal()
        height, width = image.shape
        k = 0.002 * rng.normal(size=(1, width)) + 0.0015 * rng.normal(size=(height, 1))
        k = k + 0.006 * rng.normal(size=image.shape)
        electrons = rng.poisson(np.maximum(image * 65535 * gain * (1 + k), 0) + 0.02)
        offset = 1.4 * rng.normal(size=(1, width)) + 0.3 * rng.normal(size=(height, 1))
        offset = offset + 1.1 * rng.normal(size=image.shape)
        read = tukeylambda.ppf(rng.random(image.shape), shape)
        volts = electrons + offset + sigma * read / tukeylambda.std(shape)
        dn = np.clip(np.round(volts / gain + 240), 0, 65535)
        out[i, 0] = np.clip(dn - 240, 0, None) / 65535
    return out


def torch_chain(images: torch.Tensor) -> torch.Tensor:
    """The same chain in plain torch operators, all images at once."""
    batch, _, height, width = images.shape

    def normal(*shape: int) -> torch.Tensor:
        return torch.randn(batch, 1, *shape, device=images.device)

    gain = 0.19 * 10 ** (2.0 * normal(1, 1) / 20)
    sigma, shape = 2.37 * (1 + 0.2 * normal(1, 1)), -0.1 + 0.05 * normal(1, 1)
    k = 0.002 * normal(1, width) + 0.0015 * normal(height, 1) + 0.006 * normal(height, width)
    electrons = torch.poisson((images * 65535 * gain * (1 + k)).clamp_min(0) + 0.02)
    offset = 1.4 * normal(1, width) + 0.3 * normal(height, 1) + 1.1 * normal(height, width)
    u = torch.rand_like(images).clamp(1e-7, 1 - 1e-7)
    gamma = torch.exp(2 * torch.lgamma(shape + 1) - torch.lgamma(2 * shape + 2))
    deviation = (2 / shape**2 * (1 / (1 + 2 * shape) - gamma)).sqrt()
    read = (u**shape - (1 - u) ** shape) / shape / deviation
    dn = ((electrons + offset + sigma * read) / gain + 240).round().clamp(0, 65535)
    return (dn - 240).clamp_min(0) / 65535


def inputs(batch: int, size: tuple[int, int], device: str) -> dict[str, torch.Tensor]:
    """A scene between dark sky and highlights, of 8 bit and of 16 bit; and black sky with a small bright body."""
    rng = np.random.default_rng(0)
    y, x = np.mgrid[0 : size[0], 0 : size[1]] / max(size)
    smooth = (0.45 + 0.4 * np.sin(9 * x) * np.cos(7 * y)).astype(np.float32)
    scene = smooth + np.float32(0.05) * rng.standard_normal((batch, 1, *size), dtype=np.float32)
    body = np.where((x - 0.5) ** 2 + (y - 0.3) ** 2 < 0.02, scene, np.float32(0))

    def of_bits(value: np.ndarray, white: float) -> torch.Tensor:
        return torch.from_numpy((value * white).round().clip(0, white) / np.float32(white)).to(device)

    return {
        "8 bit": of_bits(scene, 255),
        "8 bit, black sky": of_bits(body, 255),
        "16 bit": of_bits(scene, 65535),
    }


def rivals(images: dict[str, torch.Tensor], slow: bool) -> dict[str, Rival]:
    import kornia.augmentation

    scene = images["8 bit"]
    noise = visaug.VISNoise(visaug.Camera.load(CAMERA))
    gaussian = kornia.augmentation.RandomGaussianNoise(0.0, 0.05, p=1.0)
    found: dict[str, Rival] = {f"visaug, {name}": lambda x=x: noise(x) for name, x in images.items()}
    found[BASE] = lambda: gaussian(scene)
    found["torch.randn"] = lambda: torch.randn(scene.shape, device=scene.device)
    found["copy"] = lambda: scene.clone()
    if slow:
        exact = visaug.VISNoise(visaug.Camera.load(CAMERA), fast=False)
        found["visaug, exact chain"] = lambda: exact(scene)
        found["the chain in plain torch"] = lambda: torch_chain(scene)
    if scene.device.type == "cpu":
        if slow:
            array, rng = scene.numpy(), np.random.default_rng(0)
            found["the chain in NumPy"] = lambda: numpy_chain(array, rng)
        found |= albumentations_rivals(scene)
    return found


def colour_rivals(batch: int, size: tuple[int, int], device: str, slow: bool) -> dict[str, Rival]:
    """A colour camera on RGB pictures of 8 bit, against kornia on the same three channels."""
    import kornia.augmentation

    scene = inputs(batch, size, device)["8 bit"]
    tint = torch.tensor([1.0, 0.9, 0.7], device=device).view(1, 3, 1, 1)
    pictures = (scene * tint * 255).round() / 255
    noises = {
        method: visaug.VISNoise(visaug.Camera.load(CAMERA | {"colour": COLOUR | {"demosaic": method}}))
        for method in ("bilinear", "malvar")
    }
    gaussian = kornia.augmentation.RandomGaussianNoise(0.0, 0.05, p=1.0)
    found: dict[str, Rival] = {f"visaug, {method}": lambda n=n: n(pictures) for method, n in noises.items()}
    found |= {BASE: lambda: gaussian(pictures), "copy": lambda: pictures.clone()}
    if slow:
        exact = visaug.VISNoise(visaug.Camera.load(CAMERA | {"colour": COLOUR}), fast=False)
        wanted = pictures.clone().requires_grad_()
        found["visaug, exact chain, bilinear"] = lambda: exact(pictures)
        found["the same with its gradient"] = lambda: exact(wanted).sum().backward()
    return found


def albumentations_rivals(scene: torch.Tensor) -> dict[str, Rival]:
    try:
        import albumentations
    except ImportError:
        return {}
    bytes_ = [np.ascontiguousarray((image[0].numpy() * 255).astype(np.uint8)[..., None]) for image in scene]
    gaussian, shot = albumentations.GaussNoise(p=1.0), albumentations.ShotNoise(p=1.0)
    return {
        "albumentations GaussNoise (uint8)": lambda: [gaussian(image=image) for image in bytes_],
        "albumentations ShotNoise (uint8)": lambda: [shot(image=image) for image in bytes_],
    }


def timed(call: Rival, device: str) -> float:
    start = time.perf_counter()
    call()
    if device == "cuda":
        torch.cuda.synchronize()
    return time.perf_counter() - start


def measure(contestants: dict[str, Rival], rounds: int, device: str) -> dict[str, np.ndarray]:
    """Seconds of each rival in each round."""
    times: dict[str, list[float]] = {name: [] for name in contestants}
    order = np.random.default_rng(0)
    for _ in range(rounds):
        for name in order.permutation(list(contestants)):
            timed(contestants[name], device)
            times[name].append(timed(contestants[name], device))
    return {name: np.array(values) for name, values in times.items()}


def table(times: dict[str, np.ndarray], megapixels: float) -> list[str]:
    base = times[BASE]
    lines = ["| what | time over kornia's | spread | Mpx/s in this run |", "| --- | --- | --- | --- |"]
    for name, seconds in sorted(times.items(), key=lambda item: np.median(item[1] / base)):
        low, middle, high = np.percentile(seconds / base, [25, 50, 75])
        bold = "**" if name.startswith("visaug, ") and "exact" not in name else ""
        speed = megapixels / np.median(seconds)
        lines.append(f"| {bold}{name}{bold} | {middle:.2f} | {low:.2f} to {high:.2f} | {speed:.0f} |")
    return lines


def peak_memory(kind: str) -> float:
    """MB above the images and the result that eight images of 640 x 640 take, in a process of its own (Linux)."""
    code = f"""
import sys, torch
sys.path.insert(0, {str(Path(__file__).parent)!r})
import bench
call = bench.rivals(bench.inputs(8, (640, 640), "cpu"), True)[{kind!r}]
bench.rivals(bench.inputs(1, (64, 64), "cpu"), True)[{kind!r}]()
before = bench.resident("VmRSS")
open("/proc/self/clear_refs", "w").write("5")  # the peak starts anew
kept = call()
print(bench.resident("VmHWM") - before - 8 * 640 * 640 * 4 / 2**20)
"""
    # freed memory goes back to the system at once: what the process keeps for the next array would hide a peak
    at_once = {"MALLOC_MMAP_THRESHOLD_": "65536", "MALLOC_TRIM_THRESHOLD_": "65536"}
    environment = {**os.environ, **at_once}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment
    )
    return max(0.0, float(done.stdout.split()[-1]))


def resident(field: str) -> float:
    """MB of this process, by the kernel's books."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(field)) / 1024


def seconds_of(*command: str, times: int = 5) -> float:
    """User and system time of a command, the least of several: what a busy machine adds is not its cost."""
    spent = []
    for _ in range(times):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(command, check=True, capture_output=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        spent.append(after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime)
    return min(spent)


def start_up() -> list[str]:
    python = sys.executable
    bare = seconds_of(python, "-c", "import torch")
    rows = {
        "`import visaug`": seconds_of(python, "-c", "import visaug"),
        "`visaug --help`": seconds_of(python, "-m", "visaug", "--help"),
        "`visaug.Camera`, beyond `import torch`": seconds_of(
            python, "-c", "import torch, visaug; visaug.Camera"
        )
        - bare,
        "`visaug.VISNoise`, beyond `import torch`": seconds_of(
            python, "-c", "import torch, visaug; visaug.VISNoise"
        )
        - bare,
    }
    lines = ["| what | processor seconds |", "| --- | --- |"]
    return lines + [f"| {name} | {value:.2f} |" for name, value in rows.items()]


def scaling(figure: Path) -> list[str]:
    """Processor seconds of characterize and diagnose over frames and over pixels, each doubled, as tables and a picture."""

    def characterized(frames: visaug.FrameSet, camera: visaug.Camera) -> object:
        return visaug.characterize(frames, camera)

    def diagnosed(frames: visaug.FrameSet, camera: visaug.Camera) -> object:
        return visaug.diagnose(camera, frames, sets=60)

    curves = {
        "characterize": grown(characterized, (256, 384)),
        "diagnose, 60 simulated sets": grown(diagnosed, (64, 96)),
    }
    draw_scaling(curves, figure)
    lines = [
        "Processor time with an empty cache. The exponent is that of the growth from the first to the last row: 1 is"
    ]
    lines += ["linear; below it is what does not grow with the data.", ""]
    for name, (over_frames, over_pixels) in curves.items():
        lines += [f"| {name}: frames | pixels a frame | s |", "| --- | --- | --- |"]
        lines += [f"| {n} | {pixels} | {s:.2f} |" for n, pixels, s in [*over_frames, *over_pixels[1:]]]
        powers = [
            np.log(c[-1][2] / c[0][2]) / np.log(c[-1][k] / c[0][k])
            for k, c in enumerate((over_frames, over_pixels))
        ]
        lines += ["", f"Exponent over frames {powers[0]:.2f}, over pixels {powers[1]:.2f}.", ""]
    return [*lines, f"![Time over frames and pixels]({figure.parent.name}/{figure.name})"]


Grown = list[tuple[int, int, float]]  # frames, pixels a frame, seconds


def grown(
    work: Callable[[visaug.FrameSet, visaug.Camera], object], size: tuple[int, int]
) -> tuple[Grown, Grown]:
    """Over frames, and over pixels."""
    rows, columns = size
    over_frames = [(2 * 2**k, size) for k in range(4)]
    over_pixels = [(2, (rows * 2 ** ((k + 1) // 2), columns * 2 ** (k // 2))) for k in range(4)]
    found = {}
    for repeats, shape in [
        over_frames[0],
        *dict.fromkeys([*over_frames, *over_pixels]),
    ]:  # the first warms up
        frames = scaled_set(repeats, shape)
        camera = visaug.Camera.load(CAMERA | {"resolution": list(shape)})
        seconds = processor_seconds(lambda frames=frames, camera=camera: work(frames, camera))
        found[repeats, shape] = (len(frames), shape[0] * shape[1], seconds)
    return [found[key] for key in over_frames], [found[key] for key in over_pixels]


def scaled_set(repeats: int, size: tuple[int, int]) -> visaug.FrameSet:
    """The default plan at one gain and two temperatures, taken by the bench's camera."""
    from visaug.frames.plan import default_plan

    camera = visaug.Camera.load(CAMERA | {"resolution": list(size)})
    records = default_plan(
        size,
        dark_exposures_s=(0.5, 2.0),
        temperatures_c=(20, 30),
        gains_db=(0,),
        repeats=repeats,
        bias_frames=4 * repeats,
    )
    records = [record for record in records if record.kind != "scene"]
    unread = np.broadcast_to(np.uint16(0), (len(records), *size))
    return visaug.simulate(camera, visaug.FrameSet.from_arrays(records, unread, bit_depth=16))


def processor_seconds(call: Rival) -> float:
    from processor import processor_s

    with tempfile.TemporaryDirectory() as folder, mock.patch.dict(os.environ, VISAUG_CACHE=folder):
        start = processor_s()
        call()
        return processor_s() - start


def draw_scaling(curves: dict[str, tuple[Grown, Grown]], figure: Path) -> None:
    from matplotlib.figure import Figure

    canvas = Figure(figsize=(8, 3.4), layout="constrained")
    for place, label in enumerate(("frames, times those of the first", "pixels, times those of the first")):
        axes = canvas.add_subplot(1, 2, place + 1)
        for name, both in curves.items():
            points = np.array(both[place])
            times, seconds = points[:, place] / points[0, place], points[:, 2]
            (drawn,) = axes.loglog(times, seconds, "o-", label=name)
            axes.loglog(times, seconds[-1] * times / times[-1], ":", color=drawn.get_color())
        axes.minorticks_off()
        axes.set_xticks([1, 2, 4, 8], ["1", "2", "4", "8"])
        axes.set_xlabel(label)
        axes.set_ylabel("processor seconds")
    canvas.axes[0].legend(title="dotted: in proportion", frameon=False, fontsize=8)
    content = io.BytesIO()
    canvas.savefig(content, format="png", dpi=110)
    write_bytes(figure, content.getvalue())


def bandwidth(device: str) -> list[str]:
    """On a GPU: the share of the measured copy bandwidth that the augmentation reaches."""
    images = inputs(32, SIZES["1920 x 1200"], device)
    times = measure(rivals(images, False), 20, device)
    share = np.median(times["copy"]) / np.median(times["visaug, 8 bit"])
    return [f"32 images of 1920 x 1200: {share:.0%} of the measured copy bandwidth."]


def simulation(rounds: int = 9) -> list[str]:
    """Processor time a pixel of simulated frames, beside that of kornia's noise on as many pixels, in one thread."""
    import kornia.augmentation

    gaussian = kornia.augmentation.RandomGaussianNoise(0.0, 0.05, p=1.0)
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    lines = ["| frames | ns a pixel and core | over kornia's | spread |", "| --- | --- | --- | --- |"]
    for count, rows, columns in ((70, 200, 256), (60, 1000, 1000)):
        camera = visaug.Camera.load(CAMERA | {"resolution": [rows, columns], "full_well_e": 12000})
        images = torch.rand(count, 1, rows, columns)
        for name, plan in plans(count, rows, columns).items():
            times = measure_processor(
                {
                    "simulation": lambda c=camera, p=plan: visaug.simulate(c, p),
                    BASE: lambda x=images: gaussian(x),
                },
                rounds,
            )
            low, middle, high = np.percentile(times["simulation"] / times[BASE], [25, 50, 75])
            ns = 1e9 * np.median(times["simulation"]) / images.numel()
            title = f"{count} of {rows} x {columns}, {name}"
            lines.append(f"| {title} | {ns:.1f} | {middle:.2f} | {low:.2f} to {high:.2f} |")
    torch.set_num_threads(threads)
    return lines


def plans(count: int, rows: int, columns: int) -> dict[str, visaug.FrameSet]:
    """Frames of one kind, and a third of each: bias, darks of a few electrons, flats up to the full well."""
    settings: dict[str, list[tuple[str, float, float | None]]] = {
        "bias": [("bias", 0.0, None)] * count,
        "dark": [("dark", 2.0, None)] * count,
    }
    settings["flat"] = [("flat", 0.01, 200.0 * (i + 1)) for i in range(count)]
    settings["a third each"] = [settings[("bias", "dark", "flat")[3 * i // count]][i] for i in range(count)]
    unread = np.broadcast_to(np.uint16(0), (count, rows, columns))
    return {
        name: visaug.FrameSet.from_arrays(
            [
                visaug.frames.FrameRecord(i, f"{i}", kind, t, 20.0, 0.0, light)
                for i, (kind, t, light) in enumerate(own)
            ],
            unread,
            bit_depth=16,
        )
        for name, own in settings.items()
    }


def measure_processor(contestants: dict[str, Rival], rounds: int) -> dict[str, np.ndarray]:
    """Processor seconds of each rival in each round, the first round left out."""
    times: dict[str, list[float]] = {name: [] for name in contestants}
    for _ in range(rounds + 1):
        for name, call in contestants.items():
            start = time.process_time()
            call()
            times[name].append(time.process_time() - start)
    return {name: np.array(values[1:]) for name, values in times.items()}


def gpu(rounds: int, batches: tuple[int, ...] = (8, 64, 256), side: int = 640) -> list[str]:
    """Images a second of the noise on the device, and its share of a training step of YOLOv8s-pose in bfloat16."""
    from ultralytics.nn.tasks import PoseModel

    device = "cuda" if torch.cuda.is_available() else "cpu"
    model = PoseModel("yolov8s-pose.yaml", data_kpt_shape=(11, 3), nc=1, verbose=False).to(device)
    title = f"{side} x {side}, three gray channels of 8 bit, on {device}; median of {rounds} rounds, range of the middle half"
    lines = [
        title,
        "",
        "| images a batch | images/s, noise | images/s, kornia | images/s, step of YOLOv8s-pose | share of a step |",
    ]
    lines.append("| --- | --- | --- | --- | --- |")
    for batch in batches:
        gray = inputs(batch, (side, side), device)["8 bit"]
        images = gray.expand(-1, 3, -1, -1).contiguous()
        noise, gaussian = visaug.VISNoise(visaug.Camera.load(CAMERA)), rivals({"8 bit": gray}, False)[BASE]

        def step(images: torch.Tensor = images) -> None:
            model.zero_grad()
            with torch.autocast(device, torch.bfloat16):
                found = model(images)
            torch.stack([t.float().square().mean() for t in _tensors(found)]).sum().backward()

        times = measure(
            {"noise": lambda n=noise, x=images: n(x), BASE: gaussian, "step": step}, rounds, device
        )
        speeds = [f"{batch / np.median(times[name]):,.0f}" for name in ("noise", BASE, "step")]
        low, middle, high = np.percentile(times["noise"] / times["step"], [25, 50, 75])
        lines.append(f"| {batch} | {' | '.join(speeds)} | {middle:.1%} ({low:.1%} to {high:.1%}) |")
        print(
            lines[-1], file=sys.stderr, flush=True
        )  # what is measured is kept, should the rest be interrupted
    return lines


def training_step() -> list[str]:
    """Share of a step of the small pose networks at 160 on the CPU, 16 images a batch."""
    try:
        from ultralytics.nn.tasks import PoseModel
    except ImportError:
        return []
    gray = torch.rand(16, 1, 160, 160).mul(255).round().div(255)
    images = gray.expand(-1, 3, -1, -1).contiguous()
    noise = visaug.VISNoise(visaug.Camera.load(CAMERA))
    lines = ["| network | the noise, over forward and backward | spread |", "| --- | --- | --- |"]
    for name in ("yolov8n-pose", "yolov8s-pose"):
        model = PoseModel(f"{name}.yaml", data_kpt_shape=(11, 3), nc=1, verbose=False)

        def step(model: torch.nn.Module = model) -> None:
            model.zero_grad()
            torch.stack([t.float().square().mean() for t in _tensors(model(images))]).sum().backward()

        times = measure({"step": step, "noise": lambda: noise(images)}, 8, "cpu")
        low, middle, high = np.percentile(times["noise"] / times["step"], [25, 50, 75])
        lines.append(f"| {name} | {middle:.1%} | {low:.1%} to {high:.1%} |")
    return ["On the CPU, 16 images of 160 x 160 in three gray channels:", "", *lines]


def _tensors(value: object) -> list[torch.Tensor]:
    if isinstance(value, torch.Tensor):
        return [value] if value.requires_grad else []
    parts = value.values() if isinstance(value, dict) else value if isinstance(value, list | tuple) else ()
    return [tensor for part in parts for tensor in _tensors(part)]


def publish(page: list[str], output: Path | None) -> None:
    if output:
        write_text(output, "\n".join(page) + "\n")


def main() -> None:
    if sys.argv[1:2] == ["diagnose"]:
        import bench_diagnose

        return bench_diagnose.main(sys.argv[2:])
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-o", "--output", type=Path, help="write the page here; printed where left out")
    parser.add_argument("--machine", default="a machine that nobody described", help="in words")
    parser.add_argument("--sizes", nargs="+", default=list(SIZES), choices=list(SIZES))
    parser.add_argument("--batches", type=int, nargs="+", default=[1, 8, 64])
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--only", choices=["simulation", "gpu"], help="print one table alone")
    parser.add_argument("--threads", type=int, default=torch.get_num_threads())
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    if options.only:
        print("\n".join(simulation() if options.only == "simulation" else gpu(options.rounds)))
        return
    devices = ["cpu", *(["cuda"] if torch.cuda.is_available() else [])]
    page = [
        "# Speed",
        "",
        (
            f"Measured by `scripts/bench.py` on {options.machine}, {options.threads} threads, torch {torch.__version__}. "
            "All programs ran alternately in one process, so only ratios within a table are meaningful. "
            "The camera has shot noise, PRNU, DSNU, dark current, Tukey-lambda read noise, a black level and 16 bit, "
            "and is drawn anew for every image (gain, read noise and its shape)."
        ),
    ]
    for device in devices:
        for name, size in ((name, SIZES[name]) for name in options.sizes):
            for batch in options.batches:
                slow = batch * size[0] * size[1] < 4e6
                rounds = options.rounds if batch < 32 else max(5, options.rounds // 2)
                times = measure(rivals(inputs(batch, size, device), slow), rounds, device)
                title = f"{device.upper()}, {batch} {'image' if batch == 1 else 'images'} of {name}"
                page += ["", f"## {title}", "", *table(times, batch * size[0] * size[1] / 1e6)]
                times = measure(colour_rivals(batch, size, device, slow), rounds, device)
                page += ["", "A colour camera on RGB images; Mpx counts the pixels of the sensor:", ""]
                page += table(times, batch * size[0] * size[1] / 1e6)
                publish(page, options.output)  # what is measured is kept, should the rest be interrupted
    page += ["", "## Simulated frames", "", *simulation()]
    publish(page, options.output)
    page += ["", "## Start", "", *start_up()]
    publish(page, options.output)
    memory = {name: peak_memory(name) for name in ("visaug, 8 bit", BASE, "visaug, exact chain")}
    page += ["", "## Memory", "", "Beyond the images and the result, eight images of 640 x 640:", ""]
    page += [f"- {name}: {value:.0f} MB" for name, value in memory.items()]
    publish(page, options.output)
    page += ["", "## Training", "", *training_step()]
    publish(page, options.output)
    if options.output:
        figure = options.output.parent / "figures" / "scaling.png"
        page += ["", "## Frames and pixels", "", *scaling(figure)]
    if "cuda" in devices:
        page += ["", "## Bandwidth", "", *bandwidth("cuda")]
    publish(page, options.output)
    print("\n".join(page))


if __name__ == "__main__":
    main()

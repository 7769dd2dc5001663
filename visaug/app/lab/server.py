"""The page's server: on this machine only, and for who knows the address with its token."""

import json
import math
import secrets
import socket
from collections.abc import Callable
from contextlib import asynccontextmanager
from functools import partial
from importlib import resources
from types import FrameType
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import Request
from starlette.responses import HTMLResponse, PlainTextResponse, Response
from starlette.routing import Route

from visaug import __version__
from visaug.app.lab.bench import Bench
from visaug.app.lab.content import content, verdict
from visaug.app.lab.data import OwnPicture
from visaug.app.lab.guard import Guard
from visaug.app.lab.jobs import JobQueue
from visaug.app.lab.pictures import COMPARED, ViewPlots
from visaug.core.errors import InputError
from visaug.core.progress import Progress
from visaug.core.wording import probability_text
from visaug.effects import catalogue
from visaug.report.html import templates

ADDRESS = "127.0.0.1"
SCRIPTS = ("uplot.min", "plots", "lab")
QUICK, FULL = "estimating the error", "computing the error"


def application(bench: Bench, token: str) -> Starlette:
    """The page of one bench. Its comparison starts with the server."""
    lab = _Lab(bench, token)

    @asynccontextmanager
    async def lifespan(_: Starlette):
        lab.jobs.ask("comparing", bench.compare)
        yield
        lab.jobs.close()

    routes = [
        Route("/", lambda _: HTMLResponse(lab.rendered("page.html"))),
        Route("/lab.css", lab.style),
        Route("/{name}.js", lab.script),
        Route("/bench", lambda _: HTMLResponse(lab.rendered("bench.html"))),
        Route("/state", lab.state),
        Route("/view/{key}/{view}", lab.view),
        Route("/frame/{key}/{index:int}", lab.frame),
        Route("/camera.yaml", lab.camera),
        Route("/report.html", lab.report),
        Route("/diagnose", lab.diagnose, methods=["POST"]),
        Route("/add/{name}", lab.add, methods=["POST"]),
        Route("/remove/{name}", lab.remove, methods=["POST"]),
        Route("/load/{name}", lab.load, methods=["POST"]),
        Route("/save", lab.save, methods=["POST"]),
        Route("/stop", lab.stop, methods=["POST"]),
        Route("/numbers", lab.numbers, methods=["POST"]),
        Route("/own/{name}", lab.take_picture, methods=["POST"]),
        Route("/own/{picture}/{key}/{exposure:float}", lab.own_picture),
        Route("/back/{to:int}", lab.back, methods=["POST"]),
    ]
    # A page elsewhere whose name was made to point here says another Host.
    hosts = Middleware(TrustedHostMiddleware, allowed_hosts=[ADDRESS, "localhost"], www_redirect=False)
    mistakes = {ValueError: _refuse, OSError: _refuse}  # InputError is a ValueError
    guards = [hosts, Middleware(Guard, token=token)]
    app = Starlette(routes=routes, lifespan=lifespan, middleware=guards, exception_handlers=mistakes)
    app.state.jobs, app.state.pictures = lab.jobs, lab.pictures
    return app


class _JSON(Response):
    """JSON in ASCII: names of files may hold what is no Unicode."""

    media_type = "application/json"

    def render(self, content: Any) -> bytes:
        return json.dumps(content, allow_nan=False).encode()


class _Lab:
    """What each address answers. Plain functions run in a thread of their own, so that drawing stops nobody."""

    def __init__(self, bench: Bench, token: str):
        self.bench, self.token = bench, token
        self.jobs = JobQueue()
        self._wanted: dict[str, float] = {}  # numbers set by hand that no estimate has taken up yet
        self.pictures = ViewPlots(bench.frames, bench.seed)
        self.templates = templates("visaug.app.lab")

    def style(self, _: Request) -> Response:
        text = _text("page.css", "visaug.report") + _text("uplot.min.css") + _text("lab.css")
        return Response(text, media_type="text/css")

    def script(self, request: Request) -> Response:
        name = request.path_params["name"]
        if name not in SCRIPTS:
            return PlainTextResponse("no such script\n", 404)
        return Response(_text(f"{name}.js"), media_type="text/javascript")

    def state(self, _: Request) -> Response:
        return _JSON(self.jobs.as_json())

    def view(self, request: Request) -> Response:
        key, name = request.path_params["key"], request.path_params["view"]
        compared = self.bench.comparison
        worst = {} if compared is None else {place.view: place.worst for place in reversed(compared.where)}
        return _kept(self.pictures.view(key, name, worst.get(name, "") if key.endswith(COMPARED) else ""))

    def frame(self, request: Request) -> Response:
        return _kept(self.pictures.frame(request.path_params["key"], request.path_params["index"]))

    async def take_picture(self, request: Request) -> Response:
        """A picture of the user's own, shown from now on."""
        name = request.path_params["name"]
        body = await _body(request, name, "a picture", 60_000_000)
        self.bench.own_picture = await run_in_threadpool(OwnPicture.read, name, body)
        self.jobs.changed()
        return self.state(request)

    def own_picture(self, request: Request) -> Response:
        chosen, picture = request.path_params, self.bench.own_picture
        if picture is not None and picture.key != chosen["picture"]:  # another has been uploaded since
            picture = None
        return _kept(self.pictures.own(chosen["key"], picture, chosen["exposure"]))

    def camera(self, _: Request) -> Response:
        return _file(self.bench.camera_yaml(), "camera.yaml", "application/yaml")

    def report(self, _: Request) -> Response:
        return _file(self.pictures.report(self.bench, verdict(self.bench)), "report.html", "text/html")

    def diagnose(self, _: Request) -> Response:
        return self._ask("diagnosing", self.bench.diagnose)

    def add(self, request: Request) -> Response:
        name = _effect(request)
        if catalogue()[name].base:
            raise InputError(f"{name!r} is a term of every camera and cannot be added")
        return self._ask(f"adding {name}", partial(self.bench.add, name))

    def remove(self, request: Request) -> Response:
        name = _effect(request)
        return self._ask(f"removing {name}", partial(self.bench.remove, name))

    async def load(self, request: Request) -> Response:
        name = request.path_params["name"]
        body = await _body(request, name, "an effect")
        try:
            text = body.decode()
        except UnicodeDecodeError:
            raise InputError("is no text", file=name, expected="a Python file in UTF-8") from None
        return self._ask(f"loading {name}", lambda _: self.bench.load(name, text))

    async def numbers(self, request: Request) -> Response:
        """Numbers of the camera as a JSON object by path: a quick estimate of the error, then the full one."""
        values = _numbers(await _body(request, "numbers", "numbers of a camera"))
        self.bench.camera.replace(values)  # refuses at once what is out of range
        self._wanted |= values  # with those of an estimate that this one takes the place of
        self.jobs.ask(QUICK, self._set_numbers, instead_of=(QUICK, FULL))
        return self._ask(FULL, self.bench.settle)

    def _set_numbers(self, progress: Progress) -> None:
        values = dict(self._wanted)
        self.bench.set_numbers(values, True, progress)
        self._wanted = {k: v for k, v in self._wanted.items() if values.get(k) != v}

    def back(self, request: Request) -> Response:
        """Back or forward in the cameras."""
        to = request.path_params["to"]
        self._wanted = {}
        return self._ask("going back", lambda _: self.bench.go(to), instead_of=(QUICK, FULL))

    def save(self, _: Request) -> Response:
        path = self.bench.save()
        return _JSON({"saved": str(path) if path else None})

    def stop(self, _: Request) -> Response:
        self.jobs.stop()
        return self.state(_)

    def _ask(self, title: str, work: Callable, instead_of: tuple[str, ...] = ()) -> Response:
        self.jobs.ask(title, work, instead_of)
        return _JSON(self.jobs.as_json(), 202)

    def rendered(self, template: str) -> str:
        state = self.jobs.as_json()  # first: what is drawn may be newer than it says, never older
        return self.templates.get_template(template).render(
            **content(self.bench, self._wanted),
            probability_text=probability_text,
            visaug_version=__version__,
            token=self.token,
            version=state["version"],
            key=self.pictures.announce(self.bench.camera, self.bench.comparison is not None),
            given_key=self.pictures.announce(self.bench.given, self.bench.comparison is not None),
            steps=self.pictures.steps(self.bench),
        )


def serve(
    bench: Bench, port: int = 0, *, say: Callable[[str], object], ready: Callable[[str], object] | None = None
) -> None:
    """Serves the page until it is interrupted, on a free port for 0. `say` is called with the address, token included, as soon as
    it can be opened, and `ready` after that, to open it in a browser.
    """
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((ADDRESS, port))
    except OSError as error:
        listener.close()
        raise InputError(f"{port} cannot be used: {error.strerror}", field="--port") from None
    listener.listen()
    token = secrets.token_urlsafe(24)
    address = f"http://{ADDRESS}:{listener.getsockname()[1]}/?token={token}"
    say(address)
    say("Open this address in a browser. Ctrl-C ends the lab.")
    if ready:
        ready(address)
    config = uvicorn.Config(application(bench, token), log_level="warning", access_log=False)
    _Server(config).run(sockets=[listener])


class _Server(uvicorn.Server):
    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Pictures that are still to be drawn are not waited for."""
        application: Any = self.config.app
        application.state.pictures.closed = True
        super().handle_exit(sig, frame)


def _effect(request: Request) -> str:
    name = request.path_params["name"]
    if name not in catalogue():
        raise InputError(f"{name!r} is not an effect of the catalogue")
    return name


async def _body(request: Request, name: str, what: str, largest: int = 1_000_000) -> bytes:
    """What was sent, of at most `largest` bytes."""
    body = bytearray()
    async for part in request.stream():
        body += part
        if len(body) > largest:
            raise InputError(f"is too large for {what}", file=name, expected=f"at most {largest} bytes")
    return bytes(body)


def _numbers(body: bytes) -> dict[str, float]:
    try:
        values = json.loads(body)
    except ValueError:  # no text, or no JSON
        values = None
    if not isinstance(values, dict) or not values:
        raise InputError("no numbers", expected="an object of numbers by their path in camera.yaml")
    for path, value in values.items():
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise InputError("is no finite number", field=path, expected="a number")
    return {path: float(value) for path, value in values.items()}


def _kept(content: dict | None) -> Response:
    """What is drawn of one camera: its key names the camera, so it never changes."""
    if content is None:
        return _JSON(None, 404)
    return _JSON(content, headers={"Cache-Control": "private, max-age=86400"})


def _file(text: str, name: str, kind: str) -> Response:
    return Response(text, media_type=kind, headers={"Content-Disposition": f'attachment; filename="{name}"'})


def _refuse(_: Request, mistake: Exception) -> Response:
    """A user's mistake, in one line."""
    return _JSON({"error": " ".join(str(mistake).split())}, 400)


def _text(name: str, package: str = "visaug.app.lab") -> str:
    return (resources.files(package) / "templates" / name).read_text(encoding="utf-8")

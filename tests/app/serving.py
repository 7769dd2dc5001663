"""A bench on a server of its own, as `visaug lab` has it."""

import socket
import threading
import time
from contextlib import contextmanager

import uvicorn

from visaug.app.lab import application

TOKEN = "a-token-of-this-test"


@contextmanager
def served(bench):
    """The address of the page; its comparison is done."""
    listener = socket.create_server(("127.0.0.1", 0))
    app = application(bench, TOKEN)
    server = uvicorn.Server(uvicorn.Config(app, log_level="error"))
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
    thread.start()
    while not server.started:
        time.sleep(0.01)
    app.state.jobs.wait()
    yield f"http://127.0.0.1:{listener.getsockname()[1]}/?token={TOKEN}"
    app.state.pictures.closed = server.should_exit = True
    thread.join(20)


def see_everything(page):
    """Open what is folded and scroll through, so that every view is drawn."""
    for _ in range(400):
        # The page may take a newer state at any moment; what is folded in it is folded again.
        left = page.evaluate("""() => {
            document.querySelectorAll("details").forEach((each) => { each.open = true; });
            const holders = [...document.querySelectorAll("[data-view]")].filter((h) => !h.closest("[hidden]"));
            const next = holders.find((h) => !h.children.length && !h.textContent);
            next?.scrollIntoView();
            return Boolean(next);
        }""")
        if not left:
            return
        page.wait_for_timeout(100)
    raise AssertionError("a view was not drawn")

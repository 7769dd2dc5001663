"""Whatever the camera, the frames and an effect's texts hold, the lab shows it as text."""

import dataclasses
import json

import pytest
from starlette.testclient import TestClient

from tests.diagnosis.small import stated_camera
from tests.hostile import MARK, TEXT, check_page
from tests.lab.test_server import OWN
from visaug import Camera, FrameSet
from visaug.diagnosis import session as session_module
from visaug.lab import Bench, application


@pytest.fixture
def client(frames, compared, monkeypatch):
    monkeypatch.setattr(session_module, "compare", lambda *_, **__: compared)
    camera = Camera.load({**stated_camera().to_dict(), "name": TEXT, "source": TEXT})
    records = [dataclasses.replace(r, setting=TEXT, filter=TEXT) for r in frames.records]
    named = FrameSet.from_arrays(records, [frames.read(i) for i in range(len(frames))], bit_depth=14)
    app = application(Bench(camera, named, sets=60), "a-token")
    with TestClient(app, base_url="http://127.0.0.1:8000") as client:
        client.params = {"token": "a-token"}
        app.state.jobs.wait()
        client.wait = app.state.jobs.wait
        yield client


def test_every_page_shows_hostile_texts_as_text(client):
    own = OWN.replace('"what I think it is"', json.dumps(TEXT)).replace(
        'unit="e-"', f"unit={json.dumps(TEXT)}"
    )
    assert client.post("/load/mine.py", content=own).status_code == 202
    client.wait()
    assert client.get("/state").json()["message"].startswith("loaded mine")
    check_page(client.get("/").text)
    bench = client.get("/bench").text
    assert "Add mine" in bench
    check_page(bench, shown=False)
    check_page(client.get("/report.html").text)
    assert "<evil" not in client.get("/lab.js").text


def test_a_message_and_a_name_of_a_file_stay_text(client):
    client.post(
        f"/load/{TEXT.replace('/', '').replace('%', '').replace('#', '').replace('?', '')}.py", content="1/0"
    )
    client.wait()
    answer = client.get("/state")
    assert answer.headers["content-type"].startswith("application/json")
    assert MARK in answer.json()["message"]
    script = client.get("/lab.js").text
    assert (
        script.count("innerHTML") == script.count('bench.innerHTML = await (await ask("bench")).text()') == 1
    )  # tested above

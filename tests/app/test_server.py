"""Who may use the page, what it shows, and that what its buttons ask is done."""

import base64
import io
import re
import socket
import sys
import threading
from importlib import resources

import numpy as np
import pytest
import yaml
from click.testing import CliRunner
from PIL import Image
from starlette.testclient import TestClient

import visaug
from tests.diagnosis.small import SENSOR
from visaug import Camera, InputError
from visaug.app.cli.measure import lab as lab_command
from visaug.app.lab import application, serve
from visaug.diagnosis import Diagnosis, FittedValue, Ranked, Step
from visaug.diagnosis.session import session as session_module
from visaug.diagnosis.verdict import Verdict
from visaug.statistics.distance import Error

TOKEN = "a-token-of-this-test"
OWN = """
from visaug import Effect, Parameter, Stage


class Mine(Effect):
    name = "mine"
    stage = Stage.READOUT
    summary = "what I think it is"
    sigma_e = Parameter(0.0, unit="e-", low=0.0, strength=True, trials=(0.5, 3.0))

    def apply(self, signal, p, stream, context):
        return signal + p.sigma_e * stream.normal("row")
"""


@pytest.fixture
def client(bench):
    app = application(bench, TOKEN)
    with TestClient(app, base_url="http://127.0.0.1:8000") as client:
        client.params = {"token": TOKEN}
        app.state.jobs.wait()
        client.wait = app.state.jobs.wait
        yield client


def found(bench) -> Diagnosis:
    """A diagnosis as it would be, without the minutes."""
    sigma = {"sigma_e": FittedValue(2.0, 1.9, 2.1, "e-")}
    better = bench.given.with_effect("row_noise", sigma_e=2.0)
    after = Error(0.01, -0.02, 0.04)
    return Diagnosis(
        camera=better, accepted=("row_noise",), error_after=after, p_value_before=0.005, p_value_after=0.4,
        adequate_before=False, adequate_after=True, where=bench.comparison.where,
        ranking=(Ranked("row_noise", 0.99, 0.01, sigma), Ranked("flicker_noise", 0.01, 0.4, {})),
        steps=(Step("refit", Error(0.98, 0.95, 1.01)), Step("add row_noise", after)),
        frames={"fit": [0], "select": [1], "confirm": [2]}, ambiguous=(), unexplained=None, form=None,
        cannot_show=("smear",),
        effects=(
            Verdict("row_noise", "named", "row_noise.sigma_e", "e-", 2.0, 1.9, 2.1),
            Verdict("column_noise", "absent", "column_noise.sigma_e", "e-", limit=0.034),
        ),
    )  # fmt: skip


@pytest.fixture
def diagnosed(client, bench, monkeypatch):
    monkeypatch.setattr(session_module, "diagnose", lambda *_, **__: found(bench))
    assert client.post("/diagnose").status_code == 202
    client.wait()
    return client


def shown(page: str, mark: str) -> str:
    return re.search(rf'data-testid="{mark}"[^>]*>([^<]*)<', page)[1]


def test_verdicts_of_all_effects_with_value_or_limit(diagnosed):
    page = diagnosed.get("/").text
    assert "sigma_e = 2 e- [1.9, 2.1]" in page
    assert re.search(r"column_noise</td><td[^>]*>absent</td><td[^>]*>sigma_e &lt; 0.034 e-", page)


def buttons(page: str) -> list[str]:
    return re.findall(r"<button[^>]*>([^<]*)</button>", page)


@pytest.mark.parametrize("path", ["/", "/bench", "/state", "/camera.yaml", "/lab.js", "/view/x/level", "/no"])
@pytest.mark.parametrize("params", [{"token": ""}, {"token": TOKEN + "x"}, {"token": "ä"}])
def test_without_the_token_there_is_nothing(client, path, params):
    answer = client.get(path, params=params)
    assert answer.status_code == 403
    assert TOKEN not in answer.text


@pytest.mark.parametrize(
    "path",
    ["/diagnose", "/stop", "/add/row_noise", "/load/a.py", "/save", "/numbers", "/back/0", "/own/a.png"],
)
def test_without_the_token_nothing_is_done(client, bench, path):
    assert client.post(path, params={"token": "guess"}).status_code == 403
    client.wait()
    assert bench.diagnosis is None
    assert bench.now.fit is None


@pytest.mark.parametrize("host", ["example.org", "127.0.0.1.example.org:8000", "lab.local"])
def test_another_host_name_is_refused(client, host):
    assert client.get("/", headers={"host": host}).status_code == 400


def test_a_request_from_another_page_is_refused(client):
    for origin in ("http://evil.example", "null", "http://127.0.0.1:9", "https://127.0.0.1:8000"):
        assert client.post("/stop", headers={"origin": origin}).status_code == 403
    assert client.post("/stop", headers={"origin": "http://127.0.0.1:8000"}).status_code == 200


def test_a_term_of_every_camera_is_not_added(client):
    assert client.post("/add/read_noise").status_code == 400
    client.wait()


def test_the_page_loads_nothing_from_elsewhere(client):
    answer = client.get("/")
    assert "default-src 'none'" in answer.headers["content-security-policy"]
    assert answer.headers["referrer-policy"] == "no-referrer"
    scripts = [client.get(f"/{name}.js").text for name in ("lab", "plots")]
    everything = "".join([answer.text, client.get("/lab.css").text, *scripts])
    assert not re.findall(r"https?://", everything)


def test_the_first_look(client):
    page = client.get("/").text
    assert {"Diagnose", "Save camera", "Save report", "Load effect"} <= set(buttons(page))
    assert shown(page, "error") == "1.00"
    assert "does not explain these frames" in shown(page, "verdict")
    assert "Row and column noise" in page


def test_views_are_sent_as_numbers(client, bench):
    page = client.get("/").text
    key = re.search(r'data-key="(\w+)"', page)[1]
    content = client.get(f"/view/{key}/temporal_lines").json()
    curve = content["curves"][0]
    assert content["names"] == ["measured", "modelled"]
    assert len(curve["x"]) == len(curve["y"][0]) == len(curve["y"][1]) == bench.camera.resolution[0]
    assert client.get(f"/view/{key}/scene").status_code == 404  # there are no scenes among the frames
    assert client.get("/view/another/temporal_lines").status_code == 404
    shown = client.get(f"/frame/{key}/0").json()["maps"][0]
    values = np.frombuffer(base64.b64decode(shown["values"][0]), "<f4").reshape(
        shown["height"], shown["width"]
    )
    np.testing.assert_array_equal(values, bench.frames.read(0))
    assert client.get(f"/frame/{key}/999").status_code == 404


def test_numbers_set_by_hand_are_estimated_at_once_then_in_full_and_undone(client, bench):
    """With three times the gain every level and noise is far off: the error is well above 1, in both estimates."""
    gain = bench.camera.values()["gain_e_per_dn"]
    assert client.post("/numbers", json={"gain_e_per_dn": 3 * gain}).status_code == 202
    client.wait()
    assert bench.camera.values()["gain_e_per_dn"] == 3 * gain
    assert not bench.now.quick
    assert bench.now.fit.error.value > 1.5
    assert not bench.now.fit.adequate
    assert "gain_e_per_dn set by hand" in shown(client.get("/bench").text, "verdict")
    quick = bench.session.fits.as_it_is(bench.camera, True, lambda *_: None)
    assert quick.error.value == pytest.approx(bench.now.fit.error.value, rel=0.5)
    client.post("/back/0")
    client.wait()
    assert bench.camera is bench.given
    client.post("/back/1")
    client.wait()
    assert bench.camera.values()["gain_e_per_dn"] == 3 * gain


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"{", "no numbers"),
        (b"[]", "no numbers"),
        (b'{"gain_e_per_dn": "x"}', "gain_e_per_dn"),
        (b'{"gain_e_per_dn": NaN}', "gain_e_per_dn"),
        (b'{"prnu.pixel": -1}', "prnu.pixel"),
        (b'{"no.such": 1}', "no"),
    ],
)
def test_numbers_that_cannot_be_are_refused(client, bench, content, said):
    answer = client.post("/numbers", content=content)
    assert answer.status_code == 400
    assert said in answer.json()["error"]
    assert bench.camera is bench.given


def picture_file(image: Image.Image) -> bytes:
    file = io.BytesIO()
    image.save(file, "PNG")
    return file.getvalue()


def shown_picture(client, exposure: str = "1") -> dict:
    holder = re.search(r'data-view="own" data-own="(\w+)" data-key="(\w+)"', client.get("/bench").text)
    return client.get(f"/own/{holder[1]}/{holder[2]}/{exposure}").json()


def test_a_picture_of_ones_own(client, bench):
    """The mean of 1200 pixels of about 9 of 255 each: 0.26; four deviations, and one step of rounding."""
    content = picture_file(Image.new("L", (40, 30), 128))
    assert client.post("/own/gray.png", content=content).status_code == 200
    found = shown_picture(client)
    before, after = (np.frombuffer(base64.b64decode(v), "<f4") for v in found["maps"][0]["values"])
    assert found["white"] == 255
    assert (before == 128).all()
    assert after.mean() == pytest.approx(128, abs=1.5)
    assert 0 < after.std() < 20
    assert shown_picture(client) == found
    dim = np.frombuffer(base64.b64decode(shown_picture(client, "0.1")["maps"][0]["values"][1]), "<f4")
    assert dim.mean() == pytest.approx(128, abs=3)  # as bright, and 10 times the shot noise in light
    assert dim.std() > 2 * after.std()
    client.post("/numbers", json={"read_noise.sigma_e": 300.0})
    client.wait()
    louder = np.frombuffer(base64.b64decode(shown_picture(client)["maps"][0]["values"][1]), "<f4")
    assert louder.std() > 2 * after.std()


def test_a_picture_that_was_replaced_is_not_shown_under_its_old_address(client):
    client.post("/own/gray.png", content=picture_file(Image.new("L", (40, 30), 128)))
    holder = re.search(r'data-view="own" data-own="(\w+)" data-key="(\w+)"', client.get("/bench").text)
    client.post("/own/dark.png", content=picture_file(Image.new("L", (40, 30), 20)))
    assert client.get(f"/own/{holder[1]}/{holder[2]}/1").status_code == 404


def test_a_picture_of_too_many_pixels_is_refused_by_its_head(client, monkeypatch):
    """Its pixels are missing: whoever decoded them would say that it is damaged."""
    head = picture_file(Image.new("L", (6000, 5000)))[:60]
    answer = client.post("/own/wide.png", content=head)
    assert "wide.png: has 5000 x 6000 pixels" in answer.json()["error"]


def test_a_large_picture_is_taken_whole_and_its_middle_shown(client):
    ramp = np.repeat(np.arange(1000, dtype=np.uint16)[None] * 60, 700, 0)
    assert client.post("/own/ramp.png", content=picture_file(Image.fromarray(ramp))).status_code == 200
    found = shown_picture(client)
    shown = found["maps"][0]
    assert (shown["height"], shown["width"], shown["step"]) == (640, 640, 1)
    assert np.frombuffer(base64.b64decode(shown["values"][0]), "<f4")[0] == 60 * 180
    assert found["white"] == 65535
    assert "the middle of 700 x 1000 pixels" in found["title"]


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("x.png", b"GIF89a no picture", "x.png: cannot be read"),
        ("x.gif", b"GIF89a", "x.gif: is not a picture"),
        ("x", b"", "x: is not a picture"),
        ("x.p%00ng", b"", "null byte"),
        ("big.png", b"#" * 60_000_001, "big.png: is too large"),
        ("wide.png", picture_file(Image.new("1", (6000, 5000))), "wide.png: has 5000 x 6000 pixels"),
    ],
)
def test_what_is_no_picture_is_told_in_one_line(client, bench, name, content, said):
    answer = client.post(f"/own/{name}", content=content)
    assert answer.status_code == 400
    assert said in answer.json()["error"]
    assert "\n" not in answer.json()["error"]
    assert "visaug-lab-" not in answer.json()["error"]
    assert bench.own_picture is None


def test_scripts_are_those_of_the_page(client):
    assert "MIT" in (resources.files("visaug.app.lab") / "templates" / "uplot.LICENSE").read_text()
    for name in ("lab", "plots", "uplot.min"):
        assert client.get(f"/{name}.js").headers["content-type"].startswith("text/javascript")
    assert client.get("/jinja.js").status_code == 404


def test_a_diagnosis_is_shown_and_its_effects_can_be_added(diagnosed, bench):
    page = diagnosed.get("/").text
    assert {"Add row_noise", "Add flicker_noise"} <= set(buttons(page))
    assert "row_noise" in shown(page, "verdict")
    assert shown(page, "error") == "1.00"  # the camera on the bench is still the file as given
    diagnosed.post("/add/row_noise")
    diagnosed.wait()
    page = diagnosed.get("/").text
    assert shown(page, "error") == "0.01"
    assert "Remove row_noise" in buttons(page)
    assert "Add row_noise" not in buttons(page)
    assert "row_noise" in diagnosed.get("/camera.yaml").text
    diagnosed.post("/remove/row_noise")
    diagnosed.wait()
    assert shown(diagnosed.get("/bench").text, "error") == "1.00"
    assert bench.camera is bench.given


def test_save_camera(diagnosed, bench):
    diagnosed.post("/add/row_noise")
    diagnosed.wait()
    answer = diagnosed.get("/camera.yaml")
    assert 'filename="camera.yaml"' in answer.headers["content-disposition"]
    assert yaml.safe_load(answer.text)["effects"] == [{"name": "row_noise", "sigma_e": 2.0}]
    saved = diagnosed.post("/save").json()["saved"]
    assert Camera.load(saved).effect_names == ["row_noise"]


def test_a_file_that_the_lab_did_not_write_is_not_overwritten(client, bench):
    bench.output.parent.mkdir()
    bench.output.write_text("mine")
    answer = client.post("/save")
    assert answer.status_code == 400
    assert f"{bench.output}: already exists" in answer.json()["error"]
    assert "--force" in answer.json()["error"]
    assert bench.output.read_text() == "mine"
    bench.output.unlink()
    for _ in range(2):
        assert client.post("/save").json()["saved"] == str(bench.output)
    bench.output.write_text(bench.output.read_text() + "# mine\n")
    assert client.post("/save").status_code == 400
    bench.force = True
    assert client.post("/save").status_code == 200


def test_the_command_refuses_a_file_that_exists(tmp_path):
    (tmp_path / "mine.yaml").write_text("mine")
    words = [str(tmp_path), "--camera", "sony_imx174", "-o", str(tmp_path / "mine.yaml")]
    mistake = CliRunner().invoke(lab_command, words).exception
    assert isinstance(mistake, InputError)
    assert "--force" in str(mistake)


def test_save_report(diagnosed, bench):
    compared = diagnosed.get("/report.html")
    assert "-o better.yaml" in compared.text  # what was found is not on the bench
    assert "attachment" in compared.headers["content-disposition"]
    diagnosed.post("/add/row_noise")
    diagnosed.wait()
    by_hand = diagnosed.get("/report.html").text
    assert "The camera with row_noise" in by_hand
    assert f"--camera {bench.output}" in by_hand
    assert by_hand.count("data:image/") >= 2
    assert by_hand != compared.text


def test_an_effect_of_ones_own(client, bench):
    answer = client.post("/load/mine.py", content=OWN)
    assert answer.status_code == 202
    client.wait()
    assert "Add mine" in buttons(client.get("/bench").text)
    assert bench.loaded == ["mine"]


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("mine.txt", OWN, "mine.txt"),
        ("mine.py", "import sys; sys.exit(3)", "SystemExit"),
        ("mine.py", "1/0", "mine.py: cannot be imported"),
        ("mine.py", "a = 1", "mine.py: defines no Effect"),
        ("mine.py", OWN.replace("strength=True, ", ""), "mine.py: mine has no strength"),
        ("..%2Fmine.py", "a = 1", "mine.py: defines no Effect"),
    ],
)
def test_a_file_that_is_no_effect_is_told_in_one_line(client, bench, name, text, said):
    client.post(f"/load/{name}", content=text)
    client.wait()
    message = client.get("/state").json()["message"]
    if message is None:  # the name holds a slash: no such address
        assert "%2F" in name
    else:
        assert said in message
        assert "\n" not in message
        assert "visaug-lab-" not in message
    assert bench.loaded == []


def test_mistakes_are_told_in_one_line(client):
    answer = client.post("/add/no_such_effect")
    assert answer.status_code == 400
    assert "no_such_effect" in answer.json()["error"]
    answer = client.post("/add/saturation")
    assert answer.status_code == 400
    assert "term of every camera and cannot be added" in answer.json()["error"]
    assert client.post("/load/big.py", content=b"#" * 1_000_001).status_code == 400


def test_work_is_shown_while_it_goes_on_and_can_be_stopped(client, monkeypatch):
    begun, go_on = threading.Event(), threading.Event()

    def diagnose(*_, progress, **__):
        progress("trying row_noise", 3, 10)
        begun.set()
        go_on.wait(10)
        progress("trying smear", 4, 10)
        raise AssertionError("it was not stopped")

    monkeypatch.setattr(session_module, "diagnose", diagnose)
    client.post("/diagnose")
    assert begun.wait(10)
    job = client.get("/state").json()["job"]
    assert (job["title"], job["step"], job["done"], job["total"]) == ("diagnosing", "trying row_noise", 3, 10)
    assert client.post("/diagnose").status_code == 400  # under way already
    assert client.get("/bench").status_code == 200
    client.post("/stop")
    go_on.set()
    client.wait()
    state = client.get("/state").json()
    assert state["job"] is None
    assert "stopped" in state["message"]
    assert not state["failed"]


def test_a_port_in_use_is_a_users_mistake(bench):
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        with pytest.raises(InputError, match="--port"):
            serve(bench, other.getsockname()[1], say=lambda _: None)


def test_the_first_line_is_the_address(bench, tmp_path, monkeypatch):
    """The command with its server left out: what it prints, and on which address it listens."""
    listened = []
    monkeypatch.setattr("uvicorn.Server.run", lambda self, sockets: listened.extend(sockets))
    said = []
    serve(bench, say=said.append)
    host, port = listened[0].getsockname()
    listened[0].close()
    assert host == "127.0.0.1"
    assert re.fullmatch(rf"http://127\.0\.0\.1:{port}/\?token=[\w-]{{20,}}", said[0])


def test_the_extra_that_is_missing_is_named(monkeypatch, tmp_path):
    for name in [
        name for name in sys.modules if name.split(".")[0] == "starlette" or name.startswith("visaug.app.lab")
    ]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "starlette", None)
    result = CliRunner().invoke(lab_command, [str(tmp_path), "--camera", "sony_imx174"])
    assert isinstance(result.exception, InputError)
    assert "visaug[lab]" in str(result.exception)


def test_row_noise_added_by_hand_is_fitted_and_lowers_the_error(bench):
    """The real fit: 2 e- of row noise on 64 rows in each of 18 frames are known to a few per cent."""
    bench.compare(lambda *_: None)
    told = []
    bench.add("row_noise", lambda *step: told.append(step))
    assert any(step[0].startswith("refining row_noise") for step in told)
    sigma = bench.now.fit.parameters["row_noise"]["sigma_e"]
    assert sigma.low < 2.0 < sigma.high
    assert bench.now.fit.error.value < 0.15
    assert [step.action for step in bench.now.steps] == ["refit", "add row_noise"]
    assert bench.camera.values()["gain_e_per_dn"] == pytest.approx(SENSOR.e_per_dn, rel=0.05)
    assert bench.to_json()["accepted"] == ["row_noise"]
    bench.remove("row_noise", lambda *_: None)
    assert bench.camera is bench.given
    told.clear()
    bench.add("row_noise", lambda *step: told.append(step))
    assert not told  # kept

    session = visaug.Session(bench.given, bench.frames, sets=bench.session.sets)
    session.fits, session.comparison = bench.session.fits, bench.comparison  # fitted above
    assert session.error.value == 1
    assert session.where[0].view.startswith("temporal")
    tried = session.try_effect("row_noise")
    assert tried.error.high < 0.5
    assert session.camera is bench.given
    assert session.add("row_noise").error == tried.error
    assert "row_noise" in session.camera.effect_names
    with pytest.raises(InputError, match="row_noise cannot be added"):
        session.add("row_noise")
    fitted = session.camera
    assert session.set_numbers({"read_noise.sigma_e": 5.0}, quick=True).camera is session.camera
    assert session.refit().camera.values() == fitted.values()
    assert [step.action for step in session.now.steps] == ["refit", "add row_noise"]
    assert session.remove("row_noise").camera is bench.given
    with pytest.raises(InputError, match="camera has no smear"):
        session.remove("smear")
    with pytest.raises(InputError, match="cannot be added"):
        session.add("no_such_effect")

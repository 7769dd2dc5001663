"""Documents are plain data, or refused in one line; PyYAML and json are the judges of what is well-formed."""

import json

import pytest
import yaml

from visaug.core.documents import parse_json, parse_yaml, read_json, read_yaml
from visaug.core.errors import InputError

BOMB = "a: &a [x, x, x, x, x, x, x, x, x, x]\n" + "\n".join(
    f"{new}: &{new} [{', '.join(['*' + old] * 10)}]" for old, new in zip("abcdefghi", "bcdefghij")
)
YAML_REFUSED = {
    "alias bomb": BOMB,
    "alias of itself": "&a [*a]",
    "alias of itself as a key": "a: &b {c: *b}",
    "deep flow": "[" * 5000 + "]" * 5000,
    "deep block": "\n".join(" " * i + "a:" for i in range(500)),
    "400 digits": "a: " + "9" * 400,
    "beyond 64 bits": "a: 36893488147419103232",
    "hexadecimal of 300 digits": "a: 0x" + "f" * 300,
    "half a number": "a: 0x_",
    "no bool": "a: !!bool x",
    "no timestamp": "a: !!timestamp x",
    "unknown tag": "a: !mine x",
    "code": "a: !!python/object/apply:os.getcwd []",
    "doubled key": "a: 1\nb: 2\na: 3",
    "two documents": "a: 1\n---\nb: 2",
    "a list as a key": "[1, 2]: 3",
    "torn": "a: [1, 2",
    "half a surrogate pair": 'a: "\\ud800"',
    "a control character": "a: \x07",
}
JSON_REFUSED = {
    "deep": "[" * 100_000,
    "5000 digits": "1" * 5000,
    "beyond 64 bits": "[36893488147419103232]",
    "infinite": "[1e999]",
    "NaN": "[NaN]",
    "doubled key": '{"a": 1, "a": 2}',
    "torn": '{"a": [1',
    "half a surrogate pair": '["\\ud800"]',
}


@pytest.mark.parametrize("text", YAML_REFUSED.values(), ids=YAML_REFUSED)
def test_yaml_that_is_refused(text, tmp_path):
    file = tmp_path / "a.yaml"
    file.write_text(text)
    with pytest.raises(InputError, match=r"a\.yaml") as refused:
        read_yaml(file)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("text", JSON_REFUSED.values(), ids=JSON_REFUSED)
def test_json_that_is_refused(text, tmp_path):
    file = tmp_path / "a.json"
    file.write_text(text)
    with pytest.raises(InputError, match=r"a\.json"):
        read_json(file)


def test_what_is_well_formed_is_read_as_the_libraries_read_it():
    text = "a: &x {b: 1.5, c: [yes, ~, 0x1F, -3]}\nd: *x\ne: {<<: *x, b: 2}\nf: 'text'\ng: 1e+3\n"
    assert parse_yaml(text) == yaml.safe_load(text)
    assert parse_yaml("when: 2020-13-45") == {"when": "2020-13-45"}
    text = '{"a": [1, -2.5e3, true, null, "\\ud83d\\ude00"]}'
    assert parse_json(text) == json.loads(text)


def test_a_file_that_cannot_be_read_is_named(tmp_path):
    (tmp_path / "bytes").write_bytes(b"\xff\xfe\x00a")
    for read in (read_yaml, read_json):
        for name in ("bytes", "absent", ".", "x" * 300, "zero\0byte"):
            with pytest.raises(InputError):
                read(tmp_path / name)

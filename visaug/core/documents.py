"""YAML and JSON from anywhere: read as plain data, or refused in one line.

Neither runs code, and no document can hang or exhaust the program: depth, size after the expansion of aliases, length of
numbers and size of the file are bounded. What both formats leave to the reader is refused: a key that is given twice,
NaN and infinity in JSON, text that is no Unicode. Dates stay text.
"""

import json
import math
from pathlib import Path
from typing import Any

import yaml

from visaug.core.errors import InputError

LARGEST_INT = 2**63  # what NumPy and Torch still hold is below


def read_yaml(path: str | Path, expected: str = "a YAML file") -> Any:
    """The content of a YAML file as dict, list, str, int, float, bool or None."""
    yaml_bytes = 2**20  # of a file; camera files have a few thousand
    return parse_yaml(_read(Path(path), expected, yaml_bytes), path)


def parse_yaml(text: str, file: str | Path | None = None) -> Any:
    """The content of YAML text; `file` is named in the message."""
    try:
        return yaml.load(text, Loader=_Loader)
    except yaml.YAMLError as error:
        raise InputError(f"is not YAML: {error}", file=file) from None
    except (ValueError, TypeError, KeyError, IndexError, AttributeError, OverflowError) as error:
        # what PyYAML's constructors raise for `!!bool x`, `0x_` and the like
        raise InputError(f"is not YAML: a value cannot be read ({error})", file=file) from None
    except RecursionError:
        raise InputError("is nested too deeply", file=file) from None


def read_json(path: str | Path) -> Any:
    """The content of a JSON file as dict, list, str, int, float, bool or None."""
    return parse_json(_read(Path(path), "a JSON file"), path)


def parse_json(text: str, file: str | Path | None = None) -> Any:
    """The content of JSON text; `file` is named in the message."""
    try:
        content = json.loads(
            text, object_pairs_hook=_unique, parse_int=_int, parse_float=_float, parse_constant=_no_constant
        )
        if "\\u" in text:  # half of a surrogate pair can be written as an escape, but is not text
            json.dumps(content, ensure_ascii=False).encode()
        return content
    except UnicodeEncodeError:
        raise InputError("holds text that is no Unicode", file=file) from None
    except ValueError as error:
        raise InputError(f"is not JSON: {error}", file=file) from None
    except RecursionError:
        raise InputError("is nested too deeply", file=file) from None


def _read(path: Path, expected: str, limit: int | None = None) -> str:
    try:
        if limit is not None and path.stat().st_size > limit:
            raise InputError("is too large", file=path, expected=f"{expected} of at most {limit} bytes")
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise InputError("is not text in UTF-8", file=path, expected=expected) from None
    except FileNotFoundError:
        raise InputError("no such file", file=path, expected=expected) from None
    except (OSError, ValueError) as error:  # the latter for a path that holds a zero byte
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"cannot be read ({reason})", file=str(path), expected=expected) from None


class _Loader(yaml.SafeLoader):
    """PyYAML's safe loader with bounds, without dates, and strict on keys."""

    # Dates stay text: no field is a date, and 2020-13-45 is none.
    yaml_implicit_resolvers = {  # noqa: RUF012 - as PyYAML declares it
        first: [(tag, pattern) for tag, pattern in known if tag != "tag:yaml.org,2002:timestamp"]
        for first, known in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }

    def __init__(self, stream: str):
        super().__init__(stream)
        self._depth = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        self._depth += 1
        yaml_depth = 40
        if self._depth > yaml_depth:
            raise yaml.YAMLError(f"nested more than {yaml_depth} deep")
        node = super().compose_node(parent, index)
        self._depth -= 1
        return node

    def get_single_node(self) -> yaml.Node | None:
        node = super().get_single_node()
        yaml_nodes = 100_000  # after the expansion of aliases
        if node is not None and _expanded(node, {}) > yaml_nodes:
            raise yaml.YAMLError(f"more than {yaml_nodes} values once its aliases are expanded")
        return node

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict:
        if isinstance(node, yaml.MappingNode):
            seen = set()
            for key in [(key.tag, key.value) for key, _ in node.value if isinstance(key, yaml.ScalarNode)]:
                if key in seen and key != ("tag:yaml.org,2002:merge", "<<"):
                    raise yaml.YAMLError(f"the key {key[1]!r} is given twice")
                seen.add(key)
        return super().construct_mapping(node, deep)

    def construct_yaml_int(self, node: yaml.ScalarNode) -> int:
        if len(node.value) > 100:
            raise yaml.YAMLError(f"{node.value[:12]}... is too long a number")
        value = super().construct_yaml_int(node)
        if abs(value) > LARGEST_INT:
            raise yaml.YAMLError(f"{node.value[:24]} is too large a number")
        return value

    def construct_yaml_str(self, node: yaml.ScalarNode) -> str:
        text = super().construct_yaml_str(node)
        try:
            text.encode()
        except UnicodeEncodeError:
            raise yaml.YAMLError("a text holds half of a surrogate pair") from None
        return text


_Loader.add_constructor("tag:yaml.org,2002:int", _Loader.construct_yaml_int)
_Loader.add_constructor("tag:yaml.org,2002:str", _Loader.construct_yaml_str)


def _expanded(node: yaml.Node, known: dict[int, int]) -> int:
    """Values below a node, one that an alias names again counted again."""
    if isinstance(node, yaml.ScalarNode):
        return 1
    if id(node) in known:
        if known[id(node)] == 0:
            raise yaml.YAMLError("an alias inside the node that it refers to")
        return known[id(node)]
    known[id(node)] = 0
    parts = [part for pair in node.value for part in (pair if isinstance(pair, tuple) else (pair,))]
    known[id(node)] = 1 + sum(_expanded(part, known) for part in parts)
    return known[id(node)]


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    keys = [key for key, _ in pairs]
    if len(set(keys)) < len(keys):
        raise ValueError(f"the key {next(k for k in keys if keys.count(k) > 1)!r} is given twice")
    return dict(pairs)


def _int(text: str) -> int:
    if len(text) > 20 or abs(int(text)) > LARGEST_INT:
        raise ValueError(f"{text[:24]} is too large a number")
    return int(text)


def _float(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text[:24]} is too large a number")
    return value


def _no_constant(text: str) -> float:
    raise ValueError(f"{text} is not a number of JSON")

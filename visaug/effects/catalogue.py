"""The register of effects: those of the package, and those of users' files."""

import copyreg
import hashlib
import importlib
import importlib.util
import pkgutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import cache, lru_cache, partial
from pathlib import Path
from types import ModuleType
from typing import Any

from visaug.core.errors import USER_MODULE, InputError, described
from visaug.effects.checks import check_definition, try_effect
from visaug.effects.effect import Effect

ROOMS = ("optics", "charge", "readout", "digital", "picture")


@cache
def _shipped() -> dict[str, type[Effect]]:
    found: dict[str, type[Effect]] = {}
    for room in ROOMS:
        package = importlib.import_module(f"visaug.effects.{room}")
        for info in pkgutil.iter_modules(package.__path__):
            found |= _effects_in(importlib.import_module(f"{package.__name__}.{info.name}"))
    return found


_loaded: dict[str, type[Effect]] = {}
_files: dict[tuple[Path, bytes], list[type[Effect]]] = {}  # what files gave, by place and content


def catalogue() -> dict[str, type[Effect]]:
    """Every known effect by name, in the order of the chain: the shipped ones, then those loaded from files."""
    return dict(_in_order(tuple(_loaded.items())))


@lru_cache(maxsize=1)
def _in_order(loaded: tuple[tuple[str, type[Effect]], ...]) -> list[tuple[str, type[Effect]]]:
    everything = _shipped() | dict(loaded)
    return sorted(everything.items(), key=lambda item: (item[1].stage, item[1].order, item[0]))


def register(effect: type[Effect]) -> type[Effect]:
    """Adds an effect class to the catalogue; usable as a decorator.

    Raises:
        InputError: the class is not an effect, its name is one of the shipped catalogue, or `apply` fails on a small frame.
    """
    _check(effect)
    _loaded[effect.name] = effect
    return effect


@contextmanager
def registered(*effects: type[Effect], alone: bool = False) -> Iterator[None]:
    """Registers effect classes for the length of a `with` block.

    After the block the catalogue is as it was before it: effects that were registered or loaded from files inside the block
    are no longer in it.

    Args:
        effects: the classes to register.
        alone: whether effects that were registered or loaded before are hidden inside the block.

    Raises:
        InputError: as for `register`.
    """
    before = dict(_loaded)
    if alone:
        _loaded.clear()
    try:
        for effect in effects:
            register(effect)
        yield
    finally:
        _loaded.clear()
        _loaded.update(before)


def _check(effect: type[Effect]) -> None:
    check_definition(effect)
    if effect.name in _shipped():
        raise InputError(f"effect {effect.__name__}: name: {effect.name!r} is taken by the shipped catalogue")
    try_effect(effect)


def load_file(path: str | Path) -> list[type[Effect]]:
    """Adds every effect class that a Python file defines; a file that was loaded before is not run again
    unless it has changed.
    """
    path = Path(path)
    if not path.is_file() or path.suffix != ".py":
        problem = "is no Python file" if path.exists() else "no such file"
        raise InputError(problem, file=path, expected="a Python file (.py) that defines an Effect")
    return _added(_defined(path, path.read_bytes()))


def _defined(path: Path, source: bytes) -> list[type[Effect]]:
    """The effects that a file defines; the same content is run once."""
    version = (path.resolve(), hashlib.blake2b(source, digest_size=16).digest())
    if version in _files:
        return _files[version]
    tag = hashlib.blake2b(str(path.resolve()).encode(), digest_size=4).hexdigest()
    spec = importlib.util.spec_from_file_location(f"{USER_MODULE}{path.stem}_{tag}", path)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    try:
        exec(compile(source, path, "exec"), vars(module))
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # a file may raise anything, and may call sys.exit
        raise InputError(f"{path}: cannot be imported: {described(error)}") from error
    if not (effects := _effects_in(module)):
        nameless = next((c.__name__ for c in _classes_in(module)), None)
        why = f"; {nameless} has no name, expected name = 'my_effect' in the class" if nameless else ""
        raise InputError(f"{path}: defines no Effect{why}; see `visaug effects new NAME` for one that runs")
    for effect in effects.values():
        _check(effect)
        copyreg.pickle(effect, partial(_reduced, str(path.resolve()), source))
    _files[version] = list(effects.values())
    return _files[version]


def _reduced(path: str, source: bytes, effect: Effect) -> tuple:
    """An effect of a file for `pickle`: with its source, for a process or a machine that has not loaded it."""
    return _restored, (path, source, effect.name, vars(effect))


def _restored(path: str, source: bytes, name: str, state: dict[str, Any]) -> Effect:
    is_new = all(name != effect.name for effects in _files.values() for effect in effects)
    effects = _defined(Path(path), source)
    if is_new:
        _added(effects)
    made = object.__new__(next(effect for effect in effects if effect.name == name))
    vars(made).update(state)
    return made


def _added(effects: list[type[Effect]]) -> list[type[Effect]]:
    _loaded.update((effect.name, effect) for effect in effects)
    return effects


def loaded_files() -> list[Path]:
    """The files that the loaded effects come from, in the order in which they were loaded."""
    now = set(_loaded.values())
    return list(dict.fromkeys(path for (path, _), effects in _files.items() if now & set(effects)))


def sources_of(names: Iterable[str]) -> dict[str, str]:
    """Checksums of the files that give these effects, by name; those of the package have none."""
    wanted, found = set(names), {}
    for (_, digest), effects in _files.items():
        own = [effect.name for effect in effects if _loaded.get(effect.name) is effect]
        found |= dict.fromkeys(wanted.intersection(own), digest.hex())
    return dict(sorted(found.items()))


def _effects_in(module: ModuleType) -> dict[str, type[Effect]]:
    """The effects that a module defines, by name; classes without a name are those that its effects derive from."""
    effects: dict[str, type[Effect]] = {}
    for effect in (c for c in _classes_in(module) if c.name):
        check_definition(effect)
        if (other := effects.setdefault(effect.name, effect)) is not effect:
            raise InputError(
                f"effect {effect.__name__}: name: {effect.name!r} is taken by {other.__name__} of the same file"
            )
    return effects


def _classes_in(module: ModuleType) -> list[type[Effect]]:
    own = (value for value in vars(module).values() if isinstance(value, type))
    return [value for value in own if value.__module__ == module.__name__ and issubclass(value, Effect)]

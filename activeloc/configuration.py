"""Settings from plain data: names to typed, checked, frozen objects.

A setting may be given as an object, a mapping of its fields, or the name of its kind. Whatever is
unknown is refused with the nearest name that is known.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from difflib import get_close_matches
from typing import Any, TypeVar, get_type_hints

from activeloc.errors import ConfigError

T = TypeVar("T")


def unknown(where: str, given: object, known: Iterable[str]) -> ConfigError:
    """The error for a name that does not exist: says the nearest that does."""
    names = sorted(known)
    near = get_close_matches(str(given), names, n=1, cutoff=0.5)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    return ConfigError(f"{where}: unknown name {given!r}{hint} (known: {', '.join(names)})")


def build(cls: type[T], value: object, where: str) -> T:
    """An object of the dataclass ``cls`` from an object, a mapping of its fields, or None.

    Fields that are dataclasses themselves are built in turn.

    Args:
        cls: A dataclass.
        value: What was given; None for the defaults.
        where: Name of the setting, for messages.

    Raises:
        ConfigError: If a name is unknown or a value is refused by ``cls``.
    """
    if isinstance(value, cls):
        return value
    if value is None:
        return cls()
    if not isinstance(value, Mapping):
        raise ConfigError(
            f"{where} must be a {cls.__name__} or a mapping of its fields; got {value!r}"
        )
    assert is_dataclass(cls)
    hints = get_type_hints(cls)
    names = [item.name for item in fields(cls)]
    arguments: dict[str, Any] = {}
    for name, given in value.items():
        if name not in names:
            raise unknown(where, name, names)
        nested = hints[name]
        if is_dataclass(nested) and isinstance(nested, type):
            given = build(nested, given, f"{where}.{name}")
        arguments[name] = given
    return cls(**arguments)


def build_kind(kinds: Mapping[str, type[Any]], value: object, where: str, default: str) -> Any:
    """An object of one of several dataclasses, chosen by name.

    Args:
        kinds: Name to dataclass.
        value: An object of one of them, a name, or a mapping with a name under ``kind``.
        where: Name of the setting, for messages.
        default: Name taken where none is given.

    Raises:
        ConfigError: As :func:`build`, and if the kind is unknown.
    """
    if isinstance(value, tuple(kinds.values())):
        return value
    given = {"kind": value} if isinstance(value, str) else value
    if given is None:
        given = {}
    if not isinstance(given, Mapping):
        raise ConfigError(
            f"{where} must be one of {', '.join(sorted(kinds))}, or a mapping with a 'kind'; "
            f"got {value!r}"
        )
    kind = given.get("kind", default)
    if not isinstance(kind, str) or kind not in kinds:
        raise unknown(where, kind, kinds)
    return build(kinds[kind], {k: v for k, v in given.items() if k != "kind"}, where)

"""The YAML half of a map_server map: a flat mapping of few keys, read strictly.

PyYAML's events are read one by one and every value stays the text that was written, so nothing is
built, nothing recurses, an alias cannot multiply, and ``1:30`` is no number (YAML 1.1 says 90).
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import NoReturn

import yaml

from activeloc.errors import MapError
from activeloc.maps.files import read_bytes

MAX_YAML_BYTES = 64 * 2**10
MIN_RESOLUTION, MAX_RESOLUTION = 1e-4, 1e3  # [m]
MAX_ORIGIN = 1e8  # [m]; beyond it float64 and a fine resolution do not go together.
MODES = ("trinary", "scale", "raw")

_REQUIRED = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")
_OPTIONAL = ("mode", "sha256")
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)
_NEGATE = {"0": False, "1": True, "false": False, "true": True}
_Value = str | list[str]


@dataclass(frozen=True, slots=True)
class MapHeader:
    """What the YAML file of a map says.

    Attributes:
        image: The image file's name, as written.
        resolution: Side of a pixel [m].
        origin: x and y of the lower left pixel's corner [m].
        negate: Whether white means occupied.
        occupied_thresh: A pixel is occupied from this darkness on, in [0, 1].
        free_thresh: A pixel is free up to this darkness; below ``occupied_thresh``.
        mode: One of ``MODES``.
        sha256: Digest of the image file, in hexadecimal, if the file says one.
    """

    image: str
    resolution: float
    origin: tuple[float, float]
    negate: bool
    occupied_thresh: float
    free_thresh: float
    mode: str = "trinary"
    sha256: str | None = None


def read_header(path: Path) -> MapHeader:
    """Read the YAML file of a map.

    Unknown keys are ignored with a ``UserWarning`` that lists them.

    Raises:
        MapError: If it is not YAML, not a flat mapping, lacks a key, says one twice, or a value
            has the wrong type or is out of range.
    """
    content = read_bytes(path, MAX_YAML_BYTES, "the map")
    try:
        text = content.decode("utf-8-sig")
        fields = dict(_fields(path, yaml.parse(text, Loader=yaml.SafeLoader)))
    except UnicodeDecodeError as error:
        raise MapError(f"{path}: not UTF-8 text, at byte {error.start}") from None
    except MapError:
        raise
    except (yaml.YAMLError, ValueError, OverflowError) as error:  # PyYAML lets int() and chr() err.
        raise MapError(f"{path}: not YAML: {' '.join(str(error).split())[:200]}") from None
    return _FieldReader(path, fields).header()


def _fields(path: Path, events: Iterator[yaml.Event]) -> Iterator[tuple[str, _Value]]:
    """Keys and values of the one mapping that the events may describe."""
    seen: set[str] = set()
    body = (_checked(path, event) for event in events)
    next(body)  # The stream's start.
    if not isinstance(next(body), yaml.DocumentStartEvent):
        raise MapError(f"{path}: empty; expected the keys {', '.join(_REQUIRED)}")
    if not isinstance(next(body), yaml.MappingStartEvent):
        raise MapError(f"{path}: must be a mapping of keys to values")
    for event in body:
        if isinstance(event, yaml.MappingEndEvent):
            break
        if not isinstance(event, yaml.ScalarEvent):
            raise MapError(f"{path}, {_line(event)}: a key must be a word")
        key = event.value
        if key in seen:
            raise MapError(f"{path}: {_shown(key)} is given twice, again in {_line(event)}")
        seen.add(key)
        yield key, _value(path, key, body)
    if any(isinstance(event, yaml.DocumentStartEvent) for event in body):
        raise MapError(f"{path}: more than one document; a map has one")


def _value(path: Path, key: str, body: Iterator[yaml.Event]) -> _Value:
    """The value that comes next: a scalar or a list of scalars."""
    event = next(body)
    if isinstance(event, yaml.ScalarEvent):
        return str(event.value)
    values: list[str] = []
    if isinstance(event, yaml.SequenceStartEvent):
        for item in body:
            if isinstance(item, yaml.SequenceEndEvent):
                return values
            if not isinstance(item, yaml.ScalarEvent):
                break
            values.append(str(item.value))
    raise MapError(f"{path}: {_shown(key)} is nested too deep; a list of numbers is the most")


def _checked(path: Path, event: yaml.Event) -> yaml.Event:
    """Refuse what a map never needs and others have been attacked with."""
    if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None) is not None:
        raise MapError(f"{path}, {_line(event)}: anchors and aliases are not allowed")
    tag = getattr(event, "tag", None)
    if tag is not None:
        raise MapError(f"{path}, {_line(event)}: tag {_shown(tag)} is not allowed")
    return event


class _FieldReader:
    """Turns the texts of one file into a header; knows where it is for the errors."""

    def __init__(self, path: Path, fields: dict[str, _Value]) -> None:
        self._path = path
        self._fields = fields

    def header(self) -> MapHeader:
        missing = [key for key in _REQUIRED if key not in self._fields]
        if missing:
            raise MapError(f"{self._path}: missing {', '.join(missing)}")
        unknown = [_shown(key) for key in self._fields if key not in _REQUIRED + _OPTIONAL]
        if unknown:
            warnings.warn(f"{self._path}: unknown keys ignored: {', '.join(unknown)}", stacklevel=4)
        occupied_thresh = self._number("occupied_thresh", 0.0, 1.0)
        free_thresh = self._number("free_thresh", 0.0, 1.0)
        if free_thresh >= occupied_thresh:
            self._refuse("free_thresh", f"a number below occupied_thresh, {occupied_thresh:g}")
        return MapHeader(
            image=self._image(),
            resolution=self._number("resolution", MIN_RESOLUTION, MAX_RESOLUTION),
            origin=self._origin(),
            negate=self._negate(),
            occupied_thresh=occupied_thresh,
            free_thresh=free_thresh,
            mode=self._mode(),
            sha256=self._sha256(),
        )

    def _refuse(self, key: str, allowed: str) -> NoReturn:
        value = self._fields[key]
        raise MapError(f"{self._path}: {key} must be {allowed}, got {_shown(value)}")

    def _text(self, key: str, allowed: str) -> str:
        value = self._fields[key]
        return value if isinstance(value, str) else self._refuse(key, allowed)

    def _number(self, key: str, low: float, high: float) -> float:
        allowed = f"a number in [{low:g}, {high:g}]"
        number = _to_number(self._text(key, allowed))
        return (
            number if number is not None and low <= number <= high else self._refuse(key, allowed)
        )

    def _origin(self) -> tuple[float, float]:
        allowed = f"[x, y, yaw], three numbers of metres up to {MAX_ORIGIN:g} and radians"
        value = self._fields["origin"]
        numbers = [] if isinstance(value, str) else [_to_number(text) for text in value]
        if len(numbers) != 3:
            self._refuse("origin", allowed)
        x, y, yaw = numbers
        if x is None or y is None or yaw is None or max(abs(x), abs(y)) > MAX_ORIGIN:
            self._refuse("origin", allowed)
        if yaw != 0.0:
            self._refuse("origin", "unturned, its yaw 0 (turn the image instead)")
        return x, y

    def _negate(self) -> bool:
        allowed = "0, 1, false or true"
        negate = _NEGATE.get(self._text("negate", allowed).lower())
        return negate if negate is not None else self._refuse("negate", allowed)

    def _mode(self) -> str:
        if "mode" not in self._fields:
            return "trinary"
        allowed = ", ".join(MODES)
        mode = self._text("mode", allowed)
        return mode if mode in MODES else self._refuse("mode", f"one of {allowed}")

    def _image(self) -> str:
        allowed = "a file name of 1 to 1024 printable characters"
        name = self._text("image", allowed)
        return (
            name if 0 < len(name) <= 1024 and name.isprintable() else self._refuse("image", allowed)
        )

    def _sha256(self) -> str | None:
        if "sha256" not in self._fields:
            return None
        allowed = "64 hexadecimal digits"
        digest = self._text("sha256", allowed).lower()
        return digest if re.fullmatch("[0-9a-f]{64}", digest) else self._refuse("sha256", allowed)


def _to_number(text: str) -> float | None:
    """The finite number that a text says in plain decimal or scientific notation."""
    number = float(text) if _NUMBER.fullmatch(text) else None
    return number if number is not None and isfinite(number) else None


def _shown(value: _Value) -> str:
    """A value for a message: quoted, on one line, not too long."""
    text = repr(value[:60] if isinstance(value, str) else value[:8])
    return text if len(text) <= 60 else text[:57] + "..."


def _line(event: yaml.Event) -> str:
    mark = event.start_mark
    return "somewhere" if mark is None else f"line {mark.line + 1}"

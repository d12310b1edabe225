"""Range checks for settings: each refuses a value with its name, the value and what is allowed."""

from math import inf, isfinite, nan

import numpy as np

from activeloc.errors import ConfigError


def number(
    name: str,
    value: object,
    low: float = -inf,
    high: float = inf,
    *,
    above_low: bool = False,
) -> None:
    """Refuse anything but a finite real number in ``[low, high]``, or ``(low, high]``.

    Raises:
        ConfigError: With the name, the value and the interval.
    """
    given = nan
    if isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool):
        given = float(value)
    if not (isfinite(given) and low <= given <= high) or (above_low and given <= low):
        bracket = "(" if above_low or low == -inf else "["
        end = "inf)" if high == inf else f"{high:g}]"
        raise ConfigError(f"{name} must be a number in {bracket}{low:g}, {end}; got {value!r}")


def integer(name: str, value: object, low: int, high: int) -> None:
    """Refuse anything but an integer in ``[low, high]``; a bool is none.

    Raises:
        ConfigError: With the name, the value and the interval.
    """
    is_integer = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not (is_integer and low <= value <= high):  # type: ignore[operator]
        raise ConfigError(f"{name} must be an integer in [{low}, {high}]; got {value!r}")


def boolean(name: str, value: object) -> None:
    """Refuse anything but true and false.

    Raises:
        ConfigError: With the name and the value.
    """
    if not isinstance(value, bool):
        raise ConfigError(f"{name} must be true or false; got {value!r}")


def choice(name: str, value: object, allowed: tuple[str, ...]) -> None:
    """Refuse anything but one of the allowed words.

    Raises:
        ConfigError: With the name, the value and the words.
    """
    if value not in allowed:
        raise ConfigError(f"{name} must be one of {', '.join(allowed)}; got {value!r}")

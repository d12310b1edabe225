"""A window on a game: pygame shows its frames and hands it the keys.

Gymnasium's ``play`` is made for games that run by themselves: it looks at the keys that are down at
each tick, so that a tap between two is lost and a press is many steps, and it starts the next
episode before the end of one can be seen. Here a key is a step.
"""

from __future__ import annotations

import os
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from activeloc.errors import ConfigError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from activeloc.cli.game import Game

_WAIT = 200
"""Longest wait for an event before signals are looked at [ms]."""

_HELD = (350, 150)
"""A key that is held repeats after this long, and then so often [ms]."""


def demand_pygame() -> None:
    """Refuse to open a window where there is nothing to open it with.

    Raises:
        ConfigError: If pygame is not installed.
    """
    if find_spec("pygame") is None:
        raise ConfigError('play needs pygame-ce: pip install "activeloc[render]"')


def show(game: Game, title: str) -> None:
    """Play in a window until it is closed.

    Raises:
        ConfigError: If no window can be opened.
    """
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    import pygame

    try:
        # Not `pygame.init()`: it would look for sound as well.
        pygame.display.init()
        _demand_display(pygame.display.get_driver())
        frame = game.frame()
        window = pygame.display.set_mode((frame.shape[1], frame.shape[0]), pygame.RESIZABLE)
        pygame.display.set_caption(title)
        pygame.key.set_repeat(*_HELD)
        _paint(window, frame)
        stale = False
        while True:
            event = pygame.event.wait(_WAIT)
            if event.type == pygame.QUIT or _key(event) == "escape":
                return
            stale |= game.press(_key(event))
            # Keys that wait come first: a picture takes longer than a step.
            if stale and not pygame.event.peek(pygame.KEYDOWN):
                frame, stale = game.frame(), False
                _paint(window, frame)
            elif event.type in (pygame.WINDOWEXPOSED, pygame.WINDOWRESIZED):
                _paint(window, frame)
    except pygame.error as error:
        raise ConfigError(f"no window can be opened: {error}") from None
    finally:
        pygame.display.quit()


def _demand_display(driver: str) -> None:
    """Refuse a window that nobody would see, unless it was asked for.

    Raises:
        ConfigError: If SDL has found no screen.
    """
    if driver in ("dummy", "offscreen") and "SDL_VIDEODRIVER" not in os.environ:
        raise ConfigError("no window can be opened: there is no screen")


def _key(event: Any) -> str:
    """Name of the key that an event is about; empty if it is about none."""
    import pygame

    return pygame.key.name(event.key) if event.type == pygame.KEYDOWN else ""


def _paint(window: Any, frame: NDArray[np.uint8]) -> None:
    """Show a frame as large as the window allows, in its middle."""
    import pygame

    height, width, _ = frame.shape
    room = window.get_size()
    scale = min(room[0] / width, room[1] / height)
    size = max(1, round(width * scale)), max(1, round(height * scale))
    picture = pygame.surfarray.make_surface(frame.swapaxes(0, 1))
    if size != (width, height):
        picture = pygame.transform.smoothscale(picture, size)
    window.fill((247, 247, 248))
    window.blit(picture, ((room[0] - size[0]) // 2, (room[1] - size[1]) // 2))
    pygame.display.flip()

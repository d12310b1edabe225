"""Pictures of an episode: drawn with Pillow and NumPy, without a display."""

from activeloc.envs.rendering.draw import draw
from activeloc.envs.rendering.film import FPS, demand_encoder, frames_of, write_gif, write_mp4
from activeloc.envs.rendering.page import page_of, write_page
from activeloc.envs.rendering.recording import Recording, Tape, outcome_of
from activeloc.envs.rendering.scene import Layout, Scene, layout
from activeloc.envs.rendering.sidebar import Block, with_sidebar

__all__ = [
    "FPS",
    "Block",
    "Layout",
    "Recording",
    "Scene",
    "Tape",
    "demand_encoder",
    "draw",
    "frames_of",
    "layout",
    "outcome_of",
    "page_of",
    "with_sidebar",
    "write_gif",
    "write_mp4",
    "write_page",
]

"""Pictures of an episode: drawn with Pillow and NumPy, without a display."""

from activeloc.envs.rendering.draw import draw
from activeloc.envs.rendering.film import write_gif
from activeloc.envs.rendering.scene import Layout, Scene, layout

__all__ = ["Layout", "Scene", "draw", "layout", "write_gif"]

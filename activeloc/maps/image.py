"""Grey images from files that nobody vouches for.

The file is read once, as bytes, into memory: what is measured, hashed and decoded is the same.
Only PNG, PNM and BMP are ever decoded, and only once the header says that the size is bearable.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from hashlib import sha256
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from activeloc.errors import MapError
from activeloc.grid import MAX_CELLS
from activeloc.maps.files import read_bytes, reason_of

MAX_IMAGE_BYTES = 64 * 2**20
FORMATS = ("PPM", "PNG", "BMP")
_GREY_16 = ("I;16", "I;16L", "I;16B", "I")
_GREY_8 = ("1", "L", "LA", "P", "PA", "RGB", "RGBA")


@dataclass(frozen=True, eq=False)
class GreyImage:
    """How bright each pixel is, the top row first.

    Attributes:
        level: ``(H, W)`` of unsigned integers, 0 for black.
        white: The level of white: 255, 65535, or 765 where three channels are added.
        opaque: ``(H, W)`` of bool; false where the pixel is at least partly transparent.
    """

    level: NDArray[np.unsignedinteger]
    white: int
    opaque: NDArray[np.bool_]


def read_image(path: Path, digest: str | None = None) -> GreyImage:
    """Decode an image file.

    Args:
        path: A PNG, PGM (PNM) or BMP file, whatever its suffix.
        digest: SHA-256 that the file must have, in hexadecimal; not checked if ``None``.

    Raises:
        MapError: If the file cannot be read, is something else, is damaged, is larger than
            64 MiB or 25 million pixels, or its SHA-256 is another.
    """
    content = read_bytes(path, MAX_IMAGE_BYTES, "the image")
    found = sha256(content).hexdigest()
    if digest is not None and found != digest:
        raise MapError(
            f"{path}: SHA-256 is {found}, but the map's sha256 says {digest}; "
            "remove that key if the image was changed on purpose"
        )
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            with Image.open(BytesIO(content), formats=FORMATS) as image:
                _check_header(path, image)
                return _to_grey(path, image)
    except MapError:
        raise
    except UnidentifiedImageError:
        raise MapError(f"{path}: not a PNG, PGM or BMP image") from None
    except (Image.DecompressionBombWarning, Image.DecompressionBombError):
        raise MapError(f"{path}: too many pixels; at most {MAX_CELLS} are allowed") from None
    except Exception as error:  # Decoders meet damage with half a dozen kinds of error.
        raise MapError(f"{path}: damaged image: {reason_of(error)}") from None


def _check_header(path: Path, image: Image.Image) -> None:
    """Refuse what should not be decoded at all."""
    width, height = image.size
    if width * height > MAX_CELLS:
        raise MapError(
            f"{path}: {width} x {height} are {width * height} pixels; "
            f"at most {MAX_CELLS} are allowed"
        )
    if getattr(image, "n_frames", 1) != 1:
        raise MapError(f"{path}: an animation; a map is a single image")
    if image.mode not in _GREY_8 + _GREY_16:
        raise MapError(f"{path}: pixels are {image.mode}; allowed are grey, RGB and palette")
    if image.mode in _GREY_16 and "transparency" in image.info:
        raise MapError(f"{path}: 16-bit grey with a transparent colour; use an alpha channel")


def _to_grey(path: Path, image: Image.Image) -> GreyImage:
    """Decode; colours become the sum of their channels, a palette the colours it stands for."""
    if image.mode in _GREY_16:
        level = np.asarray(image)
        if level.min() < 0 or level.max() > 65535:
            raise MapError(f"{path}: 16-bit grey has levels from {level.min()} to {level.max()}")
        return GreyImage(level.astype(np.uint16), 65535, np.ones(level.shape, np.bool_))
    if image.mode in ("1", "L") and "transparency" not in image.info:
        level = np.asarray(image.convert("L"))
        return GreyImage(level, 255, np.ones(level.shape, np.bool_))
    rgba = np.asarray(image.convert("RGBA"))
    return GreyImage(rgba[..., :3].sum(axis=-1, dtype=np.uint16), 765, rgba[..., 3] == 255)

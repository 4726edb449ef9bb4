"""Pictures one after the other, as a file: GIF, or MP4 with the extra ``video``."""

import contextlib
import functools
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Any, Protocol

import numpy as np

from hlsd.core.errors import HlsdError
from hlsd.core.files import writing_atomic
from hlsd.report.rendering import Picture

GIF_RATE = 12.5
"""Pictures a second: GIF counts in hundredths of a second."""
MP4_RATE = 30.0
_COLOURS = 96
_ACCENTS = ((36, 117, 200), (240, 120, 20), (90, 170, 110), (175, 87, 122))
"""Of path, scan, goal and movers."""


class Film(Protocol):
    """What pictures are added to, and what ends it.

    Attributes:
        rate: Pictures a second.
    """

    rate: float

    def add(self, picture: Picture) -> None:
        """Take the next picture, all of one size."""

    def captioned(self, picture: Picture, text: str) -> Picture:
        """A picture with a line of text in its corner."""

    def end(self) -> None:
        """Write what is not written yet."""


@contextlib.contextmanager
def writing(file: Path) -> Iterator[Film]:
    """A film that is there, whole, when the block has ended well.

    Args:
        file: New; its ending says which kind.

    Raises:
        HlsdError: It exists, cannot be written, is of another kind, or what writes it
            is not installed.
    """
    kinds: dict[str, Callable[[IO[bytes]], Film]] = {".gif": _Gif, ".mp4": _Mp4}
    kind = kinds.get(file.suffix.lower())
    if kind is None:
        raise HlsdError(
            f"{str(file)!r} ends in {file.suffix!r}: want .gif or .mp4", argument="out"
        )
    if file.exists():
        raise HlsdError(f"{str(file)!r} exists already: give another file")
    with writing_atomic(file) as held:
        film = kind(held)
        yield film
        film.end()


class _Captions:
    def captioned(self, picture: Picture, text: str) -> Picture:
        from PIL import Image, ImageDraw

        image = Image.fromarray(picture)
        draw = ImageDraw.Draw(image)
        font = _font(max(12, picture.shape[0] // 22))
        left, top, right, bottom = draw.textbbox((10, 8), text, font=font)
        draw.rectangle((left - 5, top - 4, right + 5, bottom + 4), fill=(255, 255, 255))
        draw.text((10, 8), text, font=font, fill=(20, 24, 28))
        return np.asarray(image)


@functools.lru_cache(maxsize=8)
def _font(size: int) -> Any:
    from PIL import ImageFont

    return ImageFont.load_default(size)


class _Gif(_Captions):
    """By Pillow, which comes with matplotlib."""

    rate = GIF_RATE

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self._images: list[Any] = []

    def add(self, picture: Picture) -> None:
        from PIL import Image

        # One palette for all: what stands still stays the same, which makes it small.
        if not self._images:
            self._palette = Image.fromarray(_with_accents(picture)).quantize(_COLOURS)
        image, plain = Image.fromarray(picture), Image.Dither.NONE
        self._images.append(image.quantize(palette=self._palette, dither=plain))

    def end(self) -> None:
        first, *others = self._images
        first.save(
            self._file,
            format="GIF",
            save_all=True,
            append_images=others,
            duration=round(1000 / self.rate),
            loop=0,
            optimize=False,
        )


def _with_accents(picture: Picture) -> Picture:
    """A picture with stripes of colours that are rare and must not be lost."""
    height, width, _ = picture.shape
    stripes = [
        np.full((max(1, height // 20), width, 3), colour, dtype=np.uint8)
        for colour in _ACCENTS
    ]
    return np.vstack((picture, *stripes))


class _Mp4(_Captions):
    """H.264, by PyAV."""

    rate = MP4_RATE

    def __init__(self, file: IO[bytes]) -> None:
        try:
            import av
        except ImportError as error:
            raise HlsdError(
                "MP4 needs PyAV, which is not installed: pip install 'hlsd[video]', or "
                "write a .gif"
            ) from error
        self._av: Any = av
        self._container: Any = av.open(file, "w", format="mp4")
        self._stream: Any = None

    def add(self, picture: Picture) -> None:
        # H.264 takes even sides alone.
        height, width = (side // 2 * 2 for side in picture.shape[:2])
        if self._stream is None:
            self._stream = self._container.add_stream("libx264", rate=round(self.rate))
            self._stream.width, self._stream.height = width, height
            self._stream.pix_fmt = "yuv420p"
            self._stream.options = {"crf": "21", "threads": "1"}
        even = np.ascontiguousarray(picture[:height, :width])
        frame = self._av.VideoFrame.from_ndarray(even, format="rgb24")
        self._container.mux(self._stream.encode(frame))

    def end(self) -> None:
        self._container.mux(self._stream.encode(None))
        self._container.close()

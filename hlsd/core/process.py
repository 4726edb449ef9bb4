"""What a command's process takes from where it was started, and what it does not."""

import codecs
import ctypes.util
import io
import os
import sys
import warnings

from hlsd.core.text import spelled

_ERRORS = "hlsd.spelled"
_ASCII = "hlsd-ascii"


def settle() -> None:
    """Make a process of the command line independent of how it was started.

    A stream whose encoding lacks a sign gets it spelled (`hlsd.core.text.spelled`).
    Warnings are said and never raised, whatever ``PYTHONWARNINGS`` says. A renderer
    that is not there does not keep MuJoCo from loading: nothing is rendered here.
    """
    codecs.register_error(_ERRORS, _spell)
    codecs.register(_ascii)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            ascii_only = codecs.lookup(stream.encoding).name == "ascii"
            # Under its own name, libraries take ASCII for a mistake and write UTF-8.
            encoding = _ASCII if ascii_only else stream.encoding
            stream.reconfigure(encoding=encoding, errors=_ERRORS)
    if any(action == "error" for action, *_ in warnings.filters):
        warnings.simplefilter("default")
    renderer = os.environ.get("MUJOCO_GL", "").lower().strip()
    if renderer and not _can_render(renderer):
        os.environ["MUJOCO_GL"] = "disable"


def _can_render(renderer: str) -> bool:
    library = {"egl": "EGL", "osmesa": "OSMesa", "glfw": "", "glx": ""}.get(renderer)
    return library is not None and (
        not library or ctypes.util.find_library(library) is not None
    )


def _spell(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return spelled(error.object[error.start : error.end]), error.end


def _ascii(name: str) -> codecs.CodecInfo | None:
    if name.replace("_", "-") != _ASCII:
        return None
    plain = codecs.lookup("ascii")
    return codecs.CodecInfo(
        plain.encode,
        plain.decode,
        plain.streamreader,
        plain.streamwriter,
        plain.incrementalencoder,
        plain.incrementaldecoder,
        name=_ASCII,
    )

"""Which hlsd this is."""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("hlsd")
except PackageNotFoundError:  # a checkout that was never installed
    __version__ = "0+checkout"

"""hlsd: a benchmark for local robot-navigation planners on MuJoCo.

The list of modules is the pipeline: collect -> (data: hallucination) -> train ->
episode -> bench -> report. Stages use ``sim``, ``planners`` and ``data``; planners
never import the simulator.
"""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("hlsd")
except PackageNotFoundError:  # a checkout that was never installed
    __version__ = "0+checkout"

"""The command line: a file for each group of commands.

It parses, calls one function and prints: what it does can be done from Python, too.
"""

from hlsd.cli.app import main as main

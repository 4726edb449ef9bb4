"""What tests of the command line share."""

import sys

import pytest

from hlsd.cli.app import main


@pytest.fixture
def hlsd(made, monkeypatch, capsys):
    """Runs a command in the folder ``made`` of a module: exit code, stdout, stderr."""
    monkeypatch.chdir(made)
    monkeypatch.syspath_prepend(made)

    def call(*arguments):
        monkeypatch.setattr(sys, "argv", ["hlsd", *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            main()
        out, err = capsys.readouterr()
        return stop.value.code or 0, out, err

    return call

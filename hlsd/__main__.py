"""`python -m hlsd`."""

from hlsd.core.importing import working_directory_last

# Python has put it first.
working_directory_last()

from hlsd.cli import main  # noqa: E402 - no module of the working directory instead

main()

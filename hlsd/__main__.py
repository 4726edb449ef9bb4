"""`python -m hlsd`."""

from hlsd.cli import main

main()

"""`python cli.py ...` in a checkout does what the installed `hlsd ...` does."""

from hlsd.cli import main

if __name__ == "__main__":
    main()

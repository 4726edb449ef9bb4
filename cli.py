"""`python cli.py ...` in a checkout does what the installed `hlsd ...` does."""

from hlsd.core.importing import working_directory_last

if __name__ == "__main__":
    working_directory_last()
    from hlsd.cli import main

    main()

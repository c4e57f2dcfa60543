"""Run the command `insenv` by `python -m insenv`."""

from insenv.cli import main

if __name__ == "__main__":
    main()

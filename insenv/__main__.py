"""`python -m insenv` is the command `insenv`."""

from insenv.cli import main

if __name__ == "__main__":
    main()

"""`python -m mems_impact` is the command `mems-impact`."""

from mems_impact.cli import main

if __name__ == "__main__":
    main()

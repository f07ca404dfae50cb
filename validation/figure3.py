"""Figure 3 of the paper: `python validation/figure3.py [--quick] [--output DIR]`."""

from mems_impact.cli import main

if __name__ == "__main__":
    import sys

    main(["validate", "3", *sys.argv[1:]])

"""Figure 7 of the paper: `python validation/figure7.py [--quick] [--output DIR]`."""

from mems_impact.cli import main

if __name__ == "__main__":
    import sys

    main(["validate", "7", *sys.argv[1:]])

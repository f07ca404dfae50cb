"""Figure 6 of the paper: `python validation/figure6.py [--quick] [--output DIR]`."""

from mems_impact.cli import main

if __name__ == "__main__":
    import sys

    main(["validate", "6", *sys.argv[1:]])

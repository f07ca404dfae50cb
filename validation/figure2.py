"""Figure 2 of the paper: `python validation/figure2.py [--quick] [--output DIR]`."""

from mems_impact.cli import main

if __name__ == "__main__":
    import sys

    main(["validate", "2", *sys.argv[1:]])

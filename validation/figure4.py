"""Figure 4 of the paper: `python validation/figure4.py [--quick] [--output DIR]`."""

from mems_impact.cli import main

if __name__ == "__main__":
    import sys

    main(["validate", "4", *sys.argv[1:]])

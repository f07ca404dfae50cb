"""Figure 5 of the paper: `python validation/figure5.py [--quick] [--output DIR]`."""

from mems_impact.cli import main

if __name__ == "__main__":
    import sys

    main(["validate", "5", *sys.argv[1:]])

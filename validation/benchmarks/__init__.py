"""Benchmarks: every figure is a ratio of two things timed in turn in one run.

``python -m validation.benchmarks`` from the root of the repository runs them all; ``--help`` tells
the rest. `breakdown` shows where the time of the compiled engine goes.
"""

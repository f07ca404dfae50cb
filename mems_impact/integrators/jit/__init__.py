"""Compilation of user functions and kernels by numba."""

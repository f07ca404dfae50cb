"""Devices of public papers, from their drawings: predicted beside measured numbers.

Run ``python -m validation.devices`` from the root of the repository.
"""

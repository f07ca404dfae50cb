"""The attack on the event loop: random runs, aimed scans, closed forms, bad files, other systems.

``python -m validation.campaign --seed 1 --runs 20000 --workers 2`` writes a report; the same seed
draws the same cases on every machine.
"""

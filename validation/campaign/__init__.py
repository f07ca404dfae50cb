"""The attack on the event loop: random runs before a judge, aimed scans, closed forms, bad files.

``python -m validation.campaign --seed 1 --runs 20000 --workers 2`` writes a report; the same seed
draws the same cases on every machine.
"""

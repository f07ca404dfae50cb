"""Studies: tables of many points of a system, on one core or a cluster, with resumable storage.

`engine.study` defines a study, `engine.scheduler` runs it.
"""

"""Studies: tables of many points of a system, on one core or on a cluster, and nothing is lost.

`engine.study` says what a study is, `engine.scheduler` runs any of them.
"""

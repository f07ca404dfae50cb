"""Studies: tables of many points of a system, on one core or on a cluster, and nothing is lost.

What a study is says `study`; `running` runs any of them.
"""

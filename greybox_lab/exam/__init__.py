"""Blind examination of a diagnosis: cases of virtual vehicles whose answers are sealed until they are scored.

`make.make` makes cases, `run.run` has them diagnosed, `score.score` opens the answers. Nothing is imported here, since
every diagnosing process imports this package and should not wait for what it does not need.
"""

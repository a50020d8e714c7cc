"""The blind examination of a diagnosis: cases of virtual vehicles whose answers are sealed until they are scored.

`make.make` makes cases, `run.run` has them diagnosed, `score.score` opens the answers. Nothing is imported here: each
process that diagnoses passes through, and what it does not need it should not wait for.
"""

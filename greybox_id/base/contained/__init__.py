"""Work in processes of its own: what ends one, or takes too long or too much, ends nothing else.

`process.Contained` is such a process as seen by who asks it, `inside` what runs in it and what goes between them;
`units.Nursery` forks a child for each unit of work.
"""

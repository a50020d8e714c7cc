"""Work in separate processes: a crash, or too much time or memory in one of them, affects nothing else.

`process.Contained` is the caller's side of such a process, `inside` the code that runs in it, with their protocol;
`units.Nursery` forks a child for each unit of work.
"""

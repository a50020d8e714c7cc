"""What proves, drives, shows, or runs many: examinations, papers' tables, virtual cars, fleets, driving, a page.

The library never imports it; its commands come in by entry points. What it offers in Python is imported from its rooms:

    from greybox_lab import fleet
    from greybox_lab.driving.learn_policy import learn_policy

Importing it lets Gymnasium know `greybox/Track-v0`.
"""

from .driving.registration import register as _register

_register()

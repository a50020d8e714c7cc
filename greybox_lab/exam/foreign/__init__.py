"""Vehicles of other simulators, which share neither code nor functional forms with the models.

`families` lists them with their use for calibration or examinations. A diagnosis imports nothing from here.
"""

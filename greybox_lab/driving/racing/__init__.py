"""Driving as a learner sees it: a model of motion on a track, many vehicles at once."""

"""Tracking: EKF, UKF and smoother over any model of motion, with what drifts among its parameters."""

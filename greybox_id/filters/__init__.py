"""Tracking: EKF, UKF and smoother for any model of motion, with parameters that vary in time among the states."""

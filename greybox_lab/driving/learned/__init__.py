"""Networks that have learned how a vehicle answers its commands, and models of motion in which they act."""

import greybox_id as gb

soft_steering = gb.effects.alteration(
    "steering", "soft_steering", "1/rad^2", 0.0, (-2.0, 8.0), "share of the angle lost per squared angle", typical=1.0,
    steer=lambda steer, q: steer / (1 + q.p.soft_steering * steer**2),
)  # fmt: skip

"""
A predictive controller closes the loop
=======================================

If a controller ignores the delay of the steering, it steers too late, and the car oscillates about the path. The same
controller with the closed model, which contains the delay, takes it into account. The model is exported to CasADi.
"""

import importlib.util
from pathlib import Path
from tempfile import mkdtemp

import casadi as cs
import matplotlib.pyplot as plt
import numpy as np

import greybox_id as gb

STEP, AHEAD, SPEED = 0.05, 24, 20.0  # s between commands, steps looked ahead, m/s
LATE = 0.05  # s: the delay of the car's steering, as a diagnosis names it; see the page on a gap

# %%
# The model of the vehicle file, as CasADi functions that need nothing but CasADi.
folder = Path(mkdtemp()) / "car"
gb.export(gb.models.lateral(vehicle="full_size_car"), to=folder, target="casadi")
spec = importlib.util.spec_from_file_location("car", folder / "car.py")
car = importlib.util.module_from_spec(spec)
spec.loader.exec_module(car)


def moved(x, steer):
    """Lateral velocity, yaw rate, heading and lateral place a step later."""
    motion = car.step(x[:2], cs.vertcat(steer, SPEED), car.P, STEP)
    return cs.vertcat(motion, x[2] + STEP * motion[1], x[3] + STEP * (SPEED * cs.sin(x[2]) + motion[0] * cs.cos(x[2])))


def path(time):
    """A double lane change: lateral place, in m."""
    return 1.75 * (np.tanh(2.5 * (time - 2.0)) - np.tanh(2.5 * (time - 5.0)))


# %%
# The controller minimises the deviations from the path at all steps ahead and the changes of the command. It has a
# queue of the commands that do not act yet.
def controller(on_their_way):
    """What to steer, from the state, the commands on their way and the path ahead."""
    opti = cs.Opti()
    start, queue, goal = opti.parameter(4), opti.parameter(on_their_way + 1), opti.parameter(AHEAD)
    steer = opti.variable(AHEAD)
    acting = cs.vertcat(queue[1:], steer) if on_their_way else steer
    x, cost = start, 0
    for k in range(AHEAD):
        x = moved(x, acting[k])
        cost += (x[3] - goal[k]) ** 2 + 2.0 * (steer[k] - (steer[k - 1] if k else queue[-1])) ** 2
    opti.minimize(cost)
    opti.subject_to(opti.bounded(-0.3, steer, 0.3))
    opti.solver("ipopt", {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.max_iter": 30})
    return opti.to_function("steer", [start, queue, goal, steer], [steer])


def driven(known):
    """The car, whose steering acts a step late, under a controller that knows of `known` such steps."""
    late = round(LATE / STEP)
    decide, x, sent, guess, places = controller(known), np.zeros(4), [0.0] * (late + 1), np.zeros(AHEAD), []
    for k in range(140):
        goal = path(STEP * (k + 1 + np.arange(AHEAD)))
        guess = np.asarray(decide(x, sent[len(sent) - known - 1 :], goal, guess)).ravel()
        sent.append(float(guess[0]))
        x = np.asarray(moved(x, sent[-1 - late])).ravel()
        places.append(x[3])
        guess = np.append(guess[1:], guess[-1])
    return np.array(places)


# %%
# Both drives, and the distance of each from the path.
time = STEP * np.arange(1, 141)
figure, (place, off) = plt.subplots(2, 1, figsize=(7, 4.4), sharex=True, layout="constrained")
place.plot(time, path(time), "k--", linewidth=1, label="path")
for label, known, colour in (("vehicle file", 0, "#d55e00"), ("closed model", round(LATE / STEP), "#0072b2")):
    error = (places := driven(known)) - path(time)
    place.plot(time, places, color=colour, label=label)
    off.plot(time, error, color=colour, label=f"{label}: RMS {np.sqrt(np.mean(error**2)):.3f} m")
place.set(
    title=f"Double lane change at {SPEED:.0f} m/s, steering {1e3 * LATE:.0f} ms late", ylabel="lateral position [m]"
)
off.set(xlabel="time [s]", ylabel="path error [m]")
place.legend(loc="lower center")
off.legend(loc="upper left")

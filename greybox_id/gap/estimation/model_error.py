"""Model error inside the likelihood: unknown forces and coloured sensors, and the filter that whitens residuals.

No equations are a vehicle's. What they leave out acts as forces on the axles and along the car: first-order
Gauss-Markov processes xi of unit variance, as large as a share of the forces themselves, and a floor,

    F_yf + s_f xi_f    F_yr + s_r xi_r    F_drag + s_x xi_x        d xi = -xi dt / tau + sqrt(2 / tau) dW
    s_f^2 = (floor_y m / 2)^2 + (share_y F_yf)^2
    s_x^2 = (floor_x m)^2 + (share_x (|F_drive| + |F_drag|))^2

so that accelerometers see them too. About a simulation its error obeys the linearised equations, and a Kalman filter
turns residuals into innovations that are independent and of unit variance. The same filter whitens the derivative of
the residuals by any number. Source: Kristensen, Madsen & Jorgensen, Automatica 40, 2004; Kennedy & O'Hagan, J. R.
Statist. Soc. B 63, 2001.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...base.shorthands import Array
from ...engine.virtual import SampledFunction
from ...models.vehicle import StatedModelError
from .bench import Bench
from .calibration import CAL
from .descent import Curve, descended
from .error_filter import filtered, innovations
from .unknown_forces import FORCES, SCALES


@dataclass(frozen=True)
class Amplitudes:
    """Sizes of model error and of noise.

    Attributes
    ----------
    share_y, share_x : sd of the unknown force over the lateral force of an axle, over the longitudinal force.
    floor_y, floor_x : m/s^2, sd of the unknown forces over the mass where these forces vanish.
    memory_y, memory_x : s, correlation times.
    noise : (channels,) standard deviations of white noise.
    colour : (channels,) standard deviations of the slow part of readings' errors.
    memory : s, its correlation time.
    """

    share_y: float
    share_x: float
    floor_y: float
    floor_x: float
    memory_y: float
    memory_x: float
    noise: Array
    colour: Array
    memory: float

    @property
    def logarithms(self) -> Array:
        """(amplitudes,) logarithms of all of them, in which they are estimated."""
        six = (self.share_y, self.share_x, self.floor_y, self.floor_x, self.memory_y, self.memory_x)
        return np.asarray(np.log(np.concatenate([six, self.noise, self.colour, [self.memory]])))

    @staticmethod
    def of(logarithms: Array) -> Amplitudes:
        """Amplitudes from their logarithms."""
        values = np.exp(logarithms)
        n = (len(values) - 7) // 2
        share_y, share_x, floor_y, floor_x, memory_y, memory_x = (float(v) for v in values[:6])
        noise, colour = values[6 : 6 + n], values[6 + n : -1]
        return Amplitudes(share_y, share_x, floor_y, floor_x, memory_y, memory_x, noise, colour, float(values[-1]))


def scaled(value: Amplitudes, by: float) -> Amplitudes:
    """Model error `by` times as large."""
    return replace(value, share_y=value.share_y * by, share_x=value.share_x * by, floor_y=value.floor_y * by,
                   floor_x=value.floor_x * by)  # fmt: skip


def at_least(amplitudes: Amplitudes, least: Amplitudes) -> Amplitudes:
    """Model error no smaller than `least`; noise of sensors as it is."""
    names = ("share_y", "share_x", "floor_y", "floor_x", "memory_y", "memory_x")
    return replace(amplitudes, **{name: max(getattr(amplitudes, name), getattr(least, name)) for name in names})


@dataclass(frozen=True)
class AmplitudePrior:
    """Prior of the amplitudes: medians, and standard deviations of the logarithms, in the order of `logarithms`."""

    median: Amplitudes
    sd: Array

    def cost(self, logarithms: Array) -> Array:
        """(...,) negative logarithm of the prior's density, for (..., amplitudes)."""
        return np.asarray(0.5 * np.sum(((logarithms - self.median.logarithms) / self.sd) ** 2, axis=-1))


def amplitude_prior(
    noise: Array, noise_stated: bool, exact: bool, stated: Mapping[str, StatedModelError]
) -> AmplitudePrior:
    """Prior of model error and noise, before a recording is examined.

    Parameters
    ----------
    noise : (channels,) standard deviations, stated or estimated.
    noise_stated : whether they were stated.
    exact : whether the equations' numbers are stated without tolerances.
    stated : "F_y", "F_x" -> what a vehicle file states of its model error; the rest is as of any vehicle.
    """
    form = CAL.form_exact if exact else CAL.form
    floor = CAL.floor * form / CAL.form
    n = len(noise)
    colour = (CAL.colour_exact if exact else CAL.colour) * noise
    usual = {"share": (form, CAL.amplitude_sd), "amplitude": (floor, CAL.amplitude_sd)}
    usual["correlation_time"] = (CAL.memory, CAL.amplitude_sd)
    medians, sds = list[float](), list[float]()
    for name, (middle, sd) in usual.items():
        for force in ("F_y", "F_x"):
            known = getattr(stated.get(force), name, None)
            medians.append(middle if known is None else known)
            sds.append(sd if known is None else CAL.amplitude_sd / 2)
    all_sds = np.concatenate([
        sds, [CAL.noise_sd if noise_stated else CAL.noise_sd_estimated] * n, [CAL.amplitude_sd] * (n + 1),
    ])  # fmt: skip
    share_y, share_x, floor_y, floor_x, memory_y, memory_x = medians
    median = Amplitudes(share_y, share_x, floor_y, floor_x, memory_y, memory_x, noise, colour, CAL.sensor_memory)
    return AmplitudePrior(median, all_sds)


@dataclass(frozen=True)
class Linearised:
    """Error dynamics linearised about a simulation: S segments of all runs, one after the other.

    Attributes
    ----------
    A, B : (S, n, n), (S, n, forces) transition over a segment, from errors of the n states kept and from unknown
        forces.
    C, D : (S, channels, n), (S, channels, forces) output matrices of these errors and of unknown forces.
    length : (S,) s.
    force : (S, forces) size of the modelled force that each unknown one is a share of, N.
    axis : (forces,) 0 for lateral ones, 1 for longitudinal ones.
    mass : kg.
    start : (n,) variance of the states where runs begin.
    first : (S,) whether a run begins.
    pointer : (S + 1,) index of the first reading of each segment.
    row, channel : (R,) of each reading.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    length: Array
    force: Array
    axis: NDArray[np.intp]
    mass: float
    start: Array
    first: NDArray[np.bool_]
    pointer: NDArray[np.intp]
    row: NDArray[np.intp]
    channel: NDArray[np.intp]

    @cached_property
    def read(self) -> NDArray[np.intp]:
        """Channels with readings: these have slow errors."""
        return np.unique(self.channel)

    @cached_property
    def transition(self) -> Array:
        """(S, n, n + slow errors + forces) by which these become errors of the states over a segment."""
        S, n, forces = self.B.shape
        F = np.zeros((S, n, n + len(self.read) + forces))
        F[..., :n], F[..., F.shape[2] - forces :] = self.A, self.B
        return F

    @cached_property
    def output(self) -> Array:
        """(S, channels, n + slow errors + forces) of all errors of readings but white noise."""
        (S, channels, n), c = self.C.shape, len(self.read)
        H = np.zeros((S, channels, n + c + self.D.shape[2]))
        H[..., :n], H[..., n + c :] = self.C, self.D
        H[:, self.read, n + np.arange(c)] = 1.0
        return H


class ForceSizes:
    """Sizes of the modelled forces that unknown ones are shares of, along a simulation."""

    def __init__(self, bench: Bench) -> None:
        trace = bench.simulator.trace
        self.forces = [force for force, (name, _) in FORCES.items() if name in bench.model]
        requested = list(dict.fromkeys(n for f in self.forces for n in SCALES[f] if n in bench.model.quantities))
        self._evaluated = SampledFunction(trace.named_values(tuple(requested)))
        self._requested = requested

    def __call__(self, z: Array, segments: Array, p: Array) -> Array:
        """(S, forces) N."""
        known = np.abs(self._evaluated(z, segments, p))
        columns = [
            sum(known[:, self._requested.index(n)] for n in SCALES[f] if n in self._requested) for f in self.forces
        ]
        return np.column_stack(columns)


def linearised(bench: Bench, p: Array, noise: Array, sizes: ForceSizes, more: Sequence[int] = ()) -> Linearised:
    """Linearise errors about the simulation with these parameters.

    Parameters
    ----------
    bench, sizes : of a model with unknown forces, and the sizes of these.
    noise : (channels,) standard deviations of the readings at which runs start.
    more : indices of further parameters to differentiate by: columns of B and D behind those of the forces.
    """
    model, simulator = bench.model, bench.simulator
    names = [parameter.name for parameter in model.parameters]
    columns = [*(names.index(FORCES[force][0]) for force in sizes.forces), *more]
    trajectory = bench.trajectory(p)
    segments = np.concatenate([item.segments for item, _ in trajectory])
    z = np.concatenate([item for _, item in trajectory])
    along = bench.along(p)
    with np.errstate(all="ignore"):
        _, Z, _, Y = simulator.kernel.linearise(z, segments[:, None, :], along, np.array([True]), np.array(columns))
    nz = simulator.trace.size
    Y = Y[:, 0]
    A, B, C, D = Z[:, :, :nz], Z[:, :, nz:], Y[:, :, :nz], Y[:, :, nz:]
    kept = _states_that_matter(A, B, C)
    counted, first, row, channel, place = bench.counted, [], [], [], []
    offset = 0
    for (plan, _), rows in zip(trajectory, bench.rows, strict=True):
        read = np.where(counted[rows], plan.read_segment, -1)
        r, c = np.nonzero(read >= 0)
        row.append(r + rows.start)
        channel.append(c)
        place.append(read[r, c] + offset)
        first.append(offset)
        offset += len(plan.segments)
    places = np.concatenate(place)
    order = np.argsort(places, kind="stable")
    begins = np.zeros(offset, dtype=bool)
    begins[first] = True
    start = np.zeros(nz)
    for k, state in enumerate(model.states):
        read_by = state.name in model.outputs and np.any(counted[:, model.outputs.index(state.name)])
        sd = noise[model.outputs.index(state.name)] if read_by else CAL.unknown_start * state.scale
        start[k] = 0.0 if k in bench.loose else sd**2
    force = sizes(z, segments, along)
    parts = (A[:, kept][:, :, kept], B[:, kept], C[:, :, kept], D, segments[:, 0], force)
    A, B, C, D, length, force = (np.ascontiguousarray(np.nan_to_num(each)) for each in parts)
    return Linearised(
        A=A, B=B, C=C, D=D, length=length, force=force,
        axis=np.array([0 if FORCES[f][1] == "y" else 1 for f in sizes.forces]),
        mass=float(p[names.index("m")]), start=start[kept], first=begins,
        pointer=np.searchsorted(places[order], np.arange(offset + 1)),
        row=np.concatenate(row)[order], channel=np.concatenate(channel)[order],
    )  # fmt: skip


def _states_that_matter(A: Array, B: Array, C: Array) -> NDArray[np.bool_]:
    """(n,) whether errors reach a state, and it reaches readings; other states need not be followed."""
    moves, seen = np.any(A != 0, axis=0), np.any(C != 0, axis=(0, 1))
    reached = np.any(B != 0, axis=(0, 2))
    reached |= np.arange(len(reached)) < min(3, len(reached))  # the starts of these are uncertain
    for _ in range(len(reached)):
        reached = reached | np.any(moves & reached[None, :], axis=1)
        seen = seen | np.any(moves & seen[:, None], axis=0)
    return np.asarray(reached & seen)


@dataclass(frozen=True)
class ModelError:
    """Whitening of residuals by a Kalman filter of model error and noise, about one simulation.

    Attributes
    ----------
    about : error dynamics about that simulation.
    amplitudes : of model error and noise.
    usable : (N, channels) readings that count.
    gain, size : (R, n), (R,) of the filter: its gains, and standard deviations of its innovations.
    """

    about: Linearised
    amplitudes: Amplitudes
    usable: NDArray[np.bool_]
    gain: Array
    size: Array

    @property
    def readings(self) -> int:
        """Number of readings that count."""
        return len(self.size)

    @property
    def stationary_sd(self) -> Array:
        """(channels,) standard deviation of a reading's error."""
        return np.asarray(np.hypot(self.amplitudes.noise, self.amplitudes.colour))

    @cached_property
    def _decay(self) -> Array:
        """(S, slow errors + forces) factor of these processes over a segment."""
        forces, (colour, slow) = unknown_forces(self.about, [self.amplitudes]), _slow(self.about, [self.amplitudes])
        return np.hstack([np.repeat(slow, len(colour), axis=1), forces.decay[..., 0]])

    def white(self, values: Array) -> Array:
        """Innovations over their standard deviation, (N, channels, ...); zero where no reading counts."""
        about, (n, channels), more = self.about, values.shape[:2], int(np.prod(values.shape[2:]))
        one = np.zeros((n * channels, more))
        innovations(
            about.transition, about.output, self._decay, about.first, about.pointer, about.channel, self.gain,
            self.size, about.row * channels + about.channel, np.ascontiguousarray(values).reshape(one.shape), one,
        )  # fmt: skip
        return one.reshape(values.shape)


def model_error(about: Linearised, amplitudes: Amplitudes, usable: NDArray[np.bool_]) -> ModelError:
    """The filter for these amplitudes; only usable readings count."""
    kept = _only(about, usable)
    _, variance, gain = _filtered(kept, [amplitudes], unknown_forces(kept, [amplitudes]), np.zeros(len(kept.row)))
    return ModelError(kept, amplitudes, usable, gain, np.sqrt(variance[:, 0]))


def estimated(
    about: Linearised,
    residuals: Array,
    usable: NDArray[np.bool_],
    prior: AmplitudePrior,
    near: Amplitudes | None = None,
) -> Amplitudes:
    """The amplitudes of highest posterior density, given residuals; by Fisher scoring.

    Their curvatures differ by orders of magnitude: without the information, a search stops hundreds of nats early.

    Parameters
    ----------
    about : error dynamics about the simulation that left the residuals.
    residuals, usable : (N, channels).
    near : where the search begins; None: at the prior's medians.
    """
    kept = tuned_on(about, usable)
    r = np.ascontiguousarray(residuals[kept.row, kept.channel])
    start = prior.median.logarithms
    free = np.ones(len(start), dtype=bool)
    free[6:-1] = np.tile(np.isin(np.arange(len(prior.median.noise)), kept.read), 2)

    def placed(x: Array) -> Array:
        result = start + 0.0
        result[free] = x
        return result

    def cost(x: Array) -> float:
        at = placed(x)
        return float(negative_log_likelihood(kept, [Amplitudes.of(at)], r)[0] + prior.cost(at))

    def curve(x: Array) -> Curve:
        at = placed(x)
        lanes = np.vstack([at, at + CAL.beside * np.eye(len(at))[free]])
        lanes = np.vstack([lanes, *[at[None]] * (-len(lanes) % 4)])  # four fill a register
        fisher = np.zeros((len(lanes), len(lanes)))
        nll = negative_log_likelihood(kept, [Amplitudes.of(lane) for lane in lanes], r, fisher=fisher)
        beside = slice(1, 1 + len(x))
        off, precision = at - start, prior.sd[free] ** -2.0
        g = (nll[beside] - nll[0]) / CAL.beside + off[free] * precision
        return Curve(float(nll[0] + prior.cost(at)), g, fisher[beside, beside] / CAL.beside**2 + np.diag(precision))

    width = 4.0 * prior.sd[free]
    begin = start if near is None else near.logarithms
    x, _ = descended(
        cost, curve, begin[free], start[free] - width, start[free] + width, CAL.amplitudes_settled, CAL.amplitude_sd
    )
    return Amplitudes.of(placed(x))


def tuned_on(about: Linearised, usable: NDArray[np.bool_]) -> Linearised:
    """The beginnings of runs that amplitudes are estimated from, with the usable readings alone."""
    about, most = _only(about, usable), CAL.segments
    count = len(about.first)
    if count <= most:
        return about
    begins = np.flatnonzero(about.first)
    ends = np.append(begins[1:], count)
    kept = np.zeros(count, dtype=bool)
    for a, b in zip(begins, ends, strict=True):
        kept[a : a + max(1, round((b - a) * most / count))] = True
    readings, sizes = np.repeat(kept, np.diff(about.pointer)), np.diff(about.pointer)[kept]
    return replace(
        about, A=about.A[kept], B=about.B[kept], C=about.C[kept], D=about.D[kept], length=about.length[kept],
        force=about.force[kept], first=about.first[kept], pointer=np.concatenate(([0], np.cumsum(sizes))),
        row=about.row[readings], channel=about.channel[readings],
    )  # fmt: skip


def _only(about: Linearised, usable: NDArray[np.bool_]) -> Linearised:
    """The same with the usable readings alone."""
    kept = usable[about.row, about.channel]
    places = np.repeat(np.arange(len(about.first)), np.diff(about.pointer))[kept]
    pointer = np.searchsorted(places, np.arange(len(about.pointer)))
    return replace(about, row=about.row[kept], channel=about.channel[kept], pointer=pointer)


@dataclass(frozen=True)
class Processes:
    """Stationary first-order Gauss-Markov processes along S segments, in each of L lanes.

    Attributes
    ----------
    sd : (S, processes, L) standard deviations.
    correlation : (S, processes, L) between the beginning of a segment and its end.
    """

    sd: Array
    correlation: Array

    @property
    def decay(self) -> Array:
        """(S, processes, L) factor from the beginning of a segment to that of the next one."""
        return np.asarray(self.correlation * np.concatenate([self.sd[1:], self.sd[-1:]]) / self.sd)


def unknown_forces(about: Linearised, lanes: Sequence[Amplitudes]) -> Processes:
    """The unknown forces, N, with the amplitudes of each lane."""
    place = np.where(about.axis == 0, 0, 1)
    floor = np.array([[lane.floor_y / 2, lane.floor_x] for lane in lanes]).T * about.mass
    share = np.array([[lane.share_y, lane.share_x] for lane in lanes]).T
    memory = np.array([[lane.memory_y, lane.memory_x] for lane in lanes]).T
    sd = np.sqrt(floor[place] ** 2 + (share[place] * about.force[:, :, None]) ** 2)
    return Processes(sd, np.exp(-about.length[:, None, None] / memory[place]))


def sizes_of(about: Linearised, one: Amplitudes, usual: Amplitudes) -> tuple[tuple[float, float], float]:
    """Root mean squares of unknown forces along a simulation.

    Returns
    -------
    relative : of lateral and of longitudinal ones, over those of the modelled forces.
    over_usual : of the one that is largest compared with its usual size, over that size.
    """
    squares = np.mean(unknown_forces(about, [one, usual]).sd ** 2, axis=0)
    modelled = np.mean(about.force**2, axis=0)
    relative = (np.sqrt(np.sum(squares[at, 0]) / max(np.sum(modelled[at]), 1e-300)) if np.any(at) else 0.0
                for at in (about.axis == 0, about.axis == 1))  # fmt: skip
    lateral, longitudinal = (float(each) for each in relative)
    return (lateral, longitudinal), float(np.sqrt(np.max(squares[:, 0] / squares[:, 1], initial=0.0)))


def _slow(about: Linearised, lanes: Sequence[Amplitudes]) -> tuple[Array, Array]:
    """Of slow errors of the channels that are read: (slow errors, L) standard deviations, (S, L) correlations."""
    colour = np.array([lane.colour[about.read] for lane in lanes]).T
    memory = np.array([lane.memory for lane in lanes])
    return np.ascontiguousarray(colour), np.exp(-about.length[:, None] / memory)


def negative_log_likelihood(
    about: Linearised, lanes: Sequence[Amplitudes], r: Array, more: Processes | None = None, fisher: Array | None = None
) -> Array:
    """(L,) of residuals, under the amplitudes of each lane.

    Parameters
    ----------
    about : error dynamics about the simulation that left the residuals.
    lanes : L amplitudes.
    r : (R,) residual of each reading.
    more : processes behind the unknown forces, one for each further column of B and D.
    fisher : (L, L) receives the Fisher information of differences of the lanes from the first one; or None.
    """
    forces = unknown_forces(about, lanes)
    if more is not None:
        pairs = ((forces.sd, more.sd), (forces.correlation, more.correlation))
        forces = Processes(*(np.concatenate(pair, axis=1) for pair in pairs))
    nu, variance, _ = _filtered(about, lanes, forces, r)
    logarithm = np.log(variance)
    result = 0.5 * (np.einsum("rl,rl->l", nu, nu / variance) + np.sum(logarithm, axis=0))
    if fisher is not None:  # in place: these arrays are large
        nu -= nu[:, :1]
        nu /= np.sqrt(variance[:, :1])
        logarithm -= logarithm[:, :1]
        logarithm *= np.sqrt(0.5)
        fisher += logarithm.T @ logarithm + nu.T @ nu
    return np.asarray(result)


def _filtered(
    about: Linearised, lanes: Sequence[Amplitudes], forces: Processes, r: Array
) -> tuple[Array, Array, Array]:
    """Innovations and their variances, (R, L), and gains, (R, n), of the first lane."""
    white = np.ascontiguousarray(np.array([lane.noise for lane in lanes]).T ** 2)
    return filtered(
        about.transition, about.output, about.start, *_slow(about, lanes), forces.sd, forces.correlation, white,
        about.first, about.pointer, about.channel, r,
    )  # fmt: skip

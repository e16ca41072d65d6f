"""Variance components of scenario D, estimated from the data by restricted maximum likelihood.

Boresight, offsets and planes are integrated out, so their number does not bias the components
(Patterson and Thompson 1971; Koch 1999, section 3.6). The gradient comes from the posterior moments
of the random effects (the identity behind the EM algorithm), so it costs as much as two values. A
wide prior keeps a component that the flight cannot see near the specification. What the estimate
leaves open is carried into the boresight's covariance by the curvature of the likelihood.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import solveh_banded
from scipy.optimize import minimize_scalar

from paperrepro.method.adjustment.trajectory_equations import (
    N_COMPONENTS,
    CellBlocks,
    GaussMarkov,
)
from paperrepro.method.adjustment.trajectory_solver import (
    DataNormals,
    Noise,
    Solution,
    State,
    Step,
    TrajectoryModel,
    eliminate,
    iterate,
    prior_chi2,
)

#: Groups of components that have a factor and a correlation time of their own.
GROUPS = {"horizontal": (0, 1), "height": (2,), "roll_pitch": (3, 4), "heading": (5,)}
#: Standard deviation of the logarithm of each factor, before the data: a factor of three.
PRIOR_LOG_SIGMA = np.log(3.0)
#: Errors that last for about a second: their correlation time, s, and their sigma before the data,
#: as a share of the specified one.
FAST_TIME, FAST_SHARE = 1.0, 0.2
#: Roughness of a face that its points share, m, before the data, to a factor of ten.
SURFACE, SURFACE_LOG_SIGMA = 0.003, np.log(10.0)
#: No factor leaves a hundredth to a hundred times the specification.
WIDEST_LOG = np.log(100.0)
#: Where roughness stands; and change of -2 log likelihood at which a search ends.
ROUGHNESS, FTOL = 14, 0.01
#: Steps of a search, and how long one may be.
MOST_STEPS, LONGEST = 20, 1.5
#: A logarithm known to a tenth leaves nothing open.
MANY = 100.0
#: Rounds of estimating components and adjusting under them, and change at which they end.
ROUNDS, FINAL = 3, 0.05


@dataclass(frozen=True)
class VarianceComponents:
    """Factor on the laser's specified sigma, ``range``; sigma of a view's ``surface`` error and of
    the ``roughness`` that its points of a moment share, m; for each of `GROUPS` the factors (4,) on
    the specified ``sigma`` and ``correlation_time``, and the sigma of errors that last a second,
    ``fast``, as a share of the specified.

    ``logs`` (15,) are the logarithms of all, of roughness that of its ratio to ``range``;
    ``covariance`` (15, 15) of these, or None."""

    logs: np.ndarray = field(
        default_factory=lambda: np.log([1.0, SURFACE, *8 * [1.0], *4 * [FAST_SHARE], SURFACE])
    )
    covariance: np.ndarray | None = None

    @property
    def range(self) -> float:
        return float(np.exp(self.logs[0]))

    @property
    def surface(self) -> float:
        return float(np.exp(self.logs[1]))

    @property
    def sigma(self) -> np.ndarray:
        return np.exp(self.logs[2:6])

    @property
    def correlation_time(self) -> np.ndarray:
        return np.exp(self.logs[6:10])

    def named(self) -> dict[str, float]:
        """Plain numbers by name: surface in m, the rest as factors on what is specified."""
        out = {"range": self.range, "surface_m": self.surface, "roughness_m": self.roughness}
        for k, group in enumerate(GROUPS):
            out |= {
                group: float(self.sigma[k]), f"{group}_time": float(self.correlation_time[k]),
                f"{group}_fast": float(self.fast[k]),
            }  # fmt: skip
        return out

    @property
    def fast(self) -> np.ndarray:
        return np.exp(self.logs[10:14])

    @property
    def roughness(self) -> float:
        return float(np.exp(self.logs[0] + self.logs[14]))

    def constant(self, specified: GaussMarkov) -> np.ndarray:
        """(6,) sigma of an attitude that is off for the whole mission: what of the specified
        variance the lasting process, one standard deviation above its estimate, leaves; vibration
        that the INS does not report says nothing of it. No data tell it from the boresight; one of
        the position shifts the whole cloud and is not seen."""
        above = np.zeros(4) if self.covariance is None else np.sqrt(np.diag(self.covariance)[2:6])
        share = np.square(self.sigma * np.exp(above))
        constant = specified.sigma * np.sqrt(np.maximum(1 - _spread(share), 0.0))
        return np.r_[np.zeros(3), constant[3:]]

    def noise(self, specified: GaussMarkov, constant: np.ndarray) -> Noise:
        """Prior of the random effects, with the sigma (6,) of constants."""
        slow = GaussMarkov(
            specified.sigma * _spread(self.sigma),
            specified.correlation_time * _spread(self.correlation_time),
            specified.profile,
        )
        fast = replace(
            slow,
            sigma=specified.sigma * _spread(self.fast),
            correlation_time=np.full(6, FAST_TIME),
        )
        return Noise((slow, fast), constant, self.surface, self.roughness)

    def apply(self, model: TrajectoryModel) -> TrajectoryModel:
        """The model with the laser's variances scaled."""
        return replace(model, variances=model.variances * self.range**2)


def _spread(of_group: np.ndarray) -> np.ndarray:
    """(6,) of (4,)."""
    out = np.empty(6)
    for value, members in zip(of_group, GROUPS.values(), strict=True):
        out[list(members)] = value
    return out


_MIDDLE = VarianceComponents().logs
_LEAST, _MOST = _MIDDLE - WIDEST_LOG, _MIDDLE + WIDEST_LOG
_PRIOR_SIGMA = np.r_[10.0, SURFACE_LOG_SIGMA, np.full(12, PRIOR_LOG_SIGMA), SURFACE_LOG_SIGMA]
#: Components of laser and surfaces: any two strips show them.
OF_LASER = np.isin(np.arange(len(_MIDDLE)), (0, 1))


@dataclass(frozen=True)
class Estimate:
    """``components``, and ``open`` (3, 3) rad², what the boresight gets of their uncertainty, at
    the linearisation point ``state``."""

    components: VarianceComponents
    open: np.ndarray
    state: State


def estimate(
    model: TrajectoryModel,
    specified: GaussMarkov,
    solution: Solution,
    free: np.ndarray | None = None,
) -> Estimate:
    """Components, those of ``free`` (15,) bool, by default all, and roughness; the others keep
    their prior, under which the ``solution`` is. Raises as `trajectory_solver.iterate` does."""
    logs = VarianceComponents().logs
    free = np.arange(len(logs)) != ROUGHNESS if free is None else free
    for k in range(ROUNDS):
        components, before = VarianceComponents(logs), logs
        if k > 0:
            noise = components.noise(specified, np.zeros(6))
            solution = iterate(components.apply(model), noise, solution.state, 0.01)
        likelihood = Likelihood(
            model, specified, solution.state, solution.blocks, components.range**2
        )
        logs = _with_roughness(likelihood, logs)
        likelihood = likelihood.at(logs[ROUGHNESS])
        logs = _most_likely(likelihood, logs, free)
        if np.abs(logs - before).max() < FINAL:
            break
    return _with_uncertainty(likelihood, logs, free)


def _most_likely(likelihood: "Likelihood", logs: np.ndarray, free: np.ndarray) -> np.ndarray:
    """``logs`` with those of ``free`` (15,) at the least `Likelihood`: steps by average information
    until one promises less than `FTOL`."""
    value, gradient, information = likelihood.information(logs)
    for _ in range(MOST_STEPS):
        step = np.zeros(len(logs))
        step[free] = -np.linalg.solve(information[np.ix_(free, free)], gradient[free])
        promised = -gradient @ step / 2
        step *= min(1.0, LONGEST / np.abs(step).max())
        moved = np.where(free, np.clip(logs + step, _LEAST, _MOST), logs)
        if promised < FTOL:
            return moved
        there = likelihood.information(moved)
        while there[0] > value and np.abs(moved - logs).max() > FINAL:
            moved = (logs + moved) / 2
            there = likelihood.information(moved)
        logs, (value, gradient, information) = moved, there
    return logs


def _with_uncertainty(likelihood: "Likelihood", logs, free) -> Estimate:
    """Second-order expansion of the boresight and its covariance in the components' logarithms: one
    standard deviation to both sides along each axis of their posterior."""
    # every condition speaks of the range, few of the rest: in these steps all matter alike
    step = np.ones(len(logs))
    step[0] = 1 / np.sqrt(2 * len(likelihood.model.tie_planes.rays))
    gradient, h = likelihood(logs)[1], 0.05
    H = np.empty((len(logs), len(logs)))
    for k in range(len(logs)):
        moved = logs + h * step * np.eye(len(logs))[k]
        H[k] = (likelihood(moved)[1] - gradient) * step / h if free[k] else 0.0
    precision = (H + H.T) / 4  # of -2 log likelihood, so half; and the mean of both triangles
    least = np.diag((step / _PRIOR_SIGMA) ** 2)
    precision[~free], precision[:, ~free] = least[~free], least[:, ~free]
    values, axes = np.linalg.eigh(precision)
    values = np.maximum(values, np.diag(axes.T @ least @ axes))
    covariance = (axes / values) @ axes.T * np.outer(step, step)
    components = VarianceComponents(logs, covariance)
    constant = components.constant(likelihood.specified)
    x, Q = likelihood.boresight(logs, constant)
    extra = np.zeros((3, 3))
    for value, axis in zip(values[values < MANY], axes.T[values < MANY], strict=True):
        for side in (1.0, -1.0):
            moved = logs + side * step * axis / np.sqrt(value)
            x_side, Q_side = likelihood.boresight(moved, constant)
            extra += (Q_side - Q + np.outer(x_side - x, x_side - x)) / 2
    values, axes = np.linalg.eigh(extra)
    return Estimate(components, (axes * np.maximum(values, 0.0)) @ axes.T, likelihood.state)


def sigma_of_group(information: np.ndarray, seen: np.ndarray, prior: float) -> tuple[float, float]:
    """Standard deviation of unknowns that are zero but for it: the most likely one, within a factor
    of a hundred of ``prior``, and by how much it raises twice the logarithm of the restricted
    likelihood against none. ``information`` (m,) is what the data alone have of them, along its own
    axes, and ``seen`` (m,) the squares of the right side."""

    def against_none(log_sigma):
        gain = 1 + np.exp(2 * log_sigma) * information
        return float((np.log(gain) - seen * np.exp(2 * log_sigma) / gain).sum())

    middle = np.log(prior)
    found = minimize_scalar(
        against_none, bounds=(middle - WIDEST_LOG, middle + WIDEST_LOG), method="bounded"
    )
    return float(np.exp(found.x)), -float(found.fun)


def _with_roughness(likelihood: "Likelihood", logs: np.ndarray) -> np.ndarray:
    """``logs`` with the ratio of roughness that is most likely, the others held: parabolas through
    the best three, until one promises less than `FTOL`."""
    at = np.arange(len(logs)) == ROUGHNESS

    def value(ratio):
        return likelihood.at(ratio)(np.where(at, ratio, logs), gradient=False)[0]

    tried = {ratio: value(ratio) for ratio in logs[ROUGHNESS] + np.array([-0.2, 0.0, 0.2])}
    for _ in range(10):
        best = min(tried, key=tried.get)
        three = sorted(sorted(tried, key=lambda ratio: abs(ratio - best))[:3])
        bend, slope, _ = curve = np.polyfit(three, [tried[ratio] for ratio in three], 2)
        downhill = best - np.sign(2 * bend * best + slope) * (three[-1] - three[0])
        ratio = -slope / (2 * bend) if bend > 0 else downhill
        ratio = np.clip(
            np.clip(ratio, *sorted((best, downhill))), _LEAST[ROUGHNESS], _MOST[ROUGHNESS]
        )
        if bend > 0 and tried[best] - np.polyval(curve, ratio) < FTOL:
            break
        tried[ratio] = value(ratio)
    return np.where(at, ratio, logs)


@dataclass(frozen=True)
class Likelihood:
    """Minus twice the restricted log likelihood and log prior of the components' logarithms, at the
    linearisation point ``state``, whose ``blocks`` times ``factor`` are under the specified laser.
    """

    model: TrajectoryModel
    specified: GaussMarkov
    state: State
    blocks: CellBlocks
    factor: float
    data: DataNormals | None = None

    def at(self, log_ratio: float) -> "Likelihood":
        """With the conditions' noise at one ratio of roughness."""
        sigma = np.exp(log_ratio) * np.sqrt(self.factor)
        noise = Noise((), np.zeros(6), 0.0, sigma)
        return replace(self, data=self.model.assemble(self.blocks, noise).scaled(self.factor))

    def __call__(self, logs: np.ndarray, gradient: bool = True) -> tuple[float, np.ndarray]:
        """Value, and gradient (15,) but for that of roughness, which is held."""
        step, noise, quadratic = self.step(logs)
        wide = (logs - _MIDDLE) / _PRIOR_SIGMA
        value = self._value(logs, step, noise, quadratic) + wide @ wide
        if not gradient:
            return value, wide
        return value, self._gradient(logs, noise, step, quadratic) + 2 * wide / _PRIOR_SIGMA

    def _value(self, logs: np.ndarray, step: Step, noise: Noise, quadratic: float) -> float:
        model, time = self.model, self.model.nodes.time
        n_conditions, n_surface = len(model.tie_planes.rays), self.state.surface.size
        log_det = step.log_det + n_surface * -np.log(noise.surface_weight)
        log_det -= sum(process.information(time)[2] for process in noise.processes)
        return quadratic - step.decrement + log_det + 2 * n_conditions * logs[0]

    def step(self, logs: np.ndarray) -> tuple[Step, Noise, float]:
        """The elimination under ``logs``, and the weighted squares before it."""
        components = VarianceComponents(logs)
        noise = components.noise(self.specified, np.zeros(6))
        scaled = self.data.scaled(components.range**-2)
        quadratic = scaled.chi2 + prior_chi2(self.model, noise, self.state)
        return eliminate(scaled, self.model, noise, self.state), noise, quadratic

    def boresight(self, logs: np.ndarray, constant: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Boresight (3,) and its covariance (3, 3) under ``logs``, one step from here."""
        components = VarianceComponents(logs)
        noise = components.noise(self.specified, constant)
        data = self.data.scaled(components.range**-2)
        step = eliminate(data, self.model, noise, self.state)
        return self.state.x[:3] + step.dy[:3], step.columns(3)[:3]

    def information(self, logs: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Value, gradient and, in place of second derivatives, average information (15, 15)
        (Gilmour, Thompson and Cullis 1995): products, by the inverse of the data's covariance, of
        how the data that are expected change with each component."""
        step, noise, quadratic = self.step(logs)
        wide = (logs - _MIDDLE) / _PRIOR_SIGMA
        value = self._value(logs, step, noise, quadratic) + wide @ wide
        gradient = self._gradient(logs, noise, step, quadratic) + 2 * wide / _PRIOR_SIGMA
        information = self._information(noise, step, quadratic - step.decrement)
        return value, gradient, information + 2 * np.diag(_PRIOR_SIGMA**-2.0)

    def _information(self, noise: Noise, step: Step, squares: float) -> np.ndarray:
        error, time = self.state.error + step.d_error, self.model.nodes.time
        surface = self.state.surface + step.d_surface
        u, n = len(self.state.x), len(_MIDDLE)
        fixed = np.concatenate([self.state.x, self.state.constant])
        fixed += np.r_[step.dy[:u], step.dy[-N_COMPONENTS:]]
        weight = np.concatenate([self.model.pseudo_weight, noise.constant_weight])
        # by component, what has a prior times its information changes; at the place of roughness
        # what is held of x and constants
        errors, surfaces = np.zeros((*error.shape, n)), np.zeros((*surface.shape, n))
        of_fixed = np.zeros((len(fixed), n))
        surfaces[..., 1] = 2 * noise.surface_weight * surface
        of_fixed[:, ROUGHNESS] = 2 * weight * fixed
        out = np.zeros((n, n))
        out[1, 1] = 2 * (surfaces[..., 1] * surface).sum()
        out[ROUGHNESS, ROUGHNESS] = 2 * of_fixed[:, ROUGHNESS] @ fixed
        for k, process in enumerate(noise.processes):
            by_sigma = 2 * _times(process.information(time), error[:, k])
            by_time, beyond = _by_time(process, time, error[:, k])
            for g, members in enumerate(map(list, GROUPS.values())):
                s, own = (2, 10)[k] + g, error[:, k, members]
                errors[:, k, members, s] = by_sigma[:, members]
                out[s, s] = 2 * (by_sigma[:, members] * own).sum()
                if k == 0:
                    t = 6 + g
                    errors[:, k, members, t] = by_time[:, members]
                    out[s, t] = out[t, s] = 2 * (by_time[:, members] * own).sum()
                    out[t, t] = (by_time * beyond)[:, members].sum()
        with_data = np.einsum("kpcn,kpc->n", errors, error) + fixed @ of_fixed
        with_data += np.einsum("fcn,fc->n", surfaces, surface)
        out -= step.squares(errors, surfaces, of_fixed)[0]
        # all variances together scale the data's covariance: what the laser's does is the rest
        scales = np.r_[1:6, 10:n]
        out[0] = out[:, 0] = 2 * with_data - out[scales].sum(axis=0)
        out[0, 0] = 2 * (2 * squares - with_data[scales].sum()) - out[0, scales].sum()
        out[ROUGHNESS] = out[:, ROUGHNESS] = 0.0
        return out

    def _gradient(self, logs, noise: Noise, step: Step, quadratic: float) -> np.ndarray:
        variance, beside, surface = step.covariance()
        error = self.state.error + step.d_error
        variance += error**2
        beside += error[1:] * error[:-1]
        surface = surface + np.square(self.state.surface + step.d_surface)
        slopes = np.zeros(len(logs))
        slopes[1] = 2 * surface.size - 2 * noise.surface_weight * surface.sum()
        expected = noise.surface_weight * surface.sum()
        time = self.model.nodes.time
        for k, process in enumerate(noise.processes):
            moments = variance[:, k], beside[:, k]
            expected += _expected(process, time, *moments)[0].sum()
            by_sigma, by_time = _slopes(process, time, *moments)
            for g, members in enumerate(GROUPS.values()):
                if k == 0:
                    slopes[2 + g] = by_sigma[list(members)].sum()
                    slopes[6 + g] = by_time[list(members)].sum()
                else:
                    slopes[10 + g] = by_sigma[list(members)].sum()
        # the conditions' part of the expected squares is what the priors leave
        u = len(self.state.x)
        fixed = np.r_[:u, len(step.dy) - 6 : len(step.dy)]
        weight = np.concatenate([self.model.pseudo_weight, noise.constant_weight])
        here = np.concatenate([self.state.x, self.state.constant]) + step.dy[fixed]
        expected += weight @ (here**2 + np.diag(step.own(u)))
        unknowns = len(step.dy) + variance.size + surface.size
        slopes[0] = 2 * len(self.model.tie_planes.rays)
        slopes[0] -= 2 * (quadratic - step.decrement + unknowns - expected)
        return slopes


def _times(information, error: np.ndarray) -> np.ndarray:
    """Information, as `GaussMarkov.information` has it, times ``error`` (K, 6)."""
    diagonal, beside, *_ = information
    out = diagonal * error
    out[:-1] += beside * error[1:]
    out[1:] += beside * error[:-1]
    return out


def _by_time(process: GaussMarkov, time, error) -> tuple[np.ndarray, np.ndarray]:
    """Minus the derivative (K, 6) of information times ``error`` by the logarithm of the
    correlation time, and covariance times that."""
    h = 1e-4
    longer, shorter = (
        _times(
            replace(process, correlation_time=process.correlation_time * f).information(time), error
        )
        for f in (np.exp(h), np.exp(-h))
    )
    change = (shorter - longer) / (2 * h)
    diagonal, beside, _ = process.information(time)
    bands = np.stack([diagonal, np.concatenate([beside, np.zeros_like(diagonal[:1])])])
    columns = [
        solveh_banded(bands[..., c], change[:, c], lower=True, check_finite=False)
        for c in range(N_COMPONENTS)
    ]
    return change, np.column_stack(columns)


def _expected(process: GaussMarkov, time, variance, beside) -> tuple[np.ndarray, np.ndarray]:
    """(6,) each: expected weighted squares of a process, and minus the log of its information."""
    diagonal, next_to, _ = process.information(time)
    squares = (diagonal * variance).sum(axis=0) + 2 * (next_to * beside).sum(axis=0)
    gained = -np.expm1(-2 * np.diff(time)[:, None] / process.correlation_time)
    return squares, 2 * len(time) * np.log(process.sigma) + np.log(gained).sum(axis=0)


def _slopes(process: GaussMarkov, time, variance, beside) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives (6,) of expected squares and log determinant by the logarithms of sigma, time."""
    h = 1e-4

    def total(tau_factor):
        moved = replace(process, correlation_time=process.correlation_time * tau_factor)
        squares, log_det = _expected(moved, time, variance, beside)
        return squares + log_det

    by_time = (total(np.exp(h)) - total(np.exp(-h))) / (2 * h)
    return 2 * len(time) - 2 * _expected(process, time, variance, beside)[0], by_time

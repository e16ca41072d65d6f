"""Variance components of scenario D, estimated from the data by restricted maximum likelihood.

Groups: range (all laser observations), position and attitude (their Gauss-Markov sigma), and the
correlation time. Each is a factor on the specification. Boresight, offsets and planes are
integrated out, so their number does not bias the components (Patterson and Thompson 1971; Koch
1999, section 3.6). A wide prior keeps a factor that the flight cannot see near the specification.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize

from paperrepro.adjustment.gauss_markov import GaussMarkov
from paperrepro.adjustment.trajectory_solver import (
    DataNormals,
    State,
    TrajectoryModel,
    eliminate,
    iterate,
    prior_chi2,
)

#: Standard deviation of the logarithm of each factor, before the data: a factor of three.
PRIOR_LOG_SIGMA = np.log(3.0)
#: No factor leaves a hundredth to a hundred times the specification.
WIDEST_LOG = np.log(100.0)
#: Rounds of estimating components and adjusting under them.
ROUNDS = 3


@dataclass(frozen=True)
class VarianceComponents:
    """Factors on the specified sigma of ``range`` (with the angles), ``position``, ``attitude``,
    and on the ``correlation_time``."""

    range: float = 1.0
    position: float = 1.0
    attitude: float = 1.0
    correlation_time: float = 1.0

    @classmethod
    def of(cls, theta: np.ndarray) -> "VarianceComponents":
        return cls(*(float(factor) for factor in np.exp(theta)))

    def theta(self) -> np.ndarray:
        """Logarithms of the factors, (4,)."""
        return np.log([self.range, self.position, self.attitude, self.correlation_time])

    def prior(self, specified: GaussMarkov) -> GaussMarkov:
        """The process with the factors applied."""
        factors = np.repeat([self.position, self.attitude], 3)
        return GaussMarkov(
            specified.sigma * factors, specified.correlation_time * self.correlation_time
        )

    def apply(self, model: TrajectoryModel) -> TrajectoryModel:
        """The model with the laser's variances scaled."""
        return replace(model, variances=model.variances * self.range**2)


def estimate(
    model: TrajectoryModel, specified: GaussMarkov, state: State
) -> tuple[VarianceComponents, State]:
    """Components, and the state adjusted under them. Raises as `trajectory_solver.iterate` does."""
    components = VarianceComponents()
    # every condition speaks of the range, few of the rest: in these steps all matter alike
    step = np.array([1 / np.sqrt(2 * len(model.matched.rays)), 1.0, 1.0, 1.0])
    for _ in range(ROUNDS):
        solution = iterate(components.apply(model), components.prior(specified), state)
        state, data = solution.state, solution.data.scaled(components.range**2)
        found = minimize(
            lambda z, *rest: _objective(step * z, *rest),
            components.theta() / step,
            args=(data, model, specified, state),
            method="L-BFGS-B",
            bounds=[(-WIDEST_LOG / s, WIDEST_LOG / s) for s in step],
            options={"eps": 1e-3, "gtol": 0.05, "maxiter": 50},
        )
        change = np.abs(step * found.x - components.theta()).max()
        components = VarianceComponents.of(step * found.x)
        if change < 0.02:
            break
    return components, state


def _objective(
    theta: np.ndarray,
    data: DataNormals,
    model: TrajectoryModel,
    specified: GaussMarkov,
    state: State,
) -> float:
    """Minus twice the restricted log likelihood, at the linearisation point ``state``."""
    components = VarianceComponents.of(theta)
    prior, time = components.prior(specified), model.nodes.time
    scaled = data.scaled(components.range**-2)
    try:
        step = eliminate(scaled, prior, time, state, model.pseudo_weight)
    except np.linalg.LinAlgError:
        return np.inf
    quadratic = scaled.chi2 + prior_chi2(prior, time, state.error) - step.decrement
    quadratic += float(model.pseudo_weight @ np.square(state.x))
    log_det = step.factor.log_det + np.linalg.slogdet(step.S)[1] - prior.information(time)[2]
    n_conditions = len(model.matched.rays)
    wide = np.square(theta / PRIOR_LOG_SIGMA).sum()
    return quadratic + log_det + 2 * n_conditions * theta[0] + wide

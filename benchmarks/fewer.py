"""What making a plan's matrix products fewer gains, and what it costs, at 300 points.

On the points of plans from 8 states of the data, for the data of 30 episodes of the paper's loop and for uniform data:
the triangular product, float32 with a rigorous bound, dropping eigen-directions, dropping points that are far away, and
bounding the return of a candidate by few points before it is computed with all. Only the first is in the package.

* float32: the product errs by at most g |P| |k|, entry by entry, with P = L^-1, g = (n + 2) 2^-24. This gives an
  interval for each return; elites provably stay where the intervals of the elites and of the others are apart.
* low rank: (u_i . k)^2 <= lambda_i k(z, z), so that dropping all directions with lambda_i / (lambda_i + noise) below
  some tolerance changes the variance by at most that tolerance times k(z, z).
* far points: dropping the columns k_F changes |L^-1 k| by at most |k_F| / noise^(1/2). The rest needs a factor of
  its own, made once a plan.
* few points first: the variance given a subset of the points is never smaller than given all, so that it bounds the
  return from above; only candidates whose bound reaches the tenth return need all points.
"""

from __future__ import annotations

from itertools import pairwise

import torch
from harness import arguments, race, table, write
from task import ELITES, TRUTH, icem, pendulum_gp, uniform_transitions
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from torch_activegp.acquisition import prior_discrepancy
from torch_activegp.envs import GPEnv
from torch_activegp.models import DynamicsGP
from torch_activegp.models.inverse_factor import InverseFactor

FAR, RANK_TOLERANCE, SUBSETS, STARTS = 1e-12, 1e-6, (50, 100, 150), 8


class Recorder(GPEnv):
    """An environment that keeps the candidates and rewards of a plan."""

    def __init__(self, gp: DynamicsGP) -> None:
        super().__init__(gp, prior_discrepancy())
        self.heard: list[tuple[Tensor, Tensor]] = []

    def imagine(self, tensordict: TensorDictBase, actions: Tensor) -> Tensor:
        """See :class:`GPEnv`."""
        rewards = super().imagine(tensordict, actions)
        self.heard.append((actions.clone(), rewards))
        return rewards


def loop_data(episodes: int, generator: torch.Generator) -> DynamicsGP:
    """The paper's loop, 10 steps an episode, each from the state of largest variance among 1000."""
    gp = pendulum_gp()
    planner = icem(GPEnv(gp, prior_discrepancy()))
    for _ in range(episodes):
        state, action, _ = uniform_transitions(1000, generator)
        posterior = gp.posterior
        spread = posterior.variance(posterior.features(torch.cat([state, action], dim=-1))).sum(-1)
        state = state[spread.argmax()]
        planner.reset()
        for _ in range(10):
            action = planner(TensorDict({"state": state}, batch_size=[]))["action"]
            following = TRUTH.step(state, action)
            gp.update(state.unsqueeze(0), action.unsqueeze(0), following.unsqueeze(0))
            state = following
        gp.begin_episode()
    return gp


def plan_rows(gp: DynamicsGP, td: TensorDict) -> list[tuple[Tensor, Tensor]]:
    """For each iteration of a plan: k(z, Z) ``(H * C, n)`` at all its points, and the returns ``(C,)``."""
    env = Recorder(gp)
    icem(env)(td)
    space, posterior, found = gp.state_space, gp.posterior, []
    for actions, rewards in env.heard:
        state, rows = td["state"].expand(actions.shape[0], -1), []
        for action in actions.unbind(1):
            features = posterior.features(torch.cat([state, action], dim=-1))
            rows.append(features.cross[0].clone())
            state = space.wrap(posterior.loc(features)).clamp(space.low, space.high)
        found.append((torch.cat(rows), rewards.sum(-1)))
    return found


def spread(squared: Tensor) -> Tensor:
    """Sigma from |L^-1 k|^2 at unit signal variance."""
    return (1.0 - squared).clamp_min(0.0).sqrt()


def returns_between(low: Tensor, high: Tensor, candidates: int) -> Tensor:
    """How much each candidate's sum of sigma may differ, ``(C,)``."""
    return (high - low).reshape(-1, candidates).sum(0)


def single_precision(inverse: Tensor, rows: Tensor, returns: Tensor) -> dict[str, float]:
    """Error of sigma in float32, width of the rigorous intervals of the returns, gap at the last elite."""
    exact = spread((rows @ inverse.mT).square().sum(-1))
    norm = (rows.float() @ inverse.float().mT).double().norm(dim=-1)
    error = (inverse.shape[0] + 2) * 2.0**-24 * (rows.abs() @ inverse.abs().mT).norm(dim=-1)
    low, high = spread((norm + error).square()), spread((norm - error).clamp_min(0.0).square())
    ordered = returns.sort(descending=True).values
    width = returns_between(low, high, returns.shape[0])
    gap = float(ordered[ELITES - 1] - ordered[ELITES])
    return {
        "error of sigma": float((spread(norm.square()) - exact).abs().max()),
        "width": float(width.median()),
        "gap": gap,
        "provable": float(gap > 2 * width.max()),
    }


def candidates_left(covariance: Tensor, rows: Tensor, returns: Tensor, size: int) -> int:
    """How many candidates may be elites by the variance given the ``size`` points that matter most to the plan."""
    points = rows.square().sum(0).topk(size).indices
    few = InverseFactor(covariance[points][:, points].unsqueeze(0))
    everything = InverseFactor(covariance.unsqueeze(0))
    low, high = (
        spread(factor.squared_norm(part.unsqueeze(0))[0])
        for factor, part in ((everything, rows), (few, rows[:, points]))
    )
    bound = returns + returns_between(low, high, returns.shape[0])
    return int((bound >= returns.topk(ELITES).values[-1] - 1e-9).sum())  # rounding excludes none


def near_points(inverse: Tensor, rows: Tensor, noise: float) -> Tensor:
    """The points that cannot be dropped."""
    largest = rows.amax(0)
    order = largest.argsort()
    dropped = int((largest[order].square().cumsum(0).sqrt() < FAR * noise**0.5).sum())
    return order[dropped:].sort().values


def plans(gp: DynamicsGP) -> list[list[tuple[Tensor, Tensor]]]:
    """:func:`plan_rows` from states of the data, where plans of the loop begin."""
    states = gp.inputs[:: max(1, gp.num_points // STARTS), : gp.num_outputs]
    return [plan_rows(gp, TensorDict({"state": state}, batch_size=[])) for state in states[:STARTS]]


def measure(gp: DynamicsGP, repeats: int) -> dict[str, float]:
    """All figures for one set of data; times for the plan that has the fewest near points."""
    posterior = gp.posterior
    factor, noise = posterior.factor, float(posterior.noise)
    inverse = factor.inverse[0].clone()
    lower = torch.linalg.inv(inverse)
    covariance, found = lower @ lower.mT, plans(gp)
    kept = [len(near_points(inverse, plan[0][0], noise)) for plan in found]
    rows = found[kept.index(min(kept))][0][0]
    eigenvalues = torch.linalg.eigvalsh(covariance) - noise
    ratio = eigenvalues / (eigenvalues + noise)
    near = near_points(inverse, rows, noise)
    edges = InverseFactor.edges(len(near))

    def near_factor() -> Tensor:
        part = inverse[:, near]
        return torch.linalg.cholesky(part.mT @ part, upper=True)

    upper = near_factor()

    def near_product() -> Tensor:
        part = rows.index_select(1, near)
        white = torch.empty_like(part)
        for a, b in pairwise(edges):
            torch.mm(part[:, a:], upper[a:b, a:].mT, out=white[:, a:b])
        return white.square().sum(-1)

    rows32, inverse32 = rows.float(), inverse.float()
    times = race(
        {
            "dense": lambda: (rows @ inverse.mT).norm(dim=-1).square(),
            "triangular, in the package": lambda: factor.squared_norm(rows.unsqueeze(0)),
            "triangular solve": lambda: torch.linalg.solve_triangular(lower, rows.mT, upper=False).norm(dim=0),
            "float32, dense": lambda: (rows32 @ inverse32.mT).norm(dim=-1).square(),
            "near points, triangular": near_product,
            "find near points": lambda: near_points(inverse, rows, noise),
            "factor of near points (once a plan)": near_factor,
            "eigenvectors (once an update)": lambda: torch.linalg.eigh(covariance),
            "factor, in the package (once an update)": lambda: InverseFactor(covariance.unsqueeze(0)),
        },
        repeats,
    )
    iterations = [part for plan in found for part in plan]
    single = [single_precision(inverse, *part) for part in iterations]
    middle = {key: float(torch.tensor([row[key] for row in single]).median()) for key in ("width", "gap")}
    return {
        **{f"ms: {name}": 1e3 * value for name, value in times.items()},
        "float32: largest error of sigma": max(row["error of sigma"] for row in single),
        "float32: median width of a return's rigorous interval": middle["width"],
        "float32: median gap between last elite and next": middle["gap"],
        "float32: share of iterations whose elites provably stay": sum(row["provable"] for row in single) / len(single),
        f"low rank: directions kept for {RANK_TOLERANCE:g}": int((ratio > RANK_TOLERANCE).sum()),
        f"near points: kept for {FAR:g}, fewest": min(kept),
        f"near points: kept for {FAR:g}, mean": sum(kept) / len(kept),
        "near points: error of the squared norm": float(
            (near_product() - factor.squared_norm(rows[None])[0]).abs().max()
        ),
        **{
            f"few points first: candidates left after {size}, mean": sum(
                candidates_left(covariance, *part, size) for part in iterations
            )
            / len(iterations)
            for size in SUBSETS
            if size < len(covariance)
        },
    }


def main() -> None:
    """Measure, print, write."""
    options = arguments(__doc__.splitlines()[0])
    generator = torch.Generator().manual_seed(0)
    episodes, repeats = (6, 3) if options.quick else (30, 50)
    visited, uniform = loop_data(episodes, generator), pendulum_gp()
    uniform.update(*uniform_transitions(10 * episodes, generator))
    results = {"data of the loop": measure(visited, repeats), "uniform data": measure(uniform, repeats)}
    rows = [[name, *(result[name] for result in results.values())] for name in results["uniform data"]]
    header = [f"{10 * episodes} points, product of one iteration", *results]
    write("fewer", options, {"results": results}, {"fewer products": table(header, rows)})


if __name__ == "__main__":
    main()

"""Time of one plan at the paper's sizes, against its matrix products, TorchRL's CEMPlanner and gpytorch's prediction.

All planners try 10 iterations x 50 candidates over a horizon of 10 in the same GP environment, float64. The *products
that a plan needs* are, in each iteration, 10 x [(50, D) x (D, n) and (50, n) x (n, d)] for the kernel and the mean
along the roll-out, and one (500, n) x (n, n) for all variances, as a bare loop of ``torch.mm`` into memory that is
there already. This dense, batched count is the denominator of the bar; the step-by-step count, 10 x (50, n) x (n, n),
which is slower, and the triangular one, which is what the package computes, are given beside it.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import torch
from harness import arguments, race, table, write
from task import CANDIDATES, ELITES, HORIZON, ITERATIONS, environments, icem, pendulum_gp, start, uniform_transitions
from tensordict import TensorDict
from torch.profiler import ProfilerActivity, profile
from torchrl.modules import CEMPlanner

from torch_activegp.envs import GPEnv
from torch_activegp.models.inverse_factor import InverseFactor
from torch_activegp.planners.rewards import rollout_rewards

BARS = {"products": 1.6, "CEMPlanner": 8.0, "gpytorch": 10.0}
PRODUCTS = ("aten::mm", "aten::addmm", "aten::bmm")


class RunProducts:
    """The matrix products of one plan as a bare loop.

    Args:
        inverse: L^-1, ``(n, n)``.
        sizes: D and d.
        variance: ``"batched"``, ``"stepwise"`` or ``"triangular"`` (batched, and without the zero half).
    """

    def __init__(self, inverse: torch.Tensor, sizes: tuple[int, int], variance: str) -> None:
        n, (inputs, outputs), options = inverse.shape[0], sizes, {"dtype": inverse.dtype}
        self.points, self.centers = torch.rand(CANDIDATES, inputs, **options), torch.rand(inputs, n, **options)
        self.weights, self.kernel = torch.rand(n, outputs, **options), torch.empty(CANDIDATES, n, **options)
        self.mean = torch.empty(CANDIDATES, outputs, **options)
        self.cross = torch.rand(HORIZON * CANDIDATES, n, **options)
        self.white = torch.empty_like(self.cross)
        rows = {"batched": [slice(None)], "triangular": [slice(None)]}.get(
            variance, [slice(t * CANDIDATES, (t + 1) * CANDIDATES) for t in range(HORIZON)]
        )
        edges = InverseFactor.edges(n) if variance == "triangular" else [0, n]
        blocks = list(pairwise(edges))
        columns = [b if variance == "triangular" else n for _, b in blocks]
        self.variance = [
            (self.cross[row, :stop], inverse[a:b, :stop].mT, self.white[row, a:b])
            for row in rows
            for (a, b), stop in zip(blocks, columns, strict=True)
        ]

    def __call__(self) -> None:
        """Compute the products of all iterations."""
        for _ in range(ITERATIONS):
            for _ in range(HORIZON):
                torch.mm(self.points, self.centers, out=self.kernel)
                torch.mm(self.kernel, self.weights, out=self.mean)
            for left, right, out in self.variance:
                torch.mm(left, right, out=out)


def differences(environments: dict[str, GPEnv], td: TensorDict, generator: torch.Generator) -> dict[str, float]:
    """Largest difference in the return of the same candidates between ours, ``env.rollout`` and gpytorch."""
    ours = environments["ours"]
    actions = ours.world_model.action_space.sample((CANDIDATES, HORIZON), generator)
    returns = ours.imagine(td, actions).sum(-1)
    others = {name: env.imagine(td, actions).sum(-1) for name, env in environments.items() if name != "ours"}
    reset = TensorDict({}, batch_size=[]).update(ours.reset()).update(td)
    others["CEMPlanner"] = rollout_rewards(ours, reset, actions, ("next", "reward")).sum(-1)
    return {name: float((values - returns).abs().max()) for name, values in others.items()}


def product_share(run: Callable[[], object], repeats: int) -> dict[str, float]:
    """Shares of the time in tensor operations by torch's profiler; Python between them is not in it."""
    with profile(activities=[ProfilerActivity.CPU]) as record:
        for _ in range(repeats):
            run()
    times = {event.key: event.self_cpu_time_total for event in record.key_averages()}
    total = sum(times.values())
    products = sum(times.get(name, 0.0) for name in PRODUCTS)
    exp = times.get("aten::exp_", 0.0) + times.get("aten::exp", 0.0)
    return {"products": products / total, "exp": exp / total, "other": 1 - (products + exp) / total}


def measure(n: int, repeats: int) -> dict[str, object]:
    """Race all planners over a GP with ``n`` points."""
    generator = torch.Generator().manual_seed(0)
    gp = pendulum_gp()
    gp.update(*uniform_transitions(n, generator))
    td, envs = start(generator), environments(gp)
    inverse = gp.posterior.factor.inverse[0].clone()
    planners = {name: icem(env) for name, env in envs.items()}
    cem = CEMPlanner(envs["ours"], HORIZON, ITERATIONS, CANDIDATES, ELITES)
    reset = envs["ours"].reset().update(td)

    def plan(name: str) -> None:
        planners[name].reset()
        planners[name](td.clone())

    products = {kind: RunProducts(inverse, (3, 2), kind) for kind in ("batched", "stepwise", "triangular")}
    quick = {"ours": lambda: plan("ours"), **{f"products, {kind}": run for kind, run in products.items()}}
    slow = {name: lambda name=name: plan(name) for name in planners if name != "ours"}
    slow["CEMPlanner"] = lambda: cem(reset.clone())
    times = race({**quick, **slow}, max(3, repeats // 5), warm_up=1)
    times |= race(quick, repeats)  # the cheap ones again, in finer turns
    return {
        "n": n,
        "seconds": times,
        "difference": differences(envs, td, generator),
        "shares": product_share(quick["ours"], max(2, repeats // 5)),
    }


def ratios(result: dict) -> dict[str, float]:
    """The figures of the bars."""
    times = result["seconds"]
    return {
        "products": times["ours"] / times["products, batched"],
        "CEMPlanner": times["CEMPlanner"] / times["ours"],
        "gpytorch": min(times["gpytorch"], times["gpytorch, fast_pred_var"]) / times["ours"],
    }


def tables(results: list[dict]) -> dict[str, str]:
    """One table of times, one of ratios, one of shares."""
    names = list(results[0]["seconds"])
    milliseconds = [[name, *(1e3 * result["seconds"][name] for result in results)] for name in names]
    labels = {
        "products": f"ours / products, batched (bar at 300: at most {BARS['products']})",
        "CEMPlanner": f"CEMPlanner / ours (bar at 300: at least {BARS['CEMPlanner']:g})",
        "gpytorch": f"faster gpytorch / ours (bar at 300: at least {BARS['gpytorch']:g})",
    }
    ratio_rows = [[label, *(ratios(result)[key] for result in results)] for key, label in labels.items()]
    difference_rows = [
        [f"difference of returns, {name}", *(result["difference"][name] for result in results)]
        for name in results[0]["difference"]
    ]
    floor = [
        ["triangular products, timed alone / plan"]
        + [result["seconds"]["products, triangular"] / result["seconds"]["ours"] for result in results]
    ]
    share_rows = [
        [f"profiler, of all tensor operations: {name}", *(result["shares"][name] for result in results)]
        for name in results[0]["shares"]
    ]
    header = [f"n = {result['n']}" for result in results]
    return {
        "plan times": table(["ms for one plan", *header], milliseconds),
        "plan ratios": table(["ratio", *header], ratio_rows + difference_rows),
        "plan shares": table(["share of one plan", *header], floor + share_rows),
    }


def main() -> None:
    """Measure, print, write."""
    options = arguments(__doc__.splitlines()[0])
    sizes = (10, 100) if options.quick else (10, 100, 300, 1000)
    results = [measure(n, 3 if options.quick else 25) for n in sizes]
    write("plan", options, {"results": [{**result, "ratios": ratios(result)} for result in results]}, tables(results))
    worst = max(value for result in results for value in result["difference"].values())
    if worst > 1e-8:
        raise SystemExit(f"Wanted equal returns to 1e-8, found a difference of {worst:.2g}.")


if __name__ == "__main__":
    main()

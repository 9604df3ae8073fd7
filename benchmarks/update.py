"""Time of one more point and a prediction at 50 others: 18 outputs, 6 actions, 300 points, against gpytorch.

gpytorch's model is the usual batch of independent GPs, refitted by ``set_train_data`` or extended by
``get_fantasy_model`` (which cannot change the noise). Ours appends while the noise is held, and recomputes its one
factor for all outputs when the noise follows 1/n^2.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass

import gpytorch
import torch
from harness import arguments, race_prepared, table, write
from task import Prediction
from torch import Tensor

from torch_activegp.means import EpisodicMean, SimulatorMean
from torch_activegp.models import DynamicsGP, FixedNoise, InverseSquareNoise
from torch_activegp.simulators import FunctionSimulator

STATES, ACTIONS, QUERIES = 18, 6, 50
BAR = 100.0


@dataclass(frozen=True)
class Transitions:
    """Inputs ``(n, 24)`` and next states ``(n, 18)``."""

    z: Tensor
    targets: Tensor

    @property
    def parts(self) -> tuple[Tensor, Tensor, Tensor]:
        """States, actions and next states."""
        return self.z[:, :STATES], self.z[:, STATES:], self.targets

    def __getitem__(self, rows: slice) -> Transitions:
        """Some of the transitions."""
        return Transitions(self.z[rows], self.targets[rows])


class BatchGP(gpytorch.models.ExactGP):
    """A batch of independent GPs over the residual, as in gpytorch's documentation."""

    def __init__(self, data: Transitions, noise: float) -> None:
        shape = torch.Size([STATES])
        constraint = gpytorch.constraints.GreaterThan(1e-12)
        likelihood = gpytorch.likelihoods.GaussianLikelihood(batch_shape=shape, noise_constraint=constraint)
        super().__init__(*self.batched(data), likelihood)
        self.mean_module = gpytorch.means.ZeroMean(batch_shape=shape)
        self.covar_module = gpytorch.kernels.RBFKernel(batch_shape=shape)
        self.to(torch.float64).eval()
        self.covar_module.lengthscale = 3.0
        likelihood.noise = noise

    @staticmethod
    def batched(data: Transitions) -> tuple[Tensor, Tensor]:
        """Inputs ``(18, n, 24)`` and residuals ``(18, n)``."""
        return data.z.expand(STATES, -1, -1), (data.targets - data.z[:, :STATES]).mT.contiguous()

    def forward(self, x: Tensor) -> gpytorch.distributions.MultivariateNormal:
        """The prior."""
        return gpytorch.distributions.MultivariateNormal(self.mean_module(x), self.covar_module(x))


def ours(data: Transitions, held: bool) -> DynamicsGP:
    """Our GP whose mean is that the state stays."""
    stay = FunctionSimulator(lambda state, action: state, STATES, ACTIONS, dt=0.05)
    noise = FixedNoise(1.0 / data.z.shape[0] ** 2) if held else InverseSquareNoise()
    gp = DynamicsGP(EpisodicMean(SimulatorMean(stay)), gpytorch.kernels.RBFKernel(), noise=noise)
    gp.covar_module.lengthscale = 3.0
    gp.update(*data.parts)
    return gp


def ready(gp: DynamicsGP) -> DynamicsGP:
    """A copy of the GP that has its factor: copies do not take it along."""
    gp = copy.deepcopy(gp)
    _ = gp.posterior
    return gp


def predict(gp: DynamicsGP, z: Tensor) -> tuple[Tensor, Tensor]:
    """Mean and variance at ``z``."""
    posterior = gp.posterior
    features = posterior.features(z)
    return posterior.loc(features), posterior.variance(features)


Runner = tuple[Callable[[], object], Callable[[object], tuple[Tensor, Tensor]]]


def runners(data: Transitions, z: Tensor) -> dict[str, Runner]:
    """For each way: what makes the model at n points, and what adds the last point and predicts."""
    old, new, n = data[:-1], data[-1:], data.z.shape[0] - 1

    def add(gp: DynamicsGP) -> tuple[Tensor, Tensor]:
        gp.update(*new.parts)
        return predict(gp, z)

    def gpytorch_ways(fast: bool, held: bool) -> dict[str, Runner]:
        rule = Prediction(fast)
        name = "gpytorch, fast_pred_var" if fast else "gpytorch"
        after = (n if held else n + 1) ** -2

        def finish(model: BatchGP) -> tuple[Tensor, Tensor]:
            mean, variance = rule(model, z)
            return mean + z[:, :STATES], variance

        def refit(model: BatchGP) -> tuple[Tensor, Tensor]:
            model.set_train_data(*BatchGP.batched(data), strict=False)
            model.likelihood.noise = after
            return finish(model)

        def fantasy(model: BatchGP) -> tuple[Tensor, Tensor]:
            inputs, residual = BatchGP.batched(new)
            with torch.no_grad(), gpytorch.settings.max_cholesky_size(10_000):
                extended = model.get_fantasy_model(inputs, residual)
            return finish(extended)

        def prepared() -> BatchGP:
            model = BatchGP(old, n**-2)
            rule(model, z)
            return model

        noise = "held noise" if held else "1/n^2"
        ways: dict[str, Runner] = {f"{name}: refit, {noise}": (prepared, refit)}
        return ways | ({f"{name}: fantasy, {noise}": (prepared, fantasy)} if held else {})

    kept = {True: ours(old, held=True), False: ours(old, held=False)}
    made: dict[str, Runner] = {
        "ours: append, held noise": (lambda: ready(kept[True]), add),
        "ours: refactor, 1/n^2": (lambda: ready(kept[False]), add),
    }
    for fast in (False, True):
        made |= gpytorch_ways(fast, held=True) | gpytorch_ways(fast, held=False)
    return made


def differences(ways: dict[str, Runner]) -> dict[str, float]:
    """Largest difference of mean or variance from ours at the same noise."""
    answers = {name: run(prepare()) for name, (prepare, run) in ways.items()}
    found = {}
    for name, answer in answers.items():
        reference = answers["ours: append, held noise" if name.endswith("held noise") else "ours: refactor, 1/n^2"]
        found[name] = max(float((a - b).abs().max()) for a, b in zip(answer, reference, strict=True))
    return found


def main() -> None:
    """Measure, print, write."""
    options = arguments(__doc__.splitlines()[0])
    n = 50 if options.quick else 300
    generator = torch.Generator().manual_seed(0)
    z = torch.randn(n + 1, STATES + ACTIONS, generator=generator, dtype=torch.float64)
    data = Transitions(z, z[:, :STATES] + torch.sin(z[:, :STATES] + z[:, -ACTIONS:].sum(-1, keepdim=True)) / 10)
    ways = runners(data, torch.randn(QUERIES, STATES + ACTIONS, generator=generator, dtype=torch.float64))
    apart, times = differences(ways), race_prepared(ways, 3 if options.quick else 25)
    rows = []
    for name, seconds in times.items():
        own = times["ours: append, held noise" if name.endswith("held noise") else "ours: refactor, 1/n^2"]
        rows.append([name, 1e3 * seconds, "" if name.startswith("ours") else seconds / own, apart[name]])
    header = [f"update and predict {QUERIES}, n = {n}, {STATES} outputs", "ms", "times ours", "difference"]
    bar = f"(bar at 300: at least {BAR:g} times ours for each refit)"
    refits = {name: values for name, *values in rows if "refit" in name}
    results = {"n": n, "seconds": times, "difference": apart, "times_ours": {k: v[1] for k, v in refits.items()}}
    write("update", options, results, {"update": table(header, rows) + f"\n\n{bar}"})
    worst = max(apart.values())
    if worst > 1e-8:
        raise SystemExit(f"Wanted equal means and variances to 1e-8, found a difference of {worst:.2g}.")


if __name__ == "__main__":
    main()

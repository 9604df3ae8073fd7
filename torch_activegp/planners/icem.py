"""The improved cross-entropy method as a TorchRL planner."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from tensordict import NestedKey, TensorDictBase, unravel_key
from torch import Tensor
from torchrl.data import TensorSpec
from torchrl.envs import EnvBase
from torchrl.modules.planners.common import MPCPlannerBase

from torch_activegp.errors import ConfigurationError, PlanningError
from torch_activegp.planners.colored_noise import ColoredNoise
from torch_activegp.planners.elite_fit import EliteFit
from torch_activegp.planners.rewards import can_imagine, imagined_rewards, rollout_rewards
from torch_activegp.planners.sampling import Sampling
from torch_activegp.planners.warm_start import WarmStart


class ICEMPlanner(MPCPlannerBase):
    """Model predictive control with iCEM: plan a sequence of actions, play the first, plan again from there.

    Each iteration draws candidates from a Gaussian with coloured noise along time, clipped to the bounds, and moves
    mean and std towards the elites. The best ``num_kept`` elites compete again in the next iteration with the return
    that they were given (the model is taken to be deterministic); at the next environment step they join the first
    iteration, shifted by one step with a freshly drawn last action. The mean is shifted too, and the std starts anew.
    The number of candidates decays, and in the last iteration the mean is a candidate of its own.

    Returns that are not finite are never elites: a candidate that diverges, or leaves a safe set with reward -inf,
    loses alone. If fewer than ``top_k`` candidates have a finite return, only those count.

    The starting states may have any batch shape ``*B``; every row plans on its own. The memory of a row is dropped
    where ``is_init`` (TorchRL's ``InitTracker``) is True, at the root or beside an observation; that of all rows with
    ``reset()``, or when the batch shape changes.

    An environment with a method ``imagine(tensordict, actions) -> rewards`` (starting states ``*B``; actions
    ``(*B, C, H, m)``; rewards ``(*B, C, H)``) is asked directly; any other goes through ``env.rollout``.

    The planner uses the environment and does not own it: its ``parameters()`` and ``state_dict()`` hold nothing of the
    model, and ``.to(device)`` moves the planner alone. The ``state_dict`` holds the memory and the generator, so a
    restored planner continues with the same actions, bit for bit.

    Args:
        env: model to plan in, with free batch size and one vector of bounded actions.
        planning_horizon: number of actions of a plan, H.
        optim_steps: number of iterations.
        num_candidates: candidates drawn in the first iteration.
        top_k: number of elites.
        num_kept: how many elites are kept within and across environment steps.
        sampling: noise, decay, momentum, initial std, bounds, and which action is played.
        generator: source of all draws; a CPU generator with seed 0 when None.

    Raises:
        ConfigurationError: the environment's batch size is locked, its action is not one bounded vector, or a number
            is out of range.

    Reference:
        Pinneri et al. 2020, *Sample-efficient Cross-Entropy Method for Real-time Planning*, Algorithm 1,
        arXiv 2008.06389.

    Example:
        >>> from torchrl.envs import PendulumEnv
        >>> env = PendulumEnv()
        >>> planner = ICEMPlanner(env, planning_horizon=5, optim_steps=2, num_candidates=20, top_k=4, num_kept=2)
        >>> env.rollout(3, planner)["action"].shape
        torch.Size([3, 1])
    """

    action_spec: TensorSpec
    low: Tensor
    high: Tensor

    def __init__(
        self,
        env: EnvBase,
        *,
        planning_horizon: int = 10,
        optim_steps: int = 10,
        num_candidates: int = 50,
        top_k: int = 10,
        num_kept: int = 5,
        sampling: Sampling | None = None,
        generator: torch.Generator | None = None,
    ) -> None:
        _check_sizes(planning_horizon, optim_steps, num_candidates, top_k, num_kept)
        if env.batch_locked:
            raise ConfigurationError(
                f"ICEMPlanner needs an env that accepts any batch size; {type(env).__name__} is batch-locked. "
                "Plan in a model of it (a ModelBasedEnvBase) instead."
            )
        if len(env.action_keys) != 1:
            raise ConfigurationError(
                f"ICEMPlanner plans one action; {type(env).__name__} has the keys {list(env.action_keys)}."
            )
        if len(env.reward_keys) != 1:
            raise ConfigurationError(
                f"ICEMPlanner maximises one reward; {type(env).__name__} has the keys {list(env.reward_keys)}. "
                "Keep one of them with a transform."
            )
        sampling = Sampling() if sampling is None else sampling
        spec = env.full_action_spec[env.action_key]
        low, high = sampling.bounds(spec)
        super().__init__(env, action_key=env.action_key)
        del self._modules["module"], self._modules["env"]  # registered by the base classes: its parameters are not ours
        self.__dict__["env"] = env
        self.action_spec = spec
        self.planning_horizon = planning_horizon
        self.optim_steps = optim_steps
        self.num_candidates = num_candidates
        self.top_k = top_k
        self.num_kept = num_kept
        self.sampling = sampling
        self.population = sampling.population(num_candidates, top_k, optim_steps)
        self.register_buffer("low", low, persistent=False)
        self.register_buffer("high", high, persistent=False)
        self.noise = ColoredNoise(planning_horizon, sampling.noise_beta, generator, low.dtype).to(low.device)
        self.fit = EliteFit(top_k, sampling.momentum, low.dtype).to(low.device)
        self.memory = WarmStart(planning_horizon, low.shape[0])
        self._restart_keys = _beside(self.in_keys, "is_init")
        self.set_keys()

    def set_keys(self, *, action: NestedKey | None = None, reward: NestedKey | None = None) -> None:
        """Set the keys that differ from those of the environment.

        Args:
            action: where the planner writes its action; the environment's action key when None.
            reward: what the planner maximises, as it stands in a rollout; the environment's reward, such as
                ``("next", "reward")``, when None. Another key than that one is read through ``env.rollout``.
        """
        default = unravel_key(("next", self.env.reward_keys[0]))
        self.out_keys = [unravel_key(self.env.action_key if action is None else action)]
        self.reward_key = default if reward is None else unravel_key(reward)
        self._direct = can_imagine(self.env) and self.reward_key == default

    def reset(self) -> None:
        """Forget the last plan, as at the start of an episode; the generator goes on."""
        self.memory.forget()

    @property
    def module(self) -> EnvBase:
        """The environment, under the name that TorchRL gives to what a module wraps."""
        return self.env

    @property
    def device(self) -> torch.device:
        """Device on which candidates are drawn."""
        return self.low.device

    @torch.no_grad()
    def planning(self, tensordict: TensorDictBase) -> Tensor:
        """Plan from the states in a tensordict and return the action to play now.

        Args:
            tensordict: starting states, batch shape ``*B``, with the environment's keys.

        Returns:
            Actions, ``(*B, m)``, within the bounds.

        Raises:
            PlanningError: no candidate of a row has a finite return.
        """
        mean, std, shifted, draws = self._start(tensordict)
        low, high = self.low, self.high
        elites = draws[0][..., :0, :, :]
        scores = elites[..., 0, 0]
        for draw in draws:
            actions = torch.addcmul(mean, std, draw).clamp(low, high)
            if shifted is not None:
                actions, shifted = torch.cat([actions, shifted], dim=-3), None
            returns = self._returns(tensordict, actions)
            actions = torch.cat([actions, elites[..., : self.num_kept, :, :]], dim=-3)
            returns = torch.cat([returns, scores[..., : self.num_kept].to(returns.dtype)], dim=-1)
            elites, scores, mean, std = self.fit(actions, returns, mean, std)
        self._check_found(scores)
        mean = mean.squeeze(-3).clamp(low, high)
        self.memory.store(mean, elites[..., : self.num_kept, :, :])
        return elites[..., 0, 0, :] if self.sampling.return_best else mean[..., 0, :]

    def _start(self, tensordict: TensorDictBase) -> tuple[Tensor, Tensor, Tensor | None, Sequence[Tensor]]:
        """Return mean, std, the shifted elites if any are remembered, and the noise of each iteration."""
        batch = tensordict.batch_size
        restart = self._restarts(tensordict)
        warm = self.memory.fits(batch) and not (restart is not None and bool(restart.all()))
        sizes = [*self.population, self.num_kept if warm else 0]
        sizes[-2] += 1  # the mean is the last candidate of the last iteration: noise 0
        noise = self.noise((*batch, sum(sizes), self.low.shape[0])).transpose(-1, -2).contiguous()
        *draws, extra = noise.split(sizes, dim=-3)
        draws[-1][..., -1, :, :].zero_()
        mean = ((self.low + self.high) / 2).expand(1, self.planning_horizon, -1)
        std = ((self.high - self.low) * (self.sampling.init_std / 2)).expand_as(mean)
        if not warm:
            return mean, std, None, draws
        centre, mean = mean, self.memory.shifted_mean().unsqueeze(-3)
        if restart is not None:
            restart = restart[..., None, None, None]
            mean = torch.where(restart, centre, mean)
        fresh = torch.addcmul(mean, std, extra).clamp(self.low, self.high)
        shifted = self.memory.shifted_elites(fresh)
        return mean, std, shifted if restart is None else torch.where(restart, fresh, shifted), draws

    def _restarts(self, tensordict: TensorDictBase) -> Tensor | None:
        """Tell which rows start an episode, ``(*B,)``; None where nothing says so."""
        found = (tensordict.get(key, None) for key in self._restart_keys)
        rows = [flag.reshape(*tensordict.batch_size, -1).any(-1) for flag in found if flag is not None]
        return torch.stack(rows).any(0).to(self.device) if rows else None

    def _returns(self, tensordict: TensorDictBase, actions: Tensor) -> Tensor:
        """Return the sum of rewards of each candidate, ``(*B, C)``, with -inf for all that is not finite."""
        if self._direct:
            rewards = imagined_rewards(self.env, tensordict, actions)
        else:
            rewards = rollout_rewards(self.env, tensordict, actions, self.reward_key)
        return rewards.sum(-1).nan_to_num(nan=-torch.inf, posinf=-torch.inf, neginf=-torch.inf)

    def _check_found(self, scores: Tensor) -> None:
        lost = scores[..., 0] == -torch.inf
        if bool(lost.any()):
            rows = "" if lost.ndim == 0 else f" in rows {lost.nonzero().squeeze(-1)[:10].tolist()}"
            raise PlanningError(
                f"No candidate has a finite return{rows}: {sum(self.population)} candidates over a horizon of "
                f"{self.planning_horizon} were tried. Either the safe set excludes every one of them, or the simulator "
                "or the reward returned NaN or infinity from this state. Check both at this state; then widen the safe "
                "set, shorten the horizon or raise `num_candidates`."
            )

    def _apply(self, fn: Callable[[Tensor], Tensor], recurse: bool = True) -> ICEMPlanner:
        super()._apply(fn, recurse)
        device = fn(torch.empty(0, device=self.action_spec.device)).device
        self.action_spec = self.action_spec.to(device)
        return self


def _beside(keys: Sequence[NestedKey], name: str) -> list[NestedKey]:
    """Return the root key ``name`` and those that lie in the same groups as ``keys``."""
    groups = {key[:-1] for key in keys if isinstance(key, tuple)}
    return [name, *((*group, name) for group in sorted(groups))]


def _check_sizes(planning_horizon: int, optim_steps: int, num_candidates: int, top_k: int, num_kept: int) -> None:
    for name, value in (("planning_horizon", planning_horizon), ("optim_steps", optim_steps), ("top_k", top_k)):
        if value < 1:
            raise ConfigurationError(f"ICEMPlanner: `{name}` must be at least 1, found {value}.")
    if top_k > num_candidates:
        raise ConfigurationError(
            f"ICEMPlanner: `top_k` must not exceed `num_candidates`, found {top_k} > {num_candidates}."
        )
    if not 0 <= num_kept <= top_k:
        raise ConfigurationError(f"ICEMPlanner: `num_kept` must lie in [0, top_k = {top_k}], found {num_kept}.")
